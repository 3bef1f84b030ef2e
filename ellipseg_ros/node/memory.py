"""Memory of a process as reported by Linux, and tuning of glibc's allocator."""

import ctypes
from collections import deque
from pathlib import Path

import numpy as np

POINTER_BYTES = 8
M_MMAP_THRESHOLD, M_ARENA_MAX = -3, -8  # of malloc.h
LARGE_BLOCK_BYTES = 2**20


def peak_mb(process: int | str = "self") -> float:
    """Peak resident memory of a process since its start or `reset_peak`, MB (10^6 bytes)."""
    return _status(process, "VmHWM")


def resident_mb(process: int | str = "self") -> float:
    """Present resident memory of a process, MB (10^6 bytes)."""
    return _status(process, "VmRSS")


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


def _status(process: int | str, name: str) -> float:
    status = Path(f"/proc/{process}/status").read_text(encoding="ascii", errors="replace")
    kib = next(line.split()[1] for line in status.splitlines() if line.startswith(f"{name}:"))
    return round(int(kib) * 1024 / 1e6, 1)


def release_large_blocks() -> None:
    """Make this process return large arrays to the system when they are freed (mallopt of glibc).

    glibc keeps a heap per thread, and keeps larger and larger blocks in it once some were freed.
    Arrays whose size changes with every update then fragment it, and a process that runs for
    hours grows.
    """
    libc = ctypes.CDLL(None)
    if hasattr(libc, "mallopt"):  # not in every C library
        libc.mallopt(M_MMAP_THRESHOLD, LARGE_BLOCK_BYTES)
        libc.mallopt(M_ARENA_MAX, 1)
