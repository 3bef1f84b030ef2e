"""Alternating runs of objects and cut-pursuit, for ratios that a busy machine does not distort."""

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

from ellipseg_ros.records import Array
from studies.partition.evaluation import DEFAULT, Evaluation, run_once, warm_up
from studies.partition.means import pairs
from studies.partition.methods import OBJECTS, SEGMENTS, Method, Settings
from studies.partition.peers import CUT_PURSUIT
from studies.report.timing import in_turn, milliseconds, ratio

RUNS = 3


def paired_settings(scan: dict[str, Any]) -> tuple[Settings, Settings] | None:
    """Settings of objects and cut-pursuit at the default count of the latter, or None."""
    for ours, theirs in pairs([scan], OBJECTS.name, CUT_PURSUIT.name, DEFAULT).values():
        return ours["settings"] | {SEGMENTS: ours["count"]}, theirs["settings"]
    return None


def paired_times(
    points: Array, ours: tuple[Method, Settings], theirs: tuple[Method, Settings]
) -> Iterator[Evaluation]:
    """Yield the times from points (n, 3), m, to labels of two methods, and their ratio."""
    warm_up(ours[0])
    warm_up(theirs[0])
    calls: dict[str, Callable[[], Any]] = {
        "ours": partial(run_once, ours[0], points, ours[1]),
        "theirs": partial(run_once, theirs[0], points, theirs[1]),
    }
    times = in_turn(calls, RUNS)
    yield {
        "objects_ms": milliseconds(times["ours"]),
        "cut_pursuit_ms": milliseconds(times["theirs"]),
        "ratio": ratio(times["ours"], times["theirs"]),
    }
