"""`python -m studies.endurance`: endurance and fault-injection tests of the node."""

import json
import sys
from argparse import ArgumentParser, Namespace
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ellipseg_ros.cli.main import run_program
from ellipseg_ros.cli.report import print_status
from ellipseg_ros.errors import EllipsegError
from studies.endurance.page import page
from studies.endurance.requirements import Options
from studies.endurance.subjects import SUBJECTS, all_met, run_subject
from studies.report.command import publish, run_command, write
from studies.report.progress import progress_steps

EXAMPLES = """examples:
  python -m studies.endurance                          all subjects, 75 min
  python -m studies.endurance endurance overload --quick
  python -m studies.endurance -o docs/results          write endurance.md and endurance.json

Exit code 1: a requirement is not met. With -o, earlier results of other subjects are kept."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; returns its exit code."""
    return run_command("endurance", _add_options, _run, argv, EXAMPLES)


def _add_options(parser: ArgumentParser) -> None:
    subjects = f"{', '.join(SUBJECTS)} (all)"
    parser.add_argument("subjects", nargs="*", metavar="SUBJECT", help=subjects)
    parser.add_argument("--quick", action="store_true", help="short versions, some minutes")
    parser.add_argument("--seed", type=int, default=0, help="of all random numbers (0)")


def _run(args: Namespace) -> int:
    """Test the subjects; returns 1 if a requirement is not met."""
    unknown = sorted(set(args.subjects) - set(SUBJECTS))
    if unknown:
        raise EllipsegError(f"there is no subject {unknown[0]}; there are {', '.join(SUBJECTS)}")
    names = [name for name in SUBJECTS if name in args.subjects or not args.subjects]
    earlier = _earlier(Path(args.output)) if args.output else {}
    options = Options(args.quick, args.seed, lambda text: print_status(text, args))
    results: dict[str, Any] = {}
    with progress_steps(len(names), "subjects", args) as begin:
        for name in names:
            begin(name)
            results[name] = run_subject(name, options)
            if args.output:  # now, since the next subject may take a quarter of an hour
                write(earlier | results, page, Path(args.output))
    publish(results, page, Namespace(**{**vars(args), "output": None}))  # written already
    return 0 if all(map(all_met, results.values())) else 1


def _earlier(folder: Path) -> dict[str, Any]:
    """Results of an earlier run in the folder, by subject; empty if there is none."""
    path = folder / "endurance.json"
    if not path.exists():
        return {}
    try:
        results = {name: dict(one) for name, one in json.loads(path.read_text("utf-8")).items()}
        page(results).markdown()
    except (ValueError, AttributeError, TypeError, KeyError) as error:
        raise EllipsegError(f"{path} holds no results of studies.endurance; remove it") from error
    return results


if __name__ == "__main__":
    sys.exit(run_program("studies.endurance", main))
