"""`ellipseg soak`: long and hard trials of the node, and what came of them."""

import json
from argparse import Namespace
from pathlib import Path
from typing import Any

from ellipseg_ros.cli.report import print_results, print_status, progress_steps
from ellipseg_ros.errors import EllipsegError
from ellipseg_ros.io.atomic_files import write_text
from studies.endurance.page import blocks, page
from studies.endurance.promises import Trial
from studies.endurance.subjects import SUBJECTS, soak

NAMES = ("reliability.md", "reliability.json")


def run(args: Namespace) -> int:
    """Try the subjects; returns 1 if a promise was not kept."""
    unknown = sorted(set(args.subjects) - set(SUBJECTS))
    if unknown:
        raise EllipsegError(f"there is no subject {unknown[0]}; there are {', '.join(SUBJECTS)}")
    names = [name for name in SUBJECTS if name in args.subjects or not args.subjects]
    earlier = _earlier(Path(args.output) / NAMES[1]) if args.output else {}
    trial = Trial(args.quick, args.seed, lambda text: print_status(text, args))
    results = {}
    with progress_steps(len(names), "subjects", args) as begin:
        for name in names:
            begin(name)
            results[name] = soak(name, trial)
            if args.output:  # at once: the next one may take a quarter of an hour
                _write(earlier | results, Path(args.output))
    print_results(results, blocks, args)
    kept = [row["kept"] for found in results.values() for row in found["promises"]]
    return 0 if all(kept) else 1


def _earlier(path: Path) -> dict[str, Any]:
    """What an earlier run found of the subjects that are not tried now."""
    if not path.exists():
        return {}
    try:
        return {name: dict(found) for name, found in json.loads(path.read_text("utf-8")).items()}
    except (ValueError, AttributeError, TypeError) as error:
        raise EllipsegError(f"{path} holds no results of `ellipseg soak`; remove it") from error


def _write(results: dict[str, Any], folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    write_text(folder / NAMES[0], page(results))
    write_text(folder / NAMES[1], json.dumps(results, indent=1) + "\n")
