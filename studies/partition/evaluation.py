"""Scores and cost of one method on one cloud, at every target number of segments."""

import gc
import math
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict
from functools import partial
from statistics import median
from typing import Any

import numpy as np

from ellipseg_ros.node.memory import peak_mb, resident_mb
from ellipseg_ros.records import Array
from studies.memory import reset_peak
from studies.partition.methods import SEGMENTS, Method, Run, Settings
from studies.partition.metrics import score_instances, score_partition
from studies.partition.parameter_search import Search, reached
from studies.partition.scan import Scan, completed

DEFAULT = "default"  # instead of a target count: the method with the settings of its grid
RUNS = 3  # timed runs of a method
MAX_REPEATED_S = 2.0  # a method that takes longer is timed once
Evaluation = dict[str, Any]  # JSON-ready


def evaluate(method: Method, scan: Scan, targets: list[int | str]) -> Iterator[Evaluation]:
    """Yield scores, time and memory at every target, for the best settings of the grid.

    The best settings are those with the highest mean IoU. A timed run goes from points to
    labels, with nothing prepared but compiled kernels.
    """
    warm_up(method)
    run = _cached(method.prepare(scan.points))
    searches = [_begin_search(method, settings, run) for settings in method.grid]
    for target in targets:
        candidates = [
            _settings_at(method, settings, search, target)
            for settings, search in zip(method.grid, searches, strict=True)
        ]
        best = max(candidates, key=lambda settings: _rank(scan, run(settings), target))
        labels = run(best)
        count = segment_count(labels)
        head = {"method": method.name, "target": target, "count": count, "settings": best}
        if target != DEFAULT and not reached(count, int(target)):
            yield head | {"reached": False}
            continue
        cost = measured(partial(run_once, method, scan.points, best))
        yield head | {"reached": True} | scores(scan, labels) | cost


def warm_up(method: Method) -> None:
    """Load and compile everything that a run needs, on a few points."""
    points = np.random.default_rng(0).uniform(0.0, 20.0, (3000, 3))
    method.prepare(points)(method.grid[0])


def run_once(method: Method, points: Array, settings: Settings) -> Array:
    """Labels (n,) of points (n, 3), m, with nothing prepared."""
    return method.prepare(points)(settings)


def segment_count(labels: Array) -> int:
    """Number of different labels (n,) that are not negative."""
    return len(np.unique(labels[labels >= 0]))


def scores(scan: Scan, labels: Array) -> Evaluation:
    """All scores of labels (n,), negative for no segment."""
    full = completed(labels, scan.points)
    values: Evaluation = {"covered": float(np.mean(labels >= 0))}
    values |= asdict(score_partition(full, scan.classes, scan.edges))
    values["iou"] = {str(name): value for name, value in values["iou"].items()}
    if scan.instances is not None:
        values |= asdict(score_instances(full, scan.instances, scan.known))
    return _rounded(values)


def measured(call: Callable[[], object]) -> Evaluation:
    """Wall-clock and CPU seconds of a call, median of its runs, and its peak memory in MB.

    The memory is that beyond what the process held before.
    """
    wall_s, cpu_s, memory_mb = [], [], []
    gc.collect()
    for _ in range(RUNS):
        reset_peak()
        before = resident_mb()
        wall, cpu = time.perf_counter(), time.process_time()
        call()
        wall_s.append(time.perf_counter() - wall)
        cpu_s.append(time.process_time() - cpu)
        memory_mb.append(max(0.0, peak_mb() - before))
        if wall_s[0] > MAX_REPEATED_S:
            break
    return {
        "seconds": round(median(wall_s), 4),
        "cpu_s": round(median(cpu_s), 4),
        "memory_mb": round(max(memory_mb), 1),
        "runs": len(wall_s),
    }


def _cached(run: Run) -> Run:
    """The same run, which computes the labels of equal settings once."""
    known: dict[tuple[Any, ...], Array] = {}

    def cached(settings: Settings) -> Array:
        key = tuple(sorted(settings.items()))
        if key not in known:
            known[key] = np.array(run(settings), dtype=np.int32)
        return known[key]

    return cached


def _begin_search(method: Method, settings: Settings, run: Run) -> Search | None:
    """A search with the count at `settings`; None if the count is a setting."""
    parameter = method.parameter
    if parameter is None:
        return None
    search = Search(
        parameter, lambda value: segment_count(run(settings | {parameter.name: value}))
    )
    search.evaluate(float(settings[parameter.name]))
    return search


def _settings_at(
    method: Method, settings: Settings, search: Search | None, target: int | str
) -> Settings:
    """Settings of the grid, changed to give the target count."""
    if target == DEFAULT:
        return settings
    if search is None or method.parameter is None:
        return settings | {SEGMENTS: int(target)}
    return settings | {method.parameter.name: search.seek(int(target))}


def _rank(scan: Scan, labels: Array, target: int | str) -> tuple[bool, float]:
    """Key for the best settings of a grid: target met, then mean IoU."""
    met = target == DEFAULT or reached(segment_count(labels), int(target))
    full = completed(labels, scan.points)
    return met, score_partition(full, scan.classes, scan.edges).mean_iou


def _rounded(values: Evaluation) -> Evaluation:
    """To five decimals; NaN becomes None, as JSON has no NaN."""
    return {
        name: _rounded(value)
        if isinstance(value, dict)
        else None
        if math.isnan(value)
        else round(value, 5)
        for name, value in values.items()
    }
