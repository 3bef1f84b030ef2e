"""Conservation of points between consecutive updates, as the messages report it.

The points of a segment come from its predecessor (the segment with its id), its parents, and
points that were in no segment before; from nothing else. Likewise for objects.
"""

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ellipseg_ros.io.segment_mirror import SegmentMirror
from ellipseg_ros.records import Array, Segmentation, State

NO_IDS = np.zeros(0, np.uint32)


@dataclass(frozen=True)
class Groups:
    """The segments, or the objects, of an update."""

    arrival: Array  # (n,) int64, serial numbers of the points, ascending
    of_point: Array  # (n,) uint32: id of every point's segment, 0 for none
    reported: dict[int, Any]  # by id: state, count and parents (Segment.msg, Object.msg)
    removed: Array  # (r,) uint32: ids reported as removed

    def without_points(self) -> "Groups":
        """The same after a restart of the window, which renumbers points."""
        return replace(self, arrival=self.arrival[:0], of_point=self.of_point[:0])


NO_GROUPS = Groups(np.zeros(0, np.int64), NO_IDS, {}, NO_IDS)


def contradictions(before: Groups, after: Groups) -> Iterator[str]:
    """Yield a line for every contradiction between two consecutive updates and their reports."""
    if set(after.removed.tolist()) != before.reported.keys() - after.reported.keys():
        yield "the removed ids are not those that have vanished"
    ids, counts = np.unique(after.of_point[after.of_point > 0], return_counts=True)
    points = dict(zip(ids.tolist(), counts.tolist(), strict=True))
    if points != {number: group.count for number, group in after.reported.items()}:
        yield "the counts are not those of the labelled points"
    origins = _origins(before, after)
    for number, group in after.reported.items():
        origin = origins[number]
        if set(group.parents) != origin.keys() - {number}:
            yield f"{number} has points of {sorted(origin)}, and parents {list(group.parents)}"
        existed = number in before.reported
        if (group.state == State.NEW) == existed:
            yield f"{number} has state {group.state}, and existed before: {existed}"
        if group.state == State.UNCHANGED and not (
            origin == {number: group.count} and before.reported[number].count == group.count
        ):
            yield f"{number} is reported as unchanged, but its points have changed"


def _origins(before: Groups, after: Groups) -> dict[int, dict[int, int]]:
    """By group, the number of its points in each earlier group."""
    _, old, new = np.intersect1d(before.arrival, after.arrival, True, return_indices=True)
    origins: dict[int, dict[int, int]] = defaultdict(dict)
    for (group, origin), count in pair_counts(after.of_point[new], before.of_point[old]).items():
        if group and origin:
            origins[group][origin] = count
    return origins


def pair_counts(first: Array, second: Array) -> dict[tuple[int, int], int]:
    """How often every pair of ids occurs; both (n,) uint32."""
    pairs, counts = np.unique(np.column_stack([first, second]), axis=0, return_counts=True)
    return {(int(a), int(b)): int(n) for (a, b), n in zip(pairs, counts, strict=True)}


def object_contradictions(labels: Array, objects: Array, mirror: SegmentMirror) -> Iterator[str]:
    """Yield a line where objects do not consist of their segments; labels, objects: (n,) ids."""
    object_of = {segment.id: segment.object_id for segment in mirror.segments.values()}
    if pair_counts(labels, objects).keys() - {(0, 0)} != object_of.items():
        yield "a point's object is not that of its segment"
    members: dict[int, list[int]] = defaultdict(list)
    for number, owner in sorted(object_of.items()):
        members[owner].append(number)
    for group in mirror.objects.values():
        if members[group.id] != list(group.segments):
            yield f"object {group.id} lists segments that do not name it"
        elif sum(mirror.segments[number].count for number in group.segments) != group.count:
            yield f"object {group.id} does not have as many points as its segments"


@dataclass
class Account:
    """Checks the messages of consecutive updates; `problems` has a line per contradiction."""

    problems: list[str] = field(default_factory=list)
    _mirror: SegmentMirror = field(default_factory=SegmentMirror)
    _segments: Groups = NO_GROUPS
    _objects: Groups = NO_GROUPS

    def update(self, result: Segmentation, labels: Array, objects: Array, msg: Any) -> bool:
        """Check one update; False if anything contradicts.

        result: of the offline run, for the order of the points and restarts alone. labels,
        objects: (n,) ids of the points, from the messages. msg: the SegmentArray.
        """
        arrival = result.arrival
        if not self._mirror.update(msg) or len(labels) != len(arrival):
            self.problems.append("an update does not follow the one before")
            return False
        before = self._segments, self._objects
        if result.restart:
            before = before[0].without_points(), before[1].without_points()
        segments, objects_by_id = dict(self._mirror.segments), dict(self._mirror.objects)
        self._segments = Groups(arrival, labels, segments, msg.removed)
        self._objects = Groups(arrival, objects, objects_by_id, msg.removed_objects)
        found = [
            *(f"segments: {text}" for text in contradictions(before[0], self._segments)),
            *(f"objects: {text}" for text in contradictions(before[1], self._objects)),
            *object_contradictions(labels, objects, self._mirror),
        ]
        self.problems += found
        return not found
