"""Subject `multi-node`: a second node, other namespaces, and a subscriber that hangs."""

import time
from dataclasses import replace
from threading import Thread

import numpy as np

from ellipseg_ros.cli.node_process import START_TIMEOUT_S
from ellipseg_ros.node.playback import ReplayOptions
from ellipseg_ros.ros.replayer import Replayer
from studies.endurance.endless_drive import EndlessDrive
from studies.endurance.requirements import Options, Requirement
from studies.endurance.rig import SETTINGS, UPDATE_PERIOD, Rig, is_unbroken, rig
from studies.endurance.ros.recording_subscriber import RecordingSubscriber
from studies.endurance.subscriber_process import SubscriberProcess

CONFLICT = "other nodes publish segments"  # in /diagnostics
MAX_REPORT_DELAY_S = 15.0  # until a second node is reported
QUEUED_UPDATES = 20  # twice as many as DDS keeps
MAX_SLOWDOWN = 2.0  # ratio of latencies
SLACK_MS = 50.0  # of latency, on a busy machine


def multi_node(options: Options) -> list[Requirement]:
    """Run several nodes and a subscriber that hangs."""
    return [*second_nodes(options), *namespaces(options), *hanging_subscribers(options)]


def second_nodes(options: Options) -> list[Requirement]:
    """Start a second node in the same namespace."""
    options.log("multi-node: a second node in the namespace")
    with rig(options.seed) as test_rig, test_rig.node() as process:
        health = test_rig.subscriber.health
        test_rig.wait_for_updates(time.monotonic())
        false_alarms = sum(CONFLICT in text for _, text in health)
        started_at = time.monotonic()
        with test_rig.node() as second:
            test_rig.subscriber.wait(
                lambda: any(CONFLICT in text for moment, text in health if moment > started_at),
                START_TIMEOUT_S,
                "the second node is not reported",
            )
            seconds = time.monotonic() - started_at
            second.stop()
        process.stop()
    return [
        Requirement(
            "a second node in the same namespace is reported in /diagnostics",
            "a node started beside another; the time includes its start",
            f"WARN after {seconds:.1f} s; {false_alarms} false alarms before",
            not false_alarms,
            seconds < MAX_REPORT_DELAY_S,
        )
    ]


def namespaces(options: Options) -> list[Requirement]:
    """Run two nodes in two namespaces of one domain, each with its own clouds."""
    options.log("multi-node: two namespaces")
    count = 6 if options.quick else 60
    with rig(options.seed) as first_rig:
        args = [word.replace("__ns:=/", "__ns:=/other_") for word in first_rig.ros_args]
        drive = [
            replace(sweep, frame_id="elsewhere") for sweep in EndlessDrive(4.0, 1 + count // 8)
        ]
        with (
            RecordingSubscriber(args) as subscriber,
            Replayer(drive, ReplayOptions(clock=False), args) as replayer,
            first_rig.node() as first,
            (second_rig := Rig(args, subscriber, first_rig.folder)).node() as second,
        ):
            thread = Thread(target=replayer.run, daemon=True)
            thread.start()
            started_at = time.monotonic()
            rigs = (first_rig, second_rig)
            for each in rigs:
                each.wait_for_updates(started_at, count)
            replayer.stop()
            thread.join()
            first.stop()
            second.stop()
            frames = [{update.frame_id for update in each.subscriber.updates} for each in rigs]
            health = [text for each in rigs for _, text in each.subscriber.health]
    alarms = sum(CONFLICT in text for text in health)
    return [
        Requirement(
            "nodes in several namespaces do not interfere",
            f"two namespaces of one domain, clouds in different frames, {count} updates each",
            f"frames {' and '.join('/'.join(sorted(names)) for names in frames)}; "
            f"{alarms} false alarms",
            all(len(names) == 1 for names in frames) and frames[0] != frames[1] and not alarms,
        )
    ]


def hanging_subscribers(options: Options) -> list[Requirement]:
    """Pause a subscriber to all topics until its queues are full of large messages."""
    count = QUEUED_UPDATES if options.quick else 5 * QUEUED_UPDATES
    window = SETTINGS["window_duration"] if options.quick else 10.0
    parameter = f"window_duration:={window:g}"
    with rig(options.seed) as test_rig, test_rig.node("-p", parameter) as process:
        with SubscriberProcess(test_rig.ros_args) as subscriber:
            subscriber.wait_for_topics(START_TIMEOUT_S)
            test_rig.wait_for_updates(time.monotonic(), round(window / UPDATE_PERIOD))
            options.log(f"multi-node: {count // 2} updates while a subscriber reads")
            usual = _latencies(test_rig, count // 2)
            subscriber.pause()
            options.log(f"multi-node: {count} updates while it is paused")
            paused = _latencies(test_rig, count)
            subscriber.resume()
        process.stop()
    sequence = test_rig.sequence()
    unbroken = is_unbroken(sequence)
    (median, high), (paused_median, paused_high) = (
        (1e3 * np.quantile(times, [0.5, 0.9])).tolist() for times in (usual, paused)
    )
    return [
        Requirement(
            "a subscriber that does not read does not slow the node",
            f"SIGSTOP of a reliable subscriber to all topics, beside another, for {count} "
            f"updates, more than DDS keeps; {UPDATE_PERIOD:g} s between two, window {window:g} s",
            f"from a cloud sent to its segments received: {median:.0f} ms before (90 % within "
            f"{high:.0f} ms), {paused_median:.0f} ms meanwhile ({paused_high:.0f} ms); "
            f"{'no' if unbroken else 'an'} update missing of {len(sequence)}",
            len(paused) >= count and unbroken,
            paused_median < MAX_SLOWDOWN * median + SLACK_MS,
        )
    ]


def _latencies(test_rig: Rig, count: int) -> list[float]:
    """Latencies of the next updates, s."""
    moment = time.monotonic()
    test_rig.wait_for_updates(moment, count)
    return test_rig.latencies(moment)
