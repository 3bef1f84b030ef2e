"""Stamps as they come in the field: loops, jumps, gaps, a changed frame, a clock that stands."""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from ellipseg_ros.cli.verification import equal
from ellipseg_ros.config import Config
from ellipseg_ros.io.messages import write_segments
from ellipseg_ros.io.pointcloud2 import write_labelled
from ellipseg_ros.node.grouping import updates
from ellipseg_ros.node.stamps import StampMonitor
from ellipseg_ros.records import SECOND, Segmentation, Sweep
from ellipseg_ros.segmenter import Segmenter
from ellipseg_ros.simulation.simulator import simulate
from studies.endurance.lossless import PATIENCE, lossless
from studies.endurance.promises import Promise, Trial

CONFIG = Config(update_period=0.5, window_duration=1.5)
CLOUDS = 15  # of every part of a drive
STEP = 0.1  # s from cloud to cloud
YEAR = 365 * 86400.0  # s
PARTS = ("on", "on", "swapped", "equal", "gap", "loop", "wrong", "frame", "still")


@dataclass
class Notes:
    """What came of a drive."""

    messages: dict[str, list[bytes]] = field(default_factory=dict)  # by topic
    said: dict[str, str] = field(default_factory=dict)  # the last diagnostics
    log: str = ""

    def write(self, topic: str, time_ns: int, message: bytes) -> None:
        """Keep all of them."""
        self.messages.setdefault(topic, []).append(message)

    def write_points(self, sweep: Sweep) -> None:
        """Nothing: what was sent is known."""


def times(trial: Trial) -> list[Promise]:
    """Drives in which all happens that stamps do, with and without simulated time."""
    drives = [random_drive(trial.seed + k) for k in range(1 if trial.quick else 8)]
    wrong = compared = restarts = gaps = 0
    told: list[str] = []
    for number, drive in enumerate(drives):
        for simulated in (False, True):
            trial.say(f"times: drive {number + 1} of {len(drives)}, use_sim_time {simulated}")
            found = offline(drive)
            notes = _through_the_node(drive, len(found), simulated)
            compared += len(found)
            wrong += differences(notes, found)
            restarts += sum(bool(one.restart) for one in found)
            gaps += _gaps(drive)
            told += misreported(notes, found, _gaps(drive))
    parts = f"{len(PARTS)} parts each, in any order"
    return [
        Promise(
            "loops, jumps, gaps, swapped and equal stamps, changed frames, clocks that stand: "
            "every update is that of the same clouds offline",
            f"{len(drives)} drives of {parts}, with and without use_sim_time; segments and "
            "labelled points compared byte by byte",
            f"{compared - wrong} of {compared} updates the same",
            wrong == 0,
        ),
        Promise(
            "each is counted, and a new beginning is said once",
            "the same drives; restarts and gaps in /diagnostics, and lines in the log",
            f"{restarts} restarts, {gaps} gaps; "
            + (f"wrong: {'; '.join(sorted(set(told)))}" if told else "all told"),
            not told,
        ),
    ]


def random_drive(seed: int) -> list[Sweep]:
    """Clouds whose stamps do everything once, in an order of their own."""
    rng = np.random.default_rng(seed)
    sweeps = [s.keep(slice(None, None, 4)) for s in simulate("industrial", duration=CLOUDS * STEP)]
    drive: list[Sweep] = []
    now, frame = 0.0, "odom"
    for kind in ("on", *rng.permutation(PARTS).tolist()):
        frame = {"odom": "map", "map": "odom"}[frame] if kind == "frame" else frame
        now += {"gap": float(rng.uniform(2.0, 50.0)), "loop": -now}.get(kind, 0.0)
        part = list(_part(kind, sweeps, now))
        drive += [replace(sweep, frame_id=frame) for sweep in part]
        now += STEP * CLOUDS
    return drive


def _part(kind: str, sweeps: list[Sweep], start: float) -> Iterator[Sweep]:
    stamps = start + STEP * np.arange(CLOUDS)
    if kind == "swapped":
        stamps[3::4], stamps[4::4] = stamps[4::4].copy(), stamps[3:-1:4].copy()
    if kind == "still":
        stamps[:] = start
    for sweep, stamp in zip(sweeps, stamps.tolist(), strict=True):
        stamped = replace(sweep, stamp_ns=round(stamp * SECOND))
        if kind == "wrong" and sweep is sweeps[CLOUDS // 2]:
            yield replace(stamped, stamp_ns=stamped.stamp_ns + round(YEAR * SECOND))
        elif kind == "equal":
            yield from (stamped.keep(slice(k, None, 3)) for k in range(3))
        else:
            yield stamped


def offline(drive: list[Sweep]) -> list[Segmentation]:
    """All updates but the last one, which no stamp closes."""
    segmenter = Segmenter(CONFIG)
    return [segmenter.process(group) for group in updates(drive, CONFIG)][:-1]


def _gaps(drive: list[Sweep]) -> int:
    stamps = StampMonitor()
    for sweep in drive:
        stamps.check(sweep, CONFIG.window_duration, CONFIG.max_lateness)
    return stamps.gaps


def _through_the_node(drive: list[Sweep], count: int, simulated: bool) -> Notes:
    """As fast as the node can, nothing lost; nobody publishes /clock."""
    settings = {
        "update_period": CONFIG.update_period,
        "window_duration": CONFIG.window_duration,
        "use_sim_time": str(simulated).lower(),
    }
    notes = Notes()
    with lossless(drive, CONFIG, notes, settings) as through:
        through.replayer.run()
        through.recorder.wait_for_report("clouds received", len(drive), PATIENCE)
        notes.said = through.finish(count)
        notes.log = through.log.read_text("utf-8", "replace")
    return notes


def differences(notes: Notes, found: list[Segmentation]) -> int:
    """How many updates differ in a byte, or did not come."""
    came = [notes.messages.get(topic, []) for topic in ("/segments", "/segmented_points")]
    if {len(messages) for messages in came} != {len(found)}:
        return len(found)
    return sum(
        not (equal(segments, write_segments(one)) and equal(cloud, write_labelled(one)))
        for segments, cloud, one in zip(*came, found, strict=True)
    )


def misreported(notes: Notes, found: list[Segmentation], gaps: int) -> list[str]:
    """What /diagnostics or the log tell otherwise."""
    reasons = [one.restart for one in found if one.restart]
    expected = {"restarts": len(reasons), "stamp gaps": gaps, "clouds rejected": 0}
    wrong = [
        f"{key} {notes.said[key]}, not {count}"
        for key, count in expected.items()
        if notes.said[key] != str(count)
    ]
    lines = re.findall("restarts: (.*)", notes.log)
    return wrong if lines == reasons else [*wrong, f"{len(lines)} restarts in the log"]
