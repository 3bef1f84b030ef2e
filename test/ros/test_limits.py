"""Bounds on the cost of a flood of messages or calls."""

from pathlib import Path
from types import SimpleNamespace

import pytest
from rclpy.clock_type import ClockType
from rclpy.logging import get_logger

from ellipseg_ros.ros import limits
from ellipseg_ros.ros.limits import MAX_PAUSE_S, Pauses, Quota, Share, throttled


@pytest.fixture
def clock(monkeypatch):
    """A clock that only a test turns on."""
    now = SimpleNamespace(s=100.0)
    monkeypatch.setattr(limits.time, "monotonic", lambda: now.s)
    return now


def test_quota_is_exhausted_and_renewed(clock):
    quota = Quota(2, 10.0)
    taken = []
    for step in (0.0, 1.0, 1.0, 7.9, 0.1, 0.9, 0.1):
        clock.s += step
        taken.append(quota.take())
    assert taken == [True, True, False, False, True, False, True]


def work(share, clock, seconds):
    with share.work():
        clock.s += seconds


def test_rare_work_never_waits(clock):
    share = Share(0.1, burst=2.0)
    for _ in range(20):
        assert share.wait() == 0.0
        work(share, clock, 1.0)
        clock.s += 20.0


def test_burst_is_repaid_before_the_next(clock):
    share = Share(0.1, burst=2.0)
    work(share, clock, 3.0)
    assert share.wait() == pytest.approx(10.0)  # 1 s more than it had, at 0.1
    clock.s += 10.01
    assert share.wait() == 0.0


def test_continuous_work_gets_its_share(clock):
    share = Share(0.1, burst=1.0)
    began, done = clock.s, 0.0
    while clock.s < began + 1000.0:
        if share.wait():
            clock.s += 0.1
        else:
            work(share, clock, 0.5)
            done += 0.5
    assert done == pytest.approx(0.1 * 1000.0, rel=0.03)


@pytest.fixture
def core(clock, monkeypatch):
    """How long the thread was at work; with `clock`, which goes on while it sleeps."""
    spent = SimpleNamespace(s=5.0, pauses=[])

    def sleep(seconds):
        spent.pauses.append(seconds)
        clock.s += seconds

    def work(seconds):
        spent.s += seconds
        clock.s += seconds

    monkeypatch.setattr(limits.time, "thread_time", lambda: spent.s)
    monkeypatch.setattr(limits.time, "sleep", sleep)
    spent.work = work
    return spent


def calls(pauses, core, count, seconds=0.001):
    for _ in range(count):
        core.work(seconds)
        pauses.take()


def test_flood_of_calls_is_limited_to_its_share(clock, core):
    pauses = Pauses(0.2, burst=0.1)
    pauses.take()
    calls(pauses, core, 100)  # the burst, and what is earned meanwhile
    assert not core.pauses
    began, before = clock.s, core.s
    calls(pauses, core, 2000)
    assert core.s - before == pytest.approx(0.2 * (clock.s - began), rel=0.03)
    assert max(core.pauses) < 0.006  # that clouds wait


def test_pauses_are_short_after_long_calls(core):
    pauses = Pauses(0.2, burst=0.1)
    pauses.take()
    calls(pauses, core, 3, seconds=2.0)
    assert core.pauses == [MAX_PAUSE_S] * 3


def test_debt_is_limited_to_a_burst(clock, core):
    pauses = Pauses(0.2, burst=0.1)
    pauses.take()
    calls(pauses, core, 1, seconds=60.0)
    clock.s += 0.6  # which pays back a burst
    core.pauses.clear()
    calls(pauses, core, 1, seconds=1e-6)
    assert not core.pauses


def test_exempt_callbacks_cause_no_pauses(core):
    pauses = Pauses(0.2, burst=0.1)
    pauses.take()
    for _ in range(100):
        core.work(0.05)
        pauses.exempt()
        pauses.take()
    assert not core.pauses
    calls(pauses, core, 1, seconds=0.5)  # the exemption was for the clouds only
    assert len(core.pauses) == 1
    core.work(0.05)
    pauses.exempt()
    pauses.take()  # and the next cloud doesn't pay for the call
    assert len(core.pauses) == 1


def test_throttling_is_per_logger_call(capfd):
    logger = get_logger("throttled")
    for _ in range(3):
        logger.warning("one", **throttled(60.0))
        logger.warning("other", **throttled(60.0))
    said = capfd.readouterr().err
    assert (said.count("]: one"), said.count("]: other")) == (1, 1)


def test_throttling_uses_the_steady_clock():
    assert throttled()["throttle_time_source_type"].clock_type == ClockType.STEADY_TIME
    folder = Path(limits.__file__).parent
    using = [path.name for path in folder.glob("*.py") if "throttle_" in path.read_text()]
    assert using == ["limits.py"]
