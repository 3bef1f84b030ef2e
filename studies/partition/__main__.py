"""`python -m studies.partition`: quality of segments and objects, beside other methods."""

import sys
from argparse import ArgumentParser, Namespace
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ellipseg_ros.cli.main import run_program
from ellipseg_ros.cli.options import SOURCES, add_source_options
from ellipseg_ros.cli.report import print_status
from ellipseg_ros.cli.sources import open_input
from ellipseg_ros.errors import EllipsegError
from ellipseg_ros.io.sources import SIMULATED
from studies.partition.chart import draw, draw_scene
from studies.partition.page import page
from studies.partition.study import Plan, chosen, study
from studies.partition.truth import read_scan
from studies.report.command import publish, read_results, run_command
from studies.report.progress import progress_steps

EXAMPLES = """examples:
  python -m studies.partition sim:roadway --methods objects cut-pursuit
  python -m studies.partition scan_1.npz scan_2.npz sim:woodland -o quality
  python -m studies.partition scan_3.npz --add-to quality/partition.json -o quality

A scan is any source whose points have a class: a field `class` or `coarse` of 1 ground,
2 vegetation, 3 trunk or pole, 4 wire, 5 wall or fence, 6 vehicle, 7 person, 8 other, 0 unknown;
perhaps a field `instance`, too. The other methods need
  pip install cut-pursuit-py pgeof open3d-cpu hdbscan"""
SIMULATIONS = [f"{SIMULATED}{name}" for name in ("woodland", "industrial", "roadway", "mixed")]


def main(argv: Sequence[str] | None = None) -> int:
    """Run the study; returns 0, whatever the scores are."""
    return run_command("partition", _options, _run, argv, EXAMPLES)


def _options(parser: ArgumentParser) -> None:
    scans = f"{SOURCES}; default: all simulated scenes"
    parser.add_argument("sources", nargs="*", metavar="SCAN", default=SIMULATIONS, help=scans)
    add_source_options(parser)
    parser.add_argument(
        "--methods",
        nargs="+",
        metavar="NAME",
        default=[],
        help="only these, by the beginning of the name: objects, ellipsoids, cut-pursuit, Open3D, "
        "HDBSCAN",
    )
    parser.add_argument(
        "--counts",
        nargs="+",
        type=int,
        default=[100, 250, 1000, 2500],
        metavar="N",
        help="target numbers of segments (100 250 1000 2500)",
    )
    parser.add_argument(
        "--limit", type=float, default=900.0, metavar="S", help="time of a method on a scan (900)"
    )
    parser.add_argument(
        "--add-to",
        metavar="JSON",
        help="results of an earlier run, which are kept where they are not measured again",
    )


def _run(args: Namespace) -> int:
    methods = chosen(args.methods)
    if min(args.counts) < 1:
        raise EllipsegError(f"--counts has {min(args.counts)}; it must be 1 or more")
    if args.limit <= 0.0:
        raise EllipsegError(f"--limit is {args.limit:g}; it must be more than 0 s")
    counts = tuple(sorted(set(args.counts)))
    plan = Plan(counts, args.limit, _earlier(args.add_to, counts) if args.add_to else {})
    scans = [read_scan(open_input(spec, args), spec) for spec in args.sources]
    with progress_steps(len(scans) * len(methods), "runs", args) as begin:
        results = study(scans, methods, plan, begin)
    if args.output:
        _draw_scenes(results, Path(args.output), args)
    publish(results, page, args, draw)
    return 0


def _earlier(path: str, counts: tuple[int, ...]) -> dict[str, Any]:
    """Results of an earlier run with the same target counts."""
    results = read_results(Path(path), "counts")
    earlier = tuple(results["counts"])
    if earlier != counts:
        raise EllipsegError(f"{path} is of --counts {' '.join(map(str, earlier))}; give the same")
    return results


def _draw_scenes(results: dict[str, Any], folder: Path, args: Namespace) -> None:
    """Draw the simulated scenes; pictures of recorded scans may be under another licence."""
    folder.mkdir(parents=True, exist_ok=True)
    for spec in (spec for spec in args.sources if spec.startswith(SIMULATED)):
        print_status(f"drawing {spec} ...", args)
        source = open_input(spec, args)
        row = next(row for row in results["scans"] if row["name"] == source.name)
        row["picture"] = f"partition_{source.name}.png"
        draw_scene(source, folder / row["picture"])


if __name__ == "__main__":
    sys.exit(run_program("studies.partition", main))
