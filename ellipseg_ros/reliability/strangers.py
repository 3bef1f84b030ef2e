"""What calls of a stranger on the network cost the node."""

import json
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from ellipseg_ros.cli.running import START, running
from ellipseg_ros.reliability.last_word import last_word
from ellipseg_ros.reliability.promises import Promise, Trial
from ellipseg_ros.ros.playback import ReplayOptions
from ellipseg_ros.ros.replayer import Replayer
from ellipseg_ros.simulator import simulate

FLOOD = "import sys; from ellipseg_ros.ros.flooding import main; sys.exit(main(sys.argv[1:]))"
FLOODS = {
    "nobody": [],
    "~/tune": ["tune"],
    "~/reset": ["reset"],
    "parameters": ["get_parameters", "set_parameters"],
}
PATIENCE = 30.0  # s
REPORTS = 20  # /diagnostics, one a second, until the last update must have come
TIMES = 3.0  # the latency without a flood, at most
LEAST = 1.0  # s of latency that are fine in any case: `update_period`


@dataclass(frozen=True)
class Case:
    """One drive, with a flood or without."""

    updates: int
    expected: int
    lost: int  # clouds
    latency: float  # s, median
    answers: dict[str, list[int]] = field(default_factory=dict)  # calls answered, granted


def strangers(trial: Trial) -> list[Promise]:
    """Drive with a flood of calls, one kind after the other."""
    seconds = 8.0 if trial.quick else 60.0
    cases = {}
    for name, services in FLOODS.items():
        trial.say(f"strangers: a drive, calls of {name}")
        cases[name] = drive(services, seconds, trial.seed)
    how = f"{seconds:g} s in real time for each, four calls at once by another process"
    quiet, floods = cases["nobody"], {name: cases[name] for name in FLOODS if FLOODS[name]}
    return [_goes_on(quiet, floods, how), _answers(floods, seconds, how)]


def drive(services: list[str], seconds: float, seed: int) -> Case:
    """Replay a simulated drive into a node of which the services are called all the time."""
    scene = simulate("industrial", duration=seconds, seed=seed)
    with running({}) as (listener, _, ros_args):
        with Replayer(scene, ReplayOptions(clock=False), ros_args) as replayer:
            listener.wait_for_topics(START)
            with flood(services, ros_args) as answers:
                replayer.run()
                said = last_word(listener, REPORTS)
        return Case(
            updates=int(said["updates"]) + int(said["updates joined"]),
            expected=int(seconds) - 1,
            lost=int(said["clouds lost by DDS"]),
            latency=float(said["latency median [s]"]),
            answers=answers,
        )


@contextmanager
def flood(services: list[str], ros_args: list[str]) -> Iterator[dict[str, list[int]]]:
    """Call services for the time of the block; after it, the record tells how often."""
    answers: dict[str, list[int]] = {}
    if not services:
        yield answers
        return
    namespace = next(word.removeprefix("__ns:=") for word in ros_args if "__ns:=" in word)
    command = [sys.executable, "-c", FLOOD, f"{namespace}/ellipseg_segmenter", *services]
    process = subprocess.Popen([*command, *ros_args], stdout=subprocess.PIPE, text=True)
    try:
        yield answers
        process.send_signal(signal.SIGINT)
        told, _ = process.communicate(timeout=PATIENCE)
        answers |= json.loads(told)
    finally:
        process.kill()
        process.wait()


def _goes_on(quiet: Case, floods: dict[str, Case], how: str) -> Promise:
    texts = [
        f"{name}: {one.latency:.2f} s, {one.updates} updates, {one.lost} clouds lost"
        for name, one in floods.items()
    ]
    limit = max(LEAST, TIMES * quiet.latency)
    kept = all(
        one.latency <= limit and not one.lost and one.updates >= one.expected
        for one in floods.values()
    )
    return Promise(
        "a flood of calls does not keep the node from segmenting",
        f"{how}; every update comes, no cloud is lost, and the median latency is at most "
        f"{LEAST:g} s, or {TIMES:g} times that without calls ({quiet.latency:.2f} s)",
        "; ".join(texts),
        kept,
    )


def _answers(floods: dict[str, Case], seconds: float, how: str) -> Promise:
    texts, kept = [], True
    for one in floods.values():
        for service, (answered, granted) in sorted(one.answers.items()):
            texts.append(
                f"{service}: {answered / seconds:,.0f} answers a second, {granted:,} granted"
            )
            kept &= answered > 0
        kept &= bool(one.answers)
    return Promise(
        "every call is answered, if only by a refusal",
        f"{how}; parameters with a value out of range; of tunings one at a time, and 30 % of the "
        "time at most after the first 20 s of work",
        "; ".join(texts),
        kept and floods["parameters"].answers["set_parameters"][1] == 0,
    )
