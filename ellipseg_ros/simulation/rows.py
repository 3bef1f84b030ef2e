"""Rows of items along the lane: s along it, d to its left, in m.

Every row has a random generator of its own and ascends in s, so that a longer drive begins like a
shorter one with the same seed.
"""

from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ellipseg_ros.records import Array
from ellipseg_ros.simulation import buildings, items, plants
from ellipseg_ros.simulation.scanner import Path
from ellipseg_ros.simulation.shapes import WORLD, Class, Item, Material, Model
from ellipseg_ros.simulation.traffic import Mover

PAVING = Material(Class.GROUND, 0.35)
INWARD = np.pi  # yaw of an item on the right side whose y axis points away from the lane


class Site(NamedTuple):
    """A scene under construction."""

    model: Model
    path: Path
    end: float  # m: greatest s
    seed: int
    rows: Iterator[int]  # number of the next row of items
    movers: list[Mover]

    def rng(self) -> np.random.Generator:
        """A random generator for one row of items."""
        return np.random.default_rng((self.seed, 1, next(self.rows)))

    def item(self, s: float, d: float, yaw: float = 0.0) -> Item:
        """Begin an item at (s, d), see Path.at."""
        return self.model.item(self.path.at(s, d, yaw))

    def each(self, spacing: float) -> Array:
        """(n,) m: positions along the lane."""
        return np.arange(self.path.start + 3.0, self.end - 3.0, spacing)


def kerb(site: Site, inner: float, outer: float, height: float = 0.13) -> None:
    """A raised pavement between two distances from the lane, as slabs that follow it."""
    d, wide = 0.5 * (inner + outer), abs(outer - inner)
    for s in site.each(2.0):
        edges = (2.1, wide, height + 0.4)
        slab = site.model.ground(site.path.at(s, d))
        slab.box(PAVING, (0.0, 0.0, 0.5 * height - 0.2), edges)


def houses(site: Site, side: float, front: float, gaps: tuple[float, float] = (1.5, 7.0)) -> None:
    """A row of houses and blocks with gaps (m); side +1 left, -1 right."""
    rng = site.rng()
    s = site.path.start + rng.uniform(0.0, 8.0)
    while s < site.end - 18.0:
        wide, deep = rng.uniform(8.5, 15.0), rng.uniform(8.0, 10.0)
        d = side * (front + rng.uniform(0.0, 1.2))
        item = site.item(s + 0.5 * wide, d, 0.0 if side > 0.0 else INWARD)
        make = buildings.house if rng.random() < 0.6 else buildings.block
        make(item, (wide, deep), rng)
        s += wide + rng.uniform(*gaps)


def gardens(site: Site, side: float, d: float) -> None:
    """Low walls, hedges and fences between gardens and pavement, with gaps for gates."""
    rng = site.rng()
    s = site.path.start + 2.0
    while s < site.end - 12.0:
        length = rng.uniform(4.0, 9.0)
        pick = rng.random()
        if pick < 0.35:
            items.low_wall(site.item(s, side * d), length)
        elif pick < 0.6:
            middle = site.item(s + 0.5 * length, side * d)
            plants.hedge(middle, length, rng.uniform(0.9, 1.6))
        elif pick < 0.85:
            items.plank_fence(site.item(s, side * d), length)
        s += length + rng.uniform(1.0, 2.5)


def parked(site: Site, d: float, chance: float, slot: float = 6.2) -> None:
    """Cars at the kerb."""
    rng = site.rng()
    for s in site.each(slot):
        taken, lorry = rng.random(2)
        shift, off = rng.normal(0.0, 0.25), rng.normal(0.0, 0.08)
        own = np.random.default_rng(int(rng.integers(1 << 30)))
        if taken <= chance:
            make = items.lorry if lorry < 0.06 else items.car
            yaw = (0.0 if d < 0.0 else INWARD) + 0.2 * off
            make(site.item(s + shift, d + off, yaw), own)


def lamps(site: Site, d: float, spacing: float) -> None:
    """Lamps whose arms reach over the lane."""
    for s in site.each(spacing):
        items.lamp(site.item(s, d, 0.0 if d < 0.0 else INWARD))


def avenue(site: Site, d: float, spacing: float, height: tuple[float, float]) -> None:
    """A row of broadleaved trees."""
    rng = site.rng()
    for s in site.each(spacing):
        item = site.item(s + rng.normal(0.0, 0.6), d + rng.normal(0.0, 0.15))
        plants.broadleaf(item, rng, rng.uniform(*height))


def people(site: Site, inner: float, outer: float, spacing: float) -> None:
    """People about every `spacing` m, between two distances from the lane."""
    rng = site.rng()
    for s in site.each(spacing):
        shift, share, yaw = rng.uniform(0.0, spacing), rng.random(), rng.uniform(0.0, 2.0 * np.pi)
        item = site.item(s + shift, inner + share * (outer - inner), yaw)
        items.person(item, rng)


def drivers(site: Site, d: float, speed: float, gaps: tuple[float, float]) -> None:
    """Cars that drive along the lane, none in the first metres before the vehicle."""
    rng = site.rng()
    s = site.path.start
    while s < site.end + (400.0 if speed < 0.0 else 0.0):
        s += rng.uniform(*gaps)
        item = site.model.separate()
        items.car(item, rng)
        if d != 0.0 or s > 14.0:
            site.movers.append(Mover(s, d, speed, 0.0, 0.0, d, d, item.shapes()))


def walkers(site: Site, inner: float, outer: float, spacing: float) -> None:
    """People who walk along the lane, either way."""
    rng = site.rng()
    for s in site.each(spacing):
        share, shift, speed, way = rng.random(4)
        item = site.model.separate()
        items.person(item, rng)
        along = (0.9 + 0.9 * speed) * (1.0 if way < 0.5 else -1.0)
        d = inner + share * (outer - inner)
        site.movers.append(Mover(s + spacing * shift, d, along, 0.0, 0.13, d, d, item.shapes()))


def crossers(site: Site, low: float, high: float, spacing: float) -> None:
    """People who cross the lane back and forth between two distances from it."""
    rng = site.rng()
    for s in site.each(spacing):
        item = site.model.separate()
        items.person(item, rng)
        s += rng.uniform(0.0, 9.0)
        motion = (s, rng.uniform(low, high), 0.0, 1.3)
        site.movers.append(Mover(*motion, 0.0, low, high, item.shapes()))


def street_furniture(site: Site, d: float) -> None:
    """Signs, bins and benches along a pavement."""
    rng = site.rng()
    for s in site.each(11.0):
        item = site.item(s + rng.uniform(0.0, 6.0), d, 0.0 if d > 0.0 else INWARD)
        pick = rng.random()
        if pick < 0.4:
            items.sign(item, rng)
        elif pick < 0.75:
            items.bin_(item)
        else:
            items.bench(item)


def forest(site: Site, inner: float, outer: float, spacing: float) -> None:
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
            own = np.random.default_rng(seed)
            make(site.item(at[0], at[1], own.uniform(0.0, 2.0 * np.pi)), own, height)


def undergrowth(site: Site, inner: float, outer: float, spacing: float) -> None:
    """Bushes, some rocks and fallen stems."""
    rng = site.rng()
    for s in site.each(spacing):
        shift, d, yaw = rng.uniform(0.0, spacing), rng.uniform(inner, outer), rng.uniform(0, 6)
        item = site.item(s + shift, d, yaw)
        pick = rng.random()
        if pick < 0.75:
            plants.bush(item, rng, rng.uniform(0.4, 1.5))
        elif pick < 0.88:
            plants.boulder(item, rng)
        else:
            plants.log(item, rng)


def sheds(site: Site, side: float, front: float) -> None:
    """A row of industrial halls; side +1 left, -1 right."""
    rng = site.rng()
    s = site.path.start
    while s < site.end - 30.0:
        wide, deep, high = rng.uniform(18.0, 32.0), rng.uniform(12.0, 18.0), rng.uniform(5.5, 8.5)
        d = side * (front + rng.uniform(0.0, 4.0))
        item = site.item(s + 0.5 * wide, d, 0.0 if side > 0.0 else INWARD)
        buildings.shed(item, (wide, deep, high), rng)
        s += wide + rng.uniform(9.0, 16.0)


def yard(site: Site, side: float, d: float) -> None:
    """Containers, goods, lorries and tanks along the lane."""
    rng = site.rng()
    s = site.path.start + 4.0
    while s < site.end - 12.0:
        at = site.path.at(s, side * (d + rng.uniform(-0.4, 0.8)), rng.normal(0.0, 0.04))
        pick, gap = rng.random(), rng.uniform(2.0, 4.0)
        if pick < 0.3:
            for storey in range(int(rng.integers(1, 4))):
                items.container(site.model.item(at), storey)
            s += 7.0
        elif pick < 0.5:
            for k in range(int(rng.integers(2, 5))):
                items.pallets(site.model.item(at.moved((1.7 * k - 2.0, 0.0, 0.0))), rng)
            s += 7.0
        elif pick < 0.7:
            items.lorry(site.model.item(at), rng)
            s += 10.0
        elif pick < 0.85:
            items.tank(site.model.item(at), rng.uniform(1.2, 1.9), rng.uniform(4.0, 7.0))
            s += 5.0
        else:
            items.car(site.model.item(at), rng)
            s += 5.5
        s += gap


def groups(
    site: Site, make: Callable[[Item], None], d: float, spacing: float, bounds: tuple[int, ...]
) -> None:
    """Groups of equal items, such as fences with gaps; bounds: begin, end and period of groups."""
    begin, end, period = bounds
    for s in site.each(spacing):
        if begin < s % period < end:
            make(site.item(s, d))


def wires(site: Site, d: float) -> None:
    """A power line."""
    frames = [site.path.at(s, d) for s in site.each(28.0)]
    for frame in frames:
        items.mast(site.model.item(frame))
    for start, end in pairwise(frames):
        for y in (-1.0, 0.0, 1.0):
            ends = (start.point((0.0, y, 8.3)), end.point((0.0, y, 8.3)))
            items.wire(site.model.item(WORLD), *ends)
