"""Whether what the node said is so: every point accounted for, and all as in the offline run."""

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ellipseg_ros.cli.point_accounting import NOBODY, Census, contradictions, pair_counts
from ellipseg_ros.cli.report import Summary
from ellipseg_ros.config import NodeConfig
from ellipseg_ros.io.bag import read_messages
from ellipseg_ros.io.messages import write_landmarks
from ellipseg_ros.io.pointcloud2 import read_fields, write_labelled
from ellipseg_ros.io.segment_mirror import SegmentMirror
from ellipseg_ros.io.segment_stream import SegmentStream
from ellipseg_ros.records import Array, Segmentation, Sweep


@dataclass(frozen=True)
class Received:
    """One update as the node published it."""

    cloud: bytes
    labels: Array  # (n,) uint32: fields of the cloud
    objects: Array  # (n,) uint32
    segments: bytes
    landmarks: bytes | None  # None: nothing came
    said: Any  # `segments`, decoded: a SegmentArray


def received(bag: Path) -> Iterator[Received]:
    """Yield the updates that a bag holds, in order."""
    clouds = read_messages(bag, "/segmented_points")
    arrays = read_messages(bag, "/segments")
    landmarks = {msg.sequence: data for data, msg in read_messages(bag, "/landmarks")}
    for (cloud, cloud_msg), (segments, array_msg) in zip(clouds, arrays, strict=False):
        fields = read_fields(cloud_msg)
        found = landmarks.get(array_msg.sequence)
        yield Received(cloud, fields["label"], fields["object"], segments, found, array_msg)


def equal(came: bytes, sent: bytes) -> bool:
    """Whether a message came as it was sent; DDS fills up the last four bytes."""
    return came.startswith(sent) and came[len(sent) :] in (b"", b"\0", b"\0\0", b"\0\0\0")


def equal_landmarks(found: Segmentation, came: bytes | None) -> bool:
    """Whether the landmarks came as they were found; none at all, if none were asked for."""
    if found.landmarks is None or came is None:
        return found.landmarks is None and came is None
    return equal(came, write_landmarks(found, found.landmarks))


@dataclass
class Check:
    """Compares update after update; `problems` says what is wrong, in one line each."""

    expected: int  # updates
    config: NodeConfig = field(default_factory=NodeConfig)  # of the node
    updates: int = 0
    accounted: int = 0  # of them: every point is
    identical: int = 0  # of them: bit for bit what the offline run gives
    conserved: int = 0  # of them: what is said of segments and objects adds up
    sent: int = 0  # points
    expired: int = 0
    problems: list[str] = field(default_factory=list)
    _inside: list[Array] = field(default_factory=list)  # (n,) ns, times of points in the window
    _mirror: SegmentMirror = field(default_factory=SegmentMirror)  # fed by the node alone
    _segments: Census = NOBODY
    _objects: Census = NOBODY

    def __post_init__(self) -> None:
        self._stream = SegmentStream(self.config)

    def update(self, group: Sweep, found: Segmentation, node: Received) -> None:
        """Check one update: what was sent for it, the offline result, what the node said."""
        self.updates += 1
        expected = self._count(group, found.start_ns, found.restart)
        self.accounted += self._accounted(expected, node)
        self.conserved += self._conserved(found, node)
        same = {
            "segmented_points": equal(node.cloud, write_labelled(found)),
            "segments": equal(node.segments, self._stream.update(found)),
            "landmarks": equal_landmarks(found, node.landmarks),
        }
        other = [topic for topic, is_equal in same.items() if not is_equal]
        self.identical += not other
        if other:
            topics = ", ".join(other)
            self.problems.append(
                f"update {self.updates} differs from the offline result: {topics}"
            )

    def summary(self) -> Summary:
        """The verdict, for people."""
        return {
            "updates received": f"{self.updates} of {self.expected}",
            "points accounted for": f"in {self.accounted} of {self.expected} updates: "
            f"{self.sent:,} sent = {self.sent - self.expired:,} in the last window "
            f"+ {self.expired:,} expired",
            "segments and objects add up": f"in {self.conserved} of {self.expected} updates: "
            "births, merges, splits and expiries",
            "equal to offline": f"{self.identical} of {self.expected} updates, bit for bit",
        }

    @property
    def passed(self) -> bool:
        """Whether all is well."""
        good = self.accounted == self.conserved == self.identical
        return good and self.updates == self.identical == self.expected

    def _count(self, group: Sweep, start_ns: int, restart: str) -> int:
        """Note the points of an update; returns how many the window must hold."""
        inside = [] if restart else self._inside
        self._inside = [times[times > start_ns] for times in (*inside, group.times_ns)]
        self.sent += len(group)
        count = sum(map(len, self._inside))
        self.expired = self.sent - count
        return count

    def _accounted(self, expected: int, node: Received) -> bool:
        """Whether the node's numbers add up to the points that must be there."""
        said = node.said
        total = said.segmented + said.isolated + said.rejected + said.thinned
        labelled = int(np.count_nonzero(node.labels))
        good = expected == total == len(node.labels) and labelled == said.segmented
        if not good:
            self.problems.append(
                f"update {self.updates}: {expected} points must be in the window; "
                f"`segments` counts {total}, {said.segmented} of them segmented; "
                f"`segmented_points` has {len(node.labels)}, {labelled} of them labelled"
            )
        return good

    def _conserved(self, found: Segmentation, node: Received) -> bool:
        """Whether what the node says of segments and objects fits the points, and its last word.

        Only the order in which points arrived is taken from the offline run.
        """
        if not self._mirror.update(node.said) or len(node.labels) != len(found.arrival):
            self.problems.append(f"update {self.updates} does not follow the one before")
            return False
        before = self._segments, self._objects
        if found.restart:
            before = before[0].without_points(), before[1].without_points()
        segments, objects = dict(self._mirror.segments), dict(self._mirror.objects)
        now = (
            Census(found.arrival, node.labels, segments, node.said.removed),
            Census(found.arrival, node.objects, objects, node.said.removed_objects),
        )
        problems = [
            *(f"segments: {text}" for text in contradictions(before[0], now[0])),
            *(f"objects: {text}" for text in contradictions(before[1], now[1])),
            *misfits(node.labels, node.objects, self._mirror),
        ]
        self._segments, self._objects = now
        self.problems += [f"update {self.updates}: {text}" for text in problems]
        return not problems


def misfits(labels: Array, objects: Array, mirror: SegmentMirror) -> Iterator[str]:
    """Yield, in words, where objects are not what their segments are; both (n,) ids of points."""
    segments = {one.id: one.object_id for one in mirror.segments.values()}
    if pair_counts(labels, objects).keys() - {(0, 0)} != segments.items():
        yield "a point's object is not that of its segment"
    members: dict[int, list[int]] = defaultdict(list)
    for number, owner in sorted(segments.items()):
        members[owner].append(number)
    for one in mirror.objects.values():
        if members[one.id] != list(one.segments):
            yield f"object {one.id} lists other segments than those that name it"
        elif sum(mirror.segments[number].count for number in one.segments) != one.count:
            yield f"object {one.id} does not have as many points as its segments"
