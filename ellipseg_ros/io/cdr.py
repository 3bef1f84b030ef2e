"""Serialization of ROS 2 messages (little-endian CDR): single values, and records in bulk.

Message objects and a serializer take hundreds of milliseconds for 5,000 markers, one numpy array a
few. The tests deserialize the bytes with rosbags and with rclpy.

CDR: a number is aligned to its size, relative to the end of the four-byte header; a string is its
length including NUL (uint32), its bytes, NUL; a sequence is its length (uint32) and its elements;
a fixed array is its elements.
"""

import struct
from typing import Any

import numpy as np

from ellipseg_ros.core.fields import record_layout
from ellipseg_ros.records import SECOND, Array, Ragged

LITTLE_ENDIAN = b"\x00\x01\x00\x00"  # the header
NUMBER_SIZES = {"?": 1, "B": 1, "i": 4, "I": 4, "d": 8}


class Cdr:
    """A message under construction."""

    def __init__(self) -> None:
        self._parts: list[Any] = [LITTLE_ENDIAN]
        self.size = 0  # bytes after the header

    def put(self, codes: str, *values: Any) -> None:
        """Append numbers; codes as in `struct`: ? B i I d."""
        for code, value in zip(codes, values, strict=True):
            self.align(NUMBER_SIZES[code])
            self.bulk(struct.pack(f"<{code}", value))

    def text(self, value: str) -> None:
        """Append a string."""
        encoded = value.encode()
        self.put("I", len(encoded) + 1)
        self.bulk(encoded + b"\0")

    def time(self, ns: int) -> None:
        """Append a builtin_interfaces/Time."""
        self.put("iI", ns // SECOND, ns % SECOND)

    def header(self, stamp_ns: int, frame_id: str) -> None:
        """Append a std_msgs/Header."""
        self.time(stamp_ns)
        self.text(frame_id)

    def align(self, size: int) -> None:
        """Pad with zeros to a multiple of `size` bytes."""
        self.bulk(bytes(-self.size % size))

    def bulk(self, data: Any) -> None:
        """Append bytes, or any buffer, unchanged."""
        self._parts.append(data)
        self.size += memoryview(data).nbytes

    def bytes(self) -> bytes:
        """The message, including the header."""
        return b"".join(self._parts)

    def records(self, columns: dict[str, Array], tail: Ragged | None = None) -> None:
        """Append a sequence of n records.

        columns: name -> (n,) or (n, k) numbers of 1, 4 or 8 bytes, or (n,) texts (see `texts`), in
            the order of the message's fields, the first of 4 bytes. Names are arbitrary.
        tail: n rows of uint32 that end each record: its sequences, see `sequences`.
        """
        count = len(next(iter(columns.values())))
        self.put("I", count)
        if count:
            self.bulk(_records(columns, tail, self.size))

    def numbers(self, values: Array) -> None:
        """Append a sequence of 4-byte numbers."""
        self.put("I", len(values))
        self.bulk(np.ascontiguousarray(values).tobytes())


def texts(value: str, count: int) -> Array:
    """Column with the same string in `count` records."""
    encoded = value.encode() + b"\0"
    layout = np.dtype([("length", "<u4"), ("characters", f"V{len(encoded)}")])
    return np.full(count, np.array((len(encoded), encoded), layout))


def sequences(*parts: Ragged) -> Ragged:
    """Consecutive sequences of 4-byte numbers in n records, each preceded by its length."""
    lengths = np.array([np.diff(part.starts) for part in parts])
    ends = np.cumsum((lengths + 1).T).reshape(lengths.T.shape).T  # of every sequence
    words = np.empty(ends[-1, -1] if ends.size else 0, np.uint32)
    for part, length, end in zip(parts, lengths, ends, strict=True):
        words[end - length - 1] = length
        shift = np.repeat(end - length - part.starts[:-1], length)
        words[np.arange(len(shift)) + shift] = part.values
    return Ragged(np.append(0, ends[-1]), words)


def _records(columns: dict[str, Array], tail: Ragged | None, start: int) -> Array:
    """Bytes of n records of which the first starts at `start`, a multiple of 4.

    The padding of a record depends on whether it starts at a multiple of 8, so there are two
    layouts. Which one a record has follows from the lengths of the tails before it.
    """
    count = len(next(iter(columns.values())))
    layouts = {phase: _layout(columns, phase) for phase in (0, 4)}
    extra = np.zeros(count, np.int64) if tail is None else 4 * np.diff(tail.starts)
    first = start % 8
    # Every record has a number of 8 bytes, and the layout after it is the same in both phases: the
    # end of a record, without its tail, does not depend on its start.
    phases = np.append(first, first + layouts[first].itemsize + extra[:-1]) % 8
    sizes = np.where(phases == 0, layouts[0].itemsize, layouts[4].itemsize)
    ends = np.cumsum(sizes + extra)
    words = np.zeros(ends[-1] // 4, np.uint32)
    for phase, layout in layouts.items():
        rows = np.flatnonzero(phases == phase)
        block = np.zeros(len(rows), layout)
        for name, column in columns.items():
            block[name] = column[rows]
        begins = (ends - extra - sizes)[rows] // 4
        within = np.arange(layout.itemsize // 4)
        words[begins[:, None] + within] = block.view(np.uint32).reshape(len(rows), len(within))
    if tail is not None:
        shift = np.repeat((ends - extra) // 4 - tail.starts[:-1], np.diff(tail.starts))
        words[np.arange(len(shift)) + shift] = tail.values
    end = sizes[-1] - _layout(columns, int(phases[-1]), padded=tail is not None).itemsize
    return words.view(np.uint8)[: len(words) * 4 - end]


def _layout(columns: dict[str, Array], start: int, padded: bool = True) -> np.dtype[Any]:
    """Layout of a record that starts at `start` modulo 8; padded: to a multiple of 4 bytes."""
    fields: dict[str, tuple[np.dtype[Any], int]] = {}
    place = start
    for name, column in columns.items():
        kind = np.dtype((column.dtype, column.shape[1:]))
        place += -place % (4 if kind.names else kind.base.itemsize)
        fields[name] = (kind, place - start)
        place += kind.itemsize
    size = place - start
    return record_layout(fields, size + (-size % 4 if padded else 0))
