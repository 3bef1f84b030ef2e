"""Damaged files read by the commands, in a process that may crash, hang or run out of memory."""

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
from ellipseg_ros.node.memory import peak_mb, resident_mb
from ellipseg_ros.segmenter import warm_up
from studies.endurance.damage import LOCKED, damage
from studies.endurance.samples import write_samples
from studies.memory import reset_peak

TIMEOUT_S = 30.0  # for a file of some kilobytes
START_TIMEOUT_S = 300.0  # imports, compilation
SHUTDOWN_TIMEOUT_S = 5.0
MAX_MEMORY_MB = 500.0  # beyond what the process has
EXTRA_ADDRESSES = 2**31  # bytes that the process may allocate beyond what it has
INTACT = "none"  # the damage of an intact file
SKIPPED = "skipped"  # as root, for whom permissions do not count
MAX_LINE_LENGTH = 600  # characters of the error message, including paths


@dataclass(frozen=True)
class Outcome:
    """What happened when a file was read."""

    kind: str
    damage: str
    code: int  # exit code; -1 if there was none
    line: str  # output
    seconds: float
    memory_mb: float  # by which memory grew
    fault: str  # a description; empty if a requirement is met


Reader = Callable[[dict[str, str], Path], int]


def try_files(seed: int, cases: int) -> Iterator[Outcome]:
    """Read one intact file of every kind, then `cases` damaged ones of each."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        samples = write_samples(folder / "samples")
        kinds = list(samples)
        with Worker() as worker:
            for kind in kinds:
                _copy(samples[kind].parent, folder / "intact")
                yield worker.run(task_for(kind, folder / "intact", samples), kind, INTACT)
            for number in range(cases * len(kinds)):
                kind, other = kinds[number % len(kinds)], kinds[(number * 7 + 1) % len(kinds)]
                place = folder / "damaged"
                _copy(samples[kind].parent, place)
                how = damage(place / samples[kind].name, samples[other], seed, number)
                if how == LOCKED and os.geteuid() == 0:
                    yield Outcome(kind, SKIPPED, -1, "", 0.0, 0.0, "")
                    continue
                yield worker.run(task_for(kind, place, samples), kind, how)


def task_for(kind: str, place: Path, samples: dict[str, Path]) -> dict[str, str]:
    """The task of reading the file of this kind in the folder `place`."""
    path = place / samples[kind].name
    return {"kind": kind, "path": str(path), "cloud": str(samples["npz"])}


def _copy(sample: Path, place: Path) -> None:
    shutil.rmtree(place, ignore_errors=True)
    shutil.copytree(sample, place)


class Worker:
    """A process that runs tasks one after the other, replaced if it crashes or hangs.

    target: the program of the process, such as `work`. timeout_s: of a task.
    """

    def __init__(
        self, target: Callable[[Connection], None] | None = None, timeout_s: float = TIMEOUT_S
    ) -> None:
        self._target = target or work
        self._timeout_s = timeout_s

    def __enter__(self) -> "Worker":
        self._start()
        return self

    def __exit__(self, *_: object) -> None:
        self._end(SHUTDOWN_TIMEOUT_S)

    def _start(self) -> None:
        context = multiprocessing.get_context("spawn")
        self._pipe, other_end = context.Pipe()
        self._process = context.Process(target=self._target, args=[other_end], daemon=True)
        self._process.start()
        other_end.close()
        if not self._pipe.poll(START_TIMEOUT_S) or self._pipe.recv() != "ready":
            raise EllipsegError("the process that reads damaged files did not start")

    def _end(self, timeout_s: float) -> None:
        self._pipe.close()  # then it ends by itself, unless it hangs
        self._process.join(timeout_s)
        self._process.kill()
        self._process.join()

    def run(self, task: dict[str, str], kind: str, how: str) -> Outcome:
        """Run a task; a process that crashes or hangs is an outcome, too."""
        started = time.monotonic()
        self._pipe.send(task)
        fault = f"no answer within {self._timeout_s:g} s"
        try:
            if self._pipe.poll(self._timeout_s):
                return Outcome(kind, how, **self._pipe.recv())
        except EOFError:
            self._process.join()
            fault = f"the process ended with {self._process.exitcode}"
        self._end(timeout_s=0.0)
        self._start()
        return Outcome(kind, how, -1, "", time.monotonic() - started, 0.0, fault)


def work(pipe: Connection) -> None:
    """Run tasks until the pipe is closed: the program of a worker."""
    warm_up()
    status = Path("/proc/self/statm").read_text(encoding="ascii")
    limit = int(status.split()[0]) * resource.getpagesize() + EXTRA_ADDRESSES
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    pipe.send("ready")
    while True:
        try:
            task = pipe.recv()
        except EOFError:
            return
        pipe.send(answer(task))


def read_file(task: dict[str, str], out: Path) -> int:
    """Read a file as a user would; returns the exit code."""
    if task["kind"] == "map":  # which no command reads, but the associator when it starts
        try:
            read_map(Path(task["path"]))
        except EllipsegError as error:
            sys.stderr.write(f"ellipseg: {error}\n")
            return 2
        return 0
    options = ["-o", str(out), "--no-pictures", "--quiet"]
    if task["kind"] == "parameters":
        return main(["segment", task["cloud"], "--params", task["path"], *options])
    return main(["segment", task["path"], *options])


def answer(
    task: dict[str, str], read: Reader = read_file, max_memory_mb: float = MAX_MEMORY_MB
) -> dict[str, Any]:
    """Read a file; returns the fields of its Outcome except kind and damage."""
    reset_peak()
    before, started = resident_mb(), time.monotonic()
    out = Path(task["path"]).parent / "out"
    output = StringIO()
    with redirect_stderr(output), redirect_stdout(output):
        try:
            code, fault = read(task, out), ""
        except BaseException:  # SystemExit and a panic of Rust are not Exceptions
            code, fault = -1, traceback.format_exc()
    memory = peak_mb() - before
    line = output.getvalue().strip()
    if not fault and memory > max_memory_mb:
        fault = f"it took {memory:.0f} MB"
    return {
        "code": code,
        "line": line,
        "seconds": time.monotonic() - started,
        "memory_mb": memory,
        "fault": fault or _fault(task["kind"], code, line, out),
    }


def _fault(kind: str, code: int, line: str, out: Path) -> str:
    """Description of a requirement that is not met; empty if all are."""
    names = sorted(path.name for path in out.rglob("*")) if out.exists() else []
    if any(name.startswith(".") for name in names):
        return f"left behind: {', '.join(names)}"
    if code == 0:
        return "" if kind == "map" else _incomplete(out)
    if code != 2:
        return f"exit code {code}"
    is_short = len(line.splitlines()) == 1 and len(line) <= MAX_LINE_LENGTH
    if not is_short or not line.startswith("ellipseg: "):
        return f"not one clear line: {line}"
    return f"left behind: {', '.join(names)}" if names else ""


def _incomplete(out: Path) -> str:
    """What the results of a successful run lack; empty if they are complete."""
    if not out.exists():
        return "no results"
    summary = json.loads((out / "summary.json").read_text("utf-8"))
    missing = [name for name in summary["files"] if not Path(name).exists()]
    return f"{', '.join(missing)} does not exist" if missing else ""
