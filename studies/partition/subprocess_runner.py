"""Runs a method in a process of its own: for its memory, its crashes, and a time limit."""

import multiprocessing
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from typing import TypeAlias

from ellipseg_ros.doctor.packages import load
from studies.partition.cells import Cell
from studies.partition.methods import Method

Work: TypeAlias = Callable[[], Iterator[Cell]]  # can be pickled


@dataclass
class Outcome:
    """What came of a method; a problem may come after some cells."""

    cells: list[Cell] = field(default_factory=list)
    missing: str = ""  # why the method is not there
    problem: str = ""  # what stopped it


def run_apart(work: Work, methods: tuple[Method, ...], limit: float) -> Outcome:
    """The cells that `work` makes with `methods`, as many as come in `limit` s."""
    outcome = Outcome()
    context = multiprocessing.get_context("spawn")  # a fork would begin with our memory
    ours, theirs = context.Pipe(duplex=False)
    process = context.Process(target=_serve, args=(theirs, work, methods), daemon=True)
    process.start()
    theirs.close()
    end = time.monotonic() + limit
    try:
        _listen(ours, outcome, end, limit)
    finally:
        if process.is_alive():
            process.join(1.0)  # it has said its last word, or has run out of time
        if process.is_alive():
            process.kill()
        process.join()
        ours.close()
    if outcome.problem == ENDED:
        outcome.problem = f"its process ended with {process.exitcode}"
    return outcome


ENDED = "ended"


def _listen(ours: Connection, outcome: Outcome, end: float, limit: float) -> None:
    """Take what comes until the last word, the end of the process, or the end of the time."""
    while True:
        if not ours.poll(max(0.0, end - time.monotonic())):
            outcome.problem = f"stopped after {limit:g} s"
            return
        try:
            kind, what = ours.recv()
        except EOFError:
            outcome.problem = ENDED
            return
        if kind == "cell":
            outcome.cells.append(what)
        elif kind == "missing":
            outcome.missing = what
        elif kind == "problem":
            outcome.problem = what
        if kind != "cell":
            return


def _serve(theirs: Connection, work: Work, methods: tuple[Method, ...]) -> None:
    """In the other process: send (kind, what) until done."""
    for method in methods:
        for package, module in zip(method.package.split(), method.module.split(), strict=True):
            why = load(package, module)[1]
            if why:
                theirs.send(("missing", why))
                return
    try:
        for cell in work():
            theirs.send(("cell", cell))
    except Exception as error:  # whatever a library of others raises is said, not lost
        theirs.send(("problem", f"{type(error).__name__}: {' '.join(str(error).split())[:200]}"))
        return
    theirs.send(("done", None))
