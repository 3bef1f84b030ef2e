"""Sections about one cloud: batch, other libraries."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

from ellipseg_ros.core.criteria import CRITERIA
from ellipseg_ros.doctor.installation import version_of
from ellipseg_ros.records import Array
from ellipseg_ros.segmenter import segment
from ellipseg_ros.simulation.simulator import simulate
from studies.benchmark import peers
from studies.benchmark.streams import SCENE, SEGMENTS_ONLY, Sizes, window_points
from studies.report.packages import load
from studies.report.timing import in_turn, milliseconds, ratio

MAX_REPEATED_S = 5.0  # a library that takes longer runs once
Section = dict[str, Any]


def batch(sizes: Sizes) -> Section:
    """Times of `segment()` for every criterion, and of small_gicp's neighbour search."""
    points = batch_points(sizes)
    calls = {
        name: partial(segment, points, replace(SEGMENTS_ONLY, criterion=name)) for name in CRITERIA
    }
    times = in_turn(calls | knn(points), sizes.runs)
    cases = [batch_case(name, points, times) for name in CRITERIA]
    result: Section = {"points": len(points), "cases": cases}
    if "knn" not in times:
        return result | {"missing": {peers.KNN.name: load(peers.KNN.package, peers.KNN.module)[1]}}
    return result | {"knn_ms": milliseconds(times["knn"])}


def knn(points: Array) -> dict[str, Callable[[], Any]]:
    """The neighbour search that a batch is compared with, if it is installed."""
    module, _ = load(peers.KNN.package, peers.KNN.module)
    return {} if module is None else {"knn": peers.KNN.prepare(module, points)}


def batch_case(criterion: str, points: Array, times: dict[str, list[float]]) -> Section:
    """Times and segments of a criterion, and the ratio to the neighbour search, if measured."""
    segmentation = segment(points, replace(SEGMENTS_ONLY, criterion=criterion))
    case: Section = {
        "criterion": criterion,
        "threshold": segmentation.threshold,
        "segments": len(segmentation.ids),
        "batch_ms": milliseconds(times[criterion]),
    }
    if "knn" in times:
        case["ratio"] = ratio(times[criterion], times["knn"])
    return case


def peer_times(sizes: Sizes) -> Section:
    """Times of other libraries on the same points, alternating with a batch."""
    points = batch_points(sizes)
    calls: dict[str, Callable[[], Any]] = {"ellipseg": partial(segment, points, SEGMENTS_ONLY)}
    missing = {}
    for peer in peers.PEERS:
        module, reason = load(peer.package, peer.module)
        if module is None:
            missing[peer.name] = reason
        else:
            calls[peer.name] = peer.prepare(module, points)
    times = in_turn(calls, max(1, sizes.runs // 2), MAX_REPEATED_S)
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
    """Simulated points (n, 3), m, for all sections about one cloud."""
    return window_points(simulate(SCENE, duration=sizes.window), sizes.window, sizes.points)
