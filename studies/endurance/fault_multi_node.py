"""Others in the same network: a second node, other namespaces, a subscriber that hangs."""

import time
from dataclasses import replace
from threading import Thread

import numpy as np

from ellipseg_ros.cli.node_process import START_TIMEOUT_S
from ellipseg_ros.node.playback import ReplayOptions
from ellipseg_ros.ros.replayer import Replayer
from studies.endurance.endless_drive import Tape
from studies.endurance.fault_kills import PERIOD, Scene, scene, unbroken
from studies.endurance.listener_process import Listening
from studies.endurance.promises import Promise, Trial
from studies.endurance.ros.recording_subscriber import Witness

TOLD = "other nodes publish segments"
SLACK = 50.0  # ms, of a machine that has other things to do
SOON = 15.0  # s within which a second node is to be told of
DEEP = 20  # updates before, and while nobody reads: twice as many as DDS keeps
SLOWER = 2.0  # times the usual latency that it may be then


def second_nodes(trial: Trial) -> Promise:
    """Two nodes in one namespace, one after the other."""
    trial.say("company: a second node in the namespace")
    with scene(trial.seed) as here, here.node() as process:
        here.wait_for_step(time.monotonic())
        alone = [text for _, text in here.witness.said if TOLD in text]
        begun = time.monotonic()
        with here.node() as second:
            here.witness.wait(
                lambda: any(TOLD in text for moment, text in here.witness.said if moment > begun),
                START_TIMEOUT_S,
                "the second node is not told of",
            )
            told = time.monotonic() - begun
            second.stop()
        process.stop()
    return Promise(
        "a second node in the same namespace is told of in /diagnostics",
        "a node beside one that runs; the time includes its start",
        f"WARN after {told:.1f} s; before that {len(alone)} false alarms",
        not alone,
        told < SOON,
    )


def namespaces(trial: Trial) -> Promise:
    """Two nodes in two namespaces of one domain: each hears its own clouds alone."""
    trial.say("company: two namespaces")
    updates = 6 if trial.quick else 60
    with scene(trial.seed) as one:
        args = [word.replace("__ns:=/", "__ns:=/other_") for word in one.ros_args]
        tape = [replace(s, frame_id="elsewhere") for s in Tape(4.0, 1 + updates // 8)]
        with (
            Witness(args) as witness,
            Replayer(tape, ReplayOptions(clock=False), args) as replayer,
            one.node() as first,
            (other := Scene(args, witness, one.folder)).node() as second,
        ):
            player = Thread(target=replayer.run, daemon=True)
            player.start()
            begun = time.monotonic()
            for each in (one, other):
                each.wait_for_step(begun, updates)
            replayer.stop()
            player.join()
            first.stop()
            second.stop()
            frames = [{heard.frame_id for heard in each.witness.heard} for each in (one, other)]
            said = [text for each in (one, other) for _, text in each.witness.said]
    alarms = [text for text in said if TOLD in text]
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
            listening.wait_for_topics(START_TIMEOUT_S)
            here.wait_for_step(time.monotonic(), DEEP)  # the window is full
            trial.say(f"company: {updates} updates while a subscriber reads")
            usual = _latencies(here, updates)
            listening.stop_reading()
            trial.say(f"company: {updates} updates while it doesn't")
            hanging = _latencies(here, updates)
            listening.read_on()
        process.stop()
    numbers = here.numbers()
    (median, high), (meanwhile, most) = (
        (1e3 * np.quantile(times, [0.5, 0.9])).tolist() for times in (usual, hanging)
    )
    return Promise(
        "a subscriber that stops reading does not slow the node",
        f"SIGSTOP of a reliable subscriber to all topics, beside another, for {updates} updates, "
        f"more than DDS keeps; {PERIOD:g} s between two, window 10 s",
        f"from a cloud sent to its segments received: {median:.0f} ms before (90 % within "
        f"{high:.0f} ms), {meanwhile:.0f} ms meanwhile ({most:.0f} ms); "
        f"{'no' if unbroken(numbers) else 'an'} update missing of {len(numbers)}",
        len(hanging) >= updates and unbroken(numbers),
        meanwhile < SLOWER * median + SLACK,
    )


def _latencies(here: Scene, updates: int) -> list[float]:
    """Of the next updates, s: from the cloud that ended it sent to its segments received."""
    begun = time.monotonic()
    here.wait_for_step(begun, updates)
    return [heard.time - here.sent[heard.stamp_ns] for heard in here.witness.since(begun)]
