"""Times that a noisy machine cannot spoil: several runs, taken in turn, compared pair by pair."""

import gc
import math
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Spread:
    """Several measurements of one thing."""

    median: float
    low: float  # quartiles
    high: float
    runs: int

    def as_json(self) -> dict[str, Any]:
        """JSON-ready, to four digits."""
        return {name: float(f"{value:.4g}") for name, value in asdict(self).items()} | {
            "runs": self.runs
        }


def spread(values: list[float], scale: float = 1.0) -> dict[str, Any]:
    """Median and quartiles of `values` times `scale`, JSON-ready."""
    low, median, high = np.percentile(np.array(values) * scale, [25, 50, 75])
    return Spread(float(median), float(low), float(high), len(values)).as_json()


def milliseconds(seconds: list[float]) -> dict[str, Any]:
    """Median and quartiles in ms."""
    return spread(seconds, 1e3)


def ratio(upper: list[float], lower: list[float]) -> dict[str, Any]:
    """Median and quartiles of the ratios, each of two times measured right after one another."""
    return spread([a / b for a, b in zip(upper, lower, strict=True)])


def timed(call: Callable[[], Any]) -> tuple[float, Any]:
    """Seconds that a call takes, and what it returns; garbage is collected before, not in it."""
    gc.collect()
    gc.disable()
    try:
        start = time.perf_counter()
        result = call()
        return time.perf_counter() - start, result
    finally:
        gc.enable()


def in_turn(
    calls: dict[str, Callable[[], Any]], runs: int, patience: float = math.inf
) -> dict[str, list[float]]:
    """Seconds of every call, `runs` times, one after the other and again.

    Each is called once before; that counts only for a call that takes more than `patience` s, and
    is its only run.
    """
    first = {name: timed(call)[0] for name, call in calls.items()}
    times = {name: [seconds] if seconds > patience else [] for name, seconds in first.items()}
    again = [name for name, seconds in first.items() if seconds <= patience]
    for _ in range(runs):
        for name in again:
            times[name].append(timed(calls[name])[0])
    return times
