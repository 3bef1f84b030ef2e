"""SIGINT and SIGTERM at random moments: how the programs end."""

import random
import signal
import subprocess
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from ellipseg_ros.cli.isolation import isolated_ros_args
from studies.endurance.fault_programs import command, node, python, said, started
from studies.endurance.promises import Promise, Trial

LIMIT = 2.0  # s from the signal to the end
SCENE = "sim:industrial"
BEGUN = 0.2  # s: Python itself starts; a signal then ends it in Python's own way
HANDLED = """import sys, time
from ellipseg_ros.node.shutdown import ShutdownHandler
shutdown = ShutdownHandler(0)
print(time.monotonic())"""


@dataclass(frozen=True)
class Program:
    """A program, how long its moments last, and how it must end."""

    words: list[str]
    span: float  # s from its start that signals come in
    code: int


@dataclass(frozen=True)
class Ending:
    """How one ended."""

    what: str
    seconds: float  # after the signal
    problem: str  # empty if all was well, but perhaps late
    before: bool = False  # it had ended before the signal


def signals(trial: Trial) -> list[Promise]:
    """Each program a number of times, one or two signals at a random moment."""
    rng = random.Random(trial.seed)
    with isolated_ros_args() as ros_args, tempfile.TemporaryDirectory() as folder:
        programs = _programs(ros_args)
        names = ["segmenter", "segment"] if trial.quick else list(programs)
        times = 2 if trial.quick else 12
        endings = []
        for name in names:
            trial.say(f"signals: to {name}")
            endings += [_interrupt(name, programs[name], Path(folder), rng) for _ in range(times)]
        start = _handled_after(5)
    bad = [f"{one.what}: {one.problem}" for one in endings if one.problem]
    late = [f"{one.what}: after {one.seconds:.2f} s" for one in endings if one.seconds > LIMIT]
    failed = sum(bool(one.problem) or one.seconds > LIMIT for one in endings)
    longest = max(one.seconds for one in endings)
    before = sum(one.before for one in endings)
    return [
        Promise(
            "SIGINT and SIGTERM end every program within 2 s, without a traceback",
            f"{times} times {', '.join(names)}: one or two signals at a random moment from "
            f"{BEGUN:g} s after the start on: imports, kernels, updates, writing",
            f"{len(endings) - failed} of {len(endings)}, after {longest:.2f} s at most; {before} "
            f"had ended before the signal; Python itself needs {1e3 * start:.0f} ms until our "
            "handlers are there, during which it ends in its own way"
            + "".join(f"; {text}" for text in (bad + late)[:1]),
            not bad and before < len(endings) / 2,
            not late,
        )
    ]


def _programs(ros_args: list[str]) -> dict[str, Program]:
    play = [*ros_args, "-p", f"source:={SCENE}", "-p", "wait:=false"]
    out = ["-o", "out", "--duration", "30"]
    return {
        "segmenter": Program(node("segmenter", *ros_args), 6.0, 0),
        "associator": Program(node("associator", *ros_args), 5.0, 0),
        "replayer": Program(node("replayer", *play), 5.0, 0),
        "segment": Program(command("segment", SCENE, *out), 8.0, 130),
        "simulate": Program(command("simulate", "industrial", *out), 3.0, 130),
        "tune": Program(command("tune", SCENE, *out, "--jobs", "2"), 10.0, 130),
        "demo": Program(command("demo", "--data", SCENE, *out), 12.0, 130),
        "replay": Program(command("replay", SCENE, "--duration", "30"), 5.0, 130),
    }


def _interrupt(name: str, program: Program, folder: Path, rng: random.Random) -> Ending:
    number = rng.choice([signal.SIGINT, signal.SIGTERM])
    moment = rng.uniform(BEGUN, program.span)
    what = f"{name}, {number.name} after {moment:.3f} s"
    with tempfile.TemporaryDirectory(dir=folder) as place:
        own = Path(place)
        with started(program.words, own) as process:
            time.sleep(moment)
            before = process.poll() is not None
            told = time.monotonic()
            process.send_signal(number)
            if rng.random() < 0.3:
                time.sleep(rng.uniform(0.0, 0.2))
                process.send_signal(number)
            try:
                code = process.wait(10.0 * LIMIT)
            except subprocess.TimeoutExpired:
                return Ending(what, 10.0 * LIMIT, "it didn't end")
            seconds = time.monotonic() - told
        return Ending(what, seconds, _problem(program, code, seconds, said(own)), before)


def _problem(program: Program, code: int, seconds: float, text: str) -> str:
    if "Traceback" in text or "Exception" in text:
        return f"a traceback: {text[-300:]}"
    if code == 0 and program.code and not text.count("interrupted"):
        # Its work was done when the signal came, or it has ignored the signal.
        return "" if seconds <= LIMIT else f"it worked on for {seconds:.2f} s"
    if code != program.code:
        return f"exit code {code}, not {program.code}"
    last = "ellipseg: interrupted"
    if program.code and text.count(last) != 1:
        return f"it says {text[-200:]!r}, not once {last!r}"
    return ""


def _handled_after(times: int) -> float:
    """Time from the start of a process to our handlers, the median of so many, s."""
    took = []
    for _ in range(times):
        started_at = time.monotonic()
        done = subprocess.run(python(HANDLED), stdout=subprocess.PIPE, text=True, check=True)
        took.append(float(done.stdout) - started_at)
    return sorted(took)[times // 2]
