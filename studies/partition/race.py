"""Objects and cut-pursuit in turn: ratios of times that a busy machine cannot spoil."""

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

from ellipseg_ros.records import Array
from studies.partition.cells import OWN, Cell, warm_up
from studies.partition.means import pairs
from studies.partition.methods import OBJECTS, SEGMENTS, Method, Settings
from studies.partition.peers import CUT_PURSUIT
from studies.report.timing import in_turn, milliseconds, ratio

RUNS = 3


def rivals(scan: dict[str, Any]) -> tuple[Settings, Settings] | None:
    """Settings of objects and of cut-pursuit at cut-pursuit's own number, where it is fastest."""
    for ours, theirs in pairs([scan], OBJECTS.name, CUT_PURSUIT.name, OWN).values():
        return ours["settings"] | {SEGMENTS: ours["count"]}, theirs["settings"]
    return None


def race(
    points: Array, ours: tuple[Method, Settings], theirs: tuple[Method, Settings]
) -> Iterator[Cell]:
    """Yield the times of both, and their ratio, from the points (n, 3) m to the labels."""
    warm_up(ours[0])
    warm_up(theirs[0])
    calls: dict[str, Callable[[], Any]] = {
        "ours": partial(_once, points, *ours),
        "theirs": partial(_once, points, *theirs),
    }
    times = in_turn(calls, RUNS)
    yield {
        "ours_ms": milliseconds(times["ours"]),
        "theirs_ms": milliseconds(times["theirs"]),
        "ratio": ratio(times["ours"], times["theirs"]),
    }


def _once(points: Array, method: Method, settings: Settings) -> Array:
    return method.prepare(points)(settings)
