"""Covariances of landmarks, and innovations normalised by them."""

import numpy as np
import pytest
from landmark_scenes import landmarks_of, trunk, wall
from scipy.spatial.transform import Rotation

from ellipseg_ros.config import Config, LandmarksConfig
from ellipseg_ros.landmarks import fits
from ellipseg_ros.landmarks.innovation import innovations, normalised_squares
from ellipseg_ros.records import DETERMINED


@pytest.mark.parametrize("thing", [wall, trunk])
def test_covariances_are_consistent_with_independent_errors(thing):
    config = Config(landmarks=LandmarksConfig(registration_noise=0.0))
    runs = [landmarks_of(thing(np.random.default_rng(s), n=400), config=config) for s in range(30)]
    runs = [run for run in runs if len(run) == 1]
    assert len(runs) > 20
    kind = np.array([run.kind[0] for run in runs])
    position, axes = (
        np.stack([getattr(r, name)[0] for r in runs]) for name in ("position", "axes")
    )
    truth = axes.copy()
    pole = 2 if thing is wall else 0
    for row, frame in enumerate(axes):
        right = [1.0, 0.0, 0.0] if thing is wall else [0.0, 0.0, 1.0]
        turn, _ = Rotation.align_vectors(
            [right], [frame[:, pole] * np.sign(frame[:, pole] @ right)]
        )
        truth[row] = turn.as_matrix() @ frame
    where = np.array([3.0, 0.0, 0.0]) if thing is wall else np.zeros(3)
    error = innovations(kind, (np.broadcast_to(where, position.shape), truth), (position, axes))
    covariance = np.stack([run.covariance[0] for run in runs])
    squared = normalised_squares(kind, error, covariance)
    assert 0.15 < squared.mean() < 1.6  # never too sure; planes have an allowance for crookedness


def test_correlated_errors_enlarge_the_covariance():
    rng = np.random.default_rng(12)
    n, matrix = 1600, np.diag([1600.0])
    alone = rng.normal(0.0, 1.0, n)
    common = np.repeat(rng.normal(0.0, 1.0, fits.CHUNKS), n // fits.CHUNKS)
    made = []
    for error in (alone, common):
        scores = error.reshape(fits.CHUNKS, -1).sum(axis=1)[:, None]
        made.append(
            fits.fit_covariance(matrix.copy(), scores, error.var())[0, 0] * n / error.var()
        )
    assert made[0] < 2.5
    assert 50.0 < made[1] < 150.0  # a hundred points are worth one


def test_normalised_innovation_of_right_covariances_is_one():
    rng = np.random.default_rng(13)
    n = 3000
    kind = rng.integers(0, 3, n).astype(np.uint8)
    axes = Rotation.random(n, random_state=3).as_matrix()
    position = rng.uniform(-10.0, 10.0, (n, 3))
    sigma = np.array([0.02, 0.03, 0.04, 0.004, 0.005, 0.006])
    covariance, motion = np.zeros((n, 6, 6)), np.zeros((n, 6))
    for which, wanted in DETERMINED.items():
        rows = np.flatnonzero(kind == which)
        for m in wanted:
            covariance[rows, m, m] = sigma[m] ** 2
            motion[rows, m] = rng.normal(0.0, sigma[m], len(rows))
    shifted = position - np.einsum("nij,nj->ni", axes, motion[:, :3])
    turned = axes @ Rotation.from_rotvec(-motion[:, 3:]).as_matrix()
    found = innovations(kind, (shifted, turned), (position, axes))
    assert np.abs(found - motion).max() < 2e-3  # up to products of small angles
    assert normalised_squares(kind, found, covariance).mean() == pytest.approx(1.0, abs=0.05)


def test_singular_covariances_are_enlarged():
    kind, covariance = np.array([2, 2], np.uint8), np.zeros((2, 6, 6))
    covariance[1, :3, :3] = np.eye(3)
    motion = np.array([[0.0] * 6, [1.0] * 3 + [0.0] * 3])
    assert normalised_squares(kind, motion, covariance).tolist() == [0.0, 1.0]
    covariance[1, :3, :3] = 1.0  # known across, without error, and free along (1, 1, 1)
    assert normalised_squares(kind, motion, covariance)[1] == pytest.approx(1.0 / 3.0)
