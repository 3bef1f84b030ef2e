"""Stamps that stand still, and gaps, are said once each; what is usual is not."""

import numpy as np

from ellipseg_ros.node.stamps import STILL, Stamps
from ellipseg_ros.records import SECOND, Sweep


def lines(stamps, watch=None):
    """What is said of clouds with these stamps, in s; a window of 5 s, a lateness of 1 s."""
    watch = watch or Stamps()
    sweeps = (Sweep(round(stamp * SECOND), np.zeros((0, 3))) for stamp in stamps)
    return [text for text in (watch.look(sweep, 5.0, 1.0) for sweep in sweeps) if text]


def test_what_is_usual_is_not_told():
    assert lines([0.0, 0.1, 0.1, 0.1, 5.1, 4.5, 4.9, 5.2, 5.2]) == []
    assert lines([3.0, 3.1, 0.0, 0.1, 0.2]) == []  # a jump back, which restarts the window
    assert lines(np.linspace(1e6, 1e6 + 50.0, 11)) == []


def test_a_gap_is_told_with_its_length():
    watch = Stamps()
    (line,) = lines([0.0, 7.25, 7.5, 12.5], watch)
    assert "forward by 7.250 s" in line and "window of 5 s" in line
    assert watch.gaps == 1


def test_stamps_that_stand_still_are_told_once():
    watch = Stamps()
    (line,) = lines([3.0] * (STILL + 50), watch)
    assert "no newer than 3.000 s" in line and watch.still == STILL + 49
    assert lines([3.5], watch) == [] and watch.still == 0
    assert len(lines([3.5, 3.0, 2.6] * STILL, watch)) == 1


def test_after_a_jump_back_stamps_count_from_there():
    watch = Stamps()
    assert lines([100.0, 0.0, 0.5], watch) == [] and watch.still == 0
    assert len(lines([5.6], watch)) == 1  # a gap of this run
