"""Houses and sheds, with the frame at the middle of the foot of the front; y points inside."""

import numpy as np

from ellipseg_ros.simulation.shapes import ORIGIN, Class, Item, Material, Vector

STONE = Material(Class.WALL, 0.45)
SHEET = Material(Class.WALL, 0.5)
FRONT = Material(Class.WALL, 0.45, windows=True)
FOUNDATION = 1.5  # m below the foot of the front, so that no house floats on a slope


def house(item: Item, size: tuple[float, float], rng: np.random.Generator) -> None:
    """Windows, a gabled roof with eaves, chimney, steps, drain pipes."""
    wide, deep = size
    high = 3.0 * int(rng.integers(2, 4))
    _walls(item, (wide, deep, high), 0.2, 0.1)
    _gable(item, (wide, deep), high)
    item.box(STONE, (0.3 * wide, 0.65 * deep, high + 0.35 * deep), (0.7, 0.7, 0.4 * deep))
    item.box(STONE, (0.0, -0.5, 0.15), (1.5, 1.0, 0.3))
    item.box(STONE, (0.0, -0.45, 2.5), (1.8, 0.9, 0.12))
    for x in (-0.5 * wide + 0.15, 0.5 * wide - 0.15):
        item.cone(STONE, ((x, -0.07, 0.0), (x, -0.07, high)), (0.05, 0.05))


def _walls(item: Item, size: Vector, base: float, margin: float) -> None:
    """Walls with windows on a foundation that is `base` m high, wider by `margin` m."""
    wide, deep, high = size
    item.box(FRONT, (0.0, 0.5 * deep, 0.5 * high), size)
    centre = (0.0, 0.5 * deep, -0.5 * FOUNDATION + base)
    item.box(STONE, centre, (wide + margin, deep + margin, FOUNDATION))


def _gable(item: Item, size: tuple[float, float], high: float) -> None:
    """A gabled roof: two slabs that meet at a ridge along x."""
    wide, deep = size
    slope = np.radians(35.0)
    length = (0.5 * deep + 0.5) / np.cos(slope)
    for turn, y in ((0.5 * np.pi, 0.25 * deep - 0.25), (-0.5 * np.pi, 0.75 * deep + 0.25)):
        slab = item.moved((0.0, y, high + 0.25 * deep * np.tan(slope)), turn)
        slab.box(STONE, ORIGIN, (length, wide + 0.6, 0.18), pitch=-slope)
    for side in (-1.0, 1.0):  # the triangles under the ridge, as steps
        for k in range(5):
            share = (k + 0.5) / 5.0
            z = high + 0.5 * deep * np.tan(slope) * share
            edges = (0.2, deep * (1.0 - share), 0.1 * deep * np.tan(slope))
            item.box(STONE, (side * (0.5 * wide - 0.1), 0.5 * deep, z), edges)


def block(item: Item, size: tuple[float, float], rng: np.random.Generator) -> None:
    """A flat-roofed block with windows, ledges between the storeys and balconies."""
    wide, deep = size
    storeys = int(rng.integers(3, 5))
    high = 3.1 * storeys
    _walls(item, (wide, deep, high), 0.3, 0.16)
    item.box(STONE, (0.0, 0.5 * deep, high), (wide + 0.5, deep + 0.5, 0.35))
    for k in range(1, storeys):
        item.box(STONE, (0.0, -0.04, 3.1 * k), (wide, 0.16, 0.18))
        for x in (-0.27 * wide, 0.27 * wide):
            item.box(STONE, (x, -0.55, 3.1 * k), (2.6, 1.1, 0.15))
            item.box(STONE._replace(density=6.0), (x, -1.07, 3.1 * k + 0.5), (2.6, 0.06, 0.9))


def shed(item: Item, size: Vector, rng: np.random.Generator) -> None:
    """An industrial hall: ribs, a parapet, docks with canopies, a strip of office windows."""
    wide, deep, high = size
    item.box(SHEET, (0.0, 0.5 * deep, 0.5 * high - 0.5), (wide, deep, high + 1.0))
    item.box(SHEET, (0.0, 0.5 * deep, high), (wide + 0.3, deep + 0.3, 0.5))
    for x in np.arange(-0.5 * wide, 0.5 * wide + 0.1, 5.0):
        item.box(SHEET, (float(x), -0.08, 0.5 * high), (0.3, 0.3, high))
    for x in np.arange(-0.5 * wide + 4.5, 0.5 * wide - 3.0, 8.0):
        _dock(item.moved((float(x), 0.0, 0.0)), rng.uniform(3.0, 3.8))
    office = 0.5 * wide - 2.6
    item.box(FRONT, (office, -1.5, 3.2), (5.6, 3.0, 6.4))


def _dock(item: Item, high: float) -> None:
    """A gate between posts under a canopy."""
    for x in (-1.7, 1.7):
        item.box(SHEET, (x, -0.25, 0.5 * high), (0.35, 0.5, high))
    item.box(SHEET, (0.0, -0.25, high), (3.8, 0.5, 0.4))
    item.box(SHEET, (0.0, -0.9, high + 0.6), (4.6, 1.8, 0.12))
    item.box(SHEET, (0.0, -0.15, 0.5), (2.9, 0.3, 1.0))
