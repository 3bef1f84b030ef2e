"""Memory of a process as reported by Linux, and tuning of glibc's allocator."""

import ctypes
from pathlib import Path

M_MMAP_THRESHOLD, M_ARENA_MAX = -3, -8  # of malloc.h
LARGE_BLOCK_BYTES = 2**20


def peak_mb(process: int | str = "self") -> float:
    """Peak resident memory of a process since its start, MB (10^6 bytes)."""
    return _status(process, "VmHWM")


def resident_mb(process: int | str = "self") -> float:
    """Present resident memory of a process, MB (10^6 bytes)."""
    return _status(process, "VmRSS")


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
