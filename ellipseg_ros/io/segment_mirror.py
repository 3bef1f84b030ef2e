"""A subscriber's copy of all segments, maintained from the messages of `segments`."""

from copy import copy
from typing import Any

UNCHANGED = 2  # of Segment.msg and Object.msg


class SegmentMirror:
    """All present segments and objects, from full SegmentArray messages and changes.

    Pass every message to `update`. While `in_step` is true, `segments` and `objects` equal the
    content of a full message field by field; it is false before the first full message, and from
    a lost message to the next full one.
    """

    def __init__(self) -> None:
        self.segments: dict[int, Any] = {}  # Segment messages by id
        self.objects: dict[int, Any] = {}  # Object messages by id
        self.in_step = False
        self._sequence = -1  # of the last message

    def update(self, message: Any) -> bool:
        """Apply a SegmentArray of rclpy or rosbags; return `in_step`.

        The message is not changed, but its segments and objects are kept.
        """
        if message.full:
            self.segments = {segment.id: segment for segment in message.segments}
            self.objects = {item.id: item for item in message.objects}
            valid = True
        elif self.in_step and message.sequence == self._sequence + 1:
            valid = _change(self.segments, message.segments, message.removed)
            valid &= _change(self.objects, message.objects, message.removed_objects)
        else:  # repeated, or after a lost message
            valid = self.in_step and message.sequence == self._sequence
        self.in_step = valid and self._is_complete(message)  # not complete: of another run
        self._sequence = message.sequence
        return self.in_step

    def _is_complete(self, message: Any) -> bool:
        """Whether the point counts of the segments add up to the points of the window."""
        counts = [segment.count for segment in self.segments.values()]
        return min(counts, default=1) > 0 and sum(counts) == message.segmented


def _change(copies: dict[int, Any], listed: Any, removed: Any) -> bool:
    """Replace listed items and drop removed ones; False if a removed one was not there."""
    known = all(copies.pop(int(number), None) is not None for number in removed)
    for number, item in copies.items():
        if item.state != UNCHANGED:  # unchanged by now, or it would be listed
            item = copies[number] = copy(item)
            item.state, item.parents = UNCHANGED, item.parents[:0]
    copies.update((item.id, item) for item in listed)
    return known
