"""Most memory that a process has held, as Linux counts it."""

import ctypes
from collections import deque
from pathlib import Path

import numpy as np

POINTER = 8  # bytes


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
