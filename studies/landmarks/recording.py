"""Association of two windows of a recording that have no sweep in common."""

from collections.abc import Callable
from typing import Any

import numpy as np

from ellipseg_ros.core.fields import join_sweeps
from ellipseg_ros.errors import InputError
from ellipseg_ros.io.sources import Source
from ellipseg_ros.records import SECOND, Array, Sweep
from studies.landmarks.association import all_scores, landmark_sets
from studies.landmarks.candidates import OURS, Method
from studies.landmarks.passes import Pass, TwoPasses

WINDOW_S = 3.0
DELAYS_S = (2.0, 5.0, 8.0)  # from the start of the first window to that of the second


def windows(source: Source, delay_s: float) -> TwoPasses:
    """The first window and a later one, which lacks the sweeps of the first.

    Raises InputError if the recording is too short.
    """
    sweep = join_sweeps(list(source))
    times = (sweep.times_ns - sweep.times_ns.min()) / SECOND
    if times.max(initial=0.0) < delay_s + 0.9 * WINDOW_S:
        raise InputError(
            f"the recording takes {times.max():.1f} s; give one of {delay_s + WINDOW_S:g} s"
        )
    first = times < WINDOW_S
    second = (times >= delay_s) & (times < delay_s + WINDOW_S) & ~first
    return TwoPasses(_pass(sweep, first), _pass(sweep, second))


def _pass(sweep: Sweep, mask: Array) -> Pass:
    return Pass(sweep.keep(mask), np.eye(4))


def study_recording(
    source: Source, methods: list[Method], begin: Callable[[str], object]
) -> list[dict[str, Any]]:
    """Associate windows of a recording by every method; begin: called before each."""
    runs = []
    for delay_s in DELAYS_S:
        passes = windows(source, delay_s)
        for method in methods:
            begin(f"{source.name}, {delay_s:g} s, {method.name}")
            earlier, later = (
                method.extract(each.sweep.points) for each in (passes.earlier, passes.later)
            )
            sets = landmark_sets(passes, earlier, later)
            scores = all_scores(sets, round(delay_s), has_covariance=method == OURS)
            runs.append({"delay_s": delay_s, "method": method.name, "association": scores})
    return runs
