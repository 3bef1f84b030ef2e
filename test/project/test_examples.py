"""The examples run and produce what they state."""

import importlib.util
import sys
from collections.abc import Iterator
from types import ModuleType

import numpy as np
import pytest
from scipy.optimize import approx_fprime
from sources import ROOT

from ellipseg_ros import Verdict, select_landmarks

gtsam = pytest.importorskip("gtsam", reason="no gtsam; pip install 'ellipseg_ros[slam]'")


@pytest.fixture(scope="module")
def close_loop() -> Iterator[ModuleType]:
    """The example, as a module."""
    path = ROOT / "examples" / "close_loop.py"
    spec = importlib.util.spec_from_file_location("close_loop", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["close_loop"] = module
    spec.loader.exec_module(module)
    yield module
    del sys.modules["close_loop"]


@pytest.mark.parametrize("seed", range(3))
def test_landmarks_close_the_loop(close_loop, seed):
    result = close_loop.drive(seed)
    assert result.association.verdict < Verdict.AMBIGUOUS
    assert len(result.association) >= 10
    before, after = (
        np.linalg.norm(places[-1] - result.truth[-1])
        for places in (result.odometry, result.closed)
    )
    assert before > 1.0 and after < 0.2
    assert result.error(result.closed) < 0.4 * result.error(result.odometry)


@pytest.mark.parametrize("kind", range(3))
@pytest.mark.parametrize("key", range(2))
def test_derivatives_of_the_factor_equal_finite_differences(close_loop, kind, key):
    rng = np.random.default_rng(kind)
    world = close_loop.simulated_town(rng)
    poses = close_loop.true_poses()[:2]
    landmark = select_landmarks(world, [np.flatnonzero(world.kind == kind)[0]])
    observed = [close_loop.transformed(landmark, pose.inverse()) for pose in poses]
    factor = close_loop.landmark_factor(0, 1, *observed)
    values = gtsam.Values()
    for number, pose in enumerate(poses):
        values.insert(number, pose.compose(gtsam.Pose3.Expmap(rng.normal(scale=1e-4, size=6))))
    jacobians = [None, None]
    close_loop._error(*observed, factor, values, jacobians)

    def error(motion):
        changed = gtsam.Values(values)
        changed.update(key, values.atPose3(key).compose(gtsam.Pose3.Expmap(motion)))
        return close_loop._error(*observed, factor, changed, None)

    expected = approx_fprime(np.zeros(6), error, 1e-7)
    # The frame of the comparison turns with the pose; the derivatives leave that out.
    np.testing.assert_allclose(jacobians[key], expected, rtol=1e-3, atol=0.01)


def test_the_example_prints_its_result_and_draws_it(close_loop, capsys, monkeypatch, tmp_path):
    picture = tmp_path / "loop.png"
    monkeypatch.setattr(sys, "argv", ["close_loop.py", str(picture)])
    close_loop.main()
    assert "pairs, KNOWN" in capsys.readouterr().out
    assert picture.stat().st_size > 10_000
