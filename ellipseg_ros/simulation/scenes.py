"""The scenes: their items along the lane, and the shape of the ground."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ellipseg_ros.simulation import items, rows
from ellipseg_ros.simulation.rays import Terrain
from ellipseg_ros.simulation.rows import Site
from ellipseg_ros.simulation.scanner import SICK, Path, make_path
from ellipseg_ros.simulation.shapes import Model, Shapes
from ellipseg_ros.simulation.traffic import Mover


class Layout(NamedTuple):
    """Description of a scene: its ground and its items."""

    build: Callable[[Site], None]
    swing: float  # rad: amplitude of the heading of the lane
    hills: float  # m: height of the long waves of the ground
    bumps: float  # m: height of the short waves
    soil: float  # reflectivity of the ground
    lidar: str = SICK  # default
    speed: float = 3.0  # m/s: default
    period: float = 150.0  # m: of the heading of the lane
    before: float = 40.0  # m of scene behind the start
    after: float = 110.0  # m of scene beyond the end of the drive


class World(NamedTuple):
    """A scene, ready to be scanned."""

    path: Path
    shapes: Shapes
    soil: float  # reflectivity of the ground
    movers: tuple[Mover, ...]


def make_world(name: str, length: float, seed: int) -> World:
    """The scene `name` for a drive of `length` m."""
    layout = LAYOUTS[name]
    terrain = _terrain(layout, np.random.default_rng((seed, 0)))
    path = make_path(terrain, -layout.before, length + layout.after, layout.swing, layout.period)
    site = Site(Model(), path, length + layout.after, seed, iter(range(1000)), [])
    layout.build(site)
    return World(path, site.model.shapes(), layout.soil, tuple(site.movers))


def _terrain(layout: Layout, rng: np.random.Generator) -> Terrain:
    lengths = np.array([61.0, 43.0, 29.0, 19.0, 3.1, 1.7, 0.9])
    heights = np.array([1.0, 0.7, 0.5, 0.3, 0.0, 0.0, 0.0]) * layout.hills
    heights += np.array([0.0, 0.0, 0.0, 0.0, 1.0, 0.7, 0.4]) * layout.bumps
    turn, phase = rng.uniform(0.0, 2.0 * np.pi, (2, len(lengths)))
    wave = (2.0 * np.pi / lengths * np.array([np.cos(turn), np.sin(turn)])).T.copy()
    return Terrain(heights, wave, phase, float(np.sum(heights * 2.0 * np.pi / lengths)))


def _woodland(site: Site) -> None:
    rows.forest(site, 3.0, 26.0, 3.8)
    rows.forest(site, -26.0, -3.0, 3.8)
    rows.undergrowth(site, 2.6, 14.0, 1.6)
    rows.undergrowth(site, -14.0, -2.6, 1.6)


def _industrial(site: Site) -> None:
    rows.sheds(site, 1.0, 13.0)
    rows.sheds(site, -1.0, 16.0)
    rows.yard(site, 1.0, 7.0)
    rows.yard(site, -1.0, 10.5)
    rows.groups(site, items.mesh_fence, -5.6, 3.0, (6, 30, 30))
    rows.lamps(site, 4.6, 27.0)
    rows.groups(site, items.pipe_rack, 10.4, 40.0, (0, 40, 40))
    rows.people(site, 3.5, 5.0, 24.0)
    rows.wires(site, -14.0)
    rows.groups(site, items.bollard, 4.2, 3.0, (0, 9, 24))
    rows.undergrowth(site, -7.4, -6.6, 9.0)


def _roadway(site: Site) -> None:
    for side in (1.0, -1.0):
        rows.kerb(site, side * 5.2, side * 8.0)
        rows.houses(site, side, 11.0)
        rows.gardens(site, side, 8.3)
    rows.parked(site, 4.1, 0.6)
    rows.parked(site, -4.1, 0.7)
    rows.lamps(site, 5.6, 29.0)
    rows.avenue(site, -6.1, 13.0, (6.0, 9.0))
    rows.avenue(site, 9.7, 17.0, (5.0, 8.0))
    rows.people(site, 6.2, 7.8, 14.0)
    rows.people(site, -6.8, -7.9, 19.0)
    rows.street_furniture(site, 5.7)
    rows.street_furniture(site, -5.7)
    rows.wires(site, -8.1)


def _mixed(site: Site) -> None:
    rows.kerb(site, 4.4, 6.8)
    rows.houses(site, 1.0, 10.0)
    rows.gardens(site, 1.0, 7.2)
    rows.parked(site, 3.3, 0.6)
    rows.lamps(site, 4.9, 27.0)
    rows.people(site, 5.3, 6.6, 18.0)
    rows.street_furniture(site, 4.9)
    rows.forest(site, -30.0, -6.0, 4.2)
    rows.undergrowth(site, -12.0, -4.2, 2.4)
    rows.groups(site, items.plank_fence, -3.9, 3.0, (0, 21, 36))
    rows.wires(site, -3.3)


def _town(site: Site) -> None:
    for side, kerb, front in ((1.0, 9.0, 15.0), (-1.0, 5.6, 11.0)):
        rows.kerb(site, side * kerb, side * (front + 0.5))
        rows.houses(site, side, front, (1.0, 9.0))
        rows.gardens(site, side, front - 0.4)
        rows.people(site, side * (kerb + 0.7), side * (front - 0.8), 15.0)
        rows.street_furniture(site, side * (kerb + 0.4))
    rows.parked(site, 7.9, 0.4)
    rows.parked(site, -4.5, 0.3)
    rows.lamps(site, 9.4, 31.0)
    rows.avenue(site, -6.2, 17.0, (6.0, 9.0))
    rows.avenue(site, 9.9, 13.0, (6.0, 10.0))
    rows.wires(site, 13.4)
    rows.drivers(site, 0.0, 10.0, (24.0, 60.0))
    rows.drivers(site, 4.0, -9.0, (30.0, 80.0))
    rows.walkers(site, 10.2, 13.4, 11.0)
    rows.walkers(site, -6.8, -9.8, 13.0)
    rows.crossers(site, -9.0, 12.0, 40.0)


def _forest(site: Site) -> None:
    rows.forest(site, 4.0, 34.0, 2.6)
    rows.forest(site, -34.0, -4.0, 2.6)
    for inner, outer, spacing in ((3.2, 5.5, 0.8), (4.0, 10.0, 0.7), (6.0, 24.0, 0.6)):
        rows.undergrowth(site, inner, outer, spacing)
        rows.undergrowth(site, -outer, -inner, spacing)
    rows.drivers(site, 0.0, 18.0, (35.0, 120.0))
    rows.walkers(site, 2.2, 2.8, 40.0)


LAYOUTS = {
    "woodland": Layout(_woodland, 0.45, 0.35, 0.035, 0.13),
    "industrial": Layout(_industrial, 0.18, 0.07, 0.0, 0.3),
    "roadway": Layout(_roadway, 0.35, 0.1, 0.0, 0.25),
    "mixed": Layout(_mixed, 0.35, 0.18, 0.008, 0.22),
    "town": Layout(_town, 0.5, 0.1, 0.0, 0.25, "hdl64e", 10.0, 110.0, 100.0, 140.0),
    "forest": Layout(_forest, 0.4, 0.35, 0.03, 0.15, "hdl64e", 18.0, 150.0, 100.0, 140.0),
}
