"""Serialized ROS 2 messages (little-endian CDR), single values and records in bulk.

Why not objects and a serializer: 5,000 markers as objects take hundreds of milliseconds, as one
numpy array a few. The tests read the bytes back with rosbags and with rclpy.

Rules of CDR: a number lies at a multiple of its size, counted from behind the four-byte header; a
string is its length with the closing NUL (uint32), its bytes, NUL; a sequence is its length
(uint32) and its elements; a fixed array is its elements.
"""

import struct
from typing import Any

from ellipseg_ros.io.times import SECOND

LITTLE_ENDIAN = b"\x00\x01\x00\x00"  # the header
NUMBER_SIZES = {"?": 1, "B": 1, "i": 4, "I": 4, "d": 8}


class Cdr:
    """A message that is being written."""

    def __init__(self) -> None:
        self._parts: list[Any] = [LITTLE_ENDIAN]
        self.size = 0  # bytes behind the header

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
        """Pad with zeros to a multiple of `size`."""
        self.bulk(bytes(-self.size % size))

    def bulk(self, data: Any) -> None:
        """Append bytes, or anything that has them, as they are."""
        self._parts.append(data)
        self.size += memoryview(data).nbytes

    def bytes(self) -> bytes:
        """The whole message, header included."""
        return b"".join(self._parts)
