"""Objects and cut-pursuit in turn: ratios of times that a busy machine cannot spoil."""

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, NamedTuple

from ellipseg_ros.comparison.cells import Cell, warm_up
from ellipseg_ros.comparison.means import pairs
from ellipseg_ros.comparison.methods import OBJECTS, SEGMENTS, Method, Settings
from ellipseg_ros.comparison.peers import CUT_PURSUIT
from ellipseg_ros.data import Array
from ellipseg_ros.measuring.timing import in_turn, milliseconds, ratio

RUNS = 3


class Heat(NamedTuple):
    """What runs against one another."""

    wanted: int | str
    ours: Settings
    theirs: Settings


def heats(scan: dict[str, Any], at: tuple[int | str, ...]) -> list[Heat]:
    """Objects against cut-pursuit, at the numbers to which it came."""
    found = []
    for wanted in at:
        for ours, theirs in pairs([scan], OBJECTS.name, CUT_PURSUIT.name, wanted).values():
            settings = ours["settings"] | {SEGMENTS: ours["count"]}
            found.append(Heat(wanted, settings, theirs["settings"]))
    return found


def race(ours: Method, theirs: Method, points: Array, rounds: list[Heat]) -> Iterator[Cell]:
    """Yield the times of both, and their ratio, from the points (n, 3) m to the labels."""
    warm_up(ours)
    warm_up(theirs)
    for heat in rounds:
        calls: dict[str, Callable[[], Any]] = {
            "ours": partial(_once, ours, points, heat.ours),
            "theirs": partial(_once, theirs, points, heat.theirs),
        }
        times = in_turn(calls, RUNS)
        yield {
            "wanted": heat.wanted,
            "ours_ms": milliseconds(times["ours"]),
            "theirs_ms": milliseconds(times["theirs"]),
            "ratio": ratio(times["ours"], times["theirs"]),
        }


def _once(method: Method, points: Array, settings: Settings) -> Array:
    return method.prepare(points)(settings)
