"""Subject `signals`: SIGINT and SIGTERM to all programs at random moments."""

import random
import signal
import subprocess
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from studies.endurance.programs import command, node, python, started, stderr_text
from studies.endurance.requirements import Options, Requirement, first_of
from studies.report.isolated_nodes import isolated_ros_args

SHUTDOWN_LIMIT_S = 2.0  # from the signal to the end
KILL_AFTER_S = 10.0 * SHUTDOWN_LIMIT_S
SCENE = "sim:industrial"
EARLIEST_S = 0.2  # after the start: until then Python itself starts, and ends in its own way
INTERRUPTED = "ellipseg: interrupted"
INSTALL_HANDLERS = """import sys, time
from ellipseg_ros.node.shutdown import ShutdownHandler
shutdown = ShutdownHandler(0)
print(time.monotonic())"""


@dataclass(frozen=True)
class Program:
    """A program, the time in which signals are sent to it, and its exit code after one."""

    words: list[str]
    span_s: float  # from its start
    code: int


@dataclass(frozen=True)
class Ending:
    """How a program ended."""

    signal: str  # name of the program, signal and moment
    seconds: float  # after the signal
    problem: str  # empty if there is none, except perhaps a late end
    ended_before: bool = False  # the signal


Interrupt = Callable[[str, Program, Path, random.Random], Ending]


def programs(ros_args: list[str]) -> dict[str, Program]:
    """All programs of the package, by name."""
    replay = [*ros_args, "-p", f"source:={SCENE}", "-p", "wait:=false"]
    out = ["-o", "out", "--duration", "30"]
    return {
        "segmenter": Program(node("segmenter", *ros_args), 6.0, 0),
        "associator": Program(node("associator", *ros_args), 5.0, 0),
        "replayer": Program(node("replayer", *replay), 5.0, 0),
        "segment": Program(command("segment", SCENE, *out), 8.0, 130),
        "simulate": Program(command("simulate", "industrial", *out), 3.0, 130),
        "tune": Program(command("tune", SCENE, *out, "--jobs", "2"), 10.0, 130),
        "demo": Program(command("demo", "--data", SCENE, *out), 12.0, 130),
        "replay": Program(command("replay", SCENE, "--duration", "30"), 5.0, 130),
    }


def interrupt(name: str, program: Program, folder: Path, rng: random.Random) -> Ending:
    """Start a program and send it one or two signals at a random moment."""
    number = rng.choice([signal.SIGINT, signal.SIGTERM])
    moment = rng.uniform(EARLIEST_S, program.span_s)
    what = f"{name}, {number.name} after {moment:.3f} s"
    with tempfile.TemporaryDirectory(dir=folder) as place:
        own = Path(place)
        with started(program.words, own) as process:
            time.sleep(moment)
            ended_before = process.poll() is not None
            sent = time.monotonic()
            process.send_signal(number)
            if rng.random() < 0.3:
                time.sleep(rng.uniform(0.0, 0.2))
                process.send_signal(number)
            try:
                code = process.wait(KILL_AFTER_S)
            except subprocess.TimeoutExpired:
                return Ending(what, KILL_AFTER_S, "it did not end")
            seconds = time.monotonic() - sent
        return Ending(
            what, seconds, problem(program, code, seconds, stderr_text(own)), ended_before
        )


def signals(options: Options, interrupted: Interrupt = interrupt) -> list[Requirement]:
    """Interrupt each program several times."""
    rng = random.Random(options.seed)
    with isolated_ros_args() as ros_args, tempfile.TemporaryDirectory() as folder:
        known = programs(ros_args)
        names = ["segmenter", "segment"] if options.quick else list(known)
        times = 2 if options.quick else 12
        endings = []
        for name in names:
            options.log(f"signals: to {name}")
            endings += [interrupted(name, known[name], Path(folder), rng) for _ in range(times)]
        start_s = _handler_delay(5)
    failed = [f"{e.signal}: {e.problem}" for e in endings if e.problem]
    late = [f"{e.signal}: after {e.seconds:.2f} s" for e in endings if _is_late(e)]
    good = sum(not e.problem and not _is_late(e) for e in endings)
    ended_before = sum(ending.ended_before for ending in endings)
    return [
        Requirement(
            f"SIGINT and SIGTERM end every program within {SHUTDOWN_LIMIT_S:g} s, without a "
            "traceback",
            f"{times} times {', '.join(names)}: one or two signals at a random moment from "
            f"{EARLIEST_S:g} s after the start: imports, compilation, updates, output",
            f"{good} of {len(endings)}, after at most {max(e.seconds for e in endings):.2f} s; "
            f"{ended_before} had ended before the signal; Python needs {1e3 * start_s:.0f} ms "
            "until the signal handlers are installed, and until then ends in its own way"
            f"{first_of(failed + late)}",
            not failed and ended_before < len(endings) / 2,
            not late,
        )
    ]


def _is_late(ending: Ending) -> bool:
    return ending.seconds > SHUTDOWN_LIMIT_S


def problem(program: Program, code: int, seconds: float, stderr: str) -> str:
    """Description of a wrong end; empty if it is right, except perhaps late."""
    if "Traceback" in stderr or "Exception" in stderr:
        return f"a traceback: {stderr[-300:]}"
    if code == 0 and program.code and not stderr.count("interrupted"):
        # It had finished when the signal came, or ignored it.
        return "" if seconds <= SHUTDOWN_LIMIT_S else f"it continued for {seconds:.2f} s"
    if code != program.code:
        return f"exit code {code}, not {program.code}"
    if program.code and stderr.count(INTERRUPTED) != 1:
        return f"stderr is {stderr[-200:]!r}, without exactly one {INTERRUPTED!r}"
    return ""


def _handler_delay(times: int) -> float:
    """Median time from the start of a process until the signal handlers are installed, s."""
    seconds = []
    for _ in range(times):
        started_at = time.monotonic()
        words = python(INSTALL_HANDLERS)
        ended = subprocess.run(words, stdout=subprocess.PIPE, text=True, check=True)
        seconds.append(float(ended.stdout) - started_at)
    return sorted(seconds)[times // 2]
