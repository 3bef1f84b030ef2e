"""PCD, the format of PCL, in its three encodings.

Read with pypcd4: BSD, maintained, with wheels for every Python from 3.10 on.
"""

from pathlib import Path
from typing import Any

import numpy as np

from ellipseg_ros.core.fields import record_layout
from ellipseg_ros.errors import InputError
from ellipseg_ros.io.formats.common import check_size, damaged, header_lines
from ellipseg_ros.io.pointcloud2 import field_layout
from ellipseg_ros.records import Array

MAX_VALUES_PER_POINT = 4096  # the library makes a column of each
LZF_MAX_RATIO = 100  # of compression: 264 bytes to 3


def read(path: Path) -> Array:
    """All fields of the points but padding: (n,) structured."""
    from pypcd4.pypcd4 import PointCloud

    _check_header(path)
    cloud = PointCloud.from_path(path)
    meta = cloud.metadata
    data = np.atleast_1d(cloud.pc_data)
    if len(data) != meta.points:
        raise InputError(f"it holds {len(data)} points where its header says {meta.points}")
    fields: dict[str, tuple[np.dtype[Any], int]] = {}
    columns = iter(field_layout(data.dtype).values())
    for name, count in zip(meta.fields, meta.count, strict=True):
        kind, place = [next(columns) for _ in range(count)][0]  # there is a column per value
        if name.isidentifier():  # the library gives padding, `_`, an odd name
            fields[name] = (np.dtype((kind, () if count == 1 else (count,))), place)
    return np.asarray(data.view(record_layout(fields, data.dtype.itemsize)))


def _check_header(path: Path) -> None:
    """Raise InputError if the file is too small for the points that its header claims."""
    words = {line[0]: line[1:] for line in header_lines(path, b"DATA") if line}
    counts = [int(n) for n in words.get("COUNT", ["1"] * len(words.get("FIELDS", [])))]
    sizes = [int(n) for n in words.get("SIZE", [])]
    values = sum(counts)
    if min([*counts, *sizes], default=1) < 1 or values > MAX_VALUES_PER_POINT:
        raise damaged(f"it has {values} values per point; 1 to {MAX_VALUES_PER_POINT} are allowed")
    points = int(words.get("POINTS", ["0"])[0])
    point_bytes = sum(n * size for n, size in zip(counts, sizes, strict=True))
    encoding = words.get("DATA", [""])[0]
    ratio = {"binary": 1, "binary_compressed": LZF_MAX_RATIO}.get(encoding)
    check_size(path, points, values if ratio is None else point_bytes / ratio)
