"""The messages of `segments`, update after update: everything now and then, else changes."""

import numpy as np

from ellipseg_ros.config import NodeConfig
from ellipseg_ros.io.messages import Listed, write_segments
from ellipseg_ros.records import SECOND, Array, Segmentation, State

LOW = np.uint64(0xFFFFFFFF)
HIGH = np.uint64(32)
NONE = -2  # in place of a sequence number: no update follows it


class SegmentStream:
    """What a subscriber must be told after each update, so that it knows all segments of now.

    Everything, as often as `full_segments_period` asks for it, at a restart, and if the update
    before was not told, or could not be repeated for a newcomer; else what is not as it was.
    """

    def __init__(self, config: NodeConfig) -> None:
        self.configure(config)
        self._pairs = np.zeros(0, np.uint64)  # id of object and segment, of all in the last update
        self._sequence = NONE  # of the last update
        self._end = 0  # ns: its end
        self._repeatable = False  # whether `repeats` was true for it

    def configure(self, config: NodeConfig) -> None:
        """Take new settings."""
        self._period = round(config.full_segments_period * SECOND)

    @property
    def repeats(self) -> bool:
        """Whether a newcomer needs the last update again, in full: the next may tell changes.

        Where all list everything, a repeat would only be counted twice.
        """
        return self._period > 0

    def update(self, found: Segmentation) -> bytes:
        """A serialized ellipseg_ros/SegmentArray."""
        pairs = np.sort(found.object_ids.astype(np.uint64) << HIGH | found.ids)
        full = self._full_is_due(found)
        listed = None if full else _changes(found, np.setxor1d(self._pairs, pairs, True))
        self._pairs, self._sequence, self._end = pairs, found.sequence, found.end_ns
        self._repeatable = self.repeats
        return write_segments(found, listed)

    def _full_is_due(self, found: Segmentation) -> bool:
        """When is a matter of stamps, so that it doesn't depend on who listened since when."""
        if found.restart or found.sequence != self._sequence + 1:
            return True
        if not (self._repeatable and self.repeats):
            return True
        return found.end_ns // self._period != self._end // self._period


def _changes(found: Segmentation, other: Array) -> Listed:
    """What has changed; other: pairs of object and segment that only were, or only are."""
    segments = (found.state != State.UNCHANGED) | np.isin(found.ids, other & LOW)
    if found.objects is None:
        return Listed(segments, np.zeros(0, bool))
    others = np.isin(found.objects.ids, other >> HIGH)
    return Listed(segments, (found.objects.state != State.UNCHANGED) | others)
