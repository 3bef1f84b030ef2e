"""Tuning of many windows in parallel: on processes of this machine, or on a Dask cluster.

By concurrent.futures of the standard library, or dask.distributed (BSD, the usual choice for
Python). Processes are spawned: a fork beside the threads of numba and OpenMP may hang.
"""

import multiprocessing
import signal
from collections.abc import Callable, Iterable, Iterator
from concurrent import futures
from concurrent.futures import BrokenExecutor, Future
from contextlib import contextmanager
from functools import partial
from typing import NamedTuple

from ellipseg_ros.errors import EllipsegError
from ellipseg_ros.tuning.tasks import Curves, Task, run, run_single_threaded

TASKS_PER_WORKER = 2  # submitted ahead: no worker idles, and few windows are in memory
SCHEDULER_TIMEOUT_S = 10


class Workers(NamedTuple):
    """Executes tasks."""

    cores: int
    submit: Callable[[Task], "Future[Curves]"]


class Outcome(NamedTuple):
    """Result of a task: its curves, or one line on why there are none."""

    task: Task
    curves: Curves | None
    problem: str = ""


def outcomes(tasks: Iterable[Task], workers: Workers) -> Iterator[Outcome]:
    """Yield the outcomes of tasks as they end; a failed task does not stop the others."""
    pending: dict[Future[Curves], Task] = {}
    for task in tasks:
        pending[workers.submit(task)] = task
        if len(pending) >= TASKS_PER_WORKER * workers.cores:
            yield from _completed(pending)
    while pending:
        yield from _completed(pending)


def _completed(pending: "dict[Future[Curves], Task]") -> Iterator[Outcome]:
    """Wait for the next tasks to end; their outcomes, in the order of submission."""
    done = futures.wait(pending, return_when=futures.FIRST_COMPLETED).done
    for future in [future for future in pending if future in done]:
        task = pending.pop(future)
        error = future.exception()
        if error is None:
            yield Outcome(task, future.result())
        elif isinstance(error, BrokenExecutor):
            remedy = "the memory may be too small for this number of processes (--jobs)"
            yield Outcome(task, None, f"a worker process died; {remedy}")
        else:
            yield Outcome(task, None, f"{type(error).__name__}: {' '.join(str(error).split())}")


@contextmanager
def this_process() -> Iterator[Workers]:
    """This process alone: one task after the other, each on all cores."""
    with futures.ThreadPoolExecutor(1) as pool:
        yield Workers(1, lambda task: pool.submit(run, task))


@contextmanager
def processes(count: int) -> Iterator[Workers]:
    """`count` processes of this machine, each on one core; the pool is replaced when one dies."""
    spawn = multiprocessing.get_context("spawn")
    # Ctrl-C reaches every process of a terminal; this one alone handles it and ends the others.
    ignore = (signal.SIGINT, signal.SIG_IGN)
    new_pool = partial(futures.ProcessPoolExecutor, count, spawn, signal.signal, ignore)
    pool = new_pool()

    def submit(task: Task) -> "Future[Curves]":
        nonlocal pool
        try:
            return pool.submit(run_single_threaded, task)
        except BrokenExecutor:
            pool.shutdown(cancel_futures=True)
            pool = new_pool()
            return pool.submit(run_single_threaded, task)

    try:
        yield Workers(count, submit)
    except BaseException:
        for child in multiprocessing.active_children():
            child.terminate()  # their results would come too late
        raise
    finally:
        pool.shutdown(cancel_futures=True)


@contextmanager
def dask(address: str) -> Iterator[Workers]:
    """The workers of a Dask scheduler, such as tcp://10.0.0.1:8786; they need this package.

    EllipsegError if there is none, or if it has no workers.
    """
    from distributed import Client

    try:
        client = Client(address, timeout=SCHEDULER_TIMEOUT_S)
    except (OSError, ValueError) as error:
        example = "give an address such as tcp://10.0.0.1:8786"
        raise EllipsegError(f"no Dask scheduler answers at {address}; {example}") from error
    with client:
        count = sum(client.nthreads().values())
        if not count:
            raise EllipsegError(f"the scheduler at {address} has no workers; start some first")
        executor = client.get_executor(pure=False, retries=1)
        yield Workers(count, lambda task: executor.submit(run_single_threaded, task))
