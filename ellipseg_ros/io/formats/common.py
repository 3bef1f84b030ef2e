"""Checks and conversions that several cloud formats have in common.

A few damaged bytes of a header may claim billions of points; pypcd4, trimesh, laspy, lazrs and
numpy allocate memory for the points before they look for them.
"""

from pathlib import Path
from typing import Any

import numpy as np

from ellipseg_ros.errors import InputError
from ellipseg_ros.records import Array

MAX_HEADER_BYTES = 2**16  # of a text header


def damaged(what: str) -> InputError:
    """The error for a file that is incomplete or contradicts its header."""
    return InputError(f"{what}; it must be complete", "bad_cloud")


def check_size(path: Path, count: int, item_bytes: float, what: str = "points") -> None:
    """Raise InputError if `count` items of at least `item_bytes` exceed the size of the file."""
    size = path.stat().st_size
    if count * item_bytes > size:
        raise damaged(f"it claims {count} {what}, more than its {size} bytes can hold")


def header_lines(path: Path, last: bytes) -> list[list[str]]:
    """The words of every line of a text header, up to the line that begins with `last`."""
    with path.open("rb") as file:
        head = file.read(MAX_HEADER_BYTES)
    lines = []
    for line in head.split(b"\n"):
        lines.append(line.decode("utf-8", "replace").split())
        if line.startswith(last):
            break
    return lines


def table(columns: dict[str, Any]) -> Array:
    """Columns (n,) or (n, k) of numbers as one structured array (n,)."""
    arrays = {name: np.asarray(column) for name, column in columns.items()}
    for name, array in arrays.items():
        if array.dtype.kind not in "iufb":
            raise InputError(f"{name} holds {array.dtype.name}; fields must hold numbers")
    kinds = [(name, array.dtype, array.shape[1:]) for name, array in arrays.items()]
    points = np.zeros(len(next(iter(arrays.values()))), kinds)
    for name, array in arrays.items():
        points[name] = array
    return points
