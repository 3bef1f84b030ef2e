"""Colours of segment ids and of shapes, for messages and pictures."""

import numpy as np

from ellipseg_ros.records import Array

NO_SEGMENT = (110, 110, 110)  # grey: points without a segment, id 0
GOLDEN = 0.618033988749895  # steps of the golden ratio keep successive hues far apart


def id_colours(ids: Array) -> Array:
    """A bright colour per id, equal in all updates and runs.

    ids: (n,) unsigned integers, 0 = no segment, which is grey. Returns (n, 3) uint8 RGB.
    """
    numbers = np.asarray(ids).astype(np.float64)
    hue = np.mod(numbers * GOLDEN, 1.0)
    saturation = 0.45 + 0.5 * np.mod(numbers * np.sqrt(2.0), 1.0)
    value = 0.72 + 0.28 * np.mod(numbers * np.sqrt(3.0), 1.0)
    rgb = np.rint(255.0 * _rgb(hue, saturation, value)).astype(np.uint8)
    rgb[np.asarray(ids) == 0] = NO_SEGMENT
    return rgb


def shape_colours(planarity: Array, cylindricality: Array, sphericity: Array) -> Array:
    """Colours of the paper's figure 3: red = cylinder, green = sphere, blue = plane.

    Shares (n,) each, which add to 1. Returns (n, 3) float64 RGB in 0...1, as square roots, so that
    mixtures are not dark.
    """
    shares = np.column_stack([cylindricality, sphericity, planarity])
    return np.asarray(np.sqrt(np.clip(shares, 0.0, 1.0)))


def _rgb(hue: Array, saturation: Array, value: Array) -> Array:
    """HSV, (n,) each in 0...1, to RGB (n, 3)."""
    sector = np.mod(hue[:, None] * 6.0 + np.array([5.0, 3.0, 1.0]), 6.0)
    dip = np.clip(np.minimum(sector, 4.0 - sector), 0.0, 1.0)
    return np.asarray(value[:, None] * (1.0 - saturation[:, None] * dip))
