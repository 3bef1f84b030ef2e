"""Simple things of which landmarks are detected, for tests."""

import numpy as np
from scipy.spatial.transform import Rotation

from ellipseg_ros.segmenter import segment

NOISE = 0.015  # m


def wall(rng, n=4000, size=(6.0, 2.5)):
    """A noisy wall in the plane x = 3, seen at random places."""
    y, z = rng.uniform(0.0, size[0], n), rng.uniform(0.0, size[1], n)
    return np.column_stack([rng.normal(3.0, NOISE, n), y, z])


def trunk(rng, n=1500, radius=0.15, length=4.0, foot=(0.0, 0.0, 0.0), lean=0.0):
    """The half of a trunk that faces -x, which leans along y by `lean` radians."""
    turn, z = rng.uniform(0.5 * np.pi, 1.5 * np.pi, n), rng.uniform(0.0, length, n)
    r = radius + rng.normal(0.0, NOISE, n)
    points = np.column_stack([r * np.cos(turn), r * np.sin(turn), z])
    return points @ Rotation.from_euler("x", -lean).as_matrix().T + foot


def ball(rng, n=800, size=0.2, at=(0.0, 0.0, 1.0)):
    """A bush, as a cloud of leaves."""
    return rng.normal(0.0, size, (n, 3)) + at


def landmarks_of(*things, config=None):
    """The landmarks of a scene, its points in random order, as if a beam passed it many times.

    Most points are elsewhere, too sparse for landmarks.
    """
    rng = np.random.default_rng(0)
    elsewhere = rng.uniform(-100.0, 100.0, (4 * sum(map(len, things)), 3)) + [0.0, 0.0, 500.0]
    points = np.vstack([*things, elsewhere])
    return segment(points[rng.permutation(len(points))], config).landmarks
