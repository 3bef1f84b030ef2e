"""All commands and their options. Imports nothing heavy, so that `ellipseg --help` is instant.

argparse (standard library): a dozen commands with plain options need no more.
"""

import argparse
from collections.abc import Sequence
from importlib.metadata import version

from ellipseg_ros.cli.epilogs import (
    ASSOCIATION,
    BENCH,
    DEMO,
    DOCTOR,
    EVALUATE,
    EXAMPLES,
    PAPER,
    PARTITION,
    REPLAY,
    SCALE,
    SEGMENT,
    SIMULATE,
    SOAK,
    TUNE,
)
from ellipseg_ros.config import CRITERIA

SCENES = "woodland, industrial, roadway, mixed"
SOURCES = (
    "a bag (ROS 1 or 2), a cloud (pcd, ply, las, laz, npz) or a simulated scene (sim:industrial)"
)


def build_parser() -> argparse.ArgumentParser:
    """The parser of `ellipseg`; `args.command` names the module in cli/ that runs."""
    parser = argparse.ArgumentParser(
        prog="ellipseg",
        description="Segment registered lidar streams into ellipsoids.",
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=version("ellipseg_ros"))
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    _simulate(
        _command(commands, "simulate", "write a simulated drive, with truth, as a bag", SIMULATE)
    )
    _segment(
        _command(commands, "segment", "segment a bag, a cloud or a scene, without ROS", SEGMENT)
    )
    _tune(_command(commands, "tune", "find the threshold of least AICc for recordings", TUNE))
    _paper(_command(commands, "paper", "draw the paper's figures, tell which claims hold", PAPER))
    _replay(_command(commands, "replay", "publish any source on ROS topics, with /clock", REPLAY))
    _demo(_command(commands, "demo", "run the node on a source and check all it says", DEMO))
    _bench(_command(commands, "bench", "measure speed, latency and memory, beside others", BENCH))
    _soak(_command(commands, "soak", "try the node long and hard, and tell what it stood", SOAK))
    _doctor(_command(commands, "doctor", "tell what is wrong here, and what to do", DOCTOR))
    _evaluate(_command(commands, "evaluate", "measure quality against truth", EVALUATE))
    return parser


def _command(
    commands: "argparse._SubParsersAction[argparse.ArgumentParser]",
    name: str,
    about: str,
    examples: str,
) -> argparse.ArgumentParser:
    return commands.add_parser(
        name,
        help=about,
        description=f"{about[0].upper()}{about[1:]}.",
        epilog=examples,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )


def _simulate(command: argparse.ArgumentParser) -> None:
    command.add_argument("scene", help=SCENES)
    command.add_argument("-o", "--output", required=True, metavar="BAG", help="bag to write (new)")
    _scene_options(command)
    _second_pass(command)
    _talk(command)


def _segment(command: argparse.ArgumentParser) -> None:
    command.add_argument("source", help=SOURCES)
    command.add_argument(
        "-o", "--output", metavar="DIR", help="folder for the results (default: SOURCE_segmented)"
    )
    command.add_argument("--topic", default="", help="of the clouds, if the bag has several")
    _scene_options(command)
    _settings(command)
    command.add_argument("--no-pictures", action="store_true", help="write no pictures")
    command.add_argument("--no-bag", action="store_true", help="write no bag")
    _talk(command)


def _tune(command: argparse.ArgumentParser) -> None:
    command.add_argument("sources", nargs="+", metavar="SOURCE", help=SOURCES)
    command.add_argument(
        "-o",
        "--output",
        metavar="DIR",
        help="folder for the results (default: SOURCE_tuned); windows that are finished there "
        "are not run again",
    )
    command.add_argument("--topic", default="", help="of the clouds, if a bag has several")
    _scene_options(command)
    _settings(command, [*CRITERIA, "all"])
    group = command.add_argument_group("windows and thresholds")
    group.add_argument(
        "--every", type=float, metavar="S", help="s from window to window (window_duration)"
    )
    group.add_argument("--from", dest="lowest", type=float, help="lowest threshold tried")
    group.add_argument("--to", dest="highest", type=float, help="highest threshold tried")
    group.add_argument("--count", type=int, help="thresholds of the grid (40), then refined")
    group = command.add_argument_group("where it runs")
    group.add_argument("--jobs", type=int, metavar="N", help="processes (default: one a core)")
    group.add_argument(
        "--scheduler", metavar="ADDRESS", help="of a Dask cluster, which then does the work"
    )
    command.add_argument("--no-pictures", action="store_true", help="write no pictures")
    _talk(command)


def _paper(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "sources", nargs="*", metavar="SOURCE", help=f"beside the simulated scenes: {SOURCES}"
    )
    command.add_argument("-o", "--output", default="paper", metavar="DIR", help="results (paper)")
    command.add_argument("--topic", default="", help="of the clouds, if a bag has several")
    _scene_options(command)
    _parameters(command)
    command.set_defaults(criterion=None, threshold=None)  # all criteria, each at its own
    command.add_argument("--count", type=int, help="thresholds of the grid (40), then refined")
    command.add_argument("--no-pictures", action="store_true", help="write no pictures")
    _talk(command)


def _replay(command: argparse.ArgumentParser) -> None:
    command.add_argument("source", help=SOURCES)
    command.add_argument("--topic", default="", help="of the clouds, if the bag has several")
    _scene_options(command)
    command.add_argument(
        "--rate", type=float, default=1.0, help="times real time; 0: as fast as --ahead allows (1)"
    )
    command.add_argument(
        "--loop", action="store_true", help="start again at the end, until Ctrl-C"
    )
    command.add_argument(
        "--ahead",
        type=float,
        metavar="SECONDS",
        help="stay at most this far ahead of the node's `segments`, so that nothing is lost",
    )
    command.add_argument("--paused", action="store_true", help="start paused; see the services")
    _talk(command)


def _demo(command: argparse.ArgumentParser) -> None:
    command.add_argument("--data", default="sim:industrial", metavar="SOURCE", help=SOURCES)
    command.add_argument("--topic", default="", help="of the clouds, if the bag has several")
    _scene_options(command)
    command.add_argument("-o", "--output", default="demo", metavar="DIR", help="results (demo)")
    _settings(command)
    command.add_argument("--no-pictures", action="store_true", help="write no pictures")
    _talk(command)


def _bench(command: argparse.ArgumentParser) -> None:
    command.add_argument("--quick", action="store_true", help="small windows, a minute or two")
    command.add_argument(
        "--only",
        nargs="+",
        metavar="SECTION",
        help="batch, peers, stages, updates, length, density, data, tuning, publishing, latency, "
        "memory, start",
    )
    command.add_argument("--data", default="", metavar="SOURCE", help="a recording to use, too")
    command.add_argument("-o", "--output", metavar="DIR", help="folder for the results")
    _talk(command)


def _soak(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "subjects",
        nargs="*",
        metavar="SUBJECT",
        help="hour, overload, inputs, times, files, kills, signals, disks, caches, company, "
        "strangers, sameness (all of them)",
    )
    command.add_argument("--quick", action="store_true", help="short versions, some minutes")
    command.add_argument("--seed", type=int, default=0, help="of everything that is drawn (0)")
    command.add_argument("-o", "--output", metavar="DIR", help="folder for the results")
    _talk(command)


def _doctor(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--topic", default="", help="with the clouds (what a segmenter subscribes to, or points)"
    )
    command.add_argument(
        "--namespace", default="/", metavar="NS", help="of topic and segmenter (all)"
    )
    command.add_argument(
        "--seconds", type=float, default=5.0, metavar="S", help="to listen to the clouds (5)"
    )
    command.add_argument("--offline", action="store_true", help="leave the running graph alone")
    _talk(command)


def _evaluate(command: argparse.ArgumentParser) -> None:
    """One sub-command for each thing that there is truth about; `args.subject` names it."""
    subjects = command.add_subparsers(dest="subject", required=True, metavar="SUBJECT")
    _partition(_command(subjects, "partition", "segments against classes and things", PARTITION))
    _scale(_command(subjects, "scale", "what the scale of objects does, and its stability", SCALE))
    _association(_command(subjects, "association", "landmarks found again", ASSOCIATION))


def _association(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--scenes", nargs="+", default=["industrial", "woodland"], metavar="SCENE", help=SCENES
    )
    command.add_argument(
        "--seeds", type=int, default=20, metavar="N", help="scenes of a kind (20)"
    )
    command.add_argument(
        "--first-seed", type=int, default=100, metavar="SEED", help="of the first of them (100)"
    )
    command.add_argument(
        "--others",
        type=int,
        default=2,
        metavar="N",
        help="on so many of them other things than landmarks are looked for again, too (2)",
    )
    command.add_argument(
        "--add-to",
        nargs="+",
        metavar="JSON",
        help="results of earlier runs of this code: what is in them is not measured again",
    )
    command.add_argument(
        "--recording", metavar="SOURCE", help=f"windows of it are associated, too: {SOURCES}"
    )
    command.add_argument("--topic", default="", help="of the clouds, if a bag has several")
    command.add_argument("-o", "--output", metavar="DIR", help="folder for the results")
    _talk(command)


def _partition(command: argparse.ArgumentParser) -> None:
    command.add_argument("sources", nargs="+", metavar="SCAN", help=SOURCES)
    command.add_argument("--topic", default="", help="of the clouds, if a bag has several")
    _scene_options(command)
    command.add_argument(
        "--methods",
        nargs="+",
        metavar="NAME",
        help="only these, by the beginning of the name: objects, ellipsoids, cut-pursuit, Open3D, "
        "HDBSCAN",
    )
    command.add_argument(
        "--counts",
        nargs="+",
        type=int,
        default=[100, 250, 1000, 2500],
        metavar="N",
        help="numbers of segments to come to (100 250 1000 2500)",
    )
    command.add_argument(
        "--limit", type=float, default=900.0, metavar="S", help="time of a method on a scan (900)"
    )
    command.add_argument(
        "--add-to",
        metavar="JSON",
        help="results of an earlier run: what is not measured again stays in them",
    )
    command.add_argument("-o", "--output", metavar="DIR", help="folder for the results")
    _talk(command)


def _scale(command: argparse.ArgumentParser) -> None:
    command.add_argument("sources", nargs="+", metavar="SCENE", help=SOURCES)
    command.add_argument("--topic", default="", help="of the clouds, if a bag has several")
    _scene_options(command)
    _settings(command)
    command.add_argument("-o", "--output", metavar="DIR", help="folder for the results")
    _talk(command)


def _scene_options(command: argparse.ArgumentParser) -> None:
    group = command.add_argument_group("simulated scenes")
    group.add_argument("--seed", type=int, help="of the scene and of its noise")
    group.add_argument("--duration", type=float, metavar="S", help="seconds of driving")


def _second_pass(command: argparse.ArgumentParser) -> None:
    """How to drive through the same scene once more."""
    group = command.add_argument_group("another drive through the same scene")
    group.add_argument("--noise-seed", type=int, help="of noise and drift (the scene's)")
    group.add_argument("--speed", type=float, metavar="M/S", help="of the vehicle, m/s (3)")
    group.add_argument("--start", type=float, metavar="M", help="m along the lane (0)")
    group.add_argument("--aside", type=float, metavar="M", help="m to the left of the lane (0)")
    group.add_argument(
        "--backwards", action="store_true", default=None, help="against the lane, from the start"
    )


def _settings(command: argparse.ArgumentParser, criteria: Sequence[str] = CRITERIA) -> None:
    group = _parameters(command)
    group.add_argument("--criterion", choices=criteria, help="what decides about a merge")
    group.add_argument(
        "--threshold", metavar="T", help="merge while the criterion is at most this"
    )


def _parameters(command: argparse.ArgumentParser) -> "argparse._ArgumentGroup":
    group = command.add_argument_group("settings", "the node's parameters; the later one wins")
    group.add_argument("--params", metavar="FILE", help="YAML file, as for the node")
    group.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="any parameter, again and again: --set graph.neighbours=15",
    )
    return group


def _talk(command: argparse.ArgumentParser) -> None:
    command.add_argument("-q", "--quiet", action="store_true", help="say nothing unless it fails")
    command.add_argument(
        "--json", action="store_true", help="print the summary as JSON, no progress"
    )
