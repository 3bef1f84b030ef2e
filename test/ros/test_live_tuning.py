"""Tuning on a running node: `~/tune`, `auto_tune_period` and their reports."""

import json
import math
import os
import threading
from contextlib import contextmanager
from queue import Queue
from threading import Event, Thread
from types import SimpleNamespace

import numpy as np
import pytest
import random_records
import rclpy
from clouds import street
from diagnostic_msgs.msg import DiagnosticArray
from node_kit import SECOND, nanoseconds, peer, running
from rclpy.logging import LoggingSeverity
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import Trigger

from ellipseg_ros.config import Config
from ellipseg_ros.msg import SegmentArray, TuningCurve
from ellipseg_ros.records import Sweep
from ellipseg_ros.ros import limits, tuner
from ellipseg_ros.ros.process import Spinner
from ellipseg_ros.ros.segmenter_node import SegmenterNode
from ellipseg_ros.ros.tuner import Tuned, Tuner
from ellipseg_ros.tuning.live import LIVE_SEARCH
from ellipseg_ros.tuning.search import tune

NODE = "/ellipseg_segmenter"
BAD = 0.3  # a threshold with a loss of nearly 1 on the street


@pytest.fixture(scope="module")
def domain(session_ros_domain):
    return session_ros_domain


def sweep(stamp, points=800):
    xyz = street(points, np.random.default_rng(round(stamp))).astype(np.float32)
    return Sweep(round(stamp * SECOND), xyz, frame_id="odom")


@contextmanager
def meeting(domain, namespace=""):
    """A peer with the topics that these tests need."""
    with peer(domain, namespace) as me:
        yield SimpleNamespace(
            me=me,
            segments=me.subscribe(SegmentArray, "segments"),
            curves=me.subscribe(TuningCurve, "tuning_curve"),
            diagnostics=me.subscribe(DiagnosticArray, "/diagnostics"),
            points=me.publish(PointCloud2, "points"),
        )


def update(node, stamp, **options):
    """Send a sweep that closes an update, and wait for its segments."""
    node.points.send(sweep(stamp, **options))
    return node.segments.wait_for_stamp(stamp)


# --- a node in a process of its own ----------------------------------------------------------


@pytest.fixture(scope="module")
def node(domain, tmp_path_factory):
    """A node with a bad threshold, and a peer that hears it all."""
    log = tmp_path_factory.mktemp("tuned") / "log"
    arguments = ["-p", f"threshold:={BAD}", "-p", "window_duration:=3.0"]
    with running("segmenter_node", arguments, log) as process, meeting(domain) as found:
        found.process = process
        yield found


def call(node):
    return node.me.call(Trigger, f"{NODE}/tune")


def test_tune_before_the_first_update_is_refused_in_one_line(node):
    answer = call(node)
    assert not answer.success
    assert answer.message == "there is no window yet; call again after the first update"


def test_tune_sets_the_threshold_of_least_aicc_and_publishes_the_curve(node):
    node.points.send(sweep(10.0))
    first = update(node, 11.0)
    assert first.threshold == BAD and first.threshold_change == ""
    points = np.concatenate([sweep(stamp).points for stamp in (10.0, 11.0)])
    expected = tune(points, Config(threshold=BAD), LIVE_SEARCH)
    answer = call(node)
    assert answer.success, answer.message
    told = json.loads(answer.message.splitlines()[-1])
    assert told["aicc"] == expected.aicc.tolist()
    best = expected.threshold[expected.best]
    assert told["chosen"] == best != BAD
    assert node.me.get(NODE, "threshold")[0].double_value == best

    message = node.curves.wait(lambda _: True)
    assert (message.current_threshold, message.new_threshold) == (BAD, best)
    assert list(message.loss) == expected.loss.tolist()
    assert list(message.count) == expected.count.tolist()
    assert nanoseconds(message.header.stamp) == 11 * SECOND
    after, later = update(node, 12.0), update(node, 13.0)
    assert (after.threshold, after.threshold_change) == (best, "tuned")
    assert (later.threshold, later.threshold_change) == (best, "")
    values = node.diagnostics.wait_for_values(lambda _, values: values["threshold changes"] == "1")
    assert values["last threshold change"] == f"tuned: {best:.6g}"
    assert values["tunings"] == "1" and "shape: least AICc at" in values["last tuning"]


def test_threshold_set_by_parameter_is_reported(node):
    assert node.me.set(NODE, threshold=7.0)[0].successful
    assert update(node, 20.0).threshold_change == "set"
    assert node.me.set(NODE, marker_min_count=13)[0].successful
    assert update(node, 21.0).threshold_change == ""


def test_tune_with_too_few_points_is_refused_in_one_line(node):
    assert node.me.call(Trigger, f"{NODE}/reset").success
    node.points.send(sweep(60.0, points=20))
    update(node, 61.0, points=20)
    answer = call(node)
    assert not answer.success and "a curve needs 100 or more" in answer.message
    assert "\n" not in answer.message


def test_automatic_tuning_changes_a_bad_threshold_after_two_curves(node):
    assert node.me.call(Trigger, f"{NODE}/reset").success
    for answer in node.me.set(NODE, threshold=BAD, auto_tune_period=1):
        assert answer.successful, answer.reason
    heard, stamp = len(node.curves.messages), 100.0
    node.points.send(sweep(stamp))
    while len(node.curves.messages) < heard + 2:
        stamp += 1.0
        now = len(node.curves.messages)
        update(node, stamp)
        if stamp >= 102.0:  # a period after the first update
            node.curves.wait_for(now + 1)
    one, two = node.curves.messages[heard : heard + 2]
    assert (
        one.new_threshold == one.current_threshold == BAD and "waiting for another" in one.reason
    )
    assert two.current_threshold == BAD and two.new_threshold != BAD
    after = update(node, stamp + 1.0)
    assert (after.threshold, after.threshold_change) == (two.new_threshold, "auto_tuned")
    assert node.me.get(NODE, "threshold")[0].double_value == two.new_threshold
    assert node.me.set(NODE, auto_tune_period=0.0)[0].successful


# --- a node in this process, whose tuning is held ---------------------------------------------


@pytest.fixture
def held(domain, monkeypatch):
    """A node whose tuning waits for `go`, and tells by `begun` that it does."""
    begun, go, ended = Event(), Event(), []

    def waiting(*args):
        begun.set()
        assert go.wait(60.0)
        return tune(*args)

    monkeypatch.setattr(tuner, "tune", waiting)
    arguments = ["--ros-args", "-r", "__ns:=/held", "-p", f"threshold:={BAD}"]
    rclpy.init(args=arguments, domain_id=domain, signal_handler_options=SignalHandlerOptions.NO)
    running_node = SegmenterNode(ended.append)
    running_node.node.get_logger().set_level(LoggingSeverity.WARN)
    spinner = Spinner(running_node.node, ended.append)
    with meeting(domain, "/held") as found:
        found.begun, found.go, found.ended = begun, go, ended
        found.tuner = running_node._tuning.tuner
        yield found
    go.set()
    running_node.close()
    spinner.stop()
    running_node.node.destroy_node()
    rclpy.shutdown()
    assert ended == []


def asked(held):
    """Call `~/tune` in a thread; gives a list that will hold the answer, and the thread."""
    answers = []
    name = "/held/ellipseg_segmenter/tune"
    thread = Thread(target=lambda: answers.append(held.me.call(Trigger, name)))
    thread.start()
    return answers, thread


def test_updates_continue_during_a_tuning(held):
    held.points.send(sweep(1.0))
    update(held, 2.0)
    answers, thread = asked(held)
    assert held.begun.wait(60.0)
    for stamp in (3.0, 4.0, 5.0):  # each comes back while the tuning stands still
        found = update(held, stamp)
        assert found.threshold == BAD and found.segmented > 0
    assert not answers
    second, other = asked(held)
    other.join(60.0)
    assert not second[0].success and "a tuning is running" in second[0].message
    held.go.set()
    thread.join(60.0)
    assert answers[0].success
    assert update(held, 6.0).threshold_change == "tuned"


def test_outdated_curve_is_not_applied(held):
    held.points.send(sweep(1.0))
    update(held, 2.0)
    answers, thread = asked(held)
    assert held.begun.wait(60.0)
    assert held.me.set("/held/ellipseg_segmenter", threshold=9.0)[0].successful
    held.go.set()
    thread.join(60.0)
    assert not answers[0].success and "has changed meanwhile" in answers[0].message
    assert update(held, 3.0).threshold == 9.0


def test_failed_tuning_is_reported_and_the_node_continues(held, monkeypatch):
    def failing(*args):
        raise MemoryError("no\nroom")

    monkeypatch.setattr(tuner, "tune", failing)
    held.points.send(sweep(1.0))
    update(held, 2.0)
    answers, thread = asked(held)
    thread.join(60.0)
    assert answers[0].message == "the tuning failed: MemoryError: no room"
    assert update(held, 3.0).segmented > 0


def test_unexpected_error_ends_the_node(held, monkeypatch):
    error = RuntimeError("nobody expected this")

    def broken(*args):
        raise error

    monkeypatch.setattr(tuner, "tune_window", broken)
    held.points.send(sweep(1.0))
    update(held, 2.0)
    assert held.tuner.request(print) == ""
    held.tuner.close(60.0)
    assert held.ended == [error]
    held.ended.clear()  # for the fixture, which expects none


# --- the tuner alone -------------------------------------------------------------------------


class Tunings:
    """A tuner whose tunings take so many seconds, of a clock that only the test turns on."""

    def __init__(self, monkeypatch, seconds):
        self.now, self.seconds, self.ended = 100.0, seconds, []
        monkeypatch.setattr(limits, "time", SimpleNamespace(monotonic=lambda: self.now))
        monkeypatch.setattr(tuner, "tune_window", self._work)
        self.tuner = Tuner(lambda _: None, print)

    def _work(self, found, config):
        self.now += self.seconds
        self.ended.append(found.end_ns / SECOND)
        return Tuned(found, config, None)

    def drive(self, until, period):
        """An update every second, of the clock and of the sensor."""
        while self.now < until:
            found = random_records.segmentation(points=120, end_ns=round(self.now * SECOND))
            self.tuner.observe(found, Config(), period)
            self.rest()
            self.now = math.floor(self.now) + 1.0

    def rest(self):
        """Wait until it does nothing."""
        if self.tuner._thread is not None:
            self.tuner._thread.join(60.0)
        assert not self.tuner._busy

    def __enter__(self):
        return self

    def __exit__(self, *_):
        assert self.tuner.close(60.0)


def test_tunings_are_limited_to_a_share_of_the_time(monkeypatch):
    with Tunings(monkeypatch, 3.0) as tunings:
        tunings.drive(700.0, 0.001)
    share, burst = tuner.TUNING_SHARE
    assert 3.0 * len(tunings.ended) == pytest.approx(share * 600.0 + burst, rel=0.03)


def test_long_period_is_kept(monkeypatch):
    with Tunings(monkeypatch, 5.5) as tunings:
        tunings.drive(1000.0, 20.0)
    assert tunings.ended == list(np.arange(120.0, 1000.0, 20.0))


def test_requested_and_automatic_tunings_have_one_share(monkeypatch):
    with Tunings(monkeypatch, 25.0) as tunings:
        tunings.drive(102.0, 30.0)
        assert tunings.tuner.request(lambda _: None) == ""
        tunings.rest()
        assert "too many tunings; call again in 16.7 s" in tunings.tuner.request(print)
        tunings.drive(160.0, 30.0)
        assert tunings.ended == [101.0, 144.0]  # not at 130 s
        assert "too many tunings" in tunings.tuner.request(print)


@pytest.mark.parametrize("niceness", [0, 19])
def test_priority_is_low_and_never_raised(monkeypatch, niceness):
    present, seen = os.getpriority(os.PRIO_PROCESS, 0), Queue()

    def work(found, config):
        seen.put(os.getpriority(os.PRIO_PROCESS, threading.get_native_id()))
        return Tuned(found, config, None)

    def started_nicely():
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), max(present, niceness))
        refused.append(found.request(lambda _: None))  # its thread begins with this priority

    monkeypatch.setattr(tuner, "tune_window", work)
    refused, found = [], Tuner(print, print)
    found.observe(random_records.segmentation(), Config(), 0.0)
    starter = Thread(target=started_nicely)
    starter.start()
    starter.join(60.0)
    assert refused == [""]
    assert seen.get(timeout=60.0) == max(present, niceness, tuner.NICENESS)
    assert found.close(60.0)


def test_tuner_works_without_the_right_to_set_priorities(monkeypatch):
    def forbidden(*args):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(os, "setpriority", forbidden)
    with Tunings(monkeypatch, 1.0) as tunings:
        tunings.drive(105.0, 2.0)
    assert tunings.ended == [102.0, 104.0]


def test_automatic_tuning_once_per_period_of_sensor_time(monkeypatch):
    ended = Queue()
    monkeypatch.setattr(tuner, "tune_window", lambda found, config: Tuned(found, config, None))
    found_tuner = Tuner(lambda tuned: ended.put(tuned.window.end_ns // SECOND), print)
    heard = []
    for second in range(20):
        restart = "a jump" if second == 8 else ""
        found = random_records.segmentation(end_ns=second * SECOND, restart=restart)
        found_tuner.observe(found, Config(), 3.0 if second < 15 else 0.0)
        if second in (3, 6, 11, 14):
            heard.append(ended.get(timeout=60.0))
    assert found_tuner.close(60.0)
    assert heard == [3, 6, 11, 14] and ended.empty()


def test_reset_discards_the_window():
    found = Tuner(print, print)
    found.observe(random_records.segmentation(), Config(), 0.0)
    found.reset()
    assert "no window" in found.request(print)
