"""Two windows of one recording, without a sweep in common, as two passes."""

from typing import Any

import numpy as np

from ellipseg_ros.core.fields import join_sweeps
from ellipseg_ros.errors import InputError
from ellipseg_ros.io.sources import Source
from ellipseg_ros.records import SECOND, Sweep
from studies.landmarks.methods import OURS, Method
from studies.landmarks.passes import Pass, TwoPasses
from studies.landmarks.recognition import in_one_frame, recognitions

WINDOW = 3.0  # s
APART = (2.0, 5.0, 8.0)  # s from the beginning of one to that of the other


def windows(source: Source, apart: float) -> TwoPasses:
    """The first window, and one that begins so many s later; what is in both goes to the first.

    InputError if the recording is too short.
    """
    everything = join_sweeps(list(source))
    times = (everything.times_ns - everything.times_ns.min()) / SECOND
    if times.max(initial=0.0) < apart + 0.9 * WINDOW:
        raise InputError(
            f"the recording takes {times.max():.1f} s; give one of {apart + WINDOW:g}"
        )
    first = times < WINDOW
    second = (times >= apart) & (times < apart + WINDOW) & ~first
    return TwoPasses(_cut(everything, first), _cut(everything, second))


def _cut(everything: Sweep, mask: Any) -> Pass:
    return Pass(everything.keep(mask), np.eye(4))


def study_recording(source: Source, methods: list[Method], begin: Any) -> list[dict[str, Any]]:
    """Associate the windows of a recording by every method."""
    runs = []
    for apart in APART:
        passes = windows(source, apart)
        for method in methods:
            begin(f"{source.name}, {apart:g} s, {method.name}")
            here, there = (method.find(one.sweep.points) for one in (passes.earlier, passes.later))
            sets = in_one_frame(passes, here, there)
            found = recognitions(sets, round(apart), honest=method == OURS)
            runs.append({"apart": apart, "method": method.name, "association": found})
    return runs
