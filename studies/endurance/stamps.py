"""Subject `stamps`: loops, jumps, gaps, changed frames and frozen clocks in drives."""

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
from ellipseg_ros.poses.placer import Event
from ellipseg_ros.records import SECOND, Segmentation, Sweep
from ellipseg_ros.segmenter import Segmenter
from ellipseg_ros.simulation.simulator import simulate
from studies.endurance.requirements import Options, Requirement
from studies.endurance.running import UPDATE_TIMEOUT_S, lossless

CONFIG = Config(update_period=0.5, window_duration=1.5)
CLOUDS = 15  # of every part of a drive
STEP = 0.1  # s between two clouds
YEAR = 365 * 86400.0  # s
PARTS = ("usual", "usual", "swapped", "equal", "gap", "loop", "outlier", "frame", "frozen")


@dataclass
class Record:
    """What a node published, reported and logged during a drive; a Sink."""

    messages: dict[str, list[bytes]] = field(default_factory=dict)  # by topic
    report: dict[str, str] = field(default_factory=dict)  # the last diagnostics
    log: str = ""

    def write(self, topic: str, time_ns: int, message: bytes) -> None:
        """Keep a message."""
        self.messages.setdefault(topic, []).append(message)

    def write_event(self, event: Event) -> None:
        """Ignore a sent cloud."""


def stamps(options: Options) -> list[Requirement]:
    """Replay drives with all kinds of stamps, with and without simulated time."""
    drives = [random_drive(options.seed + k) for k in range(1 if options.quick else 8)]
    different = compared = restarts = gaps = 0
    errors: list[str] = []
    for number, drive in enumerate(drives):
        expected, drive_gaps = offline(drive), _gaps(drive)
        for simulated in (False, True):
            options.log(f"stamps: drive {number + 1} of {len(drives)}, use_sim_time {simulated}")
            record = _replayed(drive, len(expected), simulated)
            compared += len(expected)
            different += differences(record, expected)
            restarts += sum(bool(update.restart) for update in expected)
            gaps += drive_gaps
            errors += misreported(record, expected, drive_gaps)
    return [
        Requirement(
            "with loops, jumps, gaps, swapped and equal stamps, changed frames and frozen clocks, "
            "every update equals that of the same clouds offline",
            f"{len(drives)} drives of {len(PARTS)} parts each in random order, with and without "
            "use_sim_time; segments and labelled points compared byte by byte",
            f"{compared - different} of {compared} updates equal",
            different == 0,
        ),
        Requirement(
            "each of them is counted, and every restart is logged once",
            "the same drives; restarts and gaps in /diagnostics, and lines of the log",
            f"{restarts} restarts, {gaps} gaps; "
            + (f"wrong: {'; '.join(sorted(set(errors)))}" if errors else "all reported"),
            not errors,
        ),
    ]


def random_drive(seed: int) -> list[Sweep]:
    """A drive of all PARTS in random order."""
    rng = np.random.default_rng(seed)
    sweeps = [s.keep(slice(None, None, 4)) for s in simulate("industrial", duration=CLOUDS * STEP)]
    drive: list[Sweep] = []
    start, frame = 0.0, "odom"
    for kind in ("usual", *rng.permutation(PARTS).tolist()):
        frame = {"odom": "map", "map": "odom"}[frame] if kind == "frame" else frame
        start += {"gap": float(rng.uniform(2.0, 50.0)), "loop": -start}.get(kind, 0.0)
        drive += [replace(sweep, frame_id=frame) for sweep in _part(kind, sweeps, start)]
        start += STEP * CLOUDS
    return drive


def _part(kind: str, sweeps: list[Sweep], start: float) -> Iterator[Sweep]:
    """The sweeps with stamps from `start`, s, on."""
    seconds = start + STEP * np.arange(CLOUDS)
    if kind == "swapped":
        seconds[3::4], seconds[4::4] = seconds[4::4].copy(), seconds[3:-1:4].copy()
    if kind == "frozen":
        seconds[:] = start
    for sweep, second in zip(sweeps, seconds.tolist(), strict=True):
        stamped = replace(sweep, stamp_ns=round(second * SECOND))
        if kind == "outlier" and sweep is sweeps[CLOUDS // 2]:
            yield replace(stamped, stamp_ns=stamped.stamp_ns + round(YEAR * SECOND))
        elif kind == "equal":
            yield from (stamped.keep(slice(k, None, 3)) for k in range(3))
        else:
            yield stamped


def offline(drive: list[Sweep]) -> list[Segmentation]:
    """All updates except the last, which no stamp completes."""
    segmenter = Segmenter(CONFIG)
    return [segmenter.process(group) for group in updates(drive, CONFIG)][:-1]


def _gaps(drive: list[Sweep]) -> int:
    """Number of gaps that the node must report."""
    tracked = StampMonitor()
    for sweep in drive:
        tracked.check(sweep, CONFIG.window_duration, CONFIG.max_lateness)
    return tracked.gaps


def _replayed(drive: list[Sweep], updates_count: int, simulated: bool) -> Record:
    """Replay a drive losslessly; simulated: use_sim_time, though nobody publishes /clock."""
    settings = {
        "update_period": CONFIG.update_period,
        "window_duration": CONFIG.window_duration,
        "use_sim_time": str(simulated).lower(),
    }
    record = Record()
    with lossless(drive, CONFIG, record, settings) as session:
        session.replayer.run()
        session.recorder.wait_for_report("clouds received", len(drive), UPDATE_TIMEOUT_S)
        record.report = session.finish(updates_count)
        record.log = session.log.read_text("utf-8", "replace")
    return record


def differences(record: Record, expected: list[Segmentation]) -> int:
    """Number of updates that differ in a byte; all of them if some are missing."""
    topics = [record.messages.get(topic, []) for topic in ("/segments", "/segmented_points")]
    if {len(messages) for messages in topics} != {len(expected)}:
        return len(expected)
    return sum(
        not (equal(segments, write_segments(update)) and equal(cloud, write_labelled(update)))
        for segments, cloud, update in zip(*topics, expected, strict=True)
    )


def misreported(record: Record, expected: list[Segmentation], gaps: int) -> list[str]:
    """What diagnostics or log report otherwise than expected."""
    reasons = [update.restart for update in expected if update.restart]
    counts = {"restarts": len(reasons), "stamp gaps": gaps, "clouds rejected": 0}
    errors = [
        f"{name} {record.report[name]}, not {count}"
        for name, count in counts.items()
        if record.report[name] != str(count)
    ]
    logged = re.findall("restarts: (.*)", record.log)
    return errors if logged == reasons else [*errors, f"{len(logged)} restarts in the log"]
