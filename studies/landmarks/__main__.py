"""`python -m studies.landmarks`: repeatability and association of landmarks."""

import sys
from argparse import ArgumentParser, Namespace
from collections.abc import Sequence
from pathlib import Path

from ellipseg_ros.cli.main import run_program
from ellipseg_ros.cli.options import SICK_SCENES as SCENE_NAMES
from ellipseg_ros.cli.options import SOURCES
from ellipseg_ros.cli.sources import open_input
from ellipseg_ros.errors import EllipsegError
from ellipseg_ros.simulation.simulator import SCENES
from studies.landmarks.candidates import GRIDS, OURS
from studies.landmarks.chart import draw
from studies.landmarks.page import page
from studies.landmarks.passes import FULL, QUICK
from studies.landmarks.recording import study_recording
from studies.landmarks.study import Plan, Results, study, summary
from studies.report.command import publish, read_results, run_command, write
from studies.report.machine import describe
from studies.report.progress import progress_steps

EXAMPLES = """examples:
  python -m studies.landmarks --seeds 2 --others 0
  python -m studies.landmarks -o docs/results      write landmarks.md, .json and .png"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the study; returns 0, whatever the scores are."""
    return run_command("landmarks", _add_options, _run, argv, EXAMPLES)


def _add_options(parser: ArgumentParser) -> None:
    scenes = ["industrial", "woodland"]
    parser.add_argument("--scenes", nargs="+", default=scenes, metavar="SCENE", help=SCENE_NAMES)
    parser.add_argument(
        "--seeds", type=int, default=20, metavar="N", help="simulated scenes of each kind (20)"
    )
    parser.add_argument(
        "--first-seed", type=int, default=100, metavar="SEED", help="of the first scene (100)"
    )
    parser.add_argument(
        "--others",
        type=int,
        default=2,
        metavar="N",
        help="scenes of each kind with the other landmark candidates, too (2)",
    )
    parser.add_argument("--quick", action="store_true", help="drives of 18 m instead of 75 m")
    parser.add_argument(
        "--add-to",
        nargs="+",
        metavar="JSON",
        default=[],
        help="results of earlier runs of this code, which are not measured again",
    )
    parser.add_argument(
        "--recording", metavar="SOURCE", help=f"also associate windows of it: {SOURCES}"
    )
    parser.add_argument("--topic", default="", help="of the clouds, if a bag has several")


def _run(args: Namespace) -> int:
    plan = _plan(args)
    machine = describe()
    known = [run for path in args.add_to for run in read_results(Path(path), "runs")["runs"]]
    runs: list[Results] = []
    with progress_steps(len(plan.scenes) * len(plan.seeds), "scenes", args) as begin:
        for run in study(plan, known, begin):
            runs.append(run)
            if args.output:  # so that an interrupted study can be continued with --add-to
                write({"machine": machine, **summary(runs)}, page, Path(args.output))
        results: Results = {"machine": machine, **summary(runs)}
        if args.recording:
            source = open_input(args.recording, args)
            results["recording"] = study_recording(source, [OURS, *GRIDS], begin)
    publish(results, page, args, draw)
    return 0


def _plan(args: Namespace) -> Plan:
    """The plan by the options; raises EllipsegError for invalid ones."""
    for scene in args.scenes:
        if scene not in SCENES:
            raise EllipsegError(f"there is no scene {scene!r}; there are {', '.join(SCENES)}")
    for name, minimum in (("seeds", 1), ("first_seed", 0), ("others", 0)):
        value, option = getattr(args, name), name.replace("_", "-")
        if value < minimum:
            raise EllipsegError(f"--{option} is {value}; it must be {minimum} or more")
    seeds = range(args.first_seed, args.first_seed + args.seeds)
    return Plan(args.scenes, seeds, args.others, QUICK if args.quick else FULL)


if __name__ == "__main__":
    sys.exit(run_program("studies.landmarks", main))
