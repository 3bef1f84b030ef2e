"""LAS and LAZ, the formats of surveys (ASPRS).

Read with laspy and lazrs: BSD and MIT, maintained, with wheels for every Python from 3.10 on.
"""

import os
import struct
from importlib.util import find_spec
from pathlib import Path
from typing import IO

import numpy as np

from ellipseg_ros.errors import InputError
from ellipseg_ros.io.formats.common import check_size, damaged, table
from ellipseg_ros.records import Array

CHUNK = 500_000  # points read in one step: a header may claim more than there are
RECORD_HEADER_BYTES = 54  # of a variable length record
HEADER_BYTES_1_4 = 375  # of version 1.4, with 64-bit counts
MIN_HEADER_BYTES = 227


def read(path: Path) -> Array:
    """All dimensions of the points, x, y and z scaled to m: (n,) structured."""
    import laspy

    _check_header(path)
    with laspy.open(path, read_evlrs=False) as file:
        names = [n for n in file.header.point_format.dimension_names if n not in ("X", "Y", "Z")]
        tables = [
            table({name: chunk[name] for name in ("x", "y", "z", *names)})
            for chunk in file.chunk_iterator(CHUNK)
        ]
        count = sum(map(len, tables))
        if not count or count != file.header.point_count:
            raise InputError(f"it holds {count} points of {file.header.point_count}")
    return np.concatenate(tables)


def _check_header(path: Path) -> None:
    """Raise InputError if the file is too small for its records and points.

    The points of a LAZ file are decoded one by one, so that a wrong count fails at its end.
    """
    with path.open("rb") as file:
        head = file.read(HEADER_BYTES_1_4)
        if len(head) < MIN_HEADER_BYTES or head[:4] != b"LASF":
            raise damaged("it has no LAS header")
        start, records = struct.unpack_from("<II", head, 96)
        kind, point_bytes, points = struct.unpack_from("<BHI", head, 104)
        if head[25] >= 4 and len(head) == HEADER_BYTES_1_4:  # the minor version
            (points,) = struct.unpack_from("<Q", head, 247)
        check_size(path, start, 1, "bytes before the points")
        check_size(path, records, RECORD_HEADER_BYTES, "records")
        if kind & 0x80:  # compressed
            if find_spec("lazrs") is None:  # laspy's own error does not name it
                raise ModuleNotFoundError("no lazrs", name="lazrs")
            check_size(path, _laz_chunks(file, start), 1, "chunks")
        else:
            check_size(path, points, point_bytes)


def _laz_chunks(file: IO[bytes], start: int) -> int:
    """The number of chunks that the chunk table of a LAZ file claims; 0 if it has no table."""
    file.seek(start)
    (table_start,) = struct.unpack("<q", file.read(8))
    if table_start < 0:  # written as a stream: then the position is in the last 8 bytes
        file.seek(-8, os.SEEK_END)
        (table_start,) = struct.unpack("<q", file.read(8))
    if table_start < 0:
        return 0
    if table_start > file.seek(0, os.SEEK_END) - 8:
        raise damaged("its table of chunks would lie behind its end")
    file.seek(table_start)
    _, chunks = struct.unpack("<II", file.read(8))
    return int(chunks)
