"""Spoiled files given to the commands, in a process that may die, hang, or ask for too much."""

import json
import multiprocessing
import os
import resource
import shutil
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from io import StringIO
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from ellipseg_ros.cli.main import main
from ellipseg_ros.errors import EllipsegError
from ellipseg_ros.io.map_file import read_map
from ellipseg_ros.node.memory import peak_mb, reset_peak, resident_mb
from ellipseg_ros.segmenter import warm_up
from studies.endurance.damage import LOCKED, damage
from studies.endurance.samples import write_samples

LIMIT = 30.0  # s that a file of some kilobytes may take
START = 300.0  # s: imports, compilation
PATIENCE = 5.0  # s that the process gets to end
MEMORY_MB = 500.0  # that such a file may need beyond what the process has
ADDRESSES = 2**31  # bytes beyond what it has that the process may ask for
WHOLE = "none"  # the damage of a file that has none
SKIPPED = "skipped"  # for root, who may read what is locked
LONGEST = 600  # characters of the one line, paths included


@dataclass(frozen=True)
class Outcome:
    """What a spoiled file led to."""

    kind: str
    damage: str
    code: int  # exit code; -1 if there was none
    line: str  # what was said
    seconds: float
    memory_mb: float  # more than before
    fault: str  # in words; empty if all is as it must be


def try_files(seed: int, cases: int) -> Iterator[Outcome]:
    """Spoil a file of every kind so many times, and yield what the command line makes of each.

    At first one of every kind as it is, so that it is known to be good.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        samples = write_samples(folder / "good")
        kinds = list(samples)
        with Worker() as worker:
            for kind in kinds:
                _copy(samples[kind].parent, folder / "whole")
                yield worker.run(task_of(kind, folder / "whole", samples), kind, WHOLE)
            for number in range(cases * len(kinds)):
                kind, other = kinds[number % len(kinds)], kinds[(number * 7 + 1) % len(kinds)]
                place = folder / "spoiled"
                _copy(samples[kind].parent, place)
                how = damage(place / samples[kind].name, samples[other], seed, number)
                if how == LOCKED and os.geteuid() == 0:
                    yield Outcome(kind, SKIPPED, -1, "", 0.0, 0.0, "")
                    continue
                yield worker.run(task_of(kind, place, samples), kind, how)


def task_of(kind: str, place: Path, samples: dict[str, Path]) -> dict[str, str]:
    """What the worker gets: the file of this kind in a folder."""
    path = place / samples[kind].name
    return {"kind": kind, "path": str(path), "good": str(samples["npz"])}


def _copy(good: Path, place: Path) -> None:
    shutil.rmtree(place, ignore_errors=True)
    shutil.copytree(good, place)


class Worker:
    """A process that runs one task after the other; another takes its place if it must be ended.

    target: what it runs, see `work`. limit: s that a task may take.
    """

    def __init__(
        self, target: Callable[[Connection], None] | None = None, limit: float = LIMIT
    ) -> None:
        self._target = target or work
        self._limit = limit

    def __enter__(self) -> "Worker":
        self._start()
        return self

    def __exit__(self, *_: object) -> None:
        self._end(PATIENCE)

    def _start(self) -> None:
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=self._target, args=[theirs], daemon=True)
        self._process.start()
        theirs.close()
        if not self._pipe.poll(START) or self._pipe.recv() != "ready":
            raise EllipsegError("the process that reads spoiled files has not begun")

    def _end(self, patience: float) -> None:
        self._pipe.close()  # then it ends by itself, unless it hangs
        self._process.join(patience)
        self._process.kill()
        self._process.join()

    def run(self, task: dict[str, str], kind: str, how: str) -> Outcome:
        """What comes of a task: also that it never ends, or ends the process."""
        started = time.monotonic()
        self._pipe.send(task)
        fault = f"no answer within {self._limit:g} s"
        try:
            if self._pipe.poll(self._limit):
                return Outcome(kind, how, **self._pipe.recv())
        except EOFError:
            self._process.join()
            fault = f"the process ended with {self._process.exitcode}"
        self._end(patience=0.0)
        self._start()
        return Outcome(kind, how, -1, "", time.monotonic() - started, 0.0, fault)


def work(pipe: Connection) -> None:
    """In the worker: run tasks until the pipe is closed."""
    warm_up()
    status = Path("/proc/self/statm").read_text(encoding="ascii")
    most = int(status.split()[0]) * resource.getpagesize() + ADDRESSES
    resource.setrlimit(resource.RLIMIT_AS, (most, most))
    pipe.send("ready")
    while True:
        try:
            task = pipe.recv()
        except EOFError:
            return
        pipe.send(answer(task))


def answer(task: dict[str, str]) -> dict[str, Any]:
    """Read a file as a user would; the rest of its Outcome."""
    reset_peak()
    before, started = resident_mb(), time.monotonic()
    out = Path(task["path"]).parent / "out"
    said = StringIO()
    with redirect_stderr(said), redirect_stdout(said):
        try:
            code, fault = _read(task, out), ""
        except BaseException:  # SystemExit and a panic of Rust are none of Exception
            code, fault = -1, traceback.format_exc()
    memory = peak_mb() - before
    line = said.getvalue().strip()
    return {
        "code": code,
        "line": line,
        "seconds": time.monotonic() - started,
        "memory_mb": memory,
        "fault": fault or _fault(task["kind"], code, line, memory, out),
    }


def _read(task: dict[str, str], out: Path) -> int:
    """What a user would do with the file; the exit code."""
    if task["kind"] == "map":  # which no command reads, but the associator at its start
        try:
            read_map(Path(task["path"]))
        except EllipsegError as error:
            sys.stderr.write(f"ellipseg: {error}\n")
            return 2
        return 0
    options = ["-o", str(out), "--no-pictures", "--quiet"]
    if task["kind"] == "parameters":
        return main(["segment", task["good"], "--params", task["path"], *options])
    return main(["segment", task["path"], *options])


def _fault(kind: str, code: int, line: str, memory_mb: float, out: Path) -> str:
    """What is not as promised; empty if all is."""
    there = sorted(path.name for path in out.rglob("*")) if out.exists() else []
    if any(name.startswith(".") for name in there):
        return f"left behind: {', '.join(there)}"
    if memory_mb > MEMORY_MB:
        return f"it took {memory_mb:.0f} MB"
    if code == 0:
        return "" if kind == "map" else _incomplete(out)
    if code != 2:
        return f"exit code {code}"
    if len(line.splitlines()) != 1 or not line.startswith("ellipseg: ") or len(line) > LONGEST:
        return f"not one clear line: {line}"
    return f"left behind: {', '.join(there)}" if there else ""


def _incomplete(out: Path) -> str:
    """What the results of a run that ended well lack."""
    if not out.exists():
        return "no results"
    summary = json.loads((out / "summary.json").read_text("utf-8"))
    missing = [name for name in summary["files"] if not Path(name).exists()]
    return f"{', '.join(missing)} is not there" if missing else ""
