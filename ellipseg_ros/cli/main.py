"""`ellipseg COMMAND`: parse, run, and turn every expected error into one line."""

import os
import signal
import sys
from contextlib import suppress
from importlib import import_module
from typing import NoReturn

from ellipseg_ros.errors import EllipsegError
from ellipseg_ros.node.shutdown import Farewell

FAILED = 2  # exit code of every error that is not a bug; argparse uses it too
INTERRUPTED = 128 + signal.SIGINT
LAST_WORDS = "ellipseg: interrupted\n"


def program() -> int:
    """The command `ellipseg`: Ctrl-C and SIGTERM end it, from here on, within 2 s."""
    farewell: Farewell | None = None
    try:
        farewell = Farewell(INTERRUPTED, LAST_WORDS, _interrupt)
        return farewell.end(main())
    except BaseException:
        if farewell is None or not farewell.asked:
            raise
        # An import that is interrupted may fail in any way.
        sys.stderr.write(LAST_WORDS)
        return farewell.end(INTERRUPTED)


def main(argv: list[str] | None = None) -> int:
    """Run one command; returns 0, or 1 (a check failed), 2 (an error), 130 (Ctrl-C)."""
    args = None
    try:
        parser = import_module("ellipseg_ros.cli.parser")
        args = parser.build_parser().parse_args(argv)
        command = import_module(f"ellipseg_ros.cli.{args.command}")  # numba, rclpy: only now
        code = int(command.run(args))
        sys.stdout.flush()  # here, where a full disk or a closed pipe can still be told
        return code
    except EllipsegError as error:
        _complain(str(error))
    except ModuleNotFoundError as error:
        if args is None or not error.name or error.name.startswith("ellipseg_ros"):
            raise
        package = error.name.partition(".")[0]
        _complain(f"{args.command} needs the package {package}; install it")
    except BrokenPipeError:  # `ellipseg ... | head`: nobody is left to tell
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except OSError as error:
        _complain(_one_line(error))
    except KeyboardInterrupt:
        sys.stderr.write(LAST_WORDS)
        return INTERRUPTED
    return FAILED


def _complain(text: str) -> None:
    """Say what is wrong, where that is possible: stderr may be on the disk that is full."""
    with suppress(OSError):
        sys.stderr.write(f"ellipseg: {text}\n")
        sys.stderr.flush()


def _interrupt() -> NoReturn:
    raise KeyboardInterrupt


def _one_line(error: OSError) -> str:
    """What the system says, as "file: No space left on device"."""
    reason = error.strerror or str(error)
    return f"{error.filename}: {reason}" if error.filename else reason


if __name__ == "__main__":
    sys.exit(program())
