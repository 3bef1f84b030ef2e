"""`ellipseg evaluate`: how good the results are, against truth and beside other methods."""

import json
from argparse import Namespace
from pathlib import Path
from typing import Any

from ellipseg_ros.cli.report import say, show_page, steps
from ellipseg_ros.cli.sources import open_input
from ellipseg_ros.doctor.packages import load
from ellipseg_ros.errors import EllipsegError
from ellipseg_ros.io.atomic_files import write_text
from ellipseg_ros.io.sources import SIMULATED
from studies.landmarks.__main__ import association
from studies.partition.page import blocks, page
from studies.partition.picture import draw, draw_scene
from studies.partition.reading import read_scan
from studies.partition.scale_command import scale
from studies.partition.scan import SEARCH, Scan
from studies.partition.study import Plan, chosen, study

NAMES = ("quality.md", "quality.json", "quality.png")


def run(args: Namespace) -> int:
    """Do what `args.subject` names; returns 0, however good it was."""
    return {"partition": partition, "scale": scale, "association": association}[args.subject](args)


def partition(args: Namespace) -> int:
    """Segments against classes and things, beside cut-pursuit and others."""
    if why := load("scipy", SEARCH)[1]:
        raise EllipsegError(f"evaluate needs scipy, which is {why}")
    methods = chosen(args.methods or [])
    if min(args.counts) < 1:
        raise EllipsegError(f"--counts has {min(args.counts)}; it must be 1 or more")
    if args.limit <= 0.0:
        raise EllipsegError(f"--limit is {args.limit:g}; it must be more than 0 s")
    counts = tuple(sorted(set(args.counts)))
    plan = Plan(counts, args.limit, earlier(args.add_to, counts) if args.add_to else {})
    scans = [read(spec, args) for spec in args.sources]
    with steps(len(scans) * len(methods), "runs", args) as begin:
        results = study(scans, methods, plan, begin)
    show_page(results, blocks, args)
    if args.output:
        write(results, Path(args.output), args)
    return 0


def read(spec: str, args: Namespace) -> Scan:
    """A cloud with truth; --seed and --duration are for those that are simulated."""
    return read_scan(open_input(spec, args), spec)


def earlier(path: str, counts: tuple[int, ...]) -> dict[str, Any]:
    """Results that an earlier run wrote, for the same numbers of segments."""
    try:
        found = json.loads(Path(path).read_text(encoding="utf-8"))
        there = tuple(found["counts"])
    except (ValueError, KeyError, TypeError) as error:
        raise EllipsegError(f"{path} holds no results; it must be a quality.json") from error
    if there != counts:
        raise EllipsegError(f"{path} is of --counts {' '.join(map(str, there))}; give the same")
    return dict(found)


def write(results: dict[str, Any], folder: Path, args: Namespace) -> None:
    """Write page, numbers and picture, over those of an earlier run."""
    folder.mkdir(parents=True, exist_ok=True)
    for spec in (spec for spec in args.sources if spec.startswith(SIMULATED)):
        say(f"drawing {spec} ...", args)  # of recorded scans, pictures may not be ours to show
        source = open_input(spec, args)
        row = next(row for row in results["scans"] if row["name"] == source.name)
        row["picture"] = f"quality_{source.name}.png"
        draw_scene(source, folder / row["picture"])
    text, numbers, picture = (folder / name for name in NAMES)
    write_text(text, page(results))
    write_text(numbers, row_by_row(results))
    draw(results, picture)
    for path in (text, numbers, picture):
        say(f"wrote {path}", args)


def row_by_row(results: dict[str, Any]) -> str:
    """JSON with a line for each cell and each cloud: hundreds of lines, not tens of thousands."""
    text = json.dumps(results)
    for start in ('{"method": ', '{"name": ', '{"title": ', '"scans": '):
        text = text.replace(start, f"\n{start}")
    return f"{text}\n"
