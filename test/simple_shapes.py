"""Single simple items for tests: a sweep, and the item of every point."""

import numpy as np

from ellipseg_ros.records import Array, Sweep
from ellipseg_ros.simulation.scanner import HEIGHT

NOISE = 0.015  # m, along the beam
SCANNER = np.array([0.0, 0.0, HEIGHT])  # m


def wall(
    rng: np.random.Generator, width: float = 10.0, height: float = 4.0, density: float = 60.0
) -> tuple[Sweep, Array]:
    """Sample an upright wall across x, 8 m ahead, at `density` points per square metre.

    Returns the sweep and the item of every point, (n,) uint32, all 1.
    """
    count = round(width * height * density)
    y, z = rng.uniform([-0.5 * width, 0.0], [0.5 * width, height], (count, 2)).T
    return _seen([np.column_stack([np.full(count, 8.0), y, z])], rng)


def trunk(
    rng: np.random.Generator, radius: float = 0.2, height: float = 6.0, density: float = 150.0
) -> tuple[Sweep, Array]:
    """Sample the near side of an upright stem 6 m ahead, at `density` points per square metre.

    Returns the sweep and the item of every point, (n,) uint32, all 1.
    """
    count = round(np.pi * radius * height * density)
    turn = rng.uniform(0.5 * np.pi, 1.5 * np.pi, count)
    z = rng.uniform(0.0, height, count)
    return _seen([np.column_stack([6.0 + radius * np.cos(turn), radius * np.sin(turn), z])], rng)


def boxes(
    rng: np.random.Generator, gap: float, count: int = 4, density: float = 120.0
) -> tuple[Sweep, Array]:
    """Sample a row of boxes with edges of 1 m, `gap` metres apart: the faces in front and on top.

    Returns the sweep and the box of every point, (n,) uint32, from 1.
    """
    each = round(2.0 * density)
    parts = []
    for k in range(count):
        u, v = rng.uniform(0.0, 1.0, (2, each))
        front = np.arange(each) % 2 == 0
        y = k * (1.0 + gap) - 0.5 * count * (1.0 + gap) + u
        parts.append(np.column_stack([np.where(front, 6.0, 6.0 + v), y, np.where(front, v, 1.0)]))
    return _seen(parts, rng)


def _seen(parts: list[Array], rng: np.random.Generator) -> tuple[Sweep, Array]:
    """A sweep of all parts in random order, with range noise, and the part of every point."""
    points = np.concatenate(parts)
    truth = np.repeat(np.arange(1, len(parts) + 1), [len(part) for part in parts])
    beam = points - SCANNER
    beam /= np.linalg.norm(beam, axis=1, keepdims=True)
    points += NOISE * rng.standard_normal((len(points), 1)) * beam
    order = rng.permutation(len(points))
    sweep = Sweep(0, points[order], frame_id="odom")
    return sweep, truth[order].astype(np.uint32)
