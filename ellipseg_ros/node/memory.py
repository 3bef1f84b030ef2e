"""The memory of a process, as Linux counts it, and how glibc hands it out."""

import ctypes
from collections import deque
from pathlib import Path

import numpy as np

POINTER = 8  # bytes
M_MMAP_THRESHOLD, M_ARENA_MAX = -3, -8  # of malloc.h
LARGE = 2**20  # bytes


def peak_mb(process: int | str = "self") -> float:
    """Most memory that a process has held so far, or since `forget_peak`, in MB (10^6 bytes)."""
    return _status(process, "VmHWM")


def held_mb(process: int | str = "self") -> float:
    """Memory that a process holds now, in MB (10^6 bytes)."""
    return _status(process, "VmRSS")


def state_bytes(thing: object) -> int:
    """Bytes of all arrays, and of all elements of lists and mappings, that an object holds."""
    total, seen, found = 0, set(), [thing]
    while found:
        one = found.pop()
        if id(one) in seen:
            continue
        seen.add(id(one))
        if isinstance(one, np.ndarray):
            total += one.nbytes if one.base is None else 0
            found += [] if one.base is None else [one.base]
        elif isinstance(one, (list, tuple, set, deque)):
            total += POINTER * len(one)
            found += one
        elif isinstance(one, dict):
            total += 2 * POINTER * len(one)
            found += one.values()
        else:
            found += vars(one).values() if hasattr(one, "__dict__") else ()
    return total


def forget_peak() -> None:
    """Let the peak of this process begin anew, from what it holds now.

    Freed memory goes back to the system first (malloc_trim of glibc), or its use would not count.
    """
    ctypes.CDLL("libc.so.6").malloc_trim(0)
    Path("/proc/self/clear_refs").write_text("5", encoding="ascii")


def _status(process: int | str, name: str) -> float:
    status = Path(f"/proc/{process}/status").read_text(encoding="ascii", errors="replace")
    kib = next(line.split()[1] for line in status.splitlines() if line.startswith(f"{name}:"))
    return round(int(kib) * 1024 / 1e6, 1)


def give_back_large() -> None:
    """Have this process give back large arrays as soon as they are freed (mallopt of glibc).

    glibc keeps a heap for every thread, and keeps larger and larger blocks in them once some were
    freed. Arrays that have another size at every update then leave holes that nothing fits into,
    and a process that runs for hours grows.
    """
    libc = ctypes.CDLL(None)
    if hasattr(libc, "mallopt"):  # another C library may do without
        libc.mallopt(M_MMAP_THRESHOLD, LARGE)
        libc.mallopt(M_ARENA_MAX, 1)
