"""Contingency table of two labelings: how many items have each pair of labels."""

from typing import NamedTuple

import numpy as np

from ellipseg_ros.core.jit import kernel
from ellipseg_ros.records import Array


class Contingency(NamedTuple):
    """Nonzero entries of a table, row by row: row r has the entries starts[r] to starts[r + 1]."""

    starts: Array  # (rows + 1,) int64
    columns: Array  # (e,) int32, ascending within a row
    counts: Array  # (e,) int64, at least 1

    @property
    def rows(self) -> Array:
        """(e,) int32: the row of every entry."""
        rows = np.arange(len(self.starts) - 1, dtype=np.int32)
        return np.repeat(rows, np.diff(self.starts))


def contingency(rows: Array, columns: Array, shape: tuple[int, int]) -> Contingency:
    """Count the items of every pair of labels that occurs.

    rows, columns: (n,) int32, the labels of every item, negative to leave it out; shape: how many
    row labels and column labels there are.
    """
    starts = np.zeros(shape[0] + 1, np.int64)
    entries = np.empty(len(rows), np.int32), np.empty(len(rows), np.int64)
    _count(read_only(rows), read_only(columns), shape[1], starts, *entries)
    return Contingency(starts, *(entry[: starts[-1]].copy() for entry in entries))


def read_only(array: Array) -> Array:
    """A view that cannot be written: one type of array, so that a kernel is compiled once."""
    view = np.ascontiguousarray(array).view()
    view.flags.writeable = False
    return view


@kernel
def _count(rows, columns, width, starts, entry_columns, entry_counts):
    ends = np.zeros(len(starts), np.int64)
    for i in range(len(rows)):
        if rows[i] >= 0 and columns[i] >= 0:
            ends[rows[i] + 1] += 1
    ends = np.cumsum(ends)
    place = ends.copy()
    by_row = np.empty(ends[-1], np.int32)
    for i in range(len(rows)):
        if rows[i] >= 0 and columns[i] >= 0:
            by_row[place[rows[i]]] = columns[i]
            place[rows[i]] += 1
    count = np.zeros(width, np.int64)
    end = 0
    for row in range(len(starts) - 1):
        first = starts[row] = end
        for column in by_row[ends[row] : ends[row + 1]]:
            if count[column] == 0:
                entry_columns[end] = column
                end += 1
            count[column] += 1
        entry_columns[first:end].sort()
        for entry in range(first, end):
            entry_counts[entry] = count[entry_columns[entry]]
            count[entry_columns[entry]] = 0
    starts[-1] = end
