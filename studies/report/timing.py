"""Timing on a noisy machine: alternating runs, medians with quartiles, ratios of adjacent runs."""

import gc
import math
import time
from collections.abc import Callable
from typing import Any

import numpy as np


def spread(values: list[float], scale: float = 1.0) -> dict[str, Any]:
    """Median and quartiles of `values` times `scale` to four digits, and their number."""
    low, median, high = np.percentile(np.array(values) * scale, [25, 50, 75])
    named = {"median": median, "low": low, "high": high}
    return {name: float(f"{value:.4g}") for name, value in named.items()} | {"runs": len(values)}


def milliseconds(seconds: list[float]) -> dict[str, Any]:
    """Median and quartiles in ms."""
    return spread(seconds, 1e3)


def ratio(upper: list[float], lower: list[float]) -> dict[str, Any]:
    """Median and quartiles of the ratios of times that were measured one right after the other."""
    return spread([a / b for a, b in zip(upper, lower, strict=True)])


def timed(call: Callable[[], Any]) -> tuple[float, Any]:
    """Seconds that a call takes, and its result; garbage is collected before, not during it."""
    gc.collect()
    gc.disable()
    try:
        start = time.perf_counter()
        result = call()
        return time.perf_counter() - start, result
    finally:
        gc.enable()


def in_turn(
    calls: dict[str, Callable[[], Any]], runs: int, max_repeated_s: float = math.inf
) -> dict[str, list[float]]:
    """Seconds of every call in `runs` rounds, after a first round that is not counted.

    A call that takes more than `max_repeated_s` in the first round is not repeated: that time
    is its only one.
    """
    first = {name: timed(call)[0] for name, call in calls.items()}
    slow = {name for name, seconds in first.items() if seconds > max_repeated_s}
    times = {name: [first[name]] if name in slow else [] for name in calls}
    for _ in range(runs):
        for name in calls:
            if name not in slow:
                times[name].append(timed(calls[name])[0])
    return times
