"""Others in the same network: a second node, other namespaces, a subscriber that hangs."""

import time
from dataclasses import replace
from threading import Thread

import numpy as np

from ellipseg_ros.cli.listening import Listening
from ellipseg_ros.reliability.fault_kills import PERIOD, START, Scene, scene
from ellipseg_ros.reliability.promises import Promise, Trial
from ellipseg_ros.reliability.tape import Tape
from ellipseg_ros.ros.playback import ReplayOptions
from ellipseg_ros.ros.replayer import Replayer
from ellipseg_ros.ros.witness import Witness

TOLD = "other nodes publish `segments`"
SOON = 15.0  # s within which a second node is to be told of
DEEP = 20  # updates while nobody reads: twice as many as DDS keeps
SLOWER = 2.0  # times the usual interval that the longest may have then


def second_nodes(trial: Trial) -> Promise:
    """Two nodes in one namespace, one after the other."""
    trial.say("faults: a second node in the namespace")
    with scene(trial.seed) as here, here.node() as process:
        here.wait_for_step(time.monotonic())
        alone = [text for _, text in here.witness.said if TOLD in text]
        begun = time.monotonic()
        with here.node() as second:
            here.witness.wait(
                lambda: any(TOLD in text for moment, text in here.witness.said if moment > begun),
                START,
                "the second node is not told of",
            )
            told = time.monotonic() - begun
            second.stop()
        process.stop()
    return Promise(
        "a second node in the same namespace is told of in /diagnostics",
        "a node beside one that runs; the time includes its start",
        f"WARN after {told:.1f} s; before that {len(alone)} false alarms",
        not alone and told < SOON,
    )


def namespaces(trial: Trial) -> Promise:
    """Two nodes in two namespaces of one domain: each hears its own clouds alone."""
    trial.say("faults: two namespaces")
    updates = 6 if trial.quick else 60
    with scene(trial.seed) as one:
        args = [word.replace("__ns:=/", "__ns:=/other_") for word in one.ros_args]
        tape = [replace(s, frame_id="elsewhere") for s in Tape(4.0, 1 + updates // 8)]
        with (
            Witness(args) as witness,
            Replayer(tape, ReplayOptions(clock=False), args) as replayer,
            one.node() as first,
            Scene(args, witness, one.folder).node() as second,
        ):
            player = Thread(target=replayer.run, daemon=True)
            player.start()
            other = Scene(args, witness, one.folder)
            begun = time.monotonic()
            for each in (one, other):
                each.wait_for_step(begun, updates)
            replayer.stop()
            player.join()
            first.stop()
            second.stop()
            frames = [{heard.frame_id for heard in each.witness.heard} for each in (one, other)]
            alarms = [
                text for each in (one, other) for _, text in each.witness.said if TOLD in text
            ]
    return Promise(
        "nodes in several namespaces side by side do not mix",
        f"two namespaces of one domain, clouds in different frames, {updates} updates each",
        f"frames {' and '.join('/'.join(sorted(names)) for names in frames)}; "
        f"{len(alarms)} false alarms",
        all(len(names) == 1 for names in frames) and frames[0] != frames[1] and not alarms,
    )


def hanging_subscribers(trial: Trial) -> Promise:
    """A subscriber to everything that stops reading, its queues full of large messages."""
    updates = DEEP if trial.quick else 5 * DEEP
    with scene(trial.seed) as here, here.node("-p", "window_duration:=10") as process:
        with Listening(here.ros_args) as listening:
            listening.wait_for_topics(START)
            here.wait_for_step(time.monotonic(), DEEP)  # the window is full
            trial.say(f"faults: {updates} updates while a subscriber reads")
            usual = _intervals(here, updates)
            listening.stop_reading()
            trial.say(f"faults: {updates} updates while it doesn't")
            hanging = _intervals(here, updates)
            listening.read_on()
        process.stop()
    medians = [1e3 * float(np.median(times)) for times in (usual, hanging)]
    longest = [1e3 * max(times) for times in (usual, hanging)]
    return Promise(
        "a subscriber that stops reading does not slow the node",
        f"SIGSTOP of one of two reliable subscribers to all topics for {updates} updates, more "
        f"than DDS keeps; {PERIOD:g} s between two, window 10 s",
        f"from update to update {medians[0]:.0f} ms before, {medians[1]:.0f} ms meanwhile "
        f"(medians); at most {longest[0]:.0f} and {longest[1]:.0f} ms",
        max(hanging) < SLOWER * max(*usual, PERIOD),
    )


def _intervals(here: Scene, updates: int) -> list[float]:
    """Times between the next updates, s."""
    begun = time.monotonic()
    here.wait_for_step(begun, updates + 1)
    times = [heard.time for heard in here.witness.since(begun)]
    return [late - early for early, late in zip(times, times[1:], strict=False)]
