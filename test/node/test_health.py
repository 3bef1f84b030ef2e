"""Levels, messages and values of /diagnostics."""

from types import SimpleNamespace

import pytest

from ellipseg_ros.node import health
from ellipseg_ros.node.health import ERROR, OK, WARN, Health
from ellipseg_ros.records import SECOND, Counts


@pytest.fixture
def clock(monkeypatch):
    """A clock that only a test turns on."""
    now = SimpleNamespace(s=100.0)
    monkeypatch.setattr(health.time, "monotonic", lambda: now.s)
    return now


def window(restart="", change="", late=0, evicted=0):
    """What an update has found."""
    return SimpleNamespace(
        restart=restart,
        counts=Counts(90, 5, 3, 2),
        frame_id="odom",
        start_ns=0,
        end_ns=20 * SECOND,
        late=late,
        evicted=evicted,
        ids=range(7),
        criterion="shape",
        threshold=4.0,
        threshold_change=change,
        aicc=-12.345,
    )


def ready():
    """Of a node that has compiled its kernels."""
    found = Health()
    found.ready = True
    return found


def test_report_before_the_first_cloud(clock):
    found = Health()
    report = found.report(0)
    assert (report.level, report.message.split(",")[0]) == (WARN, "loading the kernels")
    found.ready = True
    report = found.report(0)
    assert (report.level, report.message) == (WARN, "no cloud yet")
    assert "time since the last update [s]" not in report.values


def test_valid_clouds_are_ok_with_their_rate(clock):
    found = ready()
    for _ in range(20):
        found.cloud()
    clock.s += 2.0
    report = found.report(waiting=1)
    assert (report.level, report.message) == (OK, "segmenting")
    assert report.values["input rate [1/s]"] == "10.00"
    assert report.values["updates in backlog"] == "1"


def test_missing_input_is_a_warning_until_the_next_cloud(clock):
    found = ready()
    found.cloud()
    clock.s += 5.1
    assert found.report(0).message == "no cloud for 5 s"
    found.cloud()
    assert found.report(0).level == OK


def test_late_and_evicted_points_are_reported(clock):
    found = ready()
    found.cloud()
    found.updated(window(late=3, evicted=40), 0.1, 0.2)
    report = found.report(0)
    assert report.level == WARN
    assert report.message == "max_points reached: 40 points evicted"
    assert (report.values["points late"], report.values["points evicted"]) == ("3", "40")
    found.cloud()
    assert found.report(0).level == OK


def test_repeated_restarts_are_a_warning(clock):
    found = ready()
    for times in (1, 3):
        found.cloud()
        for _ in range(times):
            found.updated(window(restart="the frame changed from 'a' to 'b'"), 0.1, 0.2)
        report = found.report(0)
        assert report.level == (OK if times == 1 else WARN)
    assert report.message == "the window restarted 3 times: the frame changed from 'a' to 'b'"
    assert report.values["restarts"] == "4"


def test_some_rejected_clouds_are_a_warning_and_only_rejected_ones_an_error(clock):
    found = ready()
    found.cloud()
    found.cloud()
    found.rejected("no_xyz")
    report = found.report(0)
    assert (report.level, report.message) == (WARN, "1 clouds rejected")
    assert report.values["clouds rejected: no_xyz"] == "1"
    found.cloud()
    found.rejected("no_xyz")
    report = found.report(0)
    assert (report.level, report.message) == (ERROR, "every cloud is rejected: no_xyz")
    found.cloud()
    report = found.report(0)
    assert report.level == OK
    assert report.values["clouds rejected"] == "2"


def test_error_lists_the_reasons_since_the_last_report(clock):
    found = ready()
    for reason in ("no_xyz", "stamp"):
        found.cloud()
        found.rejected(reason)
        assert found.report(0).message == f"every cloud is rejected: {reason}"


def test_rejected_group_is_a_warning(clock):
    found = ready()
    found.cloud()
    found.rejected("fields", group=True)
    report = found.report(0)
    assert (report.level, report.message) == (WARN, "1 clouds rejected")
    assert report.values["clouds rejected: fields"] == "1"


def test_lost_coalesced_and_dropped_are_counted_and_warned_of_once(clock):
    found = ready()
    found.cloud()
    found.count(lost=3)
    found.count(coalesced=2, dropped=1, points_dropped=700)
    report = found.report(0)
    assert report.level == WARN
    assert report.message == (
        "3 clouds lost; too slow: 2 updates coalesced; too slow: 1 updates dropped"
    )
    later = found.report(0)
    assert later.level == OK
    names = ("clouds lost by DDS", "updates coalesced", "updates dropped", "points dropped")
    assert [later.values[name] for name in names] == ["3", "2", "1", "700"]


def test_points_evicted_in_the_backlog_are_included(clock):
    found = ready()
    found.cloud()
    found.count(coalesced=1, dropped=0, evicted=30)
    found.updated(window(evicted=10), 0.1, 0.2)
    report = found.report(0)
    assert "max_points reached: 40 points evicted" in report.message
    assert report.values["points evicted"] == "40"


def test_times_are_of_the_last_hundred_updates(clock):
    found = ready()
    for k in range(150):
        found.updated(window(), processing=k / 1000, latency=k / 100)
    values = found.report(0).values
    assert values["updates"] == "150"
    assert values["processing median [s]"] == "0.0995"  # of 0.050 to 0.149
    assert float(values["latency p99 [s]"]) == pytest.approx(1.48, abs=0.01)


def test_window_and_last_restart_are_reported(clock):
    found = Health()
    found.updated(window(restart="a jump"), 0.1, 0.2)
    found.updated(window(), 0.1, 0.2)
    values = found.report(0).values
    assert (values["restarts"], values["last restart"]) == ("1", "a jump")
    fates = ("segmented", "isolated", "rejected", "thinned")
    assert [values[f"points {fate}"] for fate in fates] == ["90", "5", "3", "2"]
    assert (values["window [s]"], values["segments"], values["AICc"]) == ("20.000", "7", "-12.3")


def test_endless_update_is_an_error(clock):
    found = ready()
    found.cloud()
    with found.work():
        clock.s += 59.0
        found.cloud()
        assert found.report(0).level == OK
        clock.s += 2.0
        report = found.report(0)
        assert (report.level, report.message) == (
            ERROR,
            "the current update has taken 61 s so far",
        )
        assert report.values["current update duration [s]"] == "61.0"
    found.cloud()
    report = found.report(0)
    assert (report.level, report.values["current update duration [s]"]) == (OK, "0.0")


def test_three_consecutive_late_updates_are_a_warning(clock):
    found = ready()
    levels = []
    for latency in (1.5, 0.2, 1.1, 1.2, 1.3, 0.9):
        found.cloud()
        found.updated(window(), 0.1, latency, period=1.0)
        report = found.report(0)
        levels.append(report.level)
        if report.level:
            assert report.message.endswith("later than update_period, the last after 1.30 s")
            assert report.message.startswith("too slow for real time: 3 consecutive updates")
    assert levels == [OK, OK, OK, OK, WARN, OK]


def test_lateness_before_a_gap_in_the_input_is_forgotten(clock):
    found = ready()
    for _ in range(3):
        found.cloud()
        found.updated(window(), 0.1, 5.0, period=1.0)
    clock.s += 6.0
    assert found.report(0).message == "no cloud for 6 s"
    found.cloud()
    assert found.report(0).level == OK


def test_ages_and_memory_are_reported(clock):
    found = ready()
    found.updated(window(), 0.1, 0.2)
    clock.s += 3.0
    values = found.report(0, now_ns=22 * SECOND).values
    assert values["time since the last update [s]"] == "3.0"
    assert values["age of the newest point [s]"] == "2.0"
    assert values["latency last [s]"] == "0.2000"
    assert values["uptime [s]"] == "3"
    assert 10 < float(values["memory [MB]"]) < 100_000


def test_other_publisher_is_a_warning(clock):
    found = ready()
    found.cloud()
    found.other_publishers = 1
    report = found.report(0)
    assert report.level == WARN and "1 other nodes publish segments" in report.message
