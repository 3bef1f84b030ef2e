"""`ellipseg evaluate association`: what of one pass over a scene is found again in another."""

import json
from argparse import Namespace
from pathlib import Path

from ellipseg_ros.cli.report import print_results, print_status, progress_steps
from ellipseg_ros.cli.sources import open_input
from ellipseg_ros.errors import EllipsegError
from ellipseg_ros.io.atomic_files import write_text
from ellipseg_ros.simulation.simulator import SCENES
from studies.landmarks.methods import GRIDS, OURS
from studies.landmarks.page import blocks, page
from studies.landmarks.picture import draw
from studies.landmarks.recording import study_recording
from studies.landmarks.study import Plan, Results, gathered, study
from studies.report.machine import describe

NAMES = ("association.md", "association.json", "association.png")


def association(args: Namespace) -> int:
    """Measure, and print or write what was found; returns 0, however good it was."""
    plan = _plan(args)
    machine = describe()
    known = [run for path in args.add_to or [] for run in earlier(Path(path))]
    runs: list[Results] = []
    with progress_steps(len(plan.scenes) * len(plan.seeds), "scenes", args) as begin:
        for run in study(plan, known, begin):
            runs.append(run)
            if args.output:  # whoever gives up in between can go on from it
                _keep({"machine": machine} | gathered(runs), Path(args.output))
        results: Results = {"machine": machine, **gathered(runs)}
        if args.recording:
            source = open_input(args.recording, args)
            results["recording"] = study_recording(source, [OURS, *GRIDS], begin)
    print_results(results, blocks, args)
    if args.output:
        _write(results, Path(args.output), args)
    return 0


def _plan(args: Namespace) -> Plan:
    """What the options ask for; EllipsegError if that is nothing."""
    for scene in args.scenes:
        if scene not in SCENES:
            raise EllipsegError(f"there is no scene {scene!r}; there are {', '.join(SCENES)}")
    for name in ("seeds", "first_seed", "others"):
        least = 1 if name == "seeds" else 0
        if getattr(args, name) < least:
            option = name.replace("_", "-")
            raise EllipsegError(f"--{option} is {getattr(args, name)}; it must be {least} or more")
    seeds = range(args.first_seed, args.first_seed + args.seeds)
    return Plan(args.scenes, seeds, args.others)


def earlier(path: Path) -> list[Results]:
    """The runs that an earlier call wrote."""
    try:
        return list(json.loads(path.read_text(encoding="utf-8"))["runs"])
    except (ValueError, KeyError, TypeError) as error:
        raise EllipsegError(f"{path} holds no results; it must be an association.json") from error


def _keep(results: Results, folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    lines = json.dumps(results).replace('{"scene": ', '\n{"scene": ')  # a line for each run
    write_text(folder / NAMES[1], f"{lines}\n")


def _write(results: Results, folder: Path, args: Namespace) -> None:
    """Write page, numbers and picture, over those of an earlier run."""
    _keep(results, folder)
    write_text(folder / NAMES[0], page(results))
    draw(results, folder / NAMES[2])
    for name in NAMES:
        print_status(f"wrote {folder / name}", args)
