"""`ellipseg bench`: speed, latency and memory, beside what they must be and beside others."""

import json
from argparse import Namespace
from pathlib import Path
from typing import Any

from ellipseg_ros.cli.report import progress, say
from ellipseg_ros.errors import EllipsegError
from ellipseg_ros.io.atomic_files import write_text
from ellipseg_ros.io.sources import open_source
from studies.benchmark.page import blocks, page
from studies.benchmark.picture import draw
from studies.benchmark.sections import SECTIONS, measure
from studies.benchmark.streams import FULL, QUICK

NAMES = ("benchmarks.md", "benchmarks.json", "benchmarks.png")


def run(args: Namespace) -> int:
    """Measure, print and write; returns 0, however slow it was."""
    names = args.only or list(SECTIONS)
    unknown = sorted(set(names) - set(SECTIONS))
    if unknown:
        raise EllipsegError(f"there is no section {unknown[0]}; there are {', '.join(SECTIONS)}")
    if args.data:
        open_source(args.data)  # now, not after minutes, if there is none
    names = [name for name in SECTIONS if name in names and (name != "data" or args.data)]
    say("compiling kernels, which takes longer the first time ...", args)
    with progress(len(names), "sections", args) as bar:

        def begin(name: str) -> None:
            bar.update(name != names[0])  # the one before is done
            bar.set_description(name)
            if bar.disable:  # no terminal: lines instead of a bar
                say(f"{name} ...", args)

        results = measure(names, QUICK if args.quick else FULL, args.data, begin)
    _show(results, args)
    if args.output:
        _write(results, Path(args.output), args)
    return 0


def _show(results: dict[str, Any], args: Namespace) -> None:
    if args.json:
        print(json.dumps(results, indent=2))
    elif not args.quiet:
        print("\n".join(blocks(results)))


def _write(results: dict[str, Any], folder: Path, args: Namespace) -> None:
    """Write page, numbers and picture, over those of an earlier run."""
    folder.mkdir(parents=True, exist_ok=True)
    text, numbers, picture = (folder / name for name in NAMES)
    write_text(text, page(results))
    write_text(numbers, json.dumps(results, indent=2) + "\n")
    draw(results, picture)
    for path in (text, numbers, picture):
        say(f"wrote {path}", args)
