"""Verification of a recorded run of the node against an offline run on the same clouds."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ellipseg_ros.cli.report import Summary
from ellipseg_ros.config import NodeConfig
from ellipseg_ros.io.bag import read_messages
from ellipseg_ros.io.pointcloud2 import read_fields
from ellipseg_ros.io.topics import LANDMARKS, SEGMENTED_POINTS, SEGMENTS, Topic
from ellipseg_ros.io.update_messages import UpdateMessages
from ellipseg_ros.records import Array, Segmentation, Sweep

COMPARED = (SEGMENTED_POINTS, SEGMENTS, LANDMARKS)  # markers depend on the subscribers


@dataclass(frozen=True)
class RecordedUpdate:
    """The messages of one update of the node."""

    messages: dict[Topic, bytes]  # those of COMPARED that were published
    labels: Array  # (n,) uint32: a field of the cloud
    objects: Array  # (n,) uint32
    message: Any  # `segments`, decoded: a SegmentArray


def recorded_updates(bag: Path) -> Iterator[RecordedUpdate]:
    """Yield the updates in a bag, in order."""
    clouds, arrays, landmarks = (read_messages(bag, f"/{topic.name}") for topic in COMPARED)
    of_update = {msg.sequence: {LANDMARKS: data} for data, msg in landmarks}
    for (cloud, cloud_msg), (segments, msg) in zip(clouds, arrays, strict=False):
        messages = {SEGMENTED_POINTS: cloud, SEGMENTS: segments} | of_update.get(msg.sequence, {})
        fields = read_fields(cloud_msg)
        yield RecordedUpdate(messages, fields["label"], fields["object"], msg)


def equal(received: bytes, sent: bytes) -> bool:
    """Whether two serialized messages are equal but for the padding of DDS to 4 bytes."""
    return received.startswith(sent) and received[len(sent) :] in (b"", b"\0", b"\0\0", b"\0\0\0")


@dataclass
class Verification:
    """Compares updates one after the other; `problems` has a line for every difference."""

    expected: int  # updates
    config: NodeConfig = field(default_factory=NodeConfig)  # of the node
    all_kept: bool = True  # every point is in the window, no representatives
    updates: int = 0
    complete: int = 0  # updates in which every point is accounted for
    identical: int = 0  # updates that equal the offline result bit for bit
    sent: int = 0  # points
    expired: int = 0  # points
    problems: list[str] = field(default_factory=list)
    _window: list[Array] = field(default_factory=list)  # (n,) ns: times of the points in it

    def __post_init__(self) -> None:
        self._messages = UpdateMessages(self.config)

    def update(self, group: Sweep, result: Segmentation, node: RecordedUpdate) -> None:
        """Compare one update: the points sent for it, the offline result, the node's messages."""
        self.updates += 1
        self._count_points(group, result, node)
        writers = self._messages.writers(result)
        sent = {topic: writers[topic]() for topic in COMPARED if topic in writers}
        different = [
            topic.name
            for topic in COMPARED
            if not equal(node.messages.get(topic, b""), sent.get(topic, b""))
        ]
        self.identical += not different
        if different:
            text = f"update {self.updates} differs from the offline result"
            self.problems.append(f"{text}: {', '.join(different)}")

    def summary(self) -> Summary:
        """The results as lines of text."""
        return {
            "updates received": f"{self.updates} of {self.expected}",
            "points accounted for": f"in {self.complete} of {self.expected} updates: "
            f"{self.sent:,} sent = {self.sent - self.expired:,} in the last window "
            f"+ {self.expired:,} expired",
            "equal to offline": f"{self.identical} of {self.expected} updates, bit for bit",
        }

    @property
    def passed(self) -> bool:
        """Whether all expected updates were received, complete and identical."""
        return self.updates == self.complete == self.identical == self.expected

    def _count_points(self, group: Sweep, result: Segmentation, node: RecordedUpdate) -> None:
        """Compare the counts of the node with the points that were sent and have not expired."""
        window = [] if result.restart else self._window
        self._window = [times[times > result.start_ns] for times in (*window, group.times_ns)]
        expected = sum(map(len, self._window)) if self.all_kept else len(result.points)
        self.sent += len(group)
        self.expired = self.sent - expected
        counts = node.message
        total = counts.segmented + counts.isolated + counts.rejected + counts.thinned
        labelled = int(np.count_nonzero(node.labels))
        if expected == total == len(node.labels) and labelled == counts.segmented:
            self.complete += 1
            return
        points = f"`segmented_points` has {len(node.labels)}, {labelled} of them labelled"
        segments = f"`segments` counts {total}, {counts.segmented} of them segmented"
        text = f"update {self.updates}: the window must have {expected} points"
        self.problems.append(f"{text}; {segments}; {points}")
