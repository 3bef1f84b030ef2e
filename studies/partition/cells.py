"""What one method does with one cloud, at every wanted number of segments."""

import gc
import math
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict
from statistics import median
from typing import Any

import numpy as np

from ellipseg_ros.node.memory import peak_mb, reset_peak, resident_mb
from ellipseg_ros.records import Array
from studies.partition.methods import SEGMENTS, Method, Run, Settings
from studies.partition.metrics import score_instances, score_partition
from studies.partition.parameter_search import Search, reached
from studies.partition.scan import Scan, completed

OWN = "own"  # instead of a wanted count: what the method's own settings give
RUNS, PATIENCE = 3, 2.0  # times that a method runs, unless once takes longer than so many s
Cell = dict[str, Any]  # JSON-ready


def cells(method: Method, scan: Scan, wanted: list[int | str]) -> Iterator[Cell]:
    """Yield the scores at every wanted count, and time and memory of the best settings.

    The best of the method's grid is that with the highest mean IoU. What is timed is a run from
    the points on, with nothing prepared but compiled kernels.
    """
    warm_up(method)
    run = Remembered(method.prepare(scan.points))
    searches = [search(method, settings, run) for settings in method.grid]
    for count in wanted:
        chances = [
            settings_at(method, settings, found, count)
            for settings, found in zip(method.grid, searches, strict=True)
        ]
        best = max(chances, key=lambda settings: rank(scan, run(settings), count))
        labels = run(best)
        found_count = segments(labels)
        head = {"method": method.name, "wanted": count, "count": found_count, "settings": best}
        if count != OWN and not reached(found_count, int(count)):
            yield head | {"reached": False}
            continue
        yield head | {"reached": True} | scores(scan, labels) | costs(method, scan.points, best)


class Remembered:
    """A run that does nothing twice."""

    def __init__(self, run: Run) -> None:
        self._run = run
        self._known: dict[tuple[Any, ...], Array] = {}

    def __call__(self, settings: Settings) -> Array:
        """Labels (n,), from the run or from memory."""
        key = tuple(sorted(settings.items()))
        if key not in self._known:
            self._known[key] = np.array(self._run(settings), dtype=np.int32)
        return self._known[key]


def warm_up(method: Method) -> None:
    """Load and compile all that a run needs, on a few points."""
    points = np.random.default_rng(0).uniform(0.0, 20.0, (3000, 3))
    method.prepare(points)(method.grid[0])


def search(method: Method, settings: Settings, run: Run) -> Search | None:
    """What will find the settings for a count; None where the count is a setting."""
    dial = method.dial
    if dial is None:
        return None
    found = Search(dial, lambda value: segments(run(settings | {dial.name: value})))
    found.begin(float(settings[dial.name]))
    return found


def settings_at(
    method: Method, settings: Settings, found: Search | None, count: int | str
) -> Settings:
    """The settings of the grid, changed so that they give the wanted count."""
    if count == OWN:
        return settings
    if found is None or method.dial is None:
        return settings | {SEGMENTS: int(count)}
    return settings | {method.dial.name: found.seek(int(count))}


def segments(labels: Array) -> int:
    """How many there are."""
    return len(np.unique(labels[labels >= 0]))


def rank(scan: Scan, labels: Array, count: int | str) -> tuple[bool, float]:
    """What makes one of the grid better than another: the count is met, then the mean IoU."""
    met = count == OWN or reached(segments(labels), int(count))
    full = completed(labels, scan.points)
    return met, score_partition(full, scan.classes, scan.edges).mean_iou


def scores(scan: Scan, labels: Array) -> Cell:
    """All that is known of the quality of labels (n,), negative for none."""
    full = completed(labels, scan.points)
    found: Cell = {"covered": float(np.mean(labels >= 0))}
    found |= asdict(score_partition(full, scan.classes, scan.edges))
    found["iou"] = {str(name): value for name, value in found["iou"].items()}
    if scan.instances is not None:
        found |= asdict(score_instances(full, scan.instances, scan.known))
    return rounded(found)


def rounded(values: Cell) -> Cell:
    """To five places; None for NaN, which JSON has not."""
    return {
        name: rounded(value)
        if isinstance(value, dict)
        else None
        if math.isnan(value)
        else round(value, 5)
        for name, value in values.items()
    }


def costs(method: Method, points: Array, settings: Settings) -> Cell:
    """Time and memory of a run from the points on."""
    return measured(lambda: method.prepare(points)(settings))


def measured(call: Callable[[], object]) -> Cell:
    """Seconds by the clock and of all cores, median of runs; MB that are held at most, beyond
    those from before."""
    walls, processors, peaks = [], [], []
    gc.collect()
    for _ in range(RUNS):
        reset_peak()
        before = resident_mb()
        wall, processor = time.perf_counter(), time.process_time()
        call()
        walls.append(time.perf_counter() - wall)
        processors.append(time.process_time() - processor)
        peaks.append(max(0.0, peak_mb() - before))
        if walls[0] > PATIENCE:
            break
    return {
        "seconds": round(median(walls), 4),
        "cpu_s": round(median(processors), 4),
        "memory_mb": round(max(peaks), 1),
        "runs": len(walls),
    }
