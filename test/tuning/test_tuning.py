"""Thresholds by AICc: against a brute-force sweep, which calls `segment` at every threshold."""

from dataclasses import replace

import naive
import numpy as np
import pytest
from clouds import grid, street

from ellipseg_ros.config import Config, ModelConfig
from ellipseg_ros.core import jit
from ellipseg_ros.core.criteria import CRITERIA
from ellipseg_ros.errors import ConfigError
from ellipseg_ros.segmenter import segment
from ellipseg_ros.simulation import simulator
from ellipseg_ros.tuning.curve import Curve, curve_from
from ellipseg_ros.tuning.search import Search, curve, tune

FACTORS = np.geomspace(0.01, 30, 14)
SPREAD = {name: row.default_threshold * FACTORS for name, row in CRITERIA.items()}


def brute_force(points, config, thresholds, origin=None):
    """The plain twin: AICc, ellipsoids and merges of a segmentation from scratch at each."""
    found = [segment(points, replace(config, threshold=t), origin) for t in thresholds]
    return [(one.aicc, len(one.ellipsoids)) for one in found]


def assert_brute_force(found, points, config, origin=None):
    expected = brute_force(points, config, found.threshold, origin)
    assert list(zip(found.aicc, found.count, strict=True)) == expected  # bit for bit
    first = segment(points, config, origin)
    assert found.points == first.counts.segmented


@pytest.mark.nojit
@pytest.mark.parametrize("criterion", CRITERIA)
@pytest.mark.parametrize("cloud", [street, grid])
def test_curve_equals_segmentations_at_every_threshold(criterion, cloud):
    points = cloud(60 if jit.PLAIN else 3000, np.random.default_rng(0))
    config = Config(criterion=criterion)
    assert_brute_force(curve(points, config, SPREAD[criterion]), points, config)


@pytest.mark.parametrize("criterion", CRITERIA)
def test_curve_of_a_scene_equals_segmentations(criterion):
    sweeps = simulator.simulate("woodland", duration=0.5)
    points = np.concatenate([sweep.points for sweep in sweeps] + [np.full((5, 3), np.nan)])
    config = Config(criterion=criterion, model=ModelConfig(1e-3, 0.004))
    assert_brute_force(curve(points, config, SPREAD[criterion][::3]), points, config)


@pytest.mark.parametrize("criterion", CRITERIA)
@pytest.mark.parametrize("scene", ["oakland_part3_an", "kitti_2011_09_26_drive_0001"])
def test_curve_of_a_real_scan_equals_segmentations(shared_data, scene, criterion):
    points = np.load(shared_data / f"{scene}.npz")["xyz"][:5_000].astype(np.float64)
    config = Config(criterion=criterion)
    assert_brute_force(curve(points, config, SPREAD[criterion][::3]), points, config)


def test_curve_uses_the_given_origin():
    points = street(500, np.random.default_rng(1)) + 4.2e5
    origin = np.array([1000.0, 0.0, 0.0])
    config = Config()
    assert_brute_force(curve(points, config, SPREAD["shape"], origin), points, config, origin)


@pytest.mark.parametrize("threads", [1, 3, 50])
@pytest.mark.parametrize("criterion", CRITERIA)
def test_curve_does_not_depend_on_thread_count(criterion, threads, monkeypatch):
    points = street(1500, np.random.default_rng(2))
    config = Config(criterion=criterion)
    expected = curve(points, config, SPREAD[criterion])
    monkeypatch.setattr(jit, "THREADS", threads)
    found = curve(points, config, SPREAD[criterion])
    with jit.single_threaded():
        alone = curve(points, config, SPREAD[criterion])
    assert found.as_dict() == expected.as_dict() == alone.as_dict()


def test_aicc_terms_equal_the_plain_formula():
    points = street(400, np.random.default_rng(3))
    found = curve(points, Config(), [0.5, 4.0, 40.0])
    for row, tau in enumerate(found.threshold):
        model = segment(points, Config(threshold=tau)).ellipsoids
        sizes = np.bincount(segment(points, Config(threshold=tau)).labels + 1)[1:].astype(float)
        bias = np.sum(2.0 * 9.0 * sizes / np.maximum(1.0, sizes - 10.0))
        plain = (
            naive.aicc((n, None, c)) for n, c in zip(sizes, model.model_covariance, strict=True)
        )
        assert found.bias[row] == pytest.approx(bias, rel=1e-12)
        assert found.variance[row] == pytest.approx(sum(plain) - bias, rel=1e-9)
        assert found.completion[row] == (found.points - len(model)) / found.points


def test_no_merges_give_the_model_of_singletons():
    points = street(400, np.random.default_rng(4))
    found = curve(points, Config(criterion="density"), [1e-12, 0.01])
    assert found.count[0] == found.points and found.completion[0] == 0.0
    assert found.aicc[0] == pytest.approx(found.singletons, rel=1e-12)
    assert found.loss[0] == pytest.approx(1.0) and found.loss[found.best] == 0.0


@pytest.mark.parametrize("criterion", CRITERIA)
def test_tuning_finds_the_minimum_of_a_fine_grid(criterion):
    points = street(1200, np.random.default_rng(5))
    config = Config(criterion=criterion)
    found = tune(points, config)
    fine = brute_force(points, config, Search(count=100).grid(criterion))
    least = min(aicc for aicc, _ in fine)
    gain = found.singletons - least
    assert found.aicc[found.best] <= least + 0.003 * gain
    assert (np.diff(found.threshold) > 0).all()
    assert 40 < len(found.threshold) <= 40 + 1 + 2 * 8
    assert found.aicc[found.row(config.tau)] == segment(points, config).aicc


def made(aicc, singletons=0.0):
    aicc = np.array(aicc)
    count = np.arange(len(aicc), 0, -1)
    return Curve("shape", 10, singletons, 10.0 ** np.arange(len(aicc)), aicc, 0.0 * aicc, count)


def test_loss_is_the_lost_share_of_the_gain():
    found = made([0.0, -75.0, -100.0, -100.0, -90.0])
    assert found.best == 2  # of equal ones the lowest
    assert found.loss.tolist() == [1.0, 0.25, 0.0, 0.0, 0.1]
    assert found.loss_at([1e-9, 10.0**0.5, 1e3, 1e9]).tolist() == [1.0, 0.625, 0.0, 0.1]


def test_loss_without_gain_is_zero_or_one():
    assert made([5.0, 7.0, 9.0], singletons=2.0).loss.tolist() == [0.0, 1.0, 1.0]
    assert made([3.0, 3.0]).loss.tolist() == [0.0, 0.0]


@pytest.mark.parametrize("criterion", CRITERIA)
@pytest.mark.parametrize(
    "points",
    [np.zeros((0, 3)), np.zeros((1, 3)), np.zeros((30, 3)), np.full((5, 3), np.nan)],
    ids=["none", "one", "equal", "nan"],
)
def test_degenerate_clouds_have_a_curve(points, criterion):
    config = Config(criterion=criterion)
    found = tune(points, config)
    assert_brute_force(found, points, config)
    assert np.isfinite(found.loss).all()


def test_curve_survives_writing_and_reading():
    found = curve(street(300, np.random.default_rng(6)), Config(), [1.0, 4.0])
    again = curve_from(found.as_dict())
    assert again.as_dict() == found.as_dict()
    assert again.count.dtype == np.int64


@pytest.mark.parametrize("limits", [(5.0, 1.0), (0.0, 1.0), (200.0, -1.0)])
def test_thresholds_that_do_not_ascend_are_refused(limits):
    with pytest.raises(ConfigError, match="must ascend from above 0"):
        Search(*limits).grid("shape")
