"""A subscriber's copy of the segments, kept up to date by the messages of `segments`."""

from copy import copy
from typing import Any

UNCHANGED = 2  # of Segment.msg and Object.msg


class SegmentMirror:
    """The segments and objects of now, from SegmentArray messages, full ones and changes.

    Feed it every message that comes. After one that it has understood it is in step: `segments`
    and `objects` are then those that a full message would list, field by field. It is not before
    the first full message, nor between a lost message and the next full one.
    """

    def __init__(self) -> None:
        self.segments: dict[int, Any] = {}  # Segment messages by id
        self.objects: dict[int, Any] = {}  # Object messages by id
        self.in_step = False
        self._sequence = -1  # of the last message

    def update(self, message: Any) -> bool:
        """Take a SegmentArray, of rclpy or of rosbags; returns whether the copy is in step.

        A message is changed by nobody, but its segments and objects are kept.
        """
        again = self.in_step and message.sequence == self._sequence
        if message.full:
            self.segments = {segment.id: segment for segment in message.segments}
            self.objects = {thing.id: thing for thing in message.objects}
            self.in_step = self._complete(message)
        elif again:
            self.in_step = self._complete(message)
        else:
            follows = self.in_step and message.sequence == self._sequence + 1
            self.in_step = follows and self._apply(message)
        self._sequence = message.sequence
        return self.in_step

    def _apply(self, message: Any) -> bool:
        """Make the changes; False if they are not those of this copy, but of another run's."""
        known = _change(self.segments, message.segments, message.removed)
        known &= _change(self.objects, message.objects, message.removed_objects)
        return known and self._complete(message)

    def _complete(self, message: Any) -> bool:
        """Whether these can be all segments of a window: each has points, and all are counted."""
        counts = [segment.count for segment in self.segments.values()]
        return min(counts, default=1) > 0 and sum(counts) == message.segmented


def _change(copies: dict[int, Any], listed: Any, removed: Any) -> bool:
    """Replace what is listed, drop what is removed; False if some of that was not there."""
    known = all(copies.pop(int(number), None) is not None for number in removed)
    for number, one in copies.items():
        if one.state != UNCHANGED:  # which it is now, or it would be listed
            one = copies[number] = copy(one)
            one.state, one.parents = UNCHANGED, one.parents[:0]
    copies.update((one.id, one) for one in listed)
    return known
