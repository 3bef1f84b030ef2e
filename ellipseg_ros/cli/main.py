"""`ellipseg COMMAND`: parse, run, and report every expected error in one line."""

import os
import signal
import sys
from collections.abc import Callable
from contextlib import suppress
from importlib import import_module
from typing import NoReturn

from ellipseg_ros.errors import EllipsegError, missing_package
from ellipseg_ros.node.shutdown import ShutdownHandler

FAILED = 2  # exit code of every error that is not a bug; argparse uses it too
INTERRUPTED = 128 + signal.SIGINT


def program() -> int:
    """The command `ellipseg`, as installed; returns the exit code."""
    return run_program("ellipseg", _run)


def run_program(name: str, run: Callable[[], int]) -> int:
    """`run_guarded` for a whole process, which Ctrl-C or SIGTERM then ends within 2 s."""
    interrupted = f"{name}: interrupted\n"
    shutdown: ShutdownHandler | None = None
    try:
        shutdown = ShutdownHandler(INTERRUPTED, interrupted, _interrupt)
        return shutdown.finish(run_guarded(name, run))
    except BaseException:
        if shutdown is None or not shutdown.requested:
            raise
        # An import that is interrupted may fail in any way.
        sys.stderr.write(interrupted)
        return shutdown.finish(INTERRUPTED)


def main(argv: list[str] | None = None) -> int:
    """Run one command; returns 0, or 1 (a check failed), 2 (an error), 130 (Ctrl-C)."""
    return run_guarded("ellipseg", lambda: _run(argv))


def run_guarded(name: str, run: Callable[[], int]) -> int:
    """Call `run` and return its exit code; an expected error becomes a line of program `name`.

    Expected are EllipsegError, OSError, and a missing package: code 2; and Ctrl-C: code 130.
    """
    try:
        code = run()
        sys.stdout.flush()  # here, where a full disk or a closed pipe can still be reported
        return code
    except EllipsegError as error:
        _report(name, str(error))
    except ModuleNotFoundError as error:
        if not error.name or error.name.startswith("ellipseg_ros"):
            raise
        _report(name, f"this {missing_package(error)}")
    except BrokenPipeError:  # `ellipseg ... | head`: nothing can be written any more
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except OSError as error:
        reason = error.strerror or str(error)  # as "file: No space left on device"
        _report(name, f"{error.filename}: {reason}" if error.filename else reason)
    except KeyboardInterrupt:
        sys.stderr.write(f"{name}: interrupted\n")
        return INTERRUPTED
    return FAILED


def _run(argv: list[str] | None = None) -> int:
    """Parse, and run the module that is named like the command: it imports numba or rclpy."""
    parser = import_module("ellipseg_ros.cli.parser")
    args = parser.build_parser().parse_args(argv)
    return int(import_module(f"ellipseg_ros.cli.{args.command}").run(args))


def _report(name: str, text: str) -> None:
    """Write an error where that is possible: stderr may be on the disk that is full."""
    with suppress(OSError):
        sys.stderr.write(f"{name}: {text}\n")
        sys.stderr.flush()


def _interrupt() -> NoReturn:
    raise KeyboardInterrupt


if __name__ == "__main__":
    sys.exit(program())
