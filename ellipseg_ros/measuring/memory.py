"""Most memory that a process has held, as Linux counts it."""

import ctypes
from pathlib import Path


def peak_mb(process: int | str = "self") -> float:
    """Most memory that a process has held so far, or since `forget_peak`, in MB (10^6 bytes)."""
    return _status(process, "VmHWM")


def held_mb(process: int | str = "self") -> float:
    """Memory that a process holds now, in MB (10^6 bytes)."""
    return _status(process, "VmRSS")


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
