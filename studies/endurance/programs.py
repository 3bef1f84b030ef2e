"""Programs of the package and of the studies as processes that can be killed and interrupted."""

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

CHECKOUT = Path(__file__).resolve().parents[2]  # the folder of the package `studies`
COMMAND = "from ellipseg_ros.cli.main import program as run"
EXECUTABLE = "from ellipseg_ros.ros.start import {} as run"
RUN_TIMEOUT_S = 120.0
STDERR = "stderr.txt"


@dataclass(frozen=True)
class Ended:
    """Exit code of a program, and all that it wrote to stderr."""

    code: int
    stderr: str


def checkout_environment(**changes: str) -> dict[str, str]:
    """Environment for a process that imports `studies`, with the checkout on PYTHONPATH."""
    paths = [str(CHECKOUT), os.environ.get("PYTHONPATH", "")]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, paths)), **changes}


def python(code: str) -> list[str]:
    """Command line of a program given as Python source."""
    return [sys.executable, "-c", code]


def command(*words: str, before: str = "") -> list[str]:
    """Command line of `ellipseg`; before: Python source that runs first."""
    return _main(COMMAND, before, words)


def node(name: str, *words: str) -> list[str]:
    """Command line of a ROS executable of the package."""
    return _main(EXECUTABLE.format(name), "", words)


def _main(imported: str, before: str, words: tuple[str, ...]) -> list[str]:
    lines = ["import sys", before, imported, "sys.exit(run())"]
    return [*python("\n".join(filter(None, lines))), *words]


@contextmanager
def started(
    words: list[str], folder: Path, pipes: bool = False
) -> Iterator[subprocess.Popen[bytes]]:
    """A process in `folder`, killed at the end of the block; see `stderr_text`.

    pipes: stdin and stdout are pipes, not inherited and discarded.
    """
    with (folder / STDERR).open("wb") as stderr:
        process = subprocess.Popen(
            words,
            cwd=folder,
            env=checkout_environment(),
            stdin=subprocess.PIPE if pipes else None,
            stdout=subprocess.PIPE if pipes else subprocess.DEVNULL,
            stderr=stderr,
            start_new_session=True,
        )
    try:
        yield process
    finally:
        process.kill()
        process.communicate()  # closes the pipes, too


def run(words: list[str], folder: Path) -> Ended:
    """Run a program in `folder` to its end."""
    with started(words, folder) as process:
        code = process.wait(RUN_TIMEOUT_S)
    return Ended(code, stderr_text(folder))


def stderr_text(folder: Path) -> str:
    """Stderr of the last program that was started in `folder`."""
    return (folder / STDERR).read_text("utf-8", "replace")
