"""Subject `hostile-clients`: floods of service calls by another program on the network."""

import json
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory

from ellipseg_ros.errors import EllipsegError
from ellipseg_ros.records import SECOND, Sweep
from ellipseg_ros.simulation.simulator import simulate
from studies.endurance.idle_report import idle_report
from studies.endurance.programs import python, started, stderr_text
from studies.endurance.requirements import Options, Requirement
from studies.endurance.ros.service_flood import CONCURRENT_CALLS, STARTED
from studies.endurance.running import SendTimes, connected_replayer, running

PROGRAM = (
    "import sys; from studies.endurance.ros.service_flood import main; "
    "sys.exit(main(sys.argv[1:]))"
)
NO_FLOOD = "none"
FLOODS = {
    NO_FLOOD: [],
    "~/tune": ["tune"],
    "~/reset": ["reset"],
    "parameters": ["get_parameters", "set_parameters"],
}
ANSWER_TIMEOUT_S = 30.0
MAX_REPORTS = 20  # /diagnostics, one a second, until the node must be idle
MIN_POINTS = 0.7  # ratio to the points without a flood
MAX_LATENCY = 3.0  # ratio to the latency without a flood
ALLOWED_LATENCY_S = 1.0  # in any case: `update_period`


@dataclass(frozen=True)
class Calls:
    """Number of calls of one service."""

    sent: int
    answered: int
    granted: int


@dataclass
class Flood:
    """Duration and calls of a flood."""

    seconds: float = 0.0
    calls: dict[str, Calls] = field(default_factory=dict)  # by service


@dataclass(frozen=True)
class Drive:
    """Results of a drive, with a flood or without."""

    updates: int
    expected: int
    lost: int  # clouds
    latency: float  # s, median: from the newest cloud of an update sent to its segments received
    points: list[int]  # segmented in the window, at every cloud and at the end
    flood: Flood = field(default_factory=Flood)

    @property
    def usual_points(self) -> float:
        """Median over the second half of the drive."""
        return median(self.points[len(self.points) // 2 :])


def hostile_clients(options: Options) -> list[Requirement]:
    """Replay a drive with each kind of flood, one after the other."""
    seconds = 8.0 if options.quick else 60.0
    drives = {}
    for name, services in FLOODS.items():
        options.log(f"hostile-clients: a drive, calls: {name}")
        drives[name] = replay_flooded(services, seconds, options.seed)
    test = (
        f"{seconds:g} s in real time for each, {CONCURRENT_CALLS} concurrent calls of a service "
        "by another process"
    )
    quiet = drives.pop(NO_FLOOD)
    return [undisturbed(quiet, drives, test), answered(drives, test)]


def replay_flooded(services: list[str], seconds: float, seed: int) -> Drive:
    """Replay a simulated drive to a node while its services are called continuously."""
    scene = simulate("industrial", duration=seconds, seed=seed)
    points: list[int] = []
    sent = SendTimes()
    with running({}) as session, connected_replayer(session, scene) as replayer:
        subscriber = session.subscriber

        def note(sweep: Sweep) -> None:
            sent.note(sweep)
            points.append(int(subscriber.diagnostics.get("points segmented", "0")))

        with flooded(services, session.ros_args) as flood:
            replayer.run(note)
            report = idle_report(subscriber, MAX_REPORTS)
        updates = dict(subscriber.updates)
    latencies = [updates[stamp] - sent[stamp] for stamp in updates if stamp in sent]
    return Drive(
        updates=int(report["updates"]) + int(report["updates coalesced"]),
        expected=int(seconds) - 1,
        lost=int(report["clouds lost by DDS"]),
        latency=median(latencies) / SECOND,
        points=[*points, int(report["points segmented"])],
        flood=flood,
    )


@contextmanager
def flooded(services: list[str], ros_args: list[str]) -> Iterator[Flood]:
    """Call services during the block; the Flood is complete after it."""
    flood = Flood()
    if not services:
        yield flood
        return
    namespace = next(word.removeprefix("__ns:=") for word in ros_args if "__ns:=" in word)
    words = [*python(PROGRAM), f"{namespace}/ellipseg_segmenter", *services, *ros_args]
    with TemporaryDirectory() as place, started(words, Path(place), pipes=True) as process:
        assert process.stdout is not None  # a pipe
        if process.stdout.readline().decode() != f"{STARTED}\n":
            raise EllipsegError(f"the flood did not start: {stderr_text(Path(place))[-300:]}")
        started_at = time.monotonic()
        yield flood
        flood.seconds = time.monotonic() - started_at
        counts, _ = process.communicate(timeout=ANSWER_TIMEOUT_S)  # which closes its stdin
        flood.calls |= {name: Calls(*numbers) for name, numbers in json.loads(counts).items()}


def undisturbed(quiet: Drive, drives: dict[str, Drive], test: str) -> Requirement:
    """Whether drives with a flood have updates, points and latency like the quiet one."""
    texts = [
        f"{name}: {drive.latency:.2f} s, {drive.updates} updates, {drive.lost} clouds lost, "
        f"{drive.usual_points:,.0f} points"
        for name, drive in drives.items()
    ]
    max_latency = max(ALLOWED_LATENCY_S, MAX_LATENCY * quiet.latency)
    min_points = MIN_POINTS * quiet.usual_points
    return Requirement(
        "a flood of service calls does not keep the node from segmenting",
        f"{test}; an update for every second, no cloud lost, at least {MIN_POINTS:g} times the "
        f"points segmented in a window without calls ({quiet.usual_points:,.0f}; median over the "
        "second half), and a median latency, from a cloud sent to its segments received, of at "
        f"most {ALLOWED_LATENCY_S:g} s or {MAX_LATENCY:g} times that without calls "
        f"({quiet.latency:.2f} s)",
        "; ".join(texts),
        all(
            not drive.lost
            and drive.updates >= drive.expected
            and drive.usual_points >= min_points > 0.0
            for drive in drives.values()
        ),
        all(drive.latency <= max_latency for drive in drives.values()),
    )


def answered(drives: dict[str, Drive], test: str) -> Requirement:
    """Whether all calls are answered, and invalid parameters refused."""
    texts, holds = [], True
    for flood in (drive.flood for drive in drives.values()):
        for service, calls in sorted(flood.calls.items()):
            texts.append(
                f"{service}: {calls.answered / flood.seconds:,.0f} answers a second, "
                f"{calls.sent - calls.answered} missing, {calls.granted:,} granted"
            )
            holds &= calls.answered == calls.sent > CONCURRENT_CALLS
        holds &= bool(flood.calls)
    return Requirement(
        "every call is answered, if only by a refusal",
        f"{test}; parameters with a value out of range; one tuning at a time, and 30 % of the "
        "time at most after the first 20 s of work; 30 resets a minute",
        "; ".join(texts),
        holds and drives["parameters"].flood.calls["set_parameters"].granted == 0,
    )
