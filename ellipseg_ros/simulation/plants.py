"""Trees and bushes: solid wood, and porous foliage."""

import numpy as np

from ellipseg_ros.simulation.shapes import Class, Item, Material

BARK = Material(Class.POLE, 0.35)
FALLEN = Material(Class.OTHER, 0.3)
LEAVES = Material(Class.VEGETATION, 0.1, density=0.6)
NEEDLES = Material(Class.VEGETATION, 0.09, density=0.8)
SHRUB = Material(Class.VEGETATION, 0.3, density=2.5)


def broadleaf(item: Item, rng: np.random.Generator, height: float) -> None:
    """Stem, boughs, and a crown of several clumps of leaves."""
    thick = 0.016 * height * rng.uniform(0.8, 1.3)
    lean = rng.normal(0.0, 0.02 * height, 2)
    fork = (float(lean[0]), float(lean[1]), 0.42 * height)
    item.cone(BARK, ((0.0, 0.0, -0.1), fork), (thick, 0.75 * thick))
    top = (1.3 * fork[0], 1.3 * fork[1], 0.8 * height)
    item.cone(BARK, (fork, top), (0.7 * thick, 0.2 * thick))
    spread = height * rng.uniform(0.16, 0.22)
    boughs = int(rng.integers(4, 7))
    for k in range(boughs):
        turn = 2.0 * np.pi * (k + rng.uniform(-0.3, 0.3)) / boughs
        out = spread * rng.uniform(0.5, 0.9)
        start = rng.uniform(0.0, 0.4)
        foot = tuple(a + start * (b - a) for a, b in zip(fork, top, strict=True))
        tip = (
            fork[0] + out * np.cos(turn),
            fork[1] + out * np.sin(turn),
            height * rng.uniform(0.6, 0.78),
        )
        item.cone(BARK, (foot, tip), (0.35 * thick, 0.1 * thick))
        size = spread * rng.uniform(0.5, 0.75)
        item.ellipsoid(LEAVES, tip, (size, size, 0.75 * size))
    item.ellipsoid(LEAVES, (*top[:2], 0.82 * height), (0.8 * spread, 0.8 * spread, 0.17 * height))


def conifer(item: Item, rng: np.random.Generator, height: float) -> None:
    """Straight stem, a bare foot with dead twigs, whorls of needles that narrow upwards."""
    thick = 0.013 * height * rng.uniform(0.8, 1.3)
    item.cone(BARK, ((0.0, 0.0, -0.1), (0.0, 0.0, 0.97 * height)), (thick, 0.15 * thick))
    bare = rng.uniform(0.22, 0.42)
    for z in rng.uniform(0.12, bare, 5) * height:
        turn, out = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(0.5, 1.2)
        tip = (out * np.cos(turn), out * np.sin(turn), z + rng.uniform(-0.2, 0.3))
        item.cone(BARK, ((0.0, 0.0, z), tip), (0.03, 0.02))
    widest = height * rng.uniform(0.1, 0.14)
    whorls = 6
    for k in range(whorls):
        share = (k + 0.5) / whorls
        wide = widest * (1.1 - share)
        z = height * (bare + share * (1.0 - bare))
        item.ellipsoid(NEEDLES, (0.0, 0.0, z), (wide, wide, 0.6 * height * (1.0 - bare) / whorls))


def bush(item: Item, rng: np.random.Generator, size: float) -> None:
    """A few clumps of leaves on the ground, about `size` metres high."""
    for _ in range(int(rng.integers(2, 5))):
        x, y = rng.normal(0.0, 0.35 * size, 2)
        wide, high = size * rng.uniform(0.45, 0.7), size * rng.uniform(0.4, 0.6)
        item.ellipsoid(SHRUB, (x, y, 0.8 * high), (wide, wide, high))


def hedge(item: Item, length: float, height: float) -> None:
    """A clipped hedge along x, centred at the frame."""
    leaves = SHRUB._replace(density=5.0)
    item.box(leaves, (0.0, 0.0, 0.5 * height), (length, 0.7, height))


def log(item: Item, rng: np.random.Generator) -> None:
    """A fallen stem."""
    half, thick = rng.uniform(1.2, 3.5), rng.uniform(0.12, 0.3)
    ends = ((-half, 0.0, 0.8 * thick), (half, 0.0, 0.8 * thick))
    item.cone(FALLEN, ends, (thick, 0.75 * thick))


def boulder(item: Item, rng: np.random.Generator) -> None:
    """A rock half in the ground."""
    size = rng.uniform(0.3, 0.9)
    item.ellipsoid(FALLEN, (0.0, 0.0, 0.15 * size), (size, 0.8 * size, 0.65 * size))
