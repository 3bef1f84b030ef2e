"""Runs a method in a subprocess, to measure its memory, survive its crash and limit its time."""

import multiprocessing
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from typing import TypeAlias

from studies.partition.evaluation import Evaluation
from studies.partition.methods import Method
from studies.report.packages import load

Work: TypeAlias = Callable[[], Iterator[Evaluation]]  # can be pickled
ENDED = "ended"


@dataclass
class Outcome:
    """Evaluations of a method, and why there are no more of them."""

    evaluations: list[Evaluation] = field(default_factory=list)
    missing: str = ""  # why the method cannot be run
    problem: str = ""  # what stopped it


def run_in_subprocess(work: Work, methods: tuple[Method, ...], limit: float) -> Outcome:
    """The evaluations that `work` yields within `limit` s; it needs the packages of `methods`."""
    outcome = Outcome()
    context = multiprocessing.get_context("spawn")  # a fork would start with our memory
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=_serve, args=(sender, work, methods), daemon=True)
    process.start()
    sender.close()
    try:
        _receive(receiver, outcome, time.monotonic() + limit, limit)
    finally:
        if process.is_alive():
            process.join(1.0)  # it has sent its last message or has exceeded the limit
        if process.is_alive():
            process.kill()
        process.join()
        receiver.close()
    if outcome.problem == ENDED:
        outcome.problem = f"its process ended with {process.exitcode}"
    return outcome


def _receive(receiver: Connection, outcome: Outcome, end: float, limit: float) -> None:
    """Collect messages until the last one, the end of the process or the time limit."""
    while True:
        if not receiver.poll(max(0.0, end - time.monotonic())):
            outcome.problem = f"stopped after {limit:g} s"
            return
        try:
            kind, content = receiver.recv()
        except EOFError:
            outcome.problem = ENDED
            return
        if kind == "evaluation":
            outcome.evaluations.append(content)
            continue
        if kind == "missing":
            outcome.missing = content
        elif kind == "problem":
            outcome.problem = content
        return


def _serve(sender: Connection, work: Work, methods: tuple[Method, ...]) -> None:
    """In the subprocess: send (kind, content) for every evaluation and at the end."""
    for method in methods:
        for package, module in zip(method.package.split(), method.module.split(), strict=True):
            reason = load(package, module)[1]
            if reason:
                sender.send(("missing", reason))
                return
    try:
        for evaluation in work():
            sender.send(("evaluation", evaluation))
    except Exception as error:  # a library may raise anything; the report has its text
        text = " ".join(str(error).split())[:200]
        sender.send(("problem", f"{type(error).__name__}: {text}"))
        return
    sender.send(("done", None))
