"""The commands of `ellipseg` and their options.

Imports nothing heavy, so that `ellipseg --help` is instant. argparse (standard library) suffices
for six commands with plain options.
"""

import argparse
from importlib.metadata import version

from ellipseg_ros.cli.options import (
    SCENES,
    SOURCES,
    add_command,
    add_report_options,
    add_scene_options,
    add_segmentation_options,
    add_source_options,
    new_parser,
)

EXAMPLES = """examples:
  ellipseg segment drive.mcap               segment a bag; writes drive_segmented/
  ellipseg segment sim:woodland -o wood     segment a simulated scene
  ellipseg simulate industrial -o yard      write a simulated drive as a bag
  ellipseg tune drive.mcap                  find the threshold for a recording
  ellipseg replay yard --rate 2             publish a bag on ROS topics
  ellipseg demo                             run the node on a simulated drive and check it
  ellipseg doctor                           check installation, environment and running graph
`ellipseg COMMAND --help` lists the options of a command."""

SEGMENT = """examples:
  ellipseg segment drive.mcap -o out --topic /velodyne/registered
  ellipseg segment cloud.ply --criterion parsimony
  ellipseg segment sim:roadway --threshold 12 --set graph.neighbours=15
  ellipseg segment drive.mcap --params config/segmenter.yaml --json > summary.json"""

SIMULATE = """example, two drives through one scene:
  ellipseg simulate woodland -o wood --seed 3
  ellipseg simulate woodland -o back --seed 3 --noise-seed 1 --start 30 --backwards"""

TUNE = """examples:
  ellipseg tune drive.mcap                           windows of 25 s, end to end
  ellipseg tune sim:woodland --criterion all -o wood_tuned
  ellipseg tune monday.mcap tuesday.mcap --every 10 --jobs 4
  ellipseg tune drive.mcap --scheduler tcp://10.0.0.1:8786
The result is a parameter file: ros2 run ellipseg_ros segmenter --ros-args --params-file FILE"""

REPLAY = """examples:
  ellipseg replay drive.mcap --topic /velodyne/registered --rate 0.5
  ellipseg replay sim:industrial --loop
  ellipseg replay drive.mcap --rate 0 --ahead 2     as fast as the node segments, without loss"""

DEMO = """examples:
  ellipseg demo
  ellipseg demo --data drive.mcap --topic /velodyne/registered -o drive_demo"""

DOCTOR = """examples:
  ellipseg doctor                           installation, environment, graph, speed
  ellipseg doctor --topic /cloud_registered --seconds 10
  ellipseg doctor --namespace /front
  ellipseg doctor --offline --no-speed --json

Exit code 1: at least one finding is an error."""


def build_parser() -> argparse.ArgumentParser:
    """The parser of `ellipseg`; `args.command` names the module in cli/ that runs."""
    parser = new_parser("ellipseg", "Segment registered lidar streams into ellipsoids.", EXAMPLES)
    parser.add_argument("--version", action="version", version=version("ellipseg_ros"))
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    _segment(
        add_command(commands, "segment", "segment a bag, a cloud or a scene, without ROS", SEGMENT)
    )
    _simulate(
        add_command(commands, "simulate", "write a simulated drive as a bag, with truth", SIMULATE)
    )
    _tune(add_command(commands, "tune", "find the threshold with the lowest AICc", TUNE))
    _replay(
        add_command(commands, "replay", "publish any source on ROS topics, with /clock", REPLAY)
    )
    _demo(add_command(commands, "demo", "run the node on a source and check its output", DEMO))
    _doctor(
        add_command(
            commands, "doctor", "check installation, environment, running graph and speed", DOCTOR
        )
    )
    return parser


def _segment(command: argparse.ArgumentParser) -> None:
    command.add_argument("source", help=SOURCES)
    command.add_argument(
        "-o", "--output", metavar="DIR", help="folder for the results (default: SOURCE_segmented)"
    )
    add_source_options(command)
    add_segmentation_options(command)
    _add_no_pictures(command)
    command.add_argument("--no-bag", action="store_true", help="write no bag")
    add_report_options(command)


def _simulate(command: argparse.ArgumentParser) -> None:
    command.add_argument("scene", help=SCENES)
    command.add_argument("-o", "--output", required=True, metavar="BAG", help="bag to write (new)")
    add_scene_options(command)
    group = command.add_argument_group("another drive through the same scene")
    group.add_argument("--noise-seed", type=int, help="of noise and drift (that of the scene)")
    group.add_argument("--speed", type=float, metavar="M/S", help="of the vehicle, m/s (3)")
    group.add_argument("--start", type=float, metavar="M", help="m along the lane (0)")
    group.add_argument("--aside", type=float, metavar="M", help="m to the left of the lane (0)")
    group.add_argument(
        "--backwards", action="store_true", default=None, help="against the lane, from the start"
    )
    add_report_options(command)


def _tune(command: argparse.ArgumentParser) -> None:
    command.add_argument("sources", nargs="+", metavar="SOURCE", help=SOURCES)
    command.add_argument(
        "-o",
        "--output",
        metavar="DIR",
        help="folder for the results (default: SOURCE_tuned); windows that it already has "
        "are not computed again",
    )
    add_source_options(command)
    add_segmentation_options(command, "merge criterion (shape), or all")
    group = command.add_argument_group("windows and thresholds")
    group.add_argument(
        "--every", type=float, metavar="S", help="s from window to window (window_duration)"
    )
    group.add_argument("--from", dest="lowest", type=float, help="lowest threshold tried")
    group.add_argument("--to", dest="highest", type=float, help="highest threshold tried")
    group.add_argument("--count", type=int, help="thresholds of the grid (40), then refined")
    group = command.add_argument_group("parallel execution")
    group.add_argument("--jobs", type=int, metavar="N", help="processes (default: one per core)")
    group.add_argument(
        "--scheduler", metavar="ADDRESS", help="of a Dask cluster, which then does the work"
    )
    _add_no_pictures(command)
    add_report_options(command)


def _replay(command: argparse.ArgumentParser) -> None:
    command.add_argument("source", help=SOURCES)
    add_source_options(command)
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
    add_report_options(command)


def _demo(command: argparse.ArgumentParser) -> None:
    command.add_argument("--data", default="sim:industrial", metavar="SOURCE", help=SOURCES)
    command.add_argument("-o", "--output", default="demo", metavar="DIR", help="results (demo)")
    add_source_options(command)
    add_segmentation_options(command)
    _add_no_pictures(command)
    add_report_options(command)


def _doctor(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--topic", default="", help="with the clouds (what a segmenter subscribes to, or points)"
    )
    command.add_argument(
        "--namespace", default="/", metavar="NS", help="of topic and segmenter (all)"
    )
    command.add_argument(
        "--seconds", type=float, default=5.0, metavar="S", help="to observe the clouds (5)"
    )
    command.add_argument("--offline", action="store_true", help="do not observe the running graph")
    command.add_argument(
        "--no-speed", action="store_true", help="skip the speed check, up to 20 s of computing"
    )
    add_report_options(command)


def _add_no_pictures(command: argparse.ArgumentParser) -> None:
    command.add_argument("--no-pictures", action="store_true", help="write no pictures")
