"""The messages of `segments`: full ones at intervals, and changes between them."""

import numpy as np

from ellipseg_ros.config import NodeConfig
from ellipseg_ros.io.messages import NO_UPDATE, Selection, id_pairs, write_segments
from ellipseg_ros.records import SECOND, Array, Segmentation, State


class SegmentStream:
    """SegmentArray messages from which a subscriber can maintain all present segments.

    A message is full once every `full_segments_period` of sensor time, at a restart, after an
    update that was not sent, and after one that could not be resent to a new subscriber; else it
    lists changes only.
    """

    def __init__(self, config: NodeConfig) -> None:
        self.configure(config)
        self._pairs = np.zeros(0, np.uint64)  # object and segment id, of all in the last update
        self._sequence = NO_UPDATE  # of the last update
        self._end_ns = 0  # its end
        self._resendable = False  # `sends_changes` when it was sent

    def configure(self, config: NodeConfig) -> None:
        """Apply new settings from the next update on."""
        self._period_ns = round(config.full_segments_period * SECOND)

    @property
    def sends_changes(self) -> bool:
        """Whether a message may list changes only.

        A new subscriber then needs the last update in full; else that would be a duplicate.
        """
        return self._period_ns > 0

    def update(self, segmentation: Segmentation) -> bytes:
        """Serialize an ellipseg_ros/SegmentArray."""
        pairs = np.sort(id_pairs(segmentation))
        selection = None
        if not self._is_full(segmentation):
            selection = _changes(segmentation, np.setxor1d(self._pairs, pairs, True))
        self._pairs, self._sequence = pairs, segmentation.sequence
        self._end_ns, self._resendable = segmentation.end_ns, self.sends_changes
        return write_segments(segmentation, selection)

    def _is_full(self, segmentation: Segmentation) -> bool:
        """Whether the message must be full; by stamps, so that subscribers have no influence."""
        is_next = segmentation.sequence == self._sequence + 1 and not segmentation.restart
        if not (is_next and self._resendable and self.sends_changes):
            return True
        return segmentation.end_ns // self._period_ns != self._end_ns // self._period_ns


def _changes(segmentation: Segmentation, pairs: Array) -> Selection:
    """Select what has changed; pairs: of object and segment, that only one of the updates has."""
    changed = segmentation.state != State.UNCHANGED
    segments = changed | np.isin(segmentation.ids, pairs.astype(np.uint32))
    objects = segmentation.objects
    if objects is None:
        return Selection(segments, np.zeros(0, bool))
    regrouped = np.isin(objects.ids, pairs >> 32)
    return Selection(segments, (objects.state != State.UNCHANGED) | regrouped)
