"""Files of a program that is killed, or whose disk is full: whole, or not there."""

import csv
import json
import random
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from xml.etree import ElementTree  # of files that we wrote

import yaml
from PIL import Image

from ellipseg_ros.cli.results import prepare
from ellipseg_ros.errors import EllipsegError
from ellipseg_ros.io.bag import BagSweeps, read_messages
from ellipseg_ros.io.cloud_file import read_fields
from ellipseg_ros.io.topics import BAG_TOPICS
from studies.endurance.fault_programs import command, run, said, started
from studies.endurance.promises import Promise, Trial

SCENE = ("sim:industrial", "--duration", "40", "-q", "--no-pictures", "-o", "out")
SHORT = ("sim:industrial", "--duration", "5", "-o", "out")
PATIENCE = 90.0  # s until the first update: kernels may have to be compiled first
TOLD = """import ellipseg_ros.io.bag as bag
write = bag.BagSink.write_update
bag.BagSink.write_update = lambda sink, found: (
    write(sink, found), sys.stderr.write(f'{found.sequence}\\n'), sys.stderr.flush()
)"""  # each update, when the bag has it
FULL = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, ({0}, {0}))"
WRITERS = {  # the folder comes last
    "segment": ("segment", *SHORT),
    "segment --no-bag": ("segment", "--no-bag", *SHORT),
    "simulate": ("simulate", "industrial", *SHORT[1:]),
    "tune": ("tune", "--count", "4", "--jobs", "1", *SHORT),
}


# --- killed ----------------------------------------------------------------------------------


def killed_writers(trial: Trial) -> Promise:
    """`ellipseg segment`, killed at random moments: what is in its bag then."""
    rng = random.Random(trial.seed)
    problems: list[str] = []
    kills = 1 if trial.quick else 15
    updates = []
    for number in range(kills):
        trial.say(f"kills: `ellipseg segment`, {number + 1} of {kills}")
        with _folder() as folder:
            count, problem = _kill_segment(folder, rng.uniform(0.0, 2.0))
            updates.append(count)
            problems += [problem] if problem else []
    return Promise(
        "a bag is readable up to the last update when `ellipseg segment` is killed",
        f"kill -9 at {kills} random moments; the bag read with rosbags, and its folder taken by "
        "the next run",
        f"{kills - len(problems)} of {kills} readable, {min(updates)} to {max(updates)} updates "
        f"in them{_first(problems)}",
        not problems,
    )


def _kill_segment(folder: Path, after: float) -> tuple[int, str]:
    """Kill it so many s after its first update; updates in its bag, and what is wrong."""
    with started(command("segment", *SCENE, before=TOLD), folder) as process:
        _until(lambda: bool(said(folder)) or process.poll() is not None)
        time.sleep(after)
        early = process.poll()
        process.kill()
        process.wait()
    told = len(said(folder).splitlines())
    if early:
        return told, f"it ended before, with {early}: {said(folder)[-200:]}"
    return _look(folder, told)


def _look(folder: Path, told: int) -> tuple[int, str]:
    try:
        bag = folder / "out" / "bag"
        numbers = [message.sequence for _, message in read_messages(bag, "/segments")]
        counts = {topic: sum(1 for _ in read_messages(bag, topic)) for topic in BAG_TOPICS}
        prepare(folder / "out", "sim:industrial")  # as the next run does
    except EllipsegError as error:
        return 0, str(error)
    del counts["/points"]
    if numbers != list(range(len(numbers))) or set(counts.values()) != {len(numbers)}:
        return len(numbers), f"the bag has updates {numbers}, messages {counts}"
    if len(numbers) < told:
        return len(numbers), f"{told} updates were written, {len(numbers)} are there"
    return len(numbers), ""


# --- a full disk -----------------------------------------------------------------------------


def full_disks(trial: Trial) -> Promise:
    """Every command that writes, where a file can't grow beyond a random size."""
    rng = random.Random(trial.seed)
    problems: list[str] = []
    refused = tried = 0
    for name in ("segment", "simulate") if trial.quick else WRITERS:
        sizes = [round(10 ** rng.uniform(2.5, 6.0)) for _ in range(12)]
        for size in sizes[:1] if trial.quick else [300, *sizes]:
            trial.say(f"disks: `ellipseg {name}`, full after {size:,} bytes")
            tried += 1
            code, problem = _starve(name, size)
            refused += code == 2
            problems += [problem] if problem else []
    return Promise(
        "a full disk is told in one line, exit code 2, and no file is left by half",
        f"{tried} runs of commands that write, files limited to 300 to 1,000,000 bytes; every "
        "file left is read",
        f"{refused} refused in one line, {tried - refused} had enough{_first(problems)}",
        not problems and refused > 0,
    )


def _starve(name: str, size: int) -> tuple[int, str]:
    with _folder() as folder:
        ended = run(command(*WRITERS[name], before=FULL.format(size)), folder)
        lines = _complaints(ended.text)
        where = f"{name}, {size} bytes"
        if ended.code not in (0, 2) or "Traceback" in ended.text:
            return ended.code, f"{where}: exit code {ended.code}: {ended.text[-300:]}"
        # stderr is a file here, and has no more room than the others
        if ended.code and len(lines) != 1 and len(ended.text) < size:
            return ended.code, f"{where}: {len(lines)} lines: {ended.text[-300:]}"
        return ended.code, _damaged(folder / "out")


def _damaged(folder: Path) -> str:
    """The first file that can't be read; empty if all can."""
    for path in sorted(path for path in folder.rglob("*") if path.is_file()):
        if path.suffix not in READERS:
            return f"{path.name} is left"
        try:
            READERS[path.suffix](path)
        except Exception as error:  # of whatever library
            return f"{path.name} is left by half: {error}"
    return ""


def _read_table(path: Path) -> None:
    text = path.read_text("utf-8")
    widths = {len(row) for row in csv.reader(text.splitlines())}
    if len(widths) != 1 or not text.endswith("\n"):
        raise ValueError(f"rows of {sorted(widths)} columns")


def _read_bag(path: Path) -> None:
    for _ in BagSweeps(path.parent, "/points"):
        pass


def _read_picture(path: Path) -> None:
    with Image.open(path) as picture:
        picture.load()


READERS: dict[str, Callable[[Path], object]] = {
    ".mcap": _read_bag,
    ".npz": read_fields,
    ".ply": read_fields,
    ".png": _read_picture,
    ".svg": ElementTree.parse,
    ".csv": _read_table,
    ".yaml": lambda path: yaml.safe_load(path.read_text("utf-8")),
    ".json": lambda path: json.loads(path.read_text("utf-8")),
}


def forbidden_places(trial: Trial) -> Promise:
    """Every command that writes, where nobody may write: below /proc, and below a file."""
    problems = []
    with _folder() as folder:
        (folder / "file").touch()
        places = ["/proc/nobody/out", "file/out"]
        names = ["simulate"] if trial.quick else list(WRITERS)
        for name in names:
            for place in places:
                ended = run(command(*WRITERS[name][:-1], place), folder)
                if ended.code != 2 or len(_complaints(ended.text)) != 1:
                    problems.append(f"{name} -o {place}: {ended.code}: {ended.text[-300:]}")
    tried = len(places) * len(names)
    return Promise(
        "where one may not write is told in one line, exit code 2",
        f"{tried} runs that are to write below /proc and below a file",
        f"{tried - len(problems)} of {tried}{_first(problems)}",
        not problems,
    )


def _complaints(text: str) -> list[str]:
    return [] if "Traceback" in text else [t for t in text.splitlines() if t[:9] == "ellipseg:"]


# --- for both --------------------------------------------------------------------------------


def _first(problems: list[str]) -> str:
    return f"; {problems[0]}" if problems else ""


@contextmanager
def _folder() -> Iterator[Path]:
    path = Path(tempfile.mkdtemp(prefix="ellipseg_faults_"))
    try:
        yield path
    finally:
        shutil.rmtree(path, ignore_errors=True)


def _until(done: Callable[[], bool]) -> None:
    end = time.monotonic() + PATIENCE
    while not done():
        if time.monotonic() > end:
            raise EllipsegError(f"nothing happened within {PATIENCE:g} s")
        time.sleep(0.01)
