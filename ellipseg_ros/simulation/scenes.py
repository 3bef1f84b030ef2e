"""The four scenes of the paper, laid out along a lane: s along it, d to its left, in metres.

Every row of things draws from a generator of its own and goes up in s, so that a longer drive
begins as a shorter one with the same seed does.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from ellipseg_ros.data import Array
from ellipseg_ros.simulation import buildings, plants, things
from ellipseg_ros.simulation.rays import Terrain
from ellipseg_ros.simulation.scanner import Path, make_path
from ellipseg_ros.simulation.shapes import Class, Material, Model, Shapes

BEFORE, AFTER = 40.0, 110.0  # m of scene behind the start and beyond the end
PAVING = Material(Class.GROUND, 0.35)
INWARD = np.pi  # yaw of a thing on the right side whose y looks away from the lane


@dataclass(frozen=True)
class Site:
    """A scene while it is laid out."""

    model: Model
    path: Path
    end: float  # m: greatest s
    seed: int
    rows: Iterator[int]  # number of the next row of things

    def rng(self) -> np.random.Generator:
        """Return a generator for one row of things."""
        return np.random.default_rng((self.seed, 1, next(self.rows)))

    def each(self, spacing: float) -> Array:
        """(n,) m: places along the lane."""
        return np.arange(self.path.start + 3.0, self.end - 3.0, spacing)


@dataclass(frozen=True)
class Layout:
    """What makes a scene: its ground and what is put on it."""

    build: Callable[[Site], None]
    swing: float  # rad: how far the lane's heading swings
    hills: float  # m: height of the long waves of the ground
    bumps: float  # m: height of the short ones
    soil: float  # reflectivity of the ground


@dataclass(frozen=True)
class World:
    """A scene to drive through."""

    path: Path
    shapes: Shapes
    soil: float  # reflectivity of the ground


def make_world(name: str, length: float, seed: int) -> World:
    """Lay out the scene `name` for a drive of `length` metres."""
    layout = LAYOUTS[name]
    terrain = _terrain(layout, np.random.default_rng((seed, 0)))
    path = make_path(terrain, -BEFORE, length + AFTER, layout.swing)
    site = Site(Model(), path, length + AFTER, seed, iter(range(1000)))
    layout.build(site)
    return World(path, site.model.shapes(), layout.soil)


def _terrain(layout: Layout, rng: np.random.Generator) -> Terrain:
    lengths = np.array([61.0, 43.0, 29.0, 19.0, 3.1, 1.7, 0.9])
    heights = np.array([1.0, 0.7, 0.5, 0.3, 0.0, 0.0, 0.0]) * layout.hills
    heights += np.array([0.0, 0.0, 0.0, 0.0, 1.0, 0.7, 0.4]) * layout.bumps
    turn, phase = rng.uniform(0.0, 2.0 * np.pi, (2, len(lengths)))
    wave = (2.0 * np.pi / lengths * np.array([np.cos(turn), np.sin(turn)])).T.copy()
    return Terrain(heights, wave, phase, float(np.sum(heights * 2.0 * np.pi / lengths)))


def _kerb(site: Site, inner: float, outer: float, height: float = 0.13) -> None:
    """A raised pavement between two distances from the lane, as slabs that follow it."""
    d, wide = 0.5 * (inner + outer), abs(outer - inner)
    for s in site.each(2.0):
        edges = (2.1, wide, height + 0.4)
        site.model.box(site.path.at(s, d), PAVING, (0.0, 0.0, 0.5 * height - 0.2), edges)


def _houses(site: Site, side: float, front: float) -> None:
    """A row of houses and blocks with gaps; side +1 left, -1 right."""
    rng = site.rng()
    s = site.path.start + rng.uniform(0.0, 8.0)
    while s < site.end - 18.0:
        wide, deep = rng.uniform(8.5, 15.0), rng.uniform(8.0, 10.0)
        d = side * (front + rng.uniform(0.0, 1.2))
        at = site.path.at(s + 0.5 * wide, d, 0.0 if side > 0.0 else INWARD)
        if rng.random() < 0.6:
            buildings.house(site.model, at, (wide, deep), int(rng.integers(2, 4)))
        else:
            buildings.block(site.model, at, (wide, deep), int(rng.integers(3, 5)))
        s += wide + rng.uniform(1.5, 7.0)


def _gardens(site: Site, side: float, d: float) -> None:
    """What stands between gardens and pavement: low walls, hedges, fences; gaps for gates."""
    rng = site.rng()
    s = site.path.start + 2.0
    while s < site.end - 12.0:
        length = rng.uniform(4.0, 9.0)
        at, middle = site.path.at(s, side * d), site.path.at(s + 0.5 * length, side * d)
        pick = rng.random()
        if pick < 0.35:
            things.low_wall(site.model, at, length)
        elif pick < 0.6:
            plants.hedge(site.model, middle, length, rng.uniform(0.9, 1.6))
        elif pick < 0.85:
            things.plank_fence(site.model, at, length)
        s += length + rng.uniform(1.0, 2.5)


def _parked(site: Site, d: float, chance: float, slot: float = 6.2) -> None:
    """Cars at the kerb."""
    rng = site.rng()
    for s in site.each(slot):
        taken, lorry, shift, off = (
            rng.random(),
            rng.random(),
            rng.normal(0, 0.25),
            rng.normal(0, 0.08),
        )
        seed = int(rng.integers(1 << 30))
        if taken > chance:
            continue
        yaw = (0.0 if d < 0.0 else INWARD) + 0.2 * off
        make = things.lorry if lorry < 0.06 else things.car
        make(site.model, site.path.at(s + shift, d + off, yaw), np.random.default_rng(seed))


def _lamps(site: Site, d: float, spacing: float) -> None:
    for s in site.each(spacing):
        things.lamp(site.model, site.path.at(s, d, 0.0 if d < 0.0 else INWARD))


def _avenue(site: Site, d: float, spacing: float, height: tuple[float, float]) -> None:
    """A row of broadleaved trees."""
    rng = site.rng()
    for s in site.each(spacing):
        at = site.path.at(s + rng.normal(0.0, 0.6), d + rng.normal(0.0, 0.15))
        plants.broadleaf(site.model, at, rng, rng.uniform(*height))


def _people(site: Site, inner: float, outer: float, spacing: float) -> None:
    rng = site.rng()
    for s in site.each(spacing):
        shift, share, yaw = rng.uniform(0.0, spacing), rng.random(), rng.uniform(0.0, 2.0 * np.pi)
        at = site.path.at(s + shift, inner + share * (outer - inner), yaw)
        things.person(site.model, at, rng)


def _street_furniture(site: Site, d: float) -> None:
    """Signs, bins and benches along a pavement."""
    rng = site.rng()
    for s in site.each(11.0):
        at = site.path.at(s + rng.uniform(0.0, 6.0), d, 0.0 if d > 0.0 else INWARD)
        pick = rng.random()
        if pick < 0.4:
            things.sign(site.model, at, rng)
        elif pick < 0.75:
            things.bin_(site.model, at)
        else:
            things.bench(site.model, at)


def _forest(site: Site, inner: float, outer: float, spacing: float) -> None:
    """Trees between two distances from the lane, none nearer to another than `spacing`."""
    rng = site.rng()
    placed = np.full((1, 2), 1e9)
    for s in site.each(1.5):
        for _ in range(max(1, round(abs(outer - inner) * 1.5 / spacing**2))):
            at = np.array([s + rng.uniform(0.0, 1.5), rng.uniform(inner, outer)])
            seed, height, pine = int(rng.integers(1 << 30)), rng.uniform(7.0, 17.0), rng.random()
            if np.min(np.sum((placed[-200:] - at) ** 2, axis=1)) < spacing**2:
                continue
            placed = np.vstack([placed, at])
            make = plants.conifer if pine < 0.45 else plants.broadleaf
            frame = site.path.at(at[0], at[1], seed % 7)
            make(site.model, frame, np.random.default_rng(seed), height)


def _undergrowth(site: Site, inner: float, outer: float, spacing: float) -> None:
    """Bushes, now and then a rock or a fallen stem."""
    rng = site.rng()
    for s in site.each(spacing):
        at = site.path.at(
            s + rng.uniform(0.0, spacing), rng.uniform(inner, outer), rng.uniform(0, 6)
        )
        pick = rng.random()
        if pick < 0.75:
            plants.bush(site.model, at, rng, rng.uniform(0.4, 1.5))
        elif pick < 0.88:
            plants.boulder(site.model, at, rng)
        else:
            plants.log(site.model, at, rng)


def _sheds(site: Site, side: float, front: float) -> None:
    rng = site.rng()
    s = site.path.start
    while s < site.end - 30.0:
        wide, deep, high = rng.uniform(18.0, 32.0), rng.uniform(12.0, 18.0), rng.uniform(5.5, 8.5)
        d = side * (front + rng.uniform(0.0, 4.0))
        at = site.path.at(s + 0.5 * wide, d, 0.0 if side > 0.0 else INWARD)
        buildings.shed(site.model, at, (wide, deep, high), rng)
        s += wide + rng.uniform(9.0, 16.0)


def _yard(site: Site, side: float, d: float) -> None:
    """Containers, goods, lorries and tanks along the lane."""
    rng = site.rng()
    s = site.path.start + 4.0
    while s < site.end - 12.0:
        at = site.path.at(s, side * (d + rng.uniform(-0.4, 0.8)), rng.normal(0.0, 0.04))
        pick, gap = rng.random(), rng.uniform(2.0, 4.0)
        if pick < 0.3:
            things.container(site.model, at, int(rng.integers(1, 4)))
            s += 7.0
        elif pick < 0.5:
            for k in range(int(rng.integers(2, 5))):
                things.pallets(site.model, at.moved((1.7 * k - 2.0, 0.0, 0.0)), rng)
            s += 7.0
        elif pick < 0.7:
            things.lorry(site.model, at, rng)
            s += 10.0
        elif pick < 0.85:
            things.tank(site.model, at, rng.uniform(1.2, 1.9), rng.uniform(4.0, 7.0))
            s += 5.0
        else:
            things.car(site.model, at, rng)
            s += 5.5
        s += gap


def _mesh(site: Site, d: float) -> None:
    for s in site.each(3.0):
        if s % 30.0 > 6.0:
            things.mesh_fence(site.model, site.path.at(s, d), 3.0)


def _racks(site: Site, d: float) -> None:
    for s in site.each(40.0):
        things.pipe_rack(site.model, site.path.at(s, d), 15.0)


def _wires(site: Site, d: float) -> None:
    places = [site.path.at(s, d) for s in site.each(28.0)]
    things.masts_and_wires(site.model, places)


def _woodland(site: Site) -> None:
    _forest(site, 3.0, 26.0, 3.6)
    _forest(site, -26.0, -3.0, 3.6)
    _undergrowth(site, 2.6, 14.0, 1.6)
    _undergrowth(site, -14.0, -2.6, 1.6)


def _industrial(site: Site) -> None:
    _sheds(site, 1.0, 13.0)
    _sheds(site, -1.0, 16.0)
    _yard(site, 1.0, 7.0)
    _yard(site, -1.0, 10.5)
    _mesh(site, -5.6)
    _lamps(site, 4.6, 27.0)
    _racks(site, 10.4)
    _people(site, 3.5, 5.0, 24.0)
    _wires(site, -14.0)
    for s in site.each(3.0):
        if s % 24.0 < 9.0:
            things.bollard(site.model, site.path.at(s, 4.2))
    _undergrowth(site, -7.4, -6.6, 9.0)


def _roadway(site: Site) -> None:
    for side in (1.0, -1.0):
        _kerb(site, side * 5.2, side * 8.0)
        _houses(site, side, 11.0)
        _gardens(site, side, 8.3)
    _parked(site, 4.1, 0.6)
    _parked(site, -4.1, 0.7)
    _lamps(site, 5.6, 29.0)
    _avenue(site, -6.1, 13.0, (6.0, 9.0))
    _avenue(site, 9.7, 17.0, (5.0, 8.0))
    _people(site, 6.2, 7.8, 14.0)
    _people(site, -6.8, -7.9, 19.0)
    _street_furniture(site, 5.7)
    _street_furniture(site, -5.7)
    _wires(site, -8.1)


def _mixed(site: Site) -> None:
    _kerb(site, 4.4, 6.8)
    _houses(site, 1.0, 10.0)
    _gardens(site, 1.0, 7.2)
    _parked(site, 3.3, 0.6)
    _lamps(site, 4.9, 27.0)
    _people(site, 5.3, 6.6, 18.0)
    _street_furniture(site, 4.9)
    _forest(site, -30.0, -6.0, 4.2)
    _undergrowth(site, -12.0, -4.2, 2.4)
    for s in site.each(3.0):
        if s % 36.0 < 21.0:
            things.plank_fence(site.model, site.path.at(s, -3.9), 3.0)
    _wires(site, -3.3)


LAYOUTS = {
    "woodland": Layout(_woodland, 0.45, 0.35, 0.035, 0.13),
    "industrial": Layout(_industrial, 0.18, 0.07, 0.0, 0.3),
    "roadway": Layout(_roadway, 0.35, 0.1, 0.0, 0.25),
    "mixed": Layout(_mixed, 0.35, 0.18, 0.008, 0.22),
}
