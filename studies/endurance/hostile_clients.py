"""What calls of a stranger on the network cost the node."""

import json
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory

from ellipseg_ros.cli.node_process import START_TIMEOUT_S
from ellipseg_ros.errors import EllipsegError
from ellipseg_ros.node.playback import ReplayOptions
from ellipseg_ros.records import SECOND, Sweep
from ellipseg_ros.ros.replayer import Replayer
from ellipseg_ros.simulation.simulator import simulate
from studies.endurance.fault_programs import said, started
from studies.endurance.last_word import last_word
from studies.endurance.promises import Promise, Trial
from studies.endurance.ros.service_flood import AT_ONCE, BEGUN
from studies.endurance.running import running

FLOOD = (
    "import sys; from studies.endurance.ros.service_flood import main; "
    "sys.exit(main(sys.argv[1:]))"
)
FLOODS = {
    "nobody": [],
    "~/tune": ["tune"],
    "~/reset": ["reset"],
    "parameters": ["get_parameters", "set_parameters"],
}
PATIENCE = 30.0  # s
REPORTS = 20  # /diagnostics, one a second, until the last update must have come
NEAR = 0.7  # times the points without a flood, at least
TIMES = 3.0  # the latency without a flood, at most
LEAST = 1.0  # s of latency that are fine in any case: `update_period`


@dataclass(frozen=True)
class Calls:
    """Of one service."""

    asked: int
    answered: int
    granted: int


@dataclass
class Flood:
    """Of all services that were called."""

    seconds: float = 0.0  # that they were
    calls: dict[str, Calls] = field(default_factory=dict)  # by service


@dataclass(frozen=True)
class Case:
    """One drive, with a flood or without."""

    updates: int
    expected: int
    lost: int  # clouds
    latency: float  # s, median: from the newest cloud of an update sent to its segments received
    points: list[int]  # segmented in the window, as known at every cloud, and at last
    flood: Flood = field(default_factory=Flood)

    @property
    def usual_points(self) -> float:
        """Median over the second half of the drive."""
        return median(self.points[len(self.points) // 2 :])


def strangers(trial: Trial) -> list[Promise]:
    """Drive with a flood of calls, one kind after the other."""
    seconds = 8.0 if trial.quick else 60.0
    cases = {}
    for name, services in FLOODS.items():
        trial.say(f"strangers: a drive, calls of {name}")
        cases[name] = drive(services, seconds, trial.seed)
    how = f"{seconds:g} s in real time for each, {AT_ONCE} calls of a service at once, by another "
    how += "process"
    quiet, floods = cases["nobody"], {name: cases[name] for name in FLOODS if FLOODS[name]}
    return [_goes_on(quiet, floods, how), _answers(floods, how)]


def drive(services: list[str], seconds: float, seed: int) -> Case:
    """Replay a simulated drive into a node of which the services are called all the time."""
    scene = simulate("industrial", duration=seconds, seed=seed)
    points: list[int] = []
    sent: dict[int, int] = {}  # newest time of a cloud, ns: when it was sent
    with running({}) as (listener, _, ros_args):
        with Replayer(scene, ReplayOptions(clock=False), ros_args) as replayer:
            listener.wait_for_topics(START_TIMEOUT_S)

            def note(sweep: Sweep) -> None:
                sent[int(sweep.times_ns.max(initial=sweep.stamp_ns))] = time.monotonic_ns()
                points.append(int(listener.diagnostics.get("points segmented", "0")))

            with flooded(services, ros_args) as flood:
                replayer.run(note)
                last = last_word(listener, REPORTS)
        came = dict(listener.updates)
        return Case(
            updates=int(last["updates"]) + int(last["updates coalesced"]),
            expected=int(seconds) - 1,
            lost=int(last["clouds lost by DDS"]),
            latency=median(came[stamp] - sent[stamp] for stamp in came if stamp in sent) / SECOND,
            points=[*points, int(last["points segmented"])],
            flood=flood,
        )


@contextmanager
def flooded(services: list[str], ros_args: list[str]) -> Iterator[Flood]:
    """Call services for the time of the block; after it, the record tells how often."""
    found = Flood()
    if not services:
        yield found
        return
    namespace = next(word.removeprefix("__ns:=") for word in ros_args if "__ns:=" in word)
    command = [sys.executable, "-c", FLOOD, f"{namespace}/ellipseg_segmenter", *services]
    with (
        TemporaryDirectory() as place,
        started([*command, *ros_args], Path(place), True) as process,
    ):
        assert process.stdout is not None  # a pipe
        if process.stdout.readline().decode() != f"{BEGUN}\n":
            raise EllipsegError(f"the flood of calls has not begun: {said(Path(place))[-300:]}")
        began = time.monotonic()
        yield found
        found.seconds = time.monotonic() - began
        told, _ = process.communicate(timeout=PATIENCE)  # which ends its stdin
        found.calls |= {name: Calls(*counts) for name, counts in json.loads(told).items()}


def _goes_on(quiet: Case, floods: dict[str, Case], how: str) -> Promise:
    texts = [
        f"{name}: {one.latency:.2f} s, {one.updates} updates, {one.lost} clouds lost, "
        f"{one.usual_points:,.0f} points"
        for name, one in floods.items()
    ]
    limit = max(LEAST, TIMES * quiet.latency)
    least = NEAR * quiet.usual_points
    return Promise(
        "a flood of calls does not keep the node from segmenting",
        f"{how}; there is an update for every second, no cloud is lost, the points segmented in a "
        f"window (median over the second half) are at least {NEAR:g} times those without calls "
        f"({quiet.usual_points:,.0f}), and the median latency, from a cloud sent to its segments "
        f"received, at most {LEAST:g} s, or {TIMES:g} times that without calls "
        f"({quiet.latency:.2f} s)",
        "; ".join(texts),
        all(
            not one.lost and one.updates >= one.expected and one.usual_points >= least > 0.0
            for one in floods.values()
        ),
        all(one.latency <= limit for one in floods.values()),
    )


def _answers(floods: dict[str, Case], how: str) -> Promise:
    texts, kept = [], True
    for flood in (one.flood for one in floods.values()):
        for service, calls in sorted(flood.calls.items()):
            texts.append(
                f"{service}: {calls.answered / flood.seconds:,.0f} answers a second, "
                f"{calls.asked - calls.answered} missing, {calls.granted:,} granted"
            )
            kept &= calls.answered == calls.asked > AT_ONCE
        kept &= bool(flood.calls)
    return Promise(
        "every call is answered, if only by a refusal",
        f"{how}; parameters with a value out of range; of tunings one at a time, and 30 % of the "
        "time at most after the first 20 s of work; of resets 30 a minute",
        "; ".join(texts),
        kept and floods["parameters"].flood.calls["set_parameters"].granted == 0,
    )
