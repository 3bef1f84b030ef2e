"""The four scenes: their items along the lane, and the shape of the ground."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ellipseg_ros.simulation import items, rows
from ellipseg_ros.simulation.rays import Terrain
from ellipseg_ros.simulation.rows import Site
from ellipseg_ros.simulation.scanner import Path, make_path
from ellipseg_ros.simulation.shapes import Model, Shapes

BEFORE, AFTER = 40.0, 110.0  # m of scene behind the start and beyond the end


class Layout(NamedTuple):
    """Description of a scene: its ground and its items."""

    build: Callable[[Site], None]
    swing: float  # rad: amplitude of the heading of the lane
    hills: float  # m: height of the long waves of the ground
    bumps: float  # m: height of the short waves
    soil: float  # reflectivity of the ground


class World(NamedTuple):
    """A scene, ready to be scanned."""

    path: Path
    shapes: Shapes
    soil: float  # reflectivity of the ground


def make_world(name: str, length: float, seed: int) -> World:
    """The scene `name` for a drive of `length` m."""
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


LAYOUTS = {
    "woodland": Layout(_woodland, 0.45, 0.35, 0.035, 0.13),
    "industrial": Layout(_industrial, 0.18, 0.07, 0.0, 0.3),
    "roadway": Layout(_roadway, 0.35, 0.1, 0.0, 0.25),
    "mixed": Layout(_mixed, 0.35, 0.18, 0.008, 0.22),
}
