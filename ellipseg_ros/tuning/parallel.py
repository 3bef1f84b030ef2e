"""Many windows at once: on processes of this machine, or on a Dask cluster.

concurrent.futures of the standard library for the first, dask.distributed (BSD, the usual one for
Python) for the second, behind the same two calls. Processes are spawned: a fork beside the threads
of numba and OpenMP may hang.
"""

import multiprocessing
import signal
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    Executor,
    Future,
    ProcessPoolExecutor,
    wait,
)
from contextlib import contextmanager
from typing import NamedTuple

from ellipseg_ros.errors import EllipsegError
from ellipseg_ros.tuning.tasks import Curves, Task, run, run_single_threaded

AHEAD = 2  # tasks under way per worker: none idles, and few windows are in memory
PATIENCE = 10  # s that a scheduler gets to answer


class Workers(NamedTuple):
    """Who does the work."""

    cores: int
    submit: Callable[[Task], "Future[Curves]"]


class Outcome(NamedTuple):
    """What became of a task: curves, or in one line why there are none."""

    task: Task
    curves: Curves | None
    problem: str = ""


def outcomes(tasks: Iterable[Task], workers: Workers) -> Iterator[Outcome]:
    """Yield what becomes of the tasks, as they end; one that fails is told, and the rest go on."""
    under_way: dict[Future[Curves], Task] = {}
    for task in tasks:
        under_way[workers.submit(task)] = task
        if len(under_way) >= AHEAD * workers.cores:
            yield from _ended(under_way)
    while under_way:
        yield from _ended(under_way)


def _ended(under_way: "dict[Future[Curves], Task]") -> Iterator[Outcome]:
    """Wait for the next tasks to end; those that have, in the order in which they began."""
    done = wait(under_way, return_when=FIRST_COMPLETED).done
    for future in [future for future in under_way if future in done]:
        task = under_way.pop(future)
        error = future.exception()
        if error is None:
            yield Outcome(task, future.result())
        else:
            yield Outcome(task, None, _one_line(error))


def _one_line(error: BaseException) -> str:
    if isinstance(error, BrokenExecutor):
        return "a worker process died; the memory may be too small for so many at once (--jobs)"
    return f"{type(error).__name__}: {' '.join(str(error).split())}"


@contextmanager
def this_process() -> Iterator[Workers]:
    """No others: each task on all cores of this process, one after the other."""

    def submit(task: Task) -> "Future[Curves]":
        future: Future[Curves] = Future()
        try:
            future.set_result(run(task))
        except Exception as error:
            future.set_exception(error)
        return future

    yield Workers(1, submit)


@contextmanager
def processes(count: int) -> Iterator[Workers]:
    """So many processes of this machine, each on one core."""
    pool = _Pool(count)
    try:
        yield Workers(count, pool.submit)
    except BaseException:
        for child in multiprocessing.active_children():
            child.terminate()  # their results would come too late
        raise
    finally:
        pool.close()


class _Pool:
    """Processes that are replaced when one of them has died."""

    def __init__(self, count: int) -> None:
        self._count = count
        self._executor = self._new()

    def _new(self) -> Executor:
        spawn = multiprocessing.get_context("spawn")
        return ProcessPoolExecutor(self._count, mp_context=spawn, initializer=_leave_interrupts)

    def submit(self, task: Task) -> "Future[Curves]":
        try:
            return self._executor.submit(run_single_threaded, task)
        except BrokenExecutor:
            self.close()
            self._executor = self._new()
            return self._executor.submit(run_single_threaded, task)

    def close(self) -> None:
        self._executor.shutdown(cancel_futures=True)


def _leave_interrupts() -> None:
    """Ctrl-C goes to every process of a terminal; the first one ends the others in order."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


@contextmanager
def dask(address: str) -> Iterator[Workers]:
    """The workers of a Dask scheduler, such as tcp://10.0.0.1:8786; they need this package.

    EllipsegError if there is none, or if it has no workers.
    """
    from distributed import Client

    try:
        client = Client(address, timeout=PATIENCE)
    except (OSError, ValueError) as error:
        raise EllipsegError(
            f"no Dask scheduler answers at {address}; it must be one such as tcp://10.0.0.1:8786"
        ) from error
    with client:
        count = sum(client.nthreads().values())
        if not count:
            raise EllipsegError(f"the scheduler at {address} has no workers; start some first")
        executor = client.get_executor(pure=False, retries=1)
        yield Workers(count, lambda task: executor.submit(run_single_threaded, task))
