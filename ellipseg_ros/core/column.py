"""Arrays that lose rows at the front and gain rows at the end, without copying what stays."""

from typing import Any

import numpy as np

from ellipseg_ros.records import Array

SPARE_FACTOR = 2.0  # rows allocated per row needed


class Column:
    """A view on an array to which rows are only appended: views taken before never change."""

    def __init__(self, values: Array) -> None:
        self._buffer = values
        self._start, self._stop = 0, len(values)

    @property
    def dtype(self) -> Any:
        """Type of the rows."""
        return self._buffer.dtype

    @property
    def values(self) -> Array:
        """The current rows; read only."""
        rows: Array = self._buffer[self._start : self._stop]
        rows.flags.writeable = False
        return rows

    def drop(self, dropped: Array) -> None:
        """Drop the rows where `dropped` (n,) bool; copies only if kept rows precede them."""
        first = int(np.argmin(dropped)) if len(dropped) else 0
        if dropped.all():
            first = len(dropped)
        if dropped[first:].any():
            self._buffer = self.values[~dropped]
            self._start, self._stop = 0, len(self._buffer)
        else:
            self._start += first

    def append(self, rows: Array) -> None:
        """Add rows (m, ...) of the same kind at the end."""
        if not len(rows):
            return
        if self._stop + len(rows) > len(self._buffer):
            kept = self.values
            size = round(SPARE_FACTOR * (len(kept) + len(rows)))
            self._buffer = np.empty((size, *kept.shape[1:]), kept.dtype)
            self._buffer[: len(kept)] = kept
            self._start, self._stop = 0, len(kept)
        self._buffer[self._stop : self._stop + len(rows)] = rows
        self._stop += len(rows)
