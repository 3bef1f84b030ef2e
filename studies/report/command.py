"""The command line of a study: parser, common options, error messages and exit codes."""

import argparse
import json
import os
import signal
import sys
from argparse import ArgumentParser, Namespace
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from ellipseg_ros.cli.report import say
from ellipseg_ros.errors import EllipsegError
from ellipseg_ros.io.atomic_files import write_text
from studies import STUDIES
from studies.report.page import Page, json_text

FAILED = 2  # exit code of an expected error; argparse uses it too
INTERRUPTED = 128 + signal.SIGINT
SCENES = "woodland, industrial, roadway, mixed"
SOURCES = (
    "a bag (ROS 1 or 2), a cloud (pcd, ply, las, laz, npz) or a simulated scene (sim:industrial)"
)

Draw = Callable[[dict[str, Any], Path], None]


def run_command(
    name: str,
    options: Callable[[ArgumentParser], None],
    run: Callable[[Namespace], int],
    argv: Sequence[str] | None = None,
    examples: str = "",
) -> int:
    """Run the study `name` with the options in `argv`; returns its exit code.

    2: an expected error, reported in one line. 130: interrupted with Ctrl-C.
    """
    measures, duration = STUDIES[name]
    parser = ArgumentParser(
        prog=f"python -m studies.{name}",
        description=f"Measure {measures}. It takes about {duration}.",
        epilog=examples,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    options(parser)
    parser.add_argument("-o", "--output", metavar="DIR", help="folder for the results")
    parser.add_argument("--json", action="store_true", help="print the results as JSON only")
    parser.add_argument("-q", "--quiet", action="store_true", help="print errors only")
    args = parser.parse_args(argv)
    try:
        code = run(args)
        sys.stdout.flush()  # here, where a full disk can still be reported
        return code
    except KeyboardInterrupt:
        return _fail(name, "interrupted", INTERRUPTED)
    except BrokenPipeError:  # `... | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return FAILED
    except (EllipsegError, ModuleNotFoundError, OSError) as error:
        return _fail(name, _one_line(error), FAILED)


def scene_options(parser: ArgumentParser) -> None:
    """Options of sources: topic of a bag, seed and duration of a simulated scene."""
    parser.add_argument("--topic", default="", help="of the clouds, if a bag has several")
    group = parser.add_argument_group("simulated scenes")
    group.add_argument("--seed", type=int, help="of the scene and of its noise")
    group.add_argument("--duration", type=float, metavar="S", help="seconds of driving")


def parameter_options(parser: ArgumentParser) -> None:
    """Options that set any parameter of the node, for `cli.settings.read_settings`."""
    group = parser.add_argument_group("settings", "the node's parameters; the later one wins")
    group.add_argument("--params", metavar="FILE", help="YAML file, as for the node")
    group.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="any parameter, repeatable: --set graph.neighbours=15",
    )
    parser.set_defaults(criterion=None, threshold=None)


def publish(
    results: dict[str, Any],
    page: Callable[[dict[str, Any]], Page],
    args: Namespace,
    draw: Draw | None = None,
) -> None:
    """Print results as JSON or as the tables of their page; with -o, write them, too."""
    if args.json:
        print(json.dumps(results, indent=2))
    elif not args.quiet:
        print(page(results).tables())
    if args.output:
        for path in write(results, page, Path(args.output), draw):
            say(f"wrote {path}", args)


def write(
    results: dict[str, Any],
    page: Callable[[dict[str, Any]], Page],
    folder: Path,
    draw: Draw | None = None,
) -> list[Path]:
    """Write page, numbers and chart over those of an earlier run; returns their paths."""
    folder.mkdir(parents=True, exist_ok=True)
    built = page(results)
    text, numbers, chart = (folder / f"{built.name}.{kind}" for kind in ("md", "json", "png"))
    write_text(text, built.markdown())
    write_text(numbers, json_text(results))
    if draw is None:
        return [text, numbers]
    draw(results, chart)
    return [text, numbers, chart]


def read_results(path: Path, key: str) -> dict[str, Any]:
    """Results that an earlier run wrote; EllipsegError if they have no `key`."""
    try:
        results = dict(json.loads(path.read_text(encoding="utf-8")))
        results[key]
    except (ValueError, KeyError, TypeError) as error:
        raise EllipsegError(f"{path} holds no results of this study") from error
    return results


def _fail(name: str, message: str, code: int) -> int:
    print(f"studies.{name}: {message}", file=sys.stderr, flush=True)
    return code


def _one_line(error: Exception) -> str:
    """Text of an expected error; a missing extra is named, a bug of ours is raised again."""
    if isinstance(error, ModuleNotFoundError):
        package = (error.name or "").partition(".")[0]
        if package in ("", "ellipseg_ros", "studies"):
            raise error
        return f"the package {package} is missing; install it"
    if isinstance(error, OSError) and error.filename:
        return f"{error.filename}: {error.strerror}"
    return str(error)
