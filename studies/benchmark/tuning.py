"""Section about tuning: time of a whole AICc curve, and of one batch."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

from ellipseg_ros.core.criteria import CRITERIA
from ellipseg_ros.records import Array
from ellipseg_ros.segmenter import segment
from ellipseg_ros.tuning.search import Search, curve
from studies.benchmark.batch import batch_points
from studies.benchmark.streams import SEGMENTS_ONLY, Sizes
from studies.report.timing import in_turn, milliseconds, ratio

Section = dict[str, Any]


def curves(sizes: Sizes) -> Section:
    """Times of the AICc at every threshold of the grid, for every criterion."""
    points = batch_points(sizes)
    return {"points": len(points), "cases": [_case(name, points, sizes) for name in CRITERIA]}


def _case(criterion: str, points: Array, sizes: Sizes) -> Section:
    config, thresholds = replace(SEGMENTS_ONLY, criterion=criterion), Search().grid(criterion)
    calls: dict[str, Callable[[], Any]] = {
        "batch": partial(segment, points, config),
        "curve": partial(curve, points, config, thresholds),
    }
    times = in_turn(calls, max(2, sizes.runs // 3))
    return {
        "criterion": criterion,
        "thresholds": len(thresholds),
        "batch_ms": milliseconds(times["batch"]),
        "curve_ms": milliseconds(times["curve"]),
        "ratio": ratio(times["curve"], times["batch"]),
    }
