"""Playback sends clouds in time; without ROS."""

import threading
import time
from contextlib import contextmanager

import numpy as np
import pytest

from ellipseg_ros.node.playback import Playback, ReplayOptions
from ellipseg_ros.records import SECOND, Sweep

LIMIT = 30.0  # s


def clouds(count, start=100.0, step=0.1):
    return [Sweep(round((start + k * step) * SECOND), np.zeros((2, 3))) for k in range(count)]


class Audience:
    """Plays a source in a thread and notes what is sent, and when."""

    def __init__(self, source, **options):
        self.sent = []
        self.times = []
        self.said = []
        self.summary = None
        self._changed = threading.Condition()
        options = ReplayOptions(**{"wait_for_subscriber": False, **options})
        self.playback = Playback(options, self._send, self.said.append)
        self._thread = threading.Thread(target=self._play, args=(source,), daemon=True)

    def _play(self, source):
        self.summary = self.playback.play(source)

    def _send(self, sweep):
        with self._changed:
            self.sent.append(sweep.stamp_ns / SECOND)
            self.times.append(time.monotonic())
            self._changed.notify_all()

    def wait_for(self, count):
        """Wait until so many clouds were sent."""
        with self._changed:
            assert self._changed.wait_for(lambda: len(self.sent) >= count, LIMIT), self.sent

    def end(self):
        """Wait for the end; the summary."""
        self._thread.join(LIMIT)
        assert not self._thread.is_alive(), f"still playing after {len(self.sent)} clouds"
        return self.summary

    def start(self):
        """Begin to play."""
        self._thread.start()
        return self


@contextmanager
def playing(source, **options):
    audience = Audience(source, **options).start()
    try:
        yield audience
    finally:
        audience.playback.stop()
        audience.end()


def test_all_clouds_are_sent_in_order_and_summarized():
    source = clouds(20)
    with playing(source, rate=0.0) as audience:
        summary = audience.end()
    assert audience.sent == [sweep.stamp_ns / SECOND for sweep in source]
    assert (summary.clouds, summary.points, summary.runs) == (20, 40, 1)
    assert summary.sensor_seconds == pytest.approx(1.9)
    assert summary.updates == summary.missed == 0


def test_no_cloud_is_sent_early():
    with playing(clouds(6, step=0.2), rate=4.0) as audience:
        summary = audience.end()
    begun = audience.times[0]
    for k, moment in enumerate(audience.times):
        assert moment - begun >= k * 0.05 - 1e-3
    assert summary.wall_seconds >= 0.25 - 1e-3


def test_jump_back_is_sent_immediately():
    far = clouds(2, start=5000.0)
    with playing(far + clouds(2, start=100.0), rate=1.0) as audience:
        summary = audience.end()
    assert summary.wall_seconds < LIMIT / 2  # and not 4900 s, nor stuck
    assert summary.sensor_seconds == pytest.approx(0.2)


def test_loop_repeats_until_stopped():
    with playing(clouds(3), rate=0.0, loop=True) as audience:
        audience.wait_for(10)
    assert audience.sent[:4] == [100.0, 100.1, 100.2, 100.0]
    assert audience.summary.runs >= 3


def test_empty_source_ends_a_loop():
    with playing([], loop=True) as audience:
        assert audience.end().clouds == 0


def test_nothing_is_sent_without_a_subscriber():
    with playing(clouds(2), rate=0.0, wait_for_subscriber=True) as audience:
        assert audience.sent == []
        audience.playback.subscribed()
        audience.end()
    assert len(audience.sent) == 2
    assert audience.said == ["waiting for a subscriber of `points`"]


def test_paused_replay_starts_on_request():
    with playing(clouds(5), rate=0.0, start_paused=True) as audience:
        assert audience.sent == []
        audience.playback.pause(False)
        audience.end()
    assert len(audience.sent) == 5


def test_pause_delays_the_remaining_clouds():
    stop = threading.Event()

    def source():
        yield from clouds(3)
        stop.set()
        yield from clouds(3, start=100.3)

    with playing(source(), rate=2.0) as audience:
        assert stop.wait(LIMIT)
        audience.playback.pause(True)
        held = len(audience.sent)
        resumed = time.monotonic()
        audience.playback.pause(False)
        audience.end()
    assert held < 6
    assert all(moment > resumed for moment in audience.times[held + 1 :])
    assert len(audience.sent) == 6


def test_replay_is_limited_to_ahead():
    with playing(clouds(50), rate=0.0, ahead=0.5) as audience:
        audience.wait_for(11)
        for update in range(1, 5):
            assert len(audience.sent) <= 10 * update + 1
            audience.playback.acknowledge((100 + update) * SECOND)
            audience.wait_for(min(50, 10 * update + 11))
        summary = audience.end()
    assert (summary.clouds, summary.updates, summary.missed) == (50, 4, 0)


def test_replay_continues_without_updates_and_logs_it():
    with playing(clouds(35), rate=0.0, ahead=0.5, update_timeout=0.1) as audience:
        summary = audience.end()
    assert summary.clouds == 35
    assert summary.missed == summary.updates == 3
    assert "no update for 0.1 s" in audience.said[0]


@pytest.mark.parametrize(
    "options",
    [
        {"wait_for_subscriber": True},
        {"start_paused": True},
        {"rate": 0.001},
        {"rate": 0.0, "ahead": 0.1},
    ],
)
def test_stop_ends_every_wait(options):
    with playing(clouds(50), **options) as audience:
        pass
    assert audience.summary.clouds < 50
    assert audience.summary.runs == 0
