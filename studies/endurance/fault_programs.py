"""The programs of the package as processes of their own, to be killed, starved and interrupted."""

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

COMMAND = "from ellipseg_ros.cli.main import program as run"
NODE = "from ellipseg_ros.ros.start import {} as run"
LIMIT = 120.0  # s that a program gets to end by itself


@dataclass(frozen=True)
class Ended:
    """How a program ended."""

    code: int
    text: str  # all that it wrote to stderr


def python(code: str) -> list[str]:
    """The words that run a program of ours."""
    return [sys.executable, "-c", code]


def command(*words: str, before: str = "") -> list[str]:
    """The words that start `ellipseg`; before: a line of Python that runs first."""
    return _python(COMMAND, before, words)


def node(name: str, *words: str) -> list[str]:
    """The words that start an executable of the package."""
    return _python(NODE.format(name), "", words)


def _python(imported: str, before: str, words: tuple[str, ...]) -> list[str]:
    lines = ["import sys", before, imported, "sys.exit(run())"]
    return [*python("\n".join(filter(None, lines))), *words]


@contextmanager
def started(
    words: list[str], folder: Path, talks: bool = False
) -> Iterator[subprocess.Popen[bytes]]:
    """A process, killed at the end of the block; its stderr goes to `said` in the folder.

    talks: stdin and stdout are pipes.
    """
    with (folder / "said").open("wb") as said:
        process = subprocess.Popen(
            words,
            cwd=folder,
            stdin=subprocess.PIPE if talks else None,
            stdout=subprocess.PIPE if talks else subprocess.DEVNULL,
            stderr=said,
            start_new_session=True,
        )
    try:
        yield process
    finally:
        process.kill()
        process.communicate()  # closes the pipes, too


def run(words: list[str], folder: Path) -> Ended:
    """Let a program run to its end."""
    with started(words, folder) as process:
        code = process.wait(LIMIT)
    return Ended(code, said(folder))


def said(folder: Path) -> str:
    """What the last program in this folder wrote to stderr."""
    return (folder / "said").read_text("utf-8", "replace")
