"""Measurement of the memory of objects and of this process."""

import ctypes
from collections import deque
from pathlib import Path

import numpy as np

POINTER_BYTES = 8


def state_bytes(root: object) -> int:
    """Bytes of all arrays and container slots that are reachable from an object."""
    total, seen, pending = 0, set(), [root]
    while pending:
        item = pending.pop()
        if id(item) in seen:
            continue
        seen.add(id(item))
        if isinstance(item, np.ndarray):
            total += item.nbytes if item.base is None else 0
            pending += [] if item.base is None else [item.base]
        elif isinstance(item, (list, tuple, set, deque)):
            total += POINTER_BYTES * len(item)
            pending += item
        elif isinstance(item, dict):
            total += 2 * POINTER_BYTES * len(item)
            pending += item.values()
        else:
            pending += vars(item).values() if hasattr(item, "__dict__") else ()
    return total


def reset_peak() -> None:
    """Restart the peak of this process from its present memory.

    Returns freed memory to the system first (malloc_trim of glibc), or its reuse would not count.
    """
    ctypes.CDLL("libc.so.6").malloc_trim(0)
    Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
