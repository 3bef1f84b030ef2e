"""StampMonitor warns once of stalled stamps and of each gap, and not of regular stamps."""

import numpy as np

from ellipseg_ros.node.stamps import STALLED_CLOUDS, StampMonitor
from ellipseg_ros.records import SECOND, Sweep


def warnings(stamps, monitor=None):
    """Warnings for clouds with these stamps, in s; a window of 5 s, a lateness of 1 s."""
    monitor = monitor or StampMonitor()
    sweeps = (Sweep(round(stamp * SECOND), np.zeros((0, 3))) for stamp in stamps)
    return [text for text in (monitor.check(sweep, 5.0, 1.0) for sweep in sweeps) if text]


def test_regular_stamps_give_no_warning():
    assert warnings([0.0, 0.1, 0.1, 0.1, 5.1, 4.5, 4.9, 5.2, 5.2]) == []
    assert warnings([3.0, 3.1, 0.0, 0.1, 0.2]) == []  # a jump back, which restarts the window
    assert warnings(np.linspace(1e6, 1e6 + 50.0, 11)) == []


def test_gap_is_reported_with_its_length():
    monitor = StampMonitor()
    (line,) = warnings([0.0, 7.25, 7.5, 12.5], monitor)
    assert "forward by 7.250 s" in line and "window of 5 s" in line
    assert monitor.gaps == 1


def test_stalled_stamps_are_reported_once():
    monitor = StampMonitor()
    (line,) = warnings([3.0] * (STALLED_CLOUDS + 50), monitor)
    assert "no newer than 3.000 s" in line and monitor.stalled == STALLED_CLOUDS + 49
    assert warnings([3.5], monitor) == [] and monitor.stalled == 0
    assert len(warnings([3.5, 3.0, 2.6] * STALLED_CLOUDS, monitor)) == 1


def test_jump_back_becomes_the_new_reference():
    monitor = StampMonitor()
    assert warnings([100.0, 0.0, 0.5], monitor) == [] and monitor.stalled == 0
    assert len(warnings([5.6], monitor)) == 1  # a gap after the jump
