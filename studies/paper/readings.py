"""`python -m studies.paper.readings`: alternative readings of ambiguous passages of the paper.

A plain Kruskal over every fourth point of the first window of each scene, so that a reading is a
few lines here and none is in the package. The first reading of each group is that of the package.
"""

import sys
from argparse import ArgumentParser, Namespace
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from itertools import repeat
from typing import Any

import numpy as np

from ellipseg_ros.cli.main import run_program
from ellipseg_ros.cli.options import SOURCES
from ellipseg_ros.config import Config
from ellipseg_ros.core.criteria import initial_values, rule_of
from ellipseg_ros.core.ellipsoids import segment_moments
from ellipseg_ros.core.moments import no_moments
from ellipseg_ros.io.sources import open_source
from ellipseg_ros.records import Array
from ellipseg_ros.tuning.window_graph import window_graph
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
    kruskal,
    total_aicc,
)
from studies.report.command import publish, run_command
from studies.report.page import Page, Section, Table
from studies.report.progress import progress_steps

EVERY = 4  # points, of which one is used
SCENES = ("sim:industrial", "sim:woodland", "sim:roadway", "sim:mixed")
CONFIG = Config(max_points_per_second=15_000)
COARSE, FINE = 10, 4  # thresholds of the first and of the refined grid


@dataclass(frozen=True)
class Reading:
    """A reading of the paper: a criterion, and how graph and AICc are computed for it."""

    name: str
    criterion: int
    lowest: float  # threshold
    highest: float  # threshold
    compared: str = ""  # the reading of the other criterion that it is compared with
    floor: float = 1e-4  # m^2
    count: float = 1.0  # points of an initial ellipsoid
    plain: bool = False  # edges in the order of the distance of their centroids only
    unit_mass: bool = False
    own: bool = False  # AICc of the moments of the points, not of the initial ellipsoids
    passes: int = 1  # over the edges


@dataclass(frozen=True)
class Scene:
    """Points, initial ellipsoids and edges of a scene, for all readings."""

    points: Array
    moments: Array
    masses: Array
    weighted: tuple[Array, Array]  # ends of the edges, in the order of the paper
    plain: tuple[Array, Array]  # ends of the edges, by distance


@dataclass(frozen=True)
class Minimum:
    """The threshold of lowest AICc of a reading on a scene, and the result at it."""

    thresholds: Array
    losses: Array
    threshold: float
    aicc: float  # per point
    count: int
    completion: float
    largest: float  # share of the points in the largest segment


SHAPES = (
    Reading("shape: e1 in the spherical term", SHAPE, 0.1, 300.0, "density: mean mass"),
    Reading("e3 there, as printed", E3, 0.1, 300.0, "density: mean mass"),
    Reading("each term by its own share (text)", SHARES, 0.1, 300.0, "density: mean mass"),
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
    Reading("masses added, 1 per point", ADDED_MASS, 1e-6, 1.0, SHAPES[0].name, unit_mass=True),
    Reading("volume alone", DENSITY, 1e-3, 1e2, SHAPES[0].name, unit_mass=True),
    Reading("volume at least that of the noise", FLOORED, 1e-2, 1e4, SHAPES[0].name),
    Reading("density, n = 11", DENSITY, 1e-3, 1e3, "n = 11 at the start", count=11.0),
    Reading("density, edges by distance alone", DENSITY, 1e-3, 1e3, SHAPES[0].name, plain=True),
    Reading("density, AICc of the points", DENSITY, 1e-3, 1e3, SHAPES[9].name, own=True),
)
PARSIMONIES = (
    Reading("parsimony", PARSIMONY, 0.1, 100.0),
    Reading("rejected edges a second time", PARSIMONY, 0.1, 100.0, passes=2),
    Reading("three passes", PARSIMONY, 0.1, 100.0, passes=3),
    Reading("parsimony, edges by distance alone", PARSIMONY, 0.1, 100.0, plain=True),
    Reading("AIC instead of AICc in D", AIC, 0.1, 100.0),
    Reading("bias in D at most that of 12 points", CAPPED, 0.1, 100.0),
)


def load(spec: str) -> tuple[str, Scene]:
    """Name and scene of a source."""
    source = open_source(spec)
    cut = first_window(source, CONFIG)
    return source.name, scene_of(cut.points[::EVERY], cut.origin)


def scene_of(points: Array, origin: Array) -> Scene:
    """The scene of points (n, 3), m, without isolated ones."""
    window = window_graph(points, CONFIG, origin)
    graph, member = window.graph, window.change.member
    members, rows = np.flatnonzero(member), np.cumsum(member) - 1
    moments, masses = no_moments(len(members) + 1), np.zeros(len(member))
    moments[:-1] = graph.moments[members]
    density = rule_of(replace(CONFIG, criterion="density"))
    initial_values(density, graph.points, graph.knn_indices, graph.moments, members, masses)
    left, right = rows[graph.edges.i], rows[graph.edges.j]
    gaps = np.linalg.norm(moments["mean"][left] - moments["mean"][right], axis=1)
    order = np.lexsort((right, left, gaps))
    kept = points[members] - origin
    return Scene(
        kept, moments, np.append(masses[members], 0.0), (left, right), (left[order], right[order])
    )


def try_threshold(scene: Scene, reading: Reading, threshold: float) -> tuple[float, int, float]:
    """AICc per point, number of segments, and share of the points in the largest one."""
    moments, masses = scene.moments.copy(), scene.masses.copy()
    moments["count"] = reading.count
    if reading.unit_mass:
        masses[:] = 1.0
    left, right = scene.plain if reading.plain else scene.weighted
    way = (reading.criterion, reading.floor, threshold, reading.passes)
    roots, labels, sizes = np.unique(
        kruskal(moments, masses, left, right, *way), return_inverse=True, return_counts=True
    )
    aicc = total_aicc(*point_moments(scene, labels) if reading.own else (moments, roots))
    points = len(scene.points)
    return aicc / (points * reading.count), len(roots), float(sizes.max()) / points


def point_moments(scene: Scene, labels: Array) -> tuple[Array, Array]:
    """Moments of the points of every segment, and their rows."""
    count = int(labels.max()) + 1
    previous = np.full(count, -1)
    moments = segment_moments(scene.points, labels.astype(np.int32), previous, no_moments())
    return moments, np.arange(count)


def minimum(scene: Scene, reading: Reading) -> Minimum:
    """Search the threshold of lowest AICc: a coarse grid, then a finer one around its best."""
    results: dict[float, tuple[float, int, float]] = {}
    grid = np.geomspace(reading.lowest, reading.highest, COARSE)
    for _ in range(2):
        new = [t for t in grid.tolist() if t not in results]
        results |= {t: try_threshold(scene, reading, t) for t in new}
        thresholds = np.array(sorted(results))
        best = int(np.argmin([results[t][0] for t in thresholds]))
        around = thresholds[[max(best - 1, 0), min(best + 1, len(thresholds) - 1)]]
        grid = np.geomspace(*around, FINE + 2)
    aicc, count, largest = results[thresholds[best]]
    singletons = try_threshold(scene, replace(reading, passes=0), 0.0)[0]
    losses = np.array([results[t][0] - aicc for t in thresholds]) / (singletons - aicc)
    done = 1.0 - count / len(scene.points)
    return Minimum(thresholds, losses, thresholds[best], aicc, count, done, largest)


def row(reading: Reading, minima: dict[str, list[Minimum]]) -> dict[str, Any]:
    """Results of a reading over all scenes, JSON-ready; of values, the lowest and the highest."""
    results = minima[reading.name]
    candidates = np.unique(np.concatenate([one.thresholds for one in results]))
    logs = np.log(candidates)
    losses = [np.interp(logs, np.log(one.thresholds), one.losses) for one in results]
    return {
        "reading": reading.name,
        "threshold": _extremes([one.threshold for one in results]),
        "shared_loss": float(np.max(losses, axis=0).min()),
        "completion": _extremes([one.completion for one in results]),
        "aicc": float(np.mean([one.aicc for one in results])),
        "count": float(np.mean([one.count for one in results])),
        "largest": _extremes([one.largest for one in results]),
    } | _comparison(reading, minima)


def _comparison(reading: Reading, minima: dict[str, list[Minimum]]) -> dict[str, int]:
    """In how many scenes the minimum of density is later, and lower, than that of shape."""
    if not reading.compared:
        return {}
    pairs = list(zip(minima[reading.name], minima[reading.compared], strict=True))
    if reading.criterion < DENSITY:
        pairs = [(other, one) for one, other in pairs]
    return {
        "density_later": sum(density.completion > shape.completion for density, shape in pairs),
        "density_lower": sum(density.aicc < shape.aicc for density, shape in pairs),
    }


def _extremes(values: list[float]) -> list[float]:
    return [float(min(values)), float(max(values))]


COMMAND = "python -m studies.paper.readings RECORDING... -o docs/results"
INTRODUCTION = (
    "Some passages of the paper can be read in several ways. Each reading is compared here by a "
    "plain Kruskal over every fourth point of the first window of each scene. Numbers therefore "
    "differ from those of the [findings](paper.md), which use all points. The first reading of "
    "shape, density and parsimony is that of the package; [method](../explanation/method.md) "
    "gives the reasons."
)
DEFINITIONS = (
    "*Minima*: thresholds of lowest AICc, lowest to highest over the scenes. *Shared loss*: the "
    "lowest maximum loss of one threshold for all scenes. *AICc* per point and *ellipsoids*: "
    "means over the scenes. *Density later, lower*: in how many scenes the minimum of density is "
    "at a later merge completion than that of shape, and in how many its AICc is lower; a reading "
    "is compared with the first one of the other criterion, or with its counterpart."
)


def page(results: dict[str, Any]) -> Page:
    """One table of all readings."""
    head = ["reading", "minima at τ", "shared loss", "completion, %", "AICc", "ellipsoids"]
    head += ["largest segment, %", "density later, lower"]
    scenes = results["scenes"]
    rows = [_cells(one, len(scenes)) for one in results["rows"]]
    return Page(
        name="readings",
        title="Alternative readings of the paper",
        introduction=[INTRODUCTION],
        sections=[Section("Readings", [f"Scenes: {', '.join(scenes)}.", Table(head, rows)])],
        method=[DEFINITIONS],
        command=COMMAND,
    )


def _cells(one: dict[str, Any], scenes: int) -> list[str]:
    compared = "density_later" in one
    return [
        one["reading"],
        "{:.3g} to {:.3g}".format(*one["threshold"]),
        f"{one['shared_loss']:.3f}",
        "{:.1f} to {:.1f}".format(*(100.0 * value for value in one["completion"])),
        f"{one['aicc']:.2f}",
        f"{one['count']:,.0f}",
        "{:.1f} to {:.1f}".format(*(100.0 * value for value in one["largest"])),
        f"{one['density_later']}, {one['density_lower']} of {scenes}" if compared else "",
    ]


def main(argv: Sequence[str] | None = None) -> int:
    """Try all readings on all scenes; returns 0."""
    return run_command("paper.readings", _options, _run, argv)


def _options(parser: ArgumentParser) -> None:
    sources = f"besides the simulated scenes: {SOURCES}"
    parser.add_argument("sources", nargs="*", metavar="SOURCE", help=sources)


def _run(args: Namespace) -> int:
    scenes = dict(load(spec) for spec in [*SCENES, *args.sources])
    readings = (*SHAPES, *DENSITIES, *PARSIMONIES)
    minima: dict[str, list[Minimum]] = {}
    with progress_steps(len(readings), "readings", args) as begin, ThreadPoolExecutor(2) as pool:
        for reading in readings:  # kernels release the GIL
            begin(reading.name)
            minima[reading.name] = list(pool.map(minimum, scenes.values(), repeat(reading)))
    results = {"scenes": list(scenes), "rows": [row(reading, minima) for reading in readings]}
    publish(results, page, args)
    return 0


if __name__ == "__main__":
    sys.exit(run_program("studies.paper.readings", main))
