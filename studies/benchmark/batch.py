"""Sections about one cloud: batch, peers."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

from ellipseg_ros.config import CRITERIA
from ellipseg_ros.doctor.packages import load, version_of
from ellipseg_ros.records import Array
from ellipseg_ros.segmenter import segment
from ellipseg_ros.simulation.simulator import simulate
from studies.benchmark import peers
from studies.benchmark.streams import SCENE, SEGMENTS_ALONE, Sizes, window_points
from studies.report.timing import in_turn, milliseconds, ratio

PATIENCE = 5.0  # s: a peer that takes longer is run once
Section = dict[str, Any]


def batch(sizes: Sizes) -> Section:
    """`segment()` against the neighbour search of small_gicp, for every criterion."""
    points = batch_points(sizes)
    calls = {
        name: partial(segment, points, replace(SEGMENTS_ALONE, criterion=name))
        for name in CRITERIA
    }
    times = in_turn(calls | knn(points), sizes.runs)
    cases = [batch_case(name, points, times) for name in CRITERIA]
    result: Section = {"points": len(points), "cases": cases}
    if "knn" not in times:
        return result | {"missing": {peers.KNN.name: load(peers.KNN.package, peers.KNN.module)[1]}}
    return result | {"knn_ms": milliseconds(times["knn"])}


def knn(points: Array) -> dict[str, Callable[[], Any]]:
    """The search that a batch is compared with, if it is installed."""
    module, _ = load(peers.KNN.package, peers.KNN.module)
    return {} if module is None else {"knn": peers.KNN.prepare(module, points)}


def batch_case(criterion: str, points: Array, times: dict[str, list[float]]) -> Section:
    """The times of a criterion, beside those of the search."""
    found = segment(points, replace(SEGMENTS_ALONE, criterion=criterion))
    case: Section = {
        "criterion": criterion,
        "threshold": found.threshold,
        "segments": len(found.ids),
        "batch_ms": milliseconds(times[criterion]),
    }
    if "knn" in times:
        case["ratio"] = ratio(times[criterion], times["knn"])
    return case


def peer_times(sizes: Sizes) -> Section:
    """Everything that others do with the same points, and what one batch takes beside it."""
    points = batch_points(sizes)
    calls: dict[str, Callable[[], Any]] = {"ellipseg": partial(segment, points, SEGMENTS_ALONE)}
    missing = {}
    for peer in peers.PEERS:
        module, why = load(peer.package, peer.module)
        if module is None:
            missing[peer.name] = why
        else:
            calls[peer.name] = peer.prepare(module, points)
    times = in_turn(calls, max(1, sizes.runs // 2), PATIENCE)
    rows = [
        {"name": peer.name, "about": peer.about, "version": version_of(peer.package, peer.module)}
        | {"ms": milliseconds(times[peer.name])}
        for peer in peers.PEERS
        if peer.name in times
    ]
    return {
        "points": len(points),
        "ellipseg_ms": milliseconds(times["ellipseg"]),
        "peers": rows,
        "missing": missing,
    }


def batch_points(sizes: Sizes) -> Array:
    """The simulated points that batches are made of."""
    return window_points(simulate(SCENE, duration=sizes.window), sizes.window, sizes.points)
