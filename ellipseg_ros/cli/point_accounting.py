"""Whether points are conserved: where those of a segment come from, and what is said of it.

The points of a segment come from its predecessor (the segment with its id), its parents, and
points that were in no segment before; from nothing else. Likewise for objects.
"""

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ellipseg_ros.records import Array, State

HALF = np.uint64(32)  # bits


@dataclass(frozen=True)
class Census:
    """Which point is in which segment, or object, and what an update says of them."""

    arrival: Array  # (n,) int64, serial numbers of the points, ascending
    of_point: Array  # (n,) uint32: id of every point's segment, 0 for none
    told: dict[int, Any]  # by id: its state, count and parents (Segment.msg, Object.msg)
    removed: Array  # (r,) uint32: ids that are said to be no more

    def without_points(self) -> "Census":
        """The same after a restart of the window, which numbers points anew."""
        return replace(self, arrival=self.arrival[:0], of_point=self.of_point[:0])


NOBODY = Census(np.zeros(0, np.int64), np.zeros(0, np.uint32), {}, np.zeros(0, np.uint32))


def contradictions(before: Census, now: Census) -> Iterator[str]:
    """Yield, in words, what two updates in a row say that cannot be, or don't say and is."""
    if set(now.removed.tolist()) != before.told.keys() - now.told.keys():
        yield "the removed ids are not those that were there and are no more"
    counts = _tally(now.of_point)
    if counts != {number: one.count for number, one in now.told.items()}:
        yield "the counts are not those of the labelled points"
    given = _given(before, now)
    for number, one in now.told.items():
        gave = given[number]
        if set(one.parents) != gave.keys() - {number}:
            yield f"{number} has points of {sorted(gave)}, and parents {list(one.parents)}"
        if (one.state == State.NEW) != (number not in before.told):
            yield f"{number} has state {one.state}, and was {_there(number in before.told)}"
        if one.state == State.UNCHANGED and not (
            gave == {number: one.count} and before.told[number].count == one.count
        ):
            yield f"{number} is said to be unchanged, and its points are others"


def _there(known: bool) -> str:
    return "there before" if known else "not there before"


def _tally(of_point: Array) -> dict[int, int]:
    ids, counts = np.unique(of_point[of_point > 0], return_counts=True)
    return dict(zip(ids.tolist(), counts.tolist(), strict=True))


def _given(before: Census, now: Census) -> dict[int, dict[int, int]]:
    """How many points each segment of now has of which one of before."""
    _, old, new = np.intersect1d(before.arrival, now.arrival, True, return_indices=True)
    given: dict[int, dict[int, int]] = defaultdict(dict)
    for (into, source), count in pair_counts(now.of_point[new], before.of_point[old]).items():
        if into and source:
            given[into][source] = count
    return given


def pair_counts(one: Array, other: Array) -> dict[tuple[int, int], int]:
    """How often two ids meet; both (n,) uint32."""
    pairs, counts = np.unique(one.astype(np.uint64) << HALF | other, return_counts=True)
    firsts, seconds = pairs >> HALF, pairs.astype(np.uint32)
    return dict(
        zip(zip(firsts.tolist(), seconds.tolist(), strict=True), counts.tolist(), strict=True)
    )
