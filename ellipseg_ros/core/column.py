"""Arrays that lose rows at the front and gain rows at the end, without copying what stays."""

from typing import Any

import numpy as np

from ellipseg_ros.records import Array

SPARE = 2.0  # rows made per row needed


class Column:
    """A window on an array to which rows are only appended: what was given out never changes."""

    def __init__(self, values: Array) -> None:
        self._buffer = values
        self._start, self._stop = 0, len(values)

    @property
    def dtype(self) -> Any:
        """What the rows are of."""
        return self._buffer.dtype

    @property
    def values(self) -> Array:
        """The rows of now; read only."""
        rows: Array = self._buffer[self._start : self._stop]
        rows.flags.writeable = False
        return rows

    def drop(self, gone: Array) -> None:
        """Take out the rows where `gone` (n,) bool; copies only if others came before them."""
        first = int(np.argmin(gone)) if len(gone) else 0
        if gone.all():
            first = len(gone)
        if gone[first:].any():
            self._buffer = self.values[~gone]
            self._start, self._stop = 0, len(self._buffer)
        else:
            self._start += first

    def append(self, rows: Array) -> None:
        """Add rows (m, ...) of the same kind at the end."""
        if not len(rows):
            return
        if self._stop + len(rows) > len(self._buffer):
            living = self.values
            size = round(SPARE * (len(living) + len(rows)))
            self._buffer = np.empty((size, *living.shape[1:]), living.dtype)
            self._buffer[: len(living)] = living
            self._start, self._stop = 0, len(living)
        self._buffer[self._stop : self._stop + len(rows)] = rows
        self._stop += len(rows)
