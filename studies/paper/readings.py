"""Readings of the paper where its print leaves several, tried on scenes; prints a Markdown table.

python studies/readings.py [SOURCE ...]    beside the four simulated scenes

A plain Kruskal over every fourth point of the first window, so that each reading is a few lines
here and none is in the package. The readings that the package follows come first in each part.
"""

import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from itertools import repeat

import numpy as np

from ellipseg_ros.config import Config
from ellipseg_ros.core.ellipsoids import COUNT, MEAN, segment_moments
from ellipseg_ros.io.sources import open_source
from ellipseg_ros.records import Array
from ellipseg_ros.tuning.graph import graph_of
from studies.paper.facts import first_window
from studies.paper.reading_kernels import (
    ADDED_MASS,
    AIC,
    CAPPED,
    DENSITY,
    E3,
    FLOORED,
    NO_RATIOS,
    PARSIMONY,
    ROOT_N,
    SHAPE,
    SHARES,
    total_aicc,
    walk,
)
from studies.report.markdown import table

EVERY = 4  # points
SCENES = ("sim:industrial", "sim:woodland", "sim:roadway", "sim:mixed")
CONFIG = Config(max_points_per_second=15_000)
COARSE, FINE = 10, 4  # thresholds


@dataclass(frozen=True)
class Reading:
    """One way to read the paper."""

    name: str
    criterion: int
    lowest: float  # thresholds
    highest: float
    against: str = ""  # the reading of the other criterion that it is compared with
    floor: float = 1e-4  # m^2
    count: float = 1.0  # points of an initial ellipsoid
    plain: bool = False  # edges by the distance of their centroids alone
    unit_mass: bool = False
    own: bool = False  # AICc of the moments of the points themselves
    passes: int = 1  # over the edges


@dataclass(frozen=True)
class Scene:
    """What all readings of a scene share."""

    points: Array
    nodes: Array
    masses: Array
    weighted: tuple[Array, Array]  # ends of the edges, in order
    plain: tuple[Array, Array]


@dataclass(frozen=True)
class Minimum:
    """Of one reading on one scene."""

    thresholds: Array
    losses: Array
    threshold: float
    aicc: float  # a point
    count: int
    completion: float
    largest: float  # share of the points in the largest segment


SHAPES = (
    Reading("shape: e1 in the spherical term", SHAPE, 0.1, 300.0, "density: mean mass"),
    Reading("e3 there, as printed", E3, 0.1, 300.0, "density: mean mass"),
    Reading("each term by its own share (words)", SHARES, 0.1, 300.0, "density: mean mass"),
    Reading("no ratios in the angular terms", NO_RATIOS, 0.1, 300.0, "density: mean mass"),
    Reading("D / √(n_a + n_b)", ROOT_N, 0.01, 30.0, "density: mean mass"),
    Reading("floor (0.00003 m)²", SHAPE, 0.1, 300.0, "density: mean mass", floor=9e-10),
    Reading("floor (0.02 m)²", SHAPE, 0.1, 300.0, "density: mean mass", floor=4e-4),
    Reading("n = 11 at the start", SHAPE, 0.1, 300.0, "density, n = 11", count=11.0),
    Reading("edges by distance alone", SHAPE, 0.1, 300.0, "density: mean mass", plain=True),
    Reading(
        "shape, AICc of the points", SHAPE, 0.1, 300.0, "density, AICc of the points", own=True
    ),
)
DENSITIES = (
    Reading("density: mean mass", DENSITY, 1e-3, 1e3, SHAPES[0].name),
    Reading("masses added", ADDED_MASS, 1e-4, 1.0, SHAPES[0].name),
    Reading("masses added, 1 a point", ADDED_MASS, 1e-6, 1.0, SHAPES[0].name, unit_mass=True),
    Reading("volume alone", DENSITY, 1e-3, 1e2, SHAPES[0].name, unit_mass=True),
    Reading("volume of at least the noise", FLOORED, 1e-2, 1e4, SHAPES[0].name),
    Reading("density, n = 11", DENSITY, 1e-3, 1e3, "n = 11 at the start", count=11.0),
    Reading("density, edges by distance alone", DENSITY, 1e-3, 1e3, SHAPES[0].name, plain=True),
    Reading("density, AICc of the points", DENSITY, 1e-3, 1e3, SHAPES[9].name, own=True),
)
PARSIMONIES = (
    Reading("parsimony", PARSIMONY, 0.1, 100.0),
    Reading("dropped edges a second time", PARSIMONY, 0.1, 100.0, passes=2),
    Reading("three passes", PARSIMONY, 0.1, 100.0, passes=3),
    Reading("parsimony, edges by distance alone", PARSIMONY, 0.1, 100.0, plain=True),
    Reading("AIC instead of AICc in D", AIC, 0.1, 100.0),
    Reading("bias in D at most that of 12 points", CAPPED, 0.1, 100.0),
)


def load(spec: str) -> tuple[str, Scene]:
    """A scene by its name."""
    source = open_source(spec)
    cut = first_window(source, CONFIG)
    return source.name, scene_of(cut.points[::EVERY], cut.origin)


def scene_of(points: Array, origin: Array) -> Scene:
    """Neighbours, initial ellipsoids and edges of points (n, 3), m, without the isolated ones."""
    graph = graph_of(points, CONFIG, origin)
    members = np.flatnonzero(graph.change.member)
    rows = np.cumsum(graph.change.member) - 1
    nodes = np.vstack([graph.nodes[members], np.zeros((1, graph.nodes.shape[1]))])
    left, right = rows[graph.edges.i], rows[graph.edges.j]
    means = nodes[:, MEAN : MEAN + 3]
    order = np.lexsort((right, left, np.linalg.norm(means[left] - means[right], axis=1)))
    masses = np.append(graph.masses[members], 0.0)
    kept = points[members] - origin
    return Scene(kept, nodes, masses, (left, right), (left[order], right[order]))


def try_threshold(scene: Scene, reading: Reading, threshold: float) -> tuple[float, int, float]:
    """AICc a point, segments, and the largest one's share of the points."""
    nodes, masses = scene.nodes.copy(), scene.masses.copy()
    nodes[:, COUNT] = reading.count
    if reading.unit_mass:
        masses[:] = 1.0
    left, right = scene.plain if reading.plain else scene.weighted
    way = (reading.criterion, reading.floor, threshold, reading.passes)
    roots, labels, sizes = np.unique(
        walk(nodes, masses, left, right, *way), return_inverse=True, return_counts=True
    )
    aicc = total_aicc(*own_nodes(scene, labels) if reading.own else (nodes, roots))
    points = len(scene.points)
    return aicc / (points * reading.count), len(roots), float(sizes.max()) / points


def own_nodes(scene: Scene, labels: Array) -> tuple[Array, Array]:
    """Moments of the points of every segment."""
    count = int(labels.max()) + 1
    before, nothing = np.full(count, -1), np.zeros((0, scene.nodes.shape[1]))
    nodes = segment_moments(scene.points, labels.astype(np.int32), before, nothing)
    return nodes, np.arange(count)


def minimum(scene: Scene, reading: Reading) -> Minimum:
    """Look for the threshold of least AICc: a coarse grid, then a finer one around its best."""
    tried: dict[float, tuple[float, int, float]] = {}
    grid = np.geomspace(reading.lowest, reading.highest, COARSE)
    for _ in range(2):
        tried |= {t: try_threshold(scene, reading, t) for t in grid.tolist() if t not in tried}
        thresholds = np.array(sorted(tried))
        best = int(np.argmin([tried[t][0] for t in thresholds]))
        around = thresholds[[max(best - 1, 0), min(best + 1, len(thresholds) - 1)]]
        grid = np.geomspace(*around, FINE + 2)
    aicc, count, largest = tried[thresholds[best]]
    singletons = try_threshold(scene, replace(reading, passes=0), 0.0)[0]
    losses = np.array([tried[t][0] - aicc for t in thresholds]) / (singletons - aicc)
    done = 1.0 - count / len(scene.points)
    return Minimum(thresholds, losses, thresholds[best], aicc, count, done, largest)


def row(reading: Reading, minima: dict[str, list[Minimum]]) -> list[str]:
    """A reading over all scenes."""
    found = minima[reading.name]
    candidates = np.unique(np.concatenate([one.thresholds for one in found]))
    logs = np.log(candidates)
    losses = [np.interp(logs, np.log(one.thresholds), one.losses) for one in found]
    shared = float(np.max(losses, axis=0).min())
    cells = [reading.name, span([one.threshold for one in found], ".3g"), f"{shared:.3f}"]
    cells.append(span([100.0 * one.completion for one in found], ".1f"))
    cells.append(f"{np.mean([one.aicc for one in found]):.2f}")
    cells.append(f"{np.mean([one.count for one in found]):,.0f}")
    cells.append(span([100.0 * one.largest for one in found], ".1f"))
    if not reading.against:
        return [*cells, ""]
    pairs = list(zip(found, minima[reading.against], strict=True))
    if reading.criterion < DENSITY:
        pairs = [(other, one) for one, other in pairs]
    late = sum(density.completion > shape.completion for density, shape in pairs)
    low = sum(density.aicc < shape.aicc for density, shape in pairs)
    return [*cells, f"{late}, {low} of {len(pairs)}"]


def span(values: list[float], form: str) -> str:
    """Least and greatest."""
    return f"{min(values):{form}} to {max(values):{form}}"


PAGE = """# Readings of the paper, tried

Written by `python studies/readings.py`: a plain Kruskal over every fourth point of the first
window of each scene. Numbers therefore differ from those of [claims.md](claims.md), which has all
points. What the table says is weighed in [method](../explanation/method.md).

*Minima*: thresholds of least AICc, least and greatest over the scenes. *Shared loss*: the worst
loss of the one threshold that is best for all. *AICc* per point, and *ellipsoids*: means over the
scenes. *Density later, lower*: in how many scenes the minimum of density comes later in the
merging than that of shape, and in how many it is lower; a reading of one against the other's first
one, or against its like.

Scenes: {scenes}.
"""


def main() -> None:
    """Try all readings on all scenes."""
    scenes = dict(load(spec) for spec in [*SCENES, *sys.argv[1:]])
    minima: dict[str, list[Minimum]] = {}
    for reading in (*SHAPES, *DENSITIES, *PARSIMONIES):
        print(f"{reading.name} ...", file=sys.stderr)
        with ThreadPoolExecutor(2) as pool:  # kernels release the GIL
            minima[reading.name] = list(pool.map(minimum, scenes.values(), repeat(reading)))
    head = ["reading", "minima at τ", "shared loss", "completion, %", "AICc", "ellipsoids"]
    head += ["largest segment, %", "density later, lower"]
    print(PAGE.format(scenes=", ".join(scenes)))
    print(table(head, [row(r, minima) for r in (*SHAPES, *DENSITIES, *PARSIMONIES)]), end="")


if __name__ == "__main__":
    main()
