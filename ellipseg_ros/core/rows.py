"""Renumbering of the graph's rows, which drops dead ones."""

import numpy as np

from ellipseg_ros.core.jit import kernel
from ellipseg_ros.records import Array


def row_map(kept_rows: Array, size: int) -> Array:
    """(size + 1,) int32: the new row of each old one, -1 for none; entry -1 keeps -1 as it is."""
    new_rows = np.full(size + 1, -1, np.int32)
    new_rows[kept_rows] = np.arange(len(kept_rows))
    return new_rows


def moved(values: Array, kept_rows: Array, size: int) -> Array:
    """The kept rows of `values` as the first rows of an array of `size` rows; others: undefined.

    In place where the size stays: at hundreds of bytes a row, new memory costs most of the time.
    """
    target = values
    if len(values) != size:
        target = np.empty((size, *values.shape[1:]), values.dtype)
    if len(kept_rows):
        _move(values.reshape(len(values), -1), kept_rows, target.reshape(size, -1))
    return target


@kernel
def _move(values, kept_rows, target):
    for k in range(len(kept_rows)):
        for column in range(values.shape[1]):
            target[k, column] = values[kept_rows[k], column]
