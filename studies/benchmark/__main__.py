"""`python -m studies.benchmark`: speed, latency and memory, beside other libraries."""

import sys
from argparse import ArgumentParser, Namespace
from collections.abc import Sequence

from ellipseg_ros.cli.main import run_program
from ellipseg_ros.cli.options import SOURCES
from ellipseg_ros.cli.report import print_status
from ellipseg_ros.io.sources import open_source
from studies.benchmark.chart import draw
from studies.benchmark.page import page
from studies.benchmark.sections import SECTIONS, measure
from studies.benchmark.streams import FULL, QUICK
from studies.report.command import check_names, publish, run_command
from studies.report.progress import progress_steps

EXAMPLES = """examples:
  python -m studies.benchmark --quick --only batch peers
  python -m studies.benchmark --data drive.mcap -o docs/results

Ctrl-C ends it with the sections that are finished."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the benchmark; returns 0, whatever the times are."""
    return run_command("benchmark", _options, _run, argv, EXAMPLES)


def _options(parser: ArgumentParser) -> None:
    parser.add_argument("--quick", action="store_true", help="small windows, a minute or two")
    names = ", ".join(SECTIONS)
    parser.add_argument("--only", nargs="+", metavar="SECTION", default=[], help=names)
    parser.add_argument("--data", default="", metavar="SOURCE", help=f"measured, too: {SOURCES}")


def _run(args: Namespace) -> int:
    check_names(args.only, SECTIONS, "section")
    if args.data:
        open_source(args.data)  # fails here, not after minutes, if it does not exist
    names = [name for name in SECTIONS if name in args.only or not args.only]
    names = [name for name in names if name != "data" or args.data]
    print_status("compiling kernels, which takes longer the first time ...", args)
    with progress_steps(len(names), "sections", args) as begin:
        results = measure(names, QUICK if args.quick else FULL, args.data, begin)
    publish(results, page, args, draw)
    return 0


if __name__ == "__main__":
    sys.exit(run_program("studies.benchmark", main))
