"""The examples do what they say."""

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import approx_fprime

from ellipseg_ros.association.landmark_map import select_landmarks
from ellipseg_ros.records import Verdict

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "close_loop.py"
gtsam = pytest.importorskip("gtsam", reason="no gtsam; pip install 'ellipseg_ros[slam]'")


@pytest.fixture(scope="module")
def close_loop():
    spec = importlib.util.spec_from_file_location("close_loop", EXAMPLE)
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
def test_the_derivatives_of_the_factor(close_loop, kind, key):
    rng = np.random.default_rng(kind)
    world = close_loop.town(rng)
    poses = close_loop.true_poses()[:2]
    one = select_landmarks(world, [np.flatnonzero(world.kind == kind)[0]])
    seen = [close_loop.moved(one, pose.inverse()) for pose in poses]
    factor = close_loop.landmark_factor(0, 1, *seen)
    values = gtsam.Values()
    for number, pose in enumerate(poses):
        values.insert(number, pose.compose(gtsam.Pose3.Expmap(rng.normal(scale=1e-4, size=6))))
    jacobians = [None, None]
    close_loop._error(*seen, factor, values, jacobians)

    def error(motion):
        changed = gtsam.Values(values)
        changed.update(key, values.atPose3(key).compose(gtsam.Pose3.Expmap(motion)))
        return close_loop._error(*seen, factor, changed, None)

    expected = approx_fprime(np.zeros(6), error, 1e-7)
    # As far as the frame of the comparison turns with the pose, which is no part of it.
    np.testing.assert_allclose(jacobians[key], expected, rtol=1e-3, atol=0.01)


def test_the_example_says_what_came_of_it_and_draws(close_loop, capsys, monkeypatch, tmp_path):
    picture = tmp_path / "loop.png"
    monkeypatch.setattr(sys, "argv", ["close_loop.py", str(picture)])
    close_loop.main()
    assert "pairs, KNOWN" in capsys.readouterr().out
    assert picture.stat().st_size > 10_000
