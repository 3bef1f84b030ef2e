"""The one place that sets numba options and shares rows between threads.

Plain threads over kernels that release the GIL, not numba's `prange`: its threading layers forbid
calls from two Python threads at once, or a fork, and compile much longer. Row i of a result
depends on row i alone, so the number of threads cannot change it.
"""

import os
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import Any

from numba import config, njit

from ellipseg_ros.core.kernel_cache import cached


def kernel(function: Callable[..., Any]) -> Any:
    """Compile a function when it is called first, and keep that for the next process."""
    return cached(njit(function, nogil=True, error_model="numpy"))


def inlined(function: Callable[..., Any]) -> Any:
    """The same for a short kernel that others call in a loop with a record of arrays.

    Every call copies and counts the record's arrays, which can take longer than the work.
    """
    return cached(njit(function, nogil=True, error_model="numpy", inline="always"))


THREADS = len(os.sched_getaffinity(0))
MIN_ROWS_PER_THREAD = 2048  # fewer are not worth starting a thread
PLAIN = config.DISABLE_JIT  # kernels run as plain Python: for tests
_pool = ThreadPoolExecutor(max(1, THREADS - 1), "ellipseg")


class _Thread(threading.local):
    single = False  # this thread shares nothing with the pool


_thread = _Thread()


@contextmanager
def single_threaded() -> Iterator[None]:
    """Within it, this thread uses no others: for several that do the same side by side."""
    before = _thread.single
    _thread.single = True
    try:
        yield
    finally:
        _thread.single = before


def helpers() -> int:
    """The number of threads that may help the current one."""
    return 0 if _thread.single else THREADS - 1


def _renew_pool() -> None:
    """Replace the pool in a forked child: threads do not survive a fork."""
    global _pool  # a new one is the only remedy
    _pool = ThreadPoolExecutor(max(1, THREADS - 1), "ellipseg")


os.register_at_fork(after_in_child=_renew_pool)


def for_rows(function: Callable[..., Any], count: int, *args: Any) -> None:
    """Call `function(start, stop, *args)` so that the calls together cover rows 0 to count."""
    parts = min(THREADS, -(-count // MIN_ROWS_PER_THREAD)) if count else 0
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
