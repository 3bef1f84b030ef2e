"""Nodes, replayers and subscribers that are killed: how the others go on."""

import math
import random
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from itertools import groupby, pairwise
from pathlib import Path
from threading import Thread

from ellipseg_ros.cli.isolation import isolated_ros_args, parameter_args
from ellipseg_ros.cli.node_process import START_TIMEOUT_S, NodeProcess
from ellipseg_ros.node.playback import ReplayOptions
from ellipseg_ros.records import Sweep
from ellipseg_ros.ros.replayer import Replayer
from studies.endurance.endless_drive import Tape
from studies.endurance.fault_programs import node, started
from studies.endurance.listener_process import Listening
from studies.endurance.promises import Promise, Trial
from studies.endurance.ros.recording_subscriber import Heard, Witness

PERIOD = 0.5  # s, between two updates
SETTINGS = {"window_duration": 3.0, "update_period": PERIOD, "full_segments_period": 4.0}
LIFETIME = 10  # s of a marker


@dataclass
class Scene:
    """A recording that plays on and on, somebody who listens, and a place for a node."""

    ros_args: list[str]
    witness: Witness
    folder: Path
    sent: dict[int, float] = field(default_factory=dict)  # newest time of a cloud, ns: s, when

    def note(self, sweep: Sweep) -> None:
        """A cloud was sent."""
        self.sent[int(sweep.times_ns.max(initial=sweep.stamp_ns))] = time.monotonic()

    @contextmanager
    def node(self, *more: str) -> Iterator[NodeProcess]:
        """A segmenter, started; ended with the block."""
        args = [*self.ros_args, *parameter_args(SETTINGS), *more]
        with NodeProcess(args, self.folder / "node.log", lambda _: None) as process:
            process.start()
            yield process

    def wait_for_step(self, moment: float, updates: int = 1) -> float:
        """Time from `moment` until so many updates are understood, s."""
        come = self.witness.since
        self.witness.wait(
            lambda: sum(one.in_step for one in come(moment)) >= updates,
            START_TIMEOUT_S,
            "no update came",
        )
        return [one for one in come(moment) if one.in_step][updates - 1].time - moment

    def from_new(self, moment: float) -> list[Heard]:
        """What a node has said that was started at `moment`.

        What a dead one has said may come later, but of clouds that were sent before.
        """
        return [one for one in self.witness.since(moment) if self._is_new(one.stamp_ns, moment)]

    def drawn_by_new(self, moment: float) -> list[bool]:
        """Of each of its messages of markers, whether others stayed on show."""
        return [stale for ns, stale in self.witness.drawn if self._is_new(ns, moment)]

    def _is_new(self, stamp_ns: int, moment: float) -> bool:
        return self.sent.get(stamp_ns, -math.inf) > moment

    def wait_for_new(self, moment: float) -> float:
        """Time from the start of a node at `moment` until its first update is understood, s."""
        self.witness.wait(
            lambda: (
                any(one.in_step for one in self.from_new(moment))
                and bool(self.drawn_by_new(moment))
            ),
            START_TIMEOUT_S,
            "no update came",
        )
        return next(one for one in self.from_new(moment) if one.in_step).time - moment

    def numbers(self) -> list[int]:
        """Those of the updates heard; who is new is told the last one again, which counts once."""
        return [number for number, _ in groupby(one.sequence for one in self.witness.heard)]


def unbroken(numbers: list[int]) -> bool:
    """Whether each is one more than the one before."""
    return numbers == list(range(numbers[0], numbers[0] + len(numbers)))


@contextmanager
def scene(seed: int, plays: bool = True) -> Iterator[Scene]:
    """All but the node, which the trial starts and kills; plays: a recording."""
    with ExitStack() as stack:
        ros_args = stack.enter_context(isolated_ros_args("FATAL"))
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        here = Scene(ros_args, stack.enter_context(Witness(ros_args)), folder)
        if plays:
            tape = Tape(4.0, 10_000, seed=seed)
            replayer = stack.enter_context(Replayer(tape, ReplayOptions(clock=False), ros_args))
            player = Thread(target=replayer.run, args=[here.note], name="player", daemon=True)
            player.start()
            stack.callback(player.join)
            stack.callback(replayer.stop)
        yield here


# --- the node --------------------------------------------------------------------------------


@dataclass
class Restarts:
    """What came of nodes that followed on killed ones."""

    seconds: list[float] = field(default_factory=list)  # from the start to the first update
    unclear: list[str] = field(default_factory=list)  # first words of a node
    left: list[str] = field(default_factory=list)  # markers of a dead one

    def judge(self, here: Scene, begun: float) -> None:
        """Look at the first words of a new node."""
        first = here.from_new(begun)[0]
        if not (first.full and first.in_step):
            self.unclear.append(f"; the first message was {first}")
        if here.drawn_by_new(begun)[0]:
            self.left.append("; a dead marker stayed beside the new ones")


def killed_nodes(trial: Trial) -> list[Promise]:
    """Kill the node, start another; again and again."""
    rng = random.Random(trial.seed)
    kills = 1 if trial.quick else 10
    found = Restarts()
    with scene(trial.seed) as here:
        for number in range(kills + 1):
            trial.say(f"kills: the node, {number} of {kills}")
            begun = time.monotonic()
            with here.node() as process:
                # Every other one is killed while it starts, the first and the last never.
                if number % 2 == 0 or number == kills:
                    found.seconds.append(here.wait_for_new(begun))
                    if number:
                        found.judge(here, begun)
                    time.sleep(rng.uniform(0.0, 3.0 * PERIOD))
                else:
                    time.sleep(rng.uniform(0.0, found.seconds[0]))
                process.kill()
        lifetimes = here.witness.lifetimes
    seconds = sorted(found.seconds)
    judged = len(seconds) - 1  # the first has no dead one before it
    tried = f"kill -9 at {kills + 1} random moments, half of them during the start; restarted"
    return [
        Promise(
            "after a kill -9 of the node a new one is understood at once by who listens",
            tried,
            f"first message full and mirror in step in {judged - len(found.unclear)} of {judged} "
            f"runs; {seconds[len(seconds) // 2]:.1f} s from the start to the first update "
            f"(median; at most {seconds[-1]:.1f} s){''.join(found.unclear[:1])}",
            judged > 0 and not found.unclear,
        ),
        Promise(
            "markers of a dead node vanish",
            f"the same; all markers have a lifetime of {LIFETIME} s, a new node clears first",
            f"lifetimes {sorted(lifetimes)} s; no marker of a dead node beside those of a new one "
            f"in {judged - len(found.left)} of {judged} runs{''.join(found.left[:1])}",
            lifetimes == {LIFETIME} and judged > 0 and not found.left,
        ),
    ]


# --- the others ------------------------------------------------------------------------------


def killed_replayers(trial: Trial) -> Promise:
    """Kill what sends the clouds, and start it anew: the stamps jump back."""
    kills = 1 if trial.quick else 8
    rng = random.Random(trial.seed)
    seconds, again = [], []
    with scene(trial.seed, plays=False) as here, here.node() as process:
        source = ["-p", "source:=sim:industrial", "-p", "clock:=false"]
        for number in range(kills + 1):
            trial.say(f"kills: the replayer, {number} of {kills}")
            begun = time.monotonic()
            with started(node("replayer", *here.ros_args, *source), here.folder):
                seconds.append(here.wait_for_step(begun, 4))
                time.sleep(rng.uniform(0.0, 2.0 * PERIOD))
            again += [number for one in here.witness.since(begun)[1:] if not one.in_step]
        process.stop()
    numbers = here.numbers()
    back = sum(b.stamp_ns < a.stamp_ns for a, b in pairwise(here.witness.heard))
    whole = unbroken(numbers)
    return Promise(
        "the node outlives a killed source of clouds, and begins anew with the next",
        f"kill -9 of the replayer at {kills + 1} random moments; restarted, same recording",
        f"{len(numbers)} updates with{'out' if whole else ''} a break in their numbers, "
        f"{back} new beginnings, mirror out of step after {len(again)} messages; "
        f"{max(seconds):.1f} s at most from the restart to the fourth update",
        whole and back == kills and not again,
    )


def killed_subscribers(trial: Trial) -> Promise:
    """Kill a subscriber: the others hear on."""
    kills = 1 if trial.quick else 10
    longest = 0.0
    with scene(trial.seed) as here, here.node() as process:
        here.wait_for_step(time.monotonic(), 3)
        for number in range(kills):
            trial.say(f"kills: a subscriber, {number + 1} of {kills}")
            with Listening(here.ros_args) as listening:
                listening.wait_for_topics(START_TIMEOUT_S)
                begun = time.monotonic()
                here.wait_for_step(begun, 2)
                listening.kill()
                here.wait_for_step(time.monotonic(), 4)
            times = [one.time for one in here.witness.since(begun)]
            gaps = [late - early for early, late in zip(times, times[1:], strict=False)]
            longest = max(longest, *gaps)
        process.stop()
    numbers = here.numbers()
    return Promise(
        "the node doesn't mind a killed subscriber",
        f"kill -9 of {kills} subscribers to all topics, an update every {PERIOD:g} s",
        f"{'no' if unbroken(numbers) else 'an'} update missing of {len(numbers)}, "
        f"{longest:.2f} s at most between two",
        unbroken(numbers),
        longest < 4.0 * PERIOD,
    )
