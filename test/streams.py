"""Random streams of sweeps, and the comparison of an update with the batch result."""

import numpy as np
from clouds import SECOND, street

from ellipseg_ros.records import Sweep
from ellipseg_ros.segmenter import segment


def assert_batch(found, config):
    """Assert that an update equals `segment` of the points in its window."""
    again = segment(found.points, config, found.origin)
    for name in ("labels", "aicc", "threshold", "criterion"):
        assert np.array_equal(getattr(found, name), getattr(again, name)), name
    for name, column in vars(again.ellipsoids).items():
        assert np.array_equal(getattr(found.ellipsoids, name), column), name
    named = ("ids", "state", "removed", "parents", "hierarchy")  # ids tell of the past
    for name in vars(again.objects).keys() - set(named):
        assert np.array_equal(getattr(found.objects, name), getattr(again.objects, name)), name
    for name, column in vars(again.objects.hierarchy).items():
        assert np.array_equal(getattr(found.objects.hierarchy, name), column), name


def wild_stream(rng, count, cloud=street, step=0.1):
    """Sweeps with bursts, one-point and empty ones, gaps, revisits, duplicates, late stamps,
    strays that come and go, and NaN."""
    now, old = 100.0, [cloud(30, rng)]
    for _ in range(count):
        now += step * rng.choice([0.0, 1.0, 1.0, 1.0, 3.0]) + (rng.random() < 0.03) * 12 * step
        kind = rng.random()
        if kind < 0.1:
            points = cloud(1, rng)
        elif kind < 0.15:
            points = np.zeros((0, 3))
        elif kind < 0.25:
            points = cloud(150, rng)
        elif kind < 0.4:
            points = old[int(rng.integers(len(old)))].copy()  # the same places again
        elif kind < 0.5:
            points = rng.uniform(-60, 60, (5, 3))  # strays
        else:
            points = cloud(int(rng.integers(2, 50)), rng)
        points[rng.random(len(points)) < 0.02] = np.nan
        old = [*old[-5:], points]
        late = rng.choice([0.0, 0.0, 0.5, 0.9]) * (rng.random() < 0.2)
        offsets = np.sort(rng.integers(0, round(step * SECOND), len(points)))
        yield Sweep(round((now - late) * SECOND), points, offsets)
