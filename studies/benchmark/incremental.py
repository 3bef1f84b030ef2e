"""Sections about streams, without ROS: updates, stages, window length, density, recording."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice

import numpy as np

from ellipseg_ros.config import Config
from ellipseg_ros.core.criteria import CRITERIA
from ellipseg_ros.errors import InputError
from ellipseg_ros.io.sources import open_source
from ellipseg_ros.records import ISOLATED, Array, Segmentation, Sweep
from ellipseg_ros.segmenter import Segmenter, segment
from ellipseg_ros.simulation.scanner import SWEEPS_PER_SECOND
from ellipseg_ros.simulation.simulator import simulate
from studies.benchmark import stages
from studies.benchmark.batch import Section, batch_case, batch_points, knn
from studies.benchmark.streams import (
    RATE,
    SCENE,
    SEGMENTS_ONLY,
    SETTLE,
    Sizes,
    dense,
    points_per_second,
    steps,
    thinned,
    window_points,
)
from studies.report.timing import in_turn, milliseconds, ratio, timed

# Thresholds at which the ground is a few segments, or one.
COARSE = {"shape": (20.0, 40.0), "density": (6.0,), "parsimony": (20_000.0,)}
SHORT, LONG = 0.1, 1.0  # s: update periods
TOTAL = "total"


@dataclass
class Pairs:
    """Times of updates of a full window, and of the batch of the same window right after."""

    update: list[float]  # s, mean of the updates since the last batch
    batch: list[float]  # s
    last: Segmentation | None = None

    def extend(self, later: "Pairs") -> None:
        """Append later measurements."""
        self.update += later.update
        self.batch += later.batch
        self.last = later.last

    def as_json(self) -> Section:
        """Times in ms, their ratio, and the size of the last window."""
        assert self.last is not None  # every caller makes at least one update
        points = int((self.last.labels >= ISOLATED).sum())
        largest = int(self.last.ellipsoids.count.max(initial=0))
        return {
            "points": points,
            "segments": len(self.last.ids),
            "largest_share": round(largest / max(1, points), 4),
            "update_ms": milliseconds(self.update),
            "batch_ms": milliseconds(self.batch),
            "ratio": ratio(self.update, self.batch),
        }


def updates(sizes: Sizes) -> Section:
    """Times of updates and batches, at the threshold of lowest AICc and at coarse ones."""
    points = batch_points(sizes)
    cases = []
    for criterion in CRITERIA:
        best = _best_threshold(points, criterion, sizes)
        coarse = [("coarse", threshold) for threshold in COARSE[criterion]]
        for kind, threshold in (("lowest AICc", best), *coarse):
            config = replace(
                SEGMENTS_ONLY,
                criterion=criterion,
                threshold=threshold,
                window_duration=sizes.window,
            )
            head = {"criterion": criterion, "kind": kind, "threshold": threshold}
            cases += _cases(head, config, _drive(sizes), sizes)
    return {"window_s": sizes.window, "cases": cases}


def _best_threshold(points: Array, criterion: str, sizes: Sizes) -> float:
    """The threshold of lowest AICc among a few around the default."""
    segmentations = [
        segment(
            points,
            replace(
                SEGMENTS_ONLY,
                criterion=criterion,
                threshold=CRITERIA[criterion].default_threshold * factor,
            ),
        )
        for factor in sizes.factors
    ]
    return float(min(segmentations, key=lambda result: result.aicc).threshold)


def _drive(sizes: Sizes) -> Iterator[Sweep]:
    """A simulated drive that is long enough for all measurements on it."""
    return iter(simulate(SCENE, duration=sizes.window + sizes.measured + 2.0))


def _cases(head: Section, config: Config, drive: Iterator[Sweep], sizes: Sizes) -> list[Section]:
    """Fill a window, then measure updates of 1 s and of 0.1 s."""
    segmenter = Segmenter(config)
    _fill([segmenter], drive, sizes.fill, config.window_duration + 1.0)
    pairs = _measure(segmenter, steps(drive, LONG, sizes.seconds), 1)
    cases = [head | {"period": LONG} | pairs.as_json()]
    _fill([segmenter], drive, SHORT, SETTLE * SHORT)
    pairs = _measure(segmenter, steps(drive, SHORT, sizes.tenths), sizes.per_batch)
    return [*cases, head | {"period": SHORT} | pairs.as_json()]


def _fill(
    segmenters: Iterable[Segmenter], drive: Iterator[Sweep], period: float, seconds: float
) -> None:
    """Process the next seconds of a drive without measuring."""
    for sweep in steps(drive, period, round(seconds / period)):
        for segmenter in segmenters:
            segmenter.process(sweep)


def _measure(segmenter: Segmenter, sweeps: Iterator[Sweep], per_batch: int) -> Pairs:
    """Time updates and, after every `per_batch` of them, a batch of the window."""
    pairs = Pairs([], [])
    while part := list(islice(sweeps, per_batch)):
        times = []
        for sweep in part:
            seconds, pairs.last = timed(partial(segmenter.process, sweep))
            times.append(seconds)
        pairs.update.append(float(np.mean(times)))
        pairs.batch.append(timed(batch_of(pairs.last, segmenter.config))[0])
    return pairs


def batch_of(window: Segmentation | None, config: Config) -> Callable[[], Segmentation]:
    """A call that segments the points of a window in one batch."""
    assert window is not None
    points = window.points[window.labels >= ISOLATED]
    return partial(segment, points, config, origin=window.origin)


# --- stages ----------------------------------------------------------------------------------


def stage_times(sizes: Sizes) -> Section:
    """Time of every stage in a batch, and in updates of 1 s and of 0.1 s."""
    segmenter = Segmenter(Config(window_duration=sizes.window))  # with objects
    drive = _drive(sizes)
    _fill([segmenter], drive, sizes.fill, sizes.window)
    window = segmenter.process(next(steps(drive, LONG, 1)))
    columns = {"batch": _stage_times([batch_of(window, segmenter.config)] * sizes.runs)}
    for title, period, count in (("1 s", LONG, sizes.seconds), ("0.1 s", SHORT, sizes.tenths)):
        sweeps = steps(drive, period, count)
        columns[title] = _stage_times(partial(_update, segmenter, sweep) for sweep in sweeps)
        _fill([segmenter], drive, SHORT, SETTLE * SHORT)
    rows = [
        {"stage": name} | {title: milliseconds(times[name]) for title, times in columns.items()}
        for name in (*stages.NAMES, TOTAL)
    ]
    return {"points": int((window.labels >= ISOLATED).sum()), "stages": rows}


def _update(segmenter: Segmenter, sweep: Sweep) -> Segmentation:
    """One update; `process` is looked up here, after the stage clock has replaced it."""
    return segmenter.process(sweep)


def _stage_times(calls: Iterable[Callable[[], Segmentation]]) -> dict[str, list[float]]:
    """Seconds of every stage and in total, of each call."""
    times: dict[str, list[float]] = {name: [] for name in (*stages.NAMES, TOTAL)}
    for call in calls:
        with stages.stage_clock() as clock:
            times[TOTAL].append(timed(call)[0])
        for name, seconds in clock.seconds.items():
            times[name].append(seconds)
    return times


# --- length and density ----------------------------------------------------------------------


def lengths(sizes: Sizes) -> Section:
    """Times of windows of several lengths on one drive, alternating at every step."""
    sizes = _half(sizes)
    segmenters = {
        seconds: Segmenter(replace(SEGMENTS_ONLY, window_duration=seconds))
        for seconds in sizes.lengths
    }
    longest = max(sizes.lengths)
    drive = iter(simulate(SCENE, duration=longest + sizes.measured + 2.0))
    for number, sweep in enumerate(steps(drive, LONG, round(longest) + 1)):
        for seconds, segmenter in segmenters.items():
            if number >= longest - seconds - 1.0:
                segmenter.process(sweep)
    cases = _length_cases(segmenters, LONG, steps(drive, LONG, sizes.seconds), 1)
    _fill(segmenters.values(), drive, SHORT, SETTLE * SHORT)
    sweeps = steps(drive, SHORT, sizes.tenths)
    return {"cases": cases + _length_cases(segmenters, SHORT, sweeps, sizes.per_batch)}


def _half(sizes: Sizes) -> Sizes:
    """Half as many updates, for sections with large windows."""
    return replace(sizes, seconds=-(-sizes.seconds // 2), tenths=-(-sizes.tenths // 2))


def _length_cases(
    segmenters: dict[float, Segmenter], period: float, sweeps: Iterator[Sweep], per_batch: int
) -> list[Section]:
    measured = {seconds: Pairs([], []) for seconds in segmenters}
    while part := list(islice(sweeps, per_batch)):
        for seconds, segmenter in segmenters.items():
            measured[seconds].extend(_measure(segmenter, iter(part), per_batch))
    return [
        {"window_s": seconds, "period": period}
        | pairs.as_json()
        | {
            "ratio_to": {
                f"{other:g}": ratio(pairs.update, measured[other].update) for other in measured
            }
        }
        for seconds, pairs in measured.items()
    ]


def densities(sizes: Sizes) -> Section:
    """Times on the same drive at increasing point rates, in windows of one length."""
    few = replace(_half(sizes), window=sizes.density_window)
    config = replace(SEGMENTS_ONLY, window_duration=few.window)
    cases = []
    for rate in sizes.densities:
        drive = dense(rate, few.window + few.measured + 2.0)
        cases += _cases({"points_per_second": rate}, config, drive, few)
    return {"window_s": few.window, "cases": cases}


def recording(spec: str, sizes: Sizes) -> Section:
    """Times of batch and updates on a recording, thinned to 20,000 points/s.

    A cloud counts as 0.1 s. The first half fills the window, at most 25 s.
    """
    source = open_source(spec)
    clouds = source.count or sum(1 for _ in source)
    half = clouds / 2.0 / SWEEPS_PER_SECOND  # s
    seconds = int(min(sizes.seconds, max(0.0, half - 1.0) / 2.0))
    tenths = min(sizes.tenths, int(half * SWEEPS_PER_SECOND) - 10 * (seconds + 1) - SETTLE)
    if seconds < 1 or tenths < 1:
        raise InputError(f"{spec} has {clouds} clouds; a benchmark of updates needs 60 or more")
    few = replace(sizes, window=min(sizes.window, half), seconds=seconds, tenths=tenths)
    share = RATE / points_per_second(source)
    drive = thinned(source, share)
    cases = _cases(
        {"criterion": "shape"}, replace(SEGMENTS_ONLY, window_duration=few.window), drive, few
    )
    points = window_points(thinned(source, share), few.window)
    calls = {"shape": partial(segment, points, SEGMENTS_ONLY)} | knn(points)
    times = in_turn(calls, few.runs)
    return {
        "source": source.name,
        "window_s": few.window,
        "points_per_second": round(min(share, 1.0) * points_per_second(source)),
        "points": len(points),
        "batch": batch_case("shape", points, times),
        "cases": cases,
    }
