"""Tuning while the vehicle drives, without ROS: when a change is worth it, and what is told."""

import json

import numpy as np
import pytest
from clouds import street

from ellipseg_ros.config import Config
from ellipseg_ros.tuning.curve import Curve
from ellipseg_ros.tuning.live import LIVE_SEARCH, MIN_LOSS, Hysteresis, decide_by_one, report
from ellipseg_ros.tuning.search import tune


def curve(best, loss, criterion="shape"):
    """Thresholds 1, 2, 4, 8, 16; the least AICc at `best`, and `loss` at 4."""
    threshold = 2.0 ** np.arange(5)
    aicc = np.where(threshold == best, -100.0, -50.0)
    aicc[2] = -100.0 * (1.0 - loss) if best != 4.0 else aicc[2]
    count = np.arange(5, 0, -1)
    return Curve(criterion, 10, 0.0, threshold, aicc, 0.0 * aicc, count)


def chosen(*curves, present=4.0):
    judge = Hysteresis()
    return [judge.decide(one, present).threshold for one in curves]


def test_two_consecutive_agreeing_curves_change_the_threshold():
    assert chosen(curve(8.0, 0.1), curve(8.0, 0.1)) == [4.0, 8.0]
    assert chosen(curve(1.0, 0.1), curve(1.0, 0.1)) == [4.0, 1.0]


def test_a_small_loss_changes_nothing():
    small = 0.99 * MIN_LOSS
    assert chosen(*[curve(8.0, small)] * 5) == [4.0] * 5
    assert chosen(*[curve(4.0, 0.0)] * 5) == [4.0] * 5


def test_curves_that_disagree_change_nothing():
    assert chosen(*[curve(8.0, 0.1), curve(2.0, 0.1)] * 3) == [4.0] * 6
    assert chosen(*[curve(8.0, 0.1), curve(8.0, 0.01)] * 3) == [4.0] * 6
    assert chosen(curve(8.0, 0.1), curve(8.0, 0.1, "parsimony")) == [4.0, 4.0]


def test_the_mean_loss_of_the_agreeing_curves_decides():
    one, other = curve(8.0, 0.3), curve(16.0, 0.3)
    other.aicc[3] = -90.0
    assert chosen(one, other) == [4.0, 8.0]


def test_after_a_change_two_curves_must_agree_again():
    judge = Hysteresis()
    assert [judge.decide(curve(8.0, 0.1), 4.0).threshold for _ in range(2)] == [4.0, 8.0]
    assert judge.decide(curve(16.0, 0.1), 8.0).threshold == 8.0


def test_manual_threshold_resets_the_hysteresis():
    judge = Hysteresis()
    judge.decide(curve(16.0, 0.1), 4.0)
    assert judge.decide(curve(16.0, 0.1), 8.0).threshold == 8.0
    assert judge.decide(curve(16.0, 0.1), 8.0).threshold == 16.0


def test_decision_by_one_curve_takes_its_best_threshold():
    assert decide_by_one(curve(8.0, 0.001), 4.0).threshold == 8.0
    decision = decide_by_one(curve(4.0, 0.0), 4.0)
    assert decision.threshold == 4.0 and not decision.changed
    assert "is the best already" in decision.reason


def test_report_is_a_table_and_json():
    found = tune(street(500, np.random.default_rng(0)), Config(), LIVE_SEARCH)
    decision = decide_by_one(found, Config().tau)
    head, _, *rows, last = report(found, decision).splitlines()
    assert head.startswith(f"shape: threshold {Config().tau:g} -> {decision.threshold:.4g} (loss ")
    assert len(rows) == len(found.threshold)
    assert [float(row.split()[0]) for row in rows] == pytest.approx(found.threshold, rel=1e-3)
    told = json.loads(last)
    assert told["aicc"] == found.aicc.tolist()
    assert (told["present"], told["chosen"]) == (Config().tau, decision.threshold)
