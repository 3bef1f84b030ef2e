"""The messages of `segments`, update after update: everything now and then, else changes."""

import numpy as np

from ellipseg_ros.config import NodeConfig
from ellipseg_ros.data import SECOND, Array, Segmentation, State
from ellipseg_ros.io.messages import Listed, write_segments

LOW = np.uint64(0xFFFFFFFF)
HIGH = np.uint64(32)


class SegmentStream:
    """What a subscriber must be told after each update, so that it knows all segments of now.

    Everything, as often as `full_segments_period` asks for it, at a restart, and if the update
    before was not told; else what is not as it was.
    """

    def __init__(self, config: NodeConfig) -> None:
        self._config = config
        self._pairs = np.zeros(0, np.uint64)  # id of object and segment, of all in the last update
        self._sequence = -1  # of the last update
        self._end = 0  # ns: its end
        self.full = True  # whether its message listed everything

    def configure(self, config: NodeConfig) -> None:
        """Take new settings."""
        self._config = config

    def update(self, found: Segmentation) -> bytes:
        """A serialized ellipseg_ros/SegmentArray."""
        pairs = np.sort(found.object_ids.astype(np.uint64) << HIGH | found.ids)
        self.full = self._full_is_due(found)
        listed = None if self.full else _changes(found, np.setxor1d(self._pairs, pairs, True))
        self._pairs, self._sequence, self._end = pairs, found.sequence, found.end_ns
        return write_segments(found, listed)

    def _full_is_due(self, found: Segmentation) -> bool:
        """When is a matter of stamps, so that it doesn't depend on who listened since when."""
        if found.restart or found.sequence != self._sequence + 1:
            return True
        period = round(self._config.full_segments_period * SECOND)
        return period == 0 or found.end_ns // period != self._end // period


def _changes(found: Segmentation, other: Array) -> Listed:
    """What has changed; other: pairs of object and segment that only were, or only are."""
    segments = (found.state != State.UNCHANGED) | np.isin(found.ids, other & LOW)
    if found.objects is None:
        return Listed(segments, np.zeros(0, bool))
    others = np.isin(found.objects.ids, other >> HIGH)
    return Listed(segments, (found.objects.state != State.UNCHANGED) | others)
