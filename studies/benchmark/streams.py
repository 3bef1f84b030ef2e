"""Streams of the benchmark, and how much of them is measured."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from ellipseg_ros.config import Config, LandmarksConfig, ObjectsConfig
from ellipseg_ros.core.fields import join_sweeps
from ellipseg_ros.records import SECOND, Array, Sweep
from ellipseg_ros.simulation.scanner import SWEEPS_PER_SECOND
from ellipseg_ros.simulation.simulator import simulate

SCENE = "industrial"
RATE = 20_000  # points/s that recordings are thinned to
SETTLE = 5  # updates that are not measured after a change of period
WEYL = np.uint64(0x9E3779B97F4A7C15)  # 2^64 / golden ratio; multiples are evenly distributed


@dataclass(frozen=True)
class Sizes:
    """Amounts that are measured."""

    window: float = 25.0  # s
    points: int = 150_000  # of a batch
    runs: int = 9  # of calls that are compared
    fill: float = 1.0  # s: period of the updates that fill a window before it is measured
    seconds: int = 10  # updates measured at a period of 1 s
    tenths: int = 40  # updates measured at a period of 0.1 s
    per_batch: int = 4  # updates of 0.1 s between two batches
    lengths: tuple[float, ...] = (12.5, 25.0, 50.0, 100.0)  # s, of windows
    densities: tuple[int, ...] = (5_000, 10_000, 20_000, 50_000, 100_000)  # points/s
    density_window: float = 5.0  # s
    listen: float = 20.0  # s over which latency is measured
    starts: int = 5  # of the node with a warm cache
    cold: bool = True  # one start with an empty cache, too
    factors: tuple[float, ...] = (0.5, 0.7, 1.0, 1.4, 2.0)  # of the default threshold, for AICc

    @property
    def measured(self) -> float:
        """Seconds of a drive that are measured once its window is full."""
        return self.seconds + (self.tenths + SETTLE) / SWEEPS_PER_SECOND


# Requirements and ratios are of segments; objects and landmarks have rows among the stages.
SEGMENTS_ONLY = Config(
    objects=ObjectsConfig(enabled=False), landmarks=LandmarksConfig(enabled=False)
)
FULL = Sizes()
QUICK = Sizes(
    window=5.0,
    points=30_000,
    runs=3,
    seconds=3,
    tenths=8,
    lengths=(2.5, 5.0, 10.0),
    densities=(5_000, 20_000),
    density_window=2.0,
    listen=4.0,
    starts=1,
    cold=False,
    factors=(1.0,),
)


def steps(drive: Iterator[Sweep], period: float, count: int) -> Iterator[Sweep]:
    """Yield the sweeps of the next `count` updates of a drive: one every `period` s."""
    for _ in range(count):
        part = list(islice(drive, round(period * SWEEPS_PER_SECOND)))
        if not part:
            return
        yield join_sweeps(part)


def window_points(sweeps: Iterable[Sweep], seconds: float, points: int = 0) -> Array:
    """Finite points of the first `seconds` s; at most `points`, evenly spread, if not 0."""
    cloud = join_sweeps(list(until(sweeps, seconds))).points
    cloud = cloud[np.isfinite(cloud).all(axis=1)]
    if not points or len(cloud) <= points:
        return cloud
    return cloud[np.linspace(0, len(cloud) - 1, points).astype(np.int64)]


def until(sweeps: Iterable[Sweep], seconds: float) -> Iterator[Sweep]:
    """Yield the sweeps with stamps in the first `seconds` s."""
    first = None
    for sweep in sweeps:
        first = sweep.stamp_ns if first is None else first
        if sweep.stamp_ns >= first + round(seconds * SECOND):
            return
        yield sweep


def thinned(sweeps: Iterable[Sweep], share: float) -> Iterator[Sweep]:
    """Yield the sweeps with a share of their points, evenly spread; deterministic."""
    serial = 0
    limit = np.uint64(min(share, 1.0) * 2**32)
    for sweep in sweeps:
        number = np.arange(serial, serial + len(sweep), dtype=np.uint64)
        serial += len(sweep)
        yield sweep if share >= 1.0 else sweep.keep((number * WEYL) >> np.uint64(32) < limit)


def points_per_second(sweeps: Iterable[Sweep]) -> float:
    """Mean point rate of a stream; 0 if all stamps are equal."""
    stamps, points = [], 0
    for sweep in sweeps:
        stamps.append(sweep.stamp_ns)
        points += len(sweep)
    span = (max(stamps) - min(stamps)) / SECOND * len(stamps) / max(1, len(stamps) - 1)
    return points / span if span else 0.0


def dense(rate: int, seconds: float) -> Iterator[Sweep]:
    """Simulated drive with `rate` points/s, as if several scanners were on one vehicle.

    The vehicle drives an integer factor slower and is played back that much faster, so that scan
    lines lie closer together and none is repeated; then points are thinned to the rate. The drift
    of the registration stays as usual.
    """
    base = points_per_second(simulate(SCENE, duration=5.0))
    times = int(np.ceil(1.1 * rate / base))  # 1.1: parts of the scene are emptier
    slow = simulate(SCENE, duration=seconds * times, speed=3.0 / times, drift=0.05 / times**0.5)
    joined = list(_faster(slow, times))
    return thinned(joined, rate / points_per_second(joined))


def _faster(sweeps: Iterable[Sweep], times: int) -> Iterator[Sweep]:
    """Yield every `times` sweeps as one of a tenth of a second."""
    source = iter(sweeps)
    first = None
    while part := list(islice(source, times)):
        first = part[0].stamp_ns if first is None else first
        offsets = np.concatenate([sweep.times_ns for sweep in part]) - part[0].stamp_ns
        stamp_ns = first + (part[0].stamp_ns - first) // times
        joined = join_sweeps(part)
        yield replace(joined, stamp_ns=stamp_ns, offsets_ns=offsets // times)
