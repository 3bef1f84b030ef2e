"""The command line of a study: parser, common options, and what is done with results."""

import json
from argparse import ArgumentParser, Namespace
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

from ellipseg_ros.cli.main import run_guarded
from ellipseg_ros.cli.options import add_report_options, new_parser
from ellipseg_ros.cli.report import print_results, print_status
from ellipseg_ros.errors import EllipsegError
from ellipseg_ros.io.atomic_files import write_text
from studies import STUDIES
from studies.report.page import Page, json_text

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
    about = f"{measures[0].upper()}{measures[1:]}; a full run takes about {duration}."
    parser = new_parser(f"python -m studies.{name}", about, examples)
    options(parser)
    parser.add_argument("-o", "--output", metavar="DIR", help="folder for the results")
    add_report_options(parser)
    return run_guarded(f"studies.{name}", lambda: run(parser.parse_args(argv)))


def publish(
    results: dict[str, Any],
    page: Callable[[dict[str, Any]], Page],
    args: Namespace,
    draw: Draw | None = None,
) -> None:
    """Print results as JSON or as the tables of their page; with -o, write them, too."""
    print_results(results, [page(results).tables()], args)
    if args.output:
        for path in write(results, page, Path(args.output), draw):
            print_status(f"wrote {path}", args)


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


def check_names(names: Sequence[str], known: Iterable[str], kind: str) -> None:
    """Raise EllipsegError if `known` lacks one of `names`."""
    unknown = sorted(set(names) - set(known))
    if unknown:
        raise EllipsegError(f"there is no {kind} {unknown[0]}; there are {', '.join(known)}")
