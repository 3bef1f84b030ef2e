"""Seeded clouds and streams of sweeps."""

import numpy as np

from ellipseg_ros.records import Sweep

SECOND = 1_000_000_000


def street(n, rng):
    """n points: a ground, a wall, poles, a ball of leaves and some strays, noise 2 cm."""
    kind = rng.integers(0, 5, n)
    u, v = rng.uniform(-6, 6, n), rng.uniform(0, 4, n)
    ball = rng.normal(size=(n, 3))
    points = np.where(
        (kind == 0)[:, None],
        np.column_stack([u, 3 * v - 6, np.zeros(n)]),
        np.where(
            (kind == 1)[:, None],
            np.column_stack([u, np.full(n, 6.0), v]),
            np.where(
                (kind == 2)[:, None],
                np.column_stack([np.round(u / 4) * 4, np.full(n, 3.0), v]),
                np.where((kind == 3)[:, None], ball + [3.0, -3.0, 3.0], 9 * ball),
            ),
        ),
    )
    return points + rng.normal(scale=0.02, size=(n, 3))


def grid(n, rng):
    """n points with many equal distances and some equal places."""
    return rng.integers(0, 6, (n, 3)) * 0.5


def stream(rng, sweeps=30, size=60):
    """Sweeps 0.1 s apart that move through a street, uneven, some late, some with NaN."""
    for number in range(sweeps):
        n = int(rng.integers(1, size))
        points = street(n, rng) + [0.2 * number, 0.0, 0.0]
        points[rng.random(n) < 0.02] = np.nan
        late = int(rng.integers(0, 3)) if rng.random() < 0.2 else 0
        offsets = rng.integers(0, SECOND // 10, n)
        yield Sweep((100 + number - late) * SECOND // 10, points, offsets)
