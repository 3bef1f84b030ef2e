"""The one place that sets numba options and shares rows between threads.

Plain threads over kernels that release the GIL, not numba's `prange`: its layers forbid calls from
two Python threads at once, or a fork, and compile much longer. Row i of a result depends on row i
alone, so the number of threads cannot change it.
"""

import hashlib
import os
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from numba import config, njit

from ellipseg_ros.core.kernel_cache import cached

KERNEL_FOLDERS = ("core", "objects", "landmarks", "association")  # kernels call one another's


def _cache_folder() -> str:
    """One for every version of these sources; NUMBA_CACHE_DIR, where it is set, is taken as it is.

    numba's own notices no edit in another file than the kernel's, and code compiled against
    an older callee can crash.
    """
    if config.CACHE_DIR:
        return config.CACHE_DIR
    package = Path(__file__).resolve().parents[1]
    digest = hashlib.sha1(usedforsecurity=False)
    for folder in KERNEL_FOLDERS:
        for source in sorted((package / folder).rglob("*.py")):
            digest.update(source.read_bytes())
    home = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    return os.path.join(home, "ellipseg_ros", digest.hexdigest())


config.CACHE_DIR = _cache_folder()


def kernel(function: Callable[..., Any]) -> Any:
    """Compile a function when it is called first, and keep that for the next process."""
    return cached(njit(function, nogil=True, error_model="numpy"))


def inlined(function: Callable[..., Any]) -> Any:
    """The same for a short kernel that others call in a loop with a record of arrays.

    Every call copies and counts the record's arrays, which can take longer than the work.
    """
    return cached(njit(function, nogil=True, error_model="numpy", inline="always"))


THREADS = len(os.sched_getaffinity(0))
LEAST = 2048  # rows below which a thread is not worth its start
PLAIN = config.DISABLE_JIT  # kernels run as plain Python: for tests
_pool = ThreadPoolExecutor(max(1, THREADS - 1), "ellipseg")
_here = threading.local()  # .alone: this thread shares nothing with the pool


@contextmanager
def alone() -> Iterator[None]:
    """Within it, this thread does everything by itself: beside others that do the same."""
    before = _alone()
    _here.alone = True
    try:
        yield
    finally:
        _here.alone = before


def _alone() -> bool:
    return getattr(_here, "alone", False)


def helpers() -> int:
    """How many threads may help this one."""
    return 0 if _alone() else THREADS - 1


def _renew() -> None:
    """Threads do not survive a fork, and a pool does not notice."""
    global _pool  # a new one is the only cure
    _pool = ThreadPoolExecutor(max(1, THREADS - 1), "ellipseg")


os.register_at_fork(after_in_child=_renew)


def for_rows(function: Callable[..., Any], count: int, *args: Any) -> None:
    """Call `function(start, stop, *args)` so that the calls together cover rows 0 to count."""
    parts = min(THREADS, -(-count // LEAST)) if count else 0
    for_parts(
        [(count * k // parts, count * (k + 1) // parts) for k in range(parts)], function, *args
    )


def for_parts(parts: list[tuple[int, int]], function: Callable[..., Any], *args: Any) -> None:
    """Call `function(*part, *args)` for every part; a thread takes the next one that is left."""
    left = iter(parts)  # next() of a list's iterator is atomic

    def work() -> None:
        for part in left:
            function(*part, *args)

    others = [_pool.submit(work) for _ in range(min(helpers(), len(parts) - 1))]
    work()
    for other in others:
        other.result()
