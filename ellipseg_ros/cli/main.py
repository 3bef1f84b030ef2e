"""`ellipseg COMMAND`: parse, run, and turn every expected error into one line."""

import os
import signal
import sys
from importlib import import_module
from types import FrameType

from ellipseg_ros.cli.parser import build_parser
from ellipseg_ros.errors import EllipsegError

FAILED = 2  # exit code of every error that is not a bug; argparse uses it too
INTERRUPTED = 128 + signal.SIGINT


def main(argv: list[str] | None = None) -> int:
    """Run one command; returns 0, or 1 (a check failed), 2 (an error), 130 (Ctrl-C)."""
    args = build_parser().parse_args(argv)
    try:
        signal.signal(signal.SIGTERM, _interrupt)  # an ended demo ends its node, too
        command = import_module(f"ellipseg_ros.cli.{args.command}")  # numba, rclpy: only now
        code = int(command.run(args))
        sys.stdout.flush()  # here, where a full disk or a closed pipe can still be told
        return code
    except EllipsegError as error:
        print(f"ellipseg: {error}", file=sys.stderr)
    except ModuleNotFoundError as error:
        if not error.name or error.name.startswith("ellipseg_ros"):
            raise
        package = error.name.partition(".")[0]
        print(f"ellipseg: {args.command} needs the package {package}; install it", file=sys.stderr)
    except BrokenPipeError:  # `ellipseg ... | head`: nobody is left to tell
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except OSError as error:
        print(f"ellipseg: {_one_line(error)}", file=sys.stderr)
    except KeyboardInterrupt:
        print("ellipseg: interrupted", file=sys.stderr)
        return INTERRUPTED
    return FAILED


def _interrupt(signum: int, frame: FrameType | None) -> None:
    raise KeyboardInterrupt


def _one_line(error: OSError) -> str:
    """What the system says, as "file: No space left on device"."""
    reason = error.strerror or str(error)
    return f"{error.filename}: {reason}" if error.filename else reason


if __name__ == "__main__":
    sys.exit(main())
