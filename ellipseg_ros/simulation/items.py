"""Items of streets and yards: vehicles, people, posts, wires, fences, goods."""

import numpy as np

from ellipseg_ros.records import Array
from ellipseg_ros.simulation.shapes import Class, Frame, Material, Model

METAL = Material(Class.POLE, 0.45)
WIRE = Material(Class.WIRE, 0.5)
MESH = Material(Class.WALL, 0.5, density=9.0)  # a sheet of 5 cm stops a third of the beams
PLANKS = Material(Class.WALL, 0.4)
SKIN = Material(Class.PERSON, 0.4)
TYRE = Material(Class.VEHICLE, 0.12)
SCREEN = Material(Class.VEHICLE, 0.1)  # glass: few returns
GOODS = Material(Class.OTHER, 0.45)


def car(model: Model, at: Frame, rng: np.random.Generator) -> None:
    """Body, cabin with sloping screens, four wheels."""
    model.begin()
    paint = Material(Class.VEHICLE, rng.uniform(0.2, 0.6))
    long, wide, high = rng.uniform(3.9, 4.7), rng.uniform(1.68, 1.85), rng.uniform(1.4, 1.6)
    deck = 0.6 * high
    model.box(at, paint, (0.0, 0.0, 0.5 * (deck + 0.25)), (long, wide, deck - 0.25))
    roof = 0.36 * long
    model.box(at, paint, (-0.06 * long, 0.0, high - 0.05), (roof, wide - 0.35, 0.1))
    model.box(
        at, SCREEN, (-0.06 * long, 0.0, 0.5 * (deck + high)), (roof, wide - 0.25, high - deck)
    )
    for sign in (1.0, -1.0):
        x = -0.06 * long + sign * (0.5 * roof + 0.2)
        edges = (0.06, wide - 0.3, 0.75)
        model.box(at, SCREEN, (x, 0.0, 0.5 * (deck + high)), edges, pitch=-0.85 * sign)
    _wheels(model, at, (0.32 * long, -0.32 * long), wide, 0.32)


def lorry(model: Model, at: Frame, rng: np.random.Generator) -> None:
    """Cab and a closed body on a chassis."""
    model.begin()
    paint = Material(Class.VEHICLE, rng.uniform(0.3, 0.6))
    long = rng.uniform(5.0, 7.5)
    model.box(at, paint, (0.0, 0.0, 2.3), (long, 2.45, 2.5))
    model.box(at, TYRE, (0.6, 0.0, 0.85), (long + 2.0, 0.9, 0.25))
    front = 0.5 * long + 1.1
    model.box(at, paint, (front, 0.0, 1.25), (1.8, 2.3, 1.3))
    model.box(at, paint, (front - 0.15, 0.0, 2.3), (1.5, 2.2, 0.9))
    _wheels(model, at, (front, -0.3 * long, -0.3 * long - 1.1), 2.4, 0.48)


def _wheels(
    model: Model, at: Frame, places: tuple[float, ...], wide: float, radius: float
) -> None:
    for x in places:
        for side in (-0.5 * wide, 0.5 * wide - 0.22):
            ends = ((x, side, radius), (x, side + 0.22, radius))
            model.cone(at, TYRE, ends, (radius, radius))


def person(model: Model, at: Frame, rng: np.random.Generator) -> None:
    """Two legs, a trunk with arms, a head."""
    model.begin()
    tall = rng.uniform(1.6, 1.9)
    for y in (-0.1, 0.1):
        step = rng.uniform(-0.15, 0.15)
        model.cone(at, SKIN, ((step, y, 0.0), (0.0, 0.8 * y, 0.48 * tall)), (0.06, 0.09))
        model.cone(
            at, SKIN, ((-step, 3.0 * y, 0.45 * tall), (0.0, 2.1 * y, 0.8 * tall)), (0.04, 0.06)
        )
    model.ellipsoid(at, SKIN, (0.0, 0.0, 0.66 * tall), (0.14, 0.21, 0.2 * tall))
    model.ellipsoid(at, SKIN, (0.0, 0.0, 0.93 * tall), (0.1, 0.09, 0.12))


def lamp(model: Model, at: Frame, height: float = 7.0) -> None:
    """A street lamp whose arm reaches along y."""
    model.begin()
    model.cone(at, METAL, ((0.0, 0.0, 0.0), (0.0, 0.0, 0.95 * height)), (0.11, 0.06))
    model.cone(at, METAL, ((0.0, 0.0, 0.95 * height), (0.0, 1.6, height)), (0.05, 0.04))
    model.box(at, METAL, (0.0, 1.9, height), (0.3, 0.75, 0.14))


def sign(model: Model, at: Frame, rng: np.random.Generator) -> None:
    """A traffic sign across x."""
    model.begin()
    height = rng.uniform(2.2, 2.8)
    model.cone(at, METAL, ((0.0, 0.0, 0.0), (0.0, 0.0, height)), (0.035, 0.035))
    model.box(at, METAL._replace(reflectivity=0.9), (-0.06, 0.0, height - 0.3), (0.03, 0.6, 0.6))


def bollard(model: Model, at: Frame) -> None:
    """A stout low post."""
    model.begin()
    model.cone(at, METAL, ((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)), (0.1, 0.1))


def masts_and_wires(model: Model, frames: list[Frame], height: float = 8.5) -> None:
    """Wooden masts with crossarms along y, and three sagging wires between each two."""
    for at in frames:
        model.begin()
        model.cone(at, METAL, ((0.0, 0.0, 0.0), (0.0, 0.0, height)), (0.16, 0.11))
        model.box(at, METAL, (0.0, 0.0, height - 0.4), (0.12, 2.2, 0.14))
    for one, other in zip(frames, frames[1:], strict=False):
        for y in (-1.0, 0.0, 1.0):
            model.begin()
            _wire(model, one.point((0.0, y, height - 0.2)), other.point((0.0, y, height - 0.2)))


def _wire(model: Model, start: Array, end: Array, parts: int = 8) -> None:
    """A sagging wire; thicker than in reality, like the spot of the beam."""
    world = Frame(np.zeros(3), np.eye(3))
    share = np.linspace(0.0, 1.0, parts + 1)[:, None]
    nodes = start + share * (end - start) - np.array([0.0, 0.0, 3.2]) * share * (1.0 - share)
    ends = [(float(x), float(y), float(z)) for x, y, z in nodes]
    for one, other in zip(ends, ends[1:], strict=False):
        model.cone(world, WIRE, (one, other), (0.03, 0.03))


def mesh_fence(model: Model, at: Frame, length: float, height: float = 2.2) -> None:
    """Wire mesh along x from the frame on, on posts."""
    model.begin()
    model.box(at, MESH, (0.5 * length, 0.0, 0.5 * height), (length, 0.05, height))
    for x in (0.0, 0.5 * length):
        model.cone(
            at, MESH._replace(density=0.0), ((x, 0.0, 0.0), (x, 0.0, height + 0.1)), (0.04, 0.04)
        )


def plank_fence(model: Model, at: Frame, length: float, height: float = 1.1) -> None:
    """Planks with gaps along x from the frame on."""
    model.begin()
    for z in (0.3 * height, 0.85 * height):
        model.box(at, PLANKS, (0.5 * length, 0.0, z), (length, 0.06, 0.14))
    for x in np.arange(0.1, length, 0.24):
        model.box(at, PLANKS, (float(x), 0.05, 0.5 * height), (0.12, 0.03, height))


def low_wall(model: Model, at: Frame, length: float, height: float = 0.9) -> None:
    """A garden wall with a coping, along x from the frame on."""
    model.begin()
    model.box(at, PLANKS, (0.5 * length, 0.0, 0.5 * height), (length, 0.24, height))
    model.box(at, PLANKS, (0.5 * length, 0.0, height), (length, 0.36, 0.1))


def bench(model: Model, at: Frame) -> None:
    """Seat and back along x, facing y."""
    model.begin()
    model.box(at, GOODS, (0.0, 0.0, 0.45), (1.6, 0.45, 0.06))
    model.box(at, GOODS, (0.0, -0.25, 0.72), (1.6, 0.06, 0.4))
    for x in (-0.65, 0.65):
        model.box(at, GOODS, (x, 0.0, 0.22), (0.08, 0.4, 0.44))


def bin_(model: Model, at: Frame) -> None:
    """A wheeled rubbish bin."""
    model.begin()
    model.box(at, GOODS, (0.0, 0.0, 0.55), (0.55, 0.6, 1.1))


def pallets(model: Model, at: Frame, rng: np.random.Generator) -> None:
    """A stack of goods on pallets."""
    model.begin()
    for k in range(int(rng.integers(1, 4))):
        turned = at.moved((0.0, 0.0, 0.95 * k), float(rng.normal(0.0, 0.05)))
        model.box(turned, GOODS, (0.0, 0.0, 0.08), (1.2, 1.0, 0.14))
        model.box(turned, GOODS, (0.0, 0.0, 0.54), (1.15, 0.95, 0.78))


def container(model: Model, at: Frame, storeys: int, long: float = 6.06) -> None:
    """Stacked shipping containers, along x."""
    for k in range(storeys):
        model.begin()
        steel = Material(Class.WALL, 0.4)
        model.box(at, steel, (0.03 * k, 0.0, 2.6 * k + 1.3), (long, 2.44, 2.55))
        for x in np.linspace(-0.5 * long, 0.5 * long, 9):
            model.box(at, steel, (float(x) + 0.03 * k, 0.0, 2.6 * k + 1.3), (0.12, 2.5, 2.59))


def tank(model: Model, at: Frame, radius: float, height: float) -> None:
    """An upright round tank with a flat roof and a ladder."""
    model.begin()
    steel = Material(Class.WALL, 0.5)
    model.cone(at, steel, ((0.0, 0.0, 0.0), (0.0, 0.0, height)), (radius, radius))
    for y in (-0.25, 0.25):
        model.cone(at, steel, ((-radius - 0.2, y, 0.0), (-radius - 0.2, y, height)), (0.04, 0.04))


def pipe_rack(model: Model, at: Frame, length: float, height: float = 3.6) -> None:
    """Pipes along x from the frame on, side by side on gantries."""
    model.begin()
    for x in np.arange(0.0, length + 0.1, length / 3.0):
        for y in (-0.8, 0.8):
            model.box(at, METAL, (float(x), y, 0.5 * height), (0.2, 0.2, height))
        model.box(at, METAL, (float(x), 0.0, height), (0.2, 2.2, 0.2))
    for y, radius in ((-0.6, 0.17), (0.0, 0.24), (0.65, 0.13)):
        z = height + 0.1 + radius
        steel = GOODS
        model.cone(at, steel, ((0.0, y, z), (length, y, z)), (radius, radius))
