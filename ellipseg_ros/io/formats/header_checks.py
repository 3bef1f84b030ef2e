"""Whether a file can hold what its header claims: looked at before a library believes it.

A few spoiled bytes may claim billions of points; pypcd4, trimesh, laspy, lazrs and numpy then ask
for the memory before they look for the points. Raises InputError.
"""

import os
import struct
import zipfile
from pathlib import Path
from typing import IO

import numpy as np

from ellipseg_ros.errors import InputError

HEADER = 2**16  # bytes: a text header is no longer
MOST_VALUES = 4096  # numbers of a point: a column is made of each
LZF_RATIO = 100  # that LZF compresses to at most: 264 bytes to 3
UNPACKED = 2**33  # bytes that the arrays of a file may take
VLR = 54  # bytes of the head of a LAS record
LAS_1_4 = 375  # bytes of a header with 64-bit counts


def _none(what: str) -> InputError:
    return InputError(f"{what}; it must be complete", "bad_cloud")


def check_pcd(path: Path) -> None:
    """PCD: the points against the bytes that are there."""
    words = {line[0]: line[1:] for line in _lines(path, b"DATA") if line}
    counts = [int(n) for n in words.get("COUNT", ["1"] * len(words.get("FIELDS", [])))]
    sizes = [int(n) for n in words.get("SIZE", [])]
    values = sum(counts)
    if min([*counts, *sizes], default=1) < 1 or values > MOST_VALUES:
        raise _none(f"it has {values} values a point; there may be 1 to {MOST_VALUES}")
    points = int(words.get("POINTS", ["0"])[0])
    point = sum(n * size for n, size in zip(counts, sizes, strict=True))
    kind = words.get("DATA", [""])[0]
    factor = {"binary": 1, "binary_compressed": LZF_RATIO}.get(kind)
    _compare(path, points, values if factor is None else point / factor)


def check_ply(path: Path) -> None:
    """PLY: the header must end, and no element has more rows than the file has bytes."""
    lines = _lines(path, b"end_header")
    if not lines or lines[-1] != ["end_header"]:
        raise _none("its header has no end")
    for line in lines:
        if line[:1] == ["element"]:
            _compare(path, int(line[2]), 1)


def check_las(path: Path) -> None:
    """LAS, LAZ: records and points; those of LAZ are read bit by bit, and end when it ends."""
    with path.open("rb") as file:
        head = file.read(LAS_1_4)
        if len(head) < 227 or head[:4] != b"LASF":
            raise _none("it has no LAS header")
        start, records = struct.unpack_from("<II", head, 96)
        kind, point, points = struct.unpack_from("<BHI", head, 104)
        if head[25] >= 4 and len(head) == LAS_1_4:  # the version
            (points,) = struct.unpack_from("<Q", head, 247)
        _compare(path, start, 1, "bytes before the points")
        _compare(path, records, VLR, "records")
        if kind & 0x80:  # compressed
            _compare(path, _laz_chunks(file, start), 1, "chunks")
        else:
            _compare(path, points, point)


def check_arrays(path: Path, most: int = UNPACKED) -> None:
    """NPZ: every array has the bytes that its shape claims, and all together at most so many."""
    with zipfile.ZipFile(path) as archive:
        members = archive.infolist()
        size = sum(member.file_size for member in members)
        if size > most:
            raise _none(f"it unpacks to {size} bytes; {most} is the most")
        for member in members:
            with archive.open(member) as file:
                shape, kind = _array_header(file)
                needed = kind.itemsize
                for length in shape:
                    needed *= length
                if needed != member.file_size - file.tell():
                    raise _none(f"{member.filename} has another size than it says")


def _array_header(file: IO[bytes]) -> tuple[tuple[int, ...], "np.dtype[np.generic]"]:
    version = np.lib.format.read_magic(file)
    readers = {
        (1, 0): np.lib.format.read_array_header_1_0,
        (2, 0): np.lib.format.read_array_header_2_0,
    }
    if version not in readers:
        raise _none(f"an array has format {version}; it must be 1 or 2")
    shape, _, kind = readers[version](file)
    return shape, kind


def _lines(path: Path, last: bytes) -> list[list[str]]:
    """The words of every line of a text header, up to the one that begins with `last`."""
    with path.open("rb") as file:
        head = file.read(HEADER)
    lines = []
    for line in head.split(b"\n"):
        lines.append(line.decode("utf-8", "replace").split())
        if line.startswith(last):
            break
    return lines


def _laz_chunks(file: IO[bytes], start: int) -> int:
    """The number of chunks that the table of a LAZ file claims; 0 if it has none."""
    file.seek(start)
    (table,) = struct.unpack("<q", file.read(8))
    if table < 0:  # written by a program that could not go back: then it stands at the end
        file.seek(-8, os.SEEK_END)
        (table,) = struct.unpack("<q", file.read(8))
    if table < 0:
        return 0
    _compare_size(file, table)
    file.seek(table)
    _, chunks = struct.unpack("<II", file.read(8))
    return int(chunks)


def _compare_size(file: IO[bytes], place: int) -> None:
    if place > file.seek(0, os.SEEK_END) - 8:
        raise _none("its table of chunks would lie behind its end")


def _compare(path: Path, count: int, each: float, what: str = "points") -> None:
    size = path.stat().st_size
    if count * each > size:
        raise _none(f"it claims {count} {what}, more than its {size} bytes can hold")
