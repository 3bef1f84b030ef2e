"""Items of streets and yards: vehicles, people, posts, wires, fences, goods."""

from itertools import pairwise

import numpy as np

from ellipseg_ros.records import Array
from ellipseg_ros.simulation.shapes import ORIGIN, Class, Item, Material

METAL = Material(Class.POLE, 0.45)
WIRE = Material(Class.WIRE, 0.5)
MESH = Material(Class.WALL, 0.5, density=9.0)  # a sheet of 5 cm stops a third of the beams
PANELS = Material(Class.WALL, 0.4)
SHEET = Material(Class.WALL, 0.5)
SKIN = Material(Class.PERSON, 0.4)
TYRE = Material(Class.VEHICLE, 0.12)
SCREEN = Material(Class.VEHICLE, 0.1)  # glass: few returns
GOODS = Material(Class.OTHER, 0.45)


def car(item: Item, rng: np.random.Generator) -> None:
    """Body, cabin with sloping screens, four wheels."""
    paint = Material(Class.VEHICLE, rng.uniform(0.2, 0.6))
    long, wide, high = rng.uniform(3.9, 4.7), rng.uniform(1.68, 1.85), rng.uniform(1.4, 1.6)
    deck = 0.6 * high
    item.box(paint, (0.0, 0.0, 0.5 * (deck + 0.25)), (long, wide, deck - 0.25))
    roof = 0.36 * long
    item.box(paint, (-0.06 * long, 0.0, high - 0.05), (roof, wide - 0.35, 0.1))
    item.box(SCREEN, (-0.06 * long, 0.0, 0.5 * (deck + high)), (roof, wide - 0.25, high - deck))
    for sign in (1.0, -1.0):
        x = -0.06 * long + sign * (0.5 * roof + 0.2)
        edges = (0.06, wide - 0.3, 0.75)
        item.box(SCREEN, (x, 0.0, 0.5 * (deck + high)), edges, pitch=-0.85 * sign)
    _wheels(item, (0.32 * long, -0.32 * long), wide, 0.32)


def lorry(item: Item, rng: np.random.Generator) -> None:
    """Cab and a closed body on a chassis."""
    paint = Material(Class.VEHICLE, rng.uniform(0.3, 0.6))
    long = rng.uniform(5.0, 7.5)
    item.box(paint, (0.0, 0.0, 2.3), (long, 2.45, 2.5))
    item.box(TYRE, (0.6, 0.0, 0.85), (long + 2.0, 0.9, 0.25))
    front = 0.5 * long + 1.1
    item.box(paint, (front, 0.0, 1.25), (1.8, 2.3, 1.3))
    item.box(paint, (front - 0.15, 0.0, 2.3), (1.5, 2.2, 0.9))
    _wheels(item, (front, -0.3 * long, -0.3 * long - 1.1), 2.4, 0.48)


def _wheels(item: Item, places: tuple[float, ...], wide: float, radius: float) -> None:
    for x in places:
        for side in (-0.5 * wide, 0.5 * wide - 0.22):
            ends = ((x, side, radius), (x, side + 0.22, radius))
            item.cone(TYRE, ends, (radius, radius))


def person(item: Item, rng: np.random.Generator) -> None:
    """Two legs, a trunk with arms, a head."""
    tall = rng.uniform(1.6, 1.9)
    for y in (-0.1, 0.1):
        step = rng.uniform(-0.15, 0.15)
        item.cone(SKIN, ((step, y, 0.0), (0.0, 0.8 * y, 0.48 * tall)), (0.06, 0.09))
        item.cone(SKIN, ((-step, 3.0 * y, 0.45 * tall), (0.0, 2.1 * y, 0.8 * tall)), (0.04, 0.06))
    item.ellipsoid(SKIN, (0.0, 0.0, 0.66 * tall), (0.14, 0.21, 0.2 * tall))
    item.ellipsoid(SKIN, (0.0, 0.0, 0.93 * tall), (0.1, 0.09, 0.12))


def lamp(item: Item, height: float = 7.0) -> None:
    """A street lamp whose arm reaches along y."""
    item.cone(METAL, (ORIGIN, (0.0, 0.0, 0.95 * height)), (0.11, 0.06))
    item.cone(METAL, ((0.0, 0.0, 0.95 * height), (0.0, 1.6, height)), (0.05, 0.04))
    item.box(METAL, (0.0, 1.9, height), (0.3, 0.75, 0.14))


def sign(item: Item, rng: np.random.Generator) -> None:
    """A traffic sign across x."""
    height = rng.uniform(2.2, 2.8)
    item.cone(METAL, (ORIGIN, (0.0, 0.0, height)), (0.035, 0.035))
    item.box(METAL._replace(reflectivity=0.9), (-0.06, 0.0, height - 0.3), (0.03, 0.6, 0.6))


def bollard(item: Item) -> None:
    """A stout low post."""
    item.cone(METAL, (ORIGIN, (0.0, 0.0, 1.0)), (0.1, 0.1))


def mast(item: Item, height: float = 8.5) -> None:
    """A wooden mast with a crossarm along y."""
    item.cone(METAL, (ORIGIN, (0.0, 0.0, height)), (0.16, 0.11))
    item.box(METAL, (0.0, 0.0, height - 0.4), (0.12, 2.2, 0.14))


def wire(item: Item, start: Array, end: Array, parts: int = 8) -> None:
    """A sagging wire; thicker than in reality, like the spot of the beam."""
    share = np.linspace(0.0, 1.0, parts + 1)[:, None]
    nodes = start + share * (end - start) - np.array([0.0, 0.0, 3.2]) * share * (1.0 - share)
    for ends in pairwise(nodes):
        item.cone(WIRE, ends, (0.03, 0.03))


def mesh_fence(item: Item, length: float = 3.0, height: float = 2.2) -> None:
    """Wire mesh along x from the frame on, on posts."""
    item.box(MESH, (0.5 * length, 0.0, 0.5 * height), (length, 0.05, height))
    for x in (0.0, 0.5 * length):
        item.cone(SHEET, ((x, 0.0, 0.0), (x, 0.0, height + 0.1)), (0.04, 0.04))


def plank_fence(item: Item, length: float = 3.0, height: float = 1.1) -> None:
    """Planks with gaps along x from the frame on."""
    for z in (0.3 * height, 0.85 * height):
        item.box(PANELS, (0.5 * length, 0.0, z), (length, 0.06, 0.14))
    for x in np.arange(0.1, length, 0.24):
        item.box(PANELS, (float(x), 0.05, 0.5 * height), (0.12, 0.03, height))


def low_wall(item: Item, length: float, height: float = 0.9) -> None:
    """A garden wall with a coping, along x from the frame on."""
    item.box(PANELS, (0.5 * length, 0.0, 0.5 * height), (length, 0.24, height))
    item.box(PANELS, (0.5 * length, 0.0, height), (length, 0.36, 0.1))


def bench(item: Item) -> None:
    """Seat and back along x, facing y."""
    item.box(GOODS, (0.0, 0.0, 0.45), (1.6, 0.45, 0.06))
    item.box(GOODS, (0.0, -0.25, 0.72), (1.6, 0.06, 0.4))
    for x in (-0.65, 0.65):
        item.box(GOODS, (x, 0.0, 0.22), (0.08, 0.4, 0.44))


def bin_(item: Item) -> None:
    """A wheeled rubbish bin."""
    item.box(GOODS, (0.0, 0.0, 0.55), (0.55, 0.6, 1.1))


def pallets(item: Item, rng: np.random.Generator) -> None:
    """A stack of goods on pallets."""
    for k in range(int(rng.integers(1, 4))):
        turned = item.moved((0.0, 0.0, 0.95 * k), float(rng.normal(0.0, 0.05)))
        turned.box(GOODS, (0.0, 0.0, 0.08), (1.2, 1.0, 0.14))
        turned.box(GOODS, (0.0, 0.0, 0.54), (1.15, 0.95, 0.78))


def container(item: Item, storey: int, long: float = 6.06) -> None:
    """A shipping container along x, as number `storey` of a stack."""
    shift, middle = 0.03 * storey, 2.6 * storey + 1.3
    item.box(PANELS, (shift, 0.0, middle), (long, 2.44, 2.55))
    for x in np.linspace(-0.5 * long, 0.5 * long, 9):
        item.box(PANELS, (x + shift, 0.0, middle), (0.12, 2.5, 2.59))


def tank(item: Item, radius: float, height: float) -> None:
    """An upright round tank with a flat roof and a ladder."""
    item.cone(SHEET, (ORIGIN, (0.0, 0.0, height)), (radius, radius))
    for y in (-0.25, 0.25):
        item.cone(SHEET, ((-radius - 0.2, y, 0.0), (-radius - 0.2, y, height)), (0.04, 0.04))


def pipe_rack(item: Item, length: float = 15.0, height: float = 3.6) -> None:
    """Pipes along x from the frame on, side by side on gantries."""
    for x in np.arange(0.0, length + 0.1, length / 3.0):
        for y in (-0.8, 0.8):
            item.box(METAL, (float(x), y, 0.5 * height), (0.2, 0.2, height))
        item.box(METAL, (float(x), 0.0, height), (0.2, 2.2, 0.2))
    for y, radius in ((-0.6, 0.17), (0.0, 0.24), (0.65, 0.13)):
        z = height + 0.1 + radius
        item.cone(GOODS, ((0.0, y, z), (length, y, z)), (radius, radius))
