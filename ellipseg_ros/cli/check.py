"""Whether what the node said is so: every point accounted for, and all as in the offline run."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ellipseg_ros.cli.report import Summary
from ellipseg_ros.data import Array, Segmentation, Sweep
from ellipseg_ros.io.bag import read_messages
from ellipseg_ros.io.messages import write_segments
from ellipseg_ros.io.pointcloud2 import read_fields, write_labelled


@dataclass(frozen=True)
class Received:
    """One update as the node published it."""

    cloud: bytes
    labels: Array  # (n,) uint32
    segments: bytes
    counts: Any  # the decoded SegmentArray


def received(bag: Path) -> Iterator[Received]:
    """Yield the updates that a bag holds, in order."""
    clouds = read_messages(bag, "/segmented_points")
    arrays = read_messages(bag, "/segments")
    for (cloud, cloud_msg), (segments, array_msg) in zip(clouds, arrays, strict=False):
        yield Received(cloud, read_fields(cloud_msg)["label"], segments, array_msg)


def equal(came: bytes, sent: bytes) -> bool:
    """Whether a message came as it was sent; DDS fills up the last four bytes."""
    return came.startswith(sent) and came[len(sent) :] in (b"", b"\0", b"\0\0", b"\0\0\0")


@dataclass
class Check:
    """Compares update after update; `problems` says what is wrong, in one line each."""

    expected: int  # updates
    updates: int = 0
    accounted: int = 0  # of them: every point is
    identical: int = 0  # of them: bit for bit what the offline run gives
    sent: int = 0  # points
    expired: int = 0
    problems: list[str] = field(default_factory=list)
    _inside: list[Array] = field(default_factory=list)  # (n,) ns, times of points in the window

    def update(self, group: Sweep, found: Segmentation, node: Received) -> None:
        """Check one update: what was sent for it, the offline result, what the node said."""
        self.updates += 1
        expected = self._count(group, found.start_ns, found.restart)
        self.accounted += self._accounted(expected, node)
        same = equal(node.cloud, write_labelled(found))
        same = same and equal(node.segments, write_segments(found))
        self.identical += same
        if not same:
            self.problems.append(f"update {self.updates} differs from the offline result")

    def summary(self) -> Summary:
        """The verdict, for people."""
        return {
            "updates received": f"{self.updates} of {self.expected}",
            "points accounted for": f"in {self.accounted} of {self.expected} updates: "
            f"{self.sent:,} sent = {self.sent - self.expired:,} in the last window "
            f"+ {self.expired:,} expired",
            "equal to offline": f"{self.identical} of {self.expected} updates, bit for bit",
        }

    @property
    def passed(self) -> bool:
        """Whether all is well."""
        return self.updates == self.accounted == self.identical == self.expected

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
        said = node.counts
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
