"""Subject `disks`: commands whose disk is full, or who may not write."""

import csv
import json
import random
import tempfile
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree  # of files that this package wrote

import yaml
from PIL import Image

from ellipseg_ros.io.bag import BagSweeps
from ellipseg_ros.io.cloud_file import read_fields
from studies.endurance.programs import command, run
from studies.endurance.requirements import Options, Requirement, first_of

SHORT = ("sim:industrial", "--duration", "5", "-o", "out")
LIMIT_FILE_SIZE = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, ({0}, {0}))"
WRITERS = {  # commands that write; the last word is the folder
    "segment": ("segment", *SHORT),
    "segment --no-bag": ("segment", "--no-bag", *SHORT),
    "simulate": ("simulate", "industrial", *SHORT[1:]),
    "tune": ("tune", "--count", "4", "--jobs", "1", *SHORT),
}


def disks(options: Options) -> list[Requirement]:
    """Run commands that cannot write, or not enough."""
    return [*full_disks(options), *forbidden_folders(options)]


def full_disks(options: Options) -> list[Requirement]:
    """Run every command that writes with a random limit on file sizes."""
    rng = random.Random(options.seed)
    problems: list[str] = []
    refused = runs = 0
    for name in ("segment", "simulate") if options.quick else WRITERS:
        sizes = [round(10 ** rng.uniform(2.5, 6.0)) for _ in range(12)]
        for size in sizes[:1] if options.quick else [300, *sizes]:
            options.log(f"disks: `ellipseg {name}`, full after {size:,} bytes")
            code, problem = _run_with_full_disk(name, size)
            runs += 1
            refused += code == 2
            problems += [problem] if problem else []
    return [
        Requirement(
            "a full disk is reported in one line with exit code 2, and no partial file remains",
            f"{runs} runs of commands that write, files limited to 300 to 1,000,000 bytes; every "
            "remaining file is read",
            f"{refused} refused in one line, {runs - refused} had enough space"
            f"{first_of(problems)}",
            not problems and refused > 0,
        )
    ]


def _run_with_full_disk(name: str, size: int) -> tuple[int, str]:
    """Exit code of a command with this limit on file sizes, and a problem or an empty text."""
    with tempfile.TemporaryDirectory() as folder:
        ended = run(command(*WRITERS[name], before=LIMIT_FILE_SIZE.format(size)), Path(folder))
        lines = _messages(ended.stderr)
        if ended.code not in (0, 2) or "Traceback" in ended.stderr:
            problem = f"exit code {ended.code}: {ended.stderr[-300:]}"
        # Stderr is a file, too, and has no more space than the others.
        elif ended.code and len(lines) != 1 and len(ended.stderr) < size:
            problem = f"{len(lines)} lines: {ended.stderr[-300:]}"
        else:
            problem = _unreadable(Path(folder) / "out")
    return ended.code, f"{name}, {size} bytes: {problem}" if problem else ""


def _unreadable(folder: Path) -> str:
    """The first file that cannot be read; empty if all can."""
    for path in sorted(path for path in folder.rglob("*") if path.is_file()):
        if path.suffix not in READERS:
            return f"{path.name} remains"
        try:
            READERS[path.suffix](path)
        except Exception as error:  # of any library
            return f"{path.name} is partial: {error}"
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


def forbidden_folders(options: Options) -> list[Requirement]:
    """Run every command that writes below /proc and below a file, where nothing can be written."""
    problems = []
    places = ("/proc/missing/out", "file/out")
    names = ["simulate"] if options.quick else list(WRITERS)
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "file").touch()
        for name in names:
            for place in places:
                ended = run(command(*WRITERS[name][:-1], place), Path(folder))
                if ended.code != 2 or len(_messages(ended.stderr)) != 1:
                    problem = f"{ended.code}: {ended.stderr[-300:]}"
                    problems.append(f"{name} -o {place}: {problem}")
    runs = len(places) * len(names)
    return [
        Requirement(
            "a folder that cannot be written is reported in one line with exit code 2",
            f"{runs} runs with output below /proc and below a file",
            f"{runs - len(problems)} of {runs}{first_of(problems)}",
            not problems,
        )
    ]


def _messages(stderr: str) -> list[str]:
    """Error messages of `ellipseg`; none if there is a traceback."""
    if "Traceback" in stderr:
        return []
    return [line for line in stderr.splitlines() if line.startswith("ellipseg:")]
