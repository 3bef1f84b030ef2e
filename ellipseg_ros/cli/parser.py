"""The commands of `ellipseg` and their options.

The docstring of a command is its help: summary and examples. Imports nothing heavy, so that
`ellipseg --help` is instant. argparse (standard library) suffices for plain options.
"""

from argparse import ArgumentParser, RawDescriptionHelpFormatter
from importlib.metadata import version
from inspect import cleandoc

from ellipseg_ros.cli import options

EXAMPLES = """examples:
  ellipseg segment drive.mcap               segment a bag; writes drive_segmented/
  ellipseg segment sim:woodland -o wood     segment a simulated scene
  ellipseg simulate industrial -o yard      write a simulated drive as a bag
  ellipseg tune drive.mcap                  find the threshold for a recording
  ellipseg replay yard --rate 2             publish a bag on ROS topics
  ellipseg demo                             run the node on a simulated drive and check it
  ellipseg doctor                           check installation, environment and running graph
`ellipseg COMMAND --help` lists the options of a command."""


def build_parser() -> ArgumentParser:
    """The parser of `ellipseg`; `args.command` names the module in cli/ that runs."""
    about = "Segment registered lidar streams into ellipsoids."
    parser = options.new_parser("ellipseg", about, EXAMPLES)
    parser.add_argument("--version", action="version", version=version("ellipseg_ros"))
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for define in (segment, simulate, tune, replay, demo, doctor):
        summary, _, examples = cleandoc(define.__doc__ or "").partition("\n\n")
        command = commands.add_parser(
            define.__name__,
            help=summary[:1].lower() + summary[1:].rstrip("."),
            description=summary,
            epilog=examples,
            formatter_class=RawDescriptionHelpFormatter,
        )
        define(command)
        options.add_report_options(command)
    return parser


def segment(command: ArgumentParser) -> None:
    """Segment a bag, a cloud or a scene, without ROS.

    examples:
      ellipseg segment drive.mcap -o out --topic /velodyne/registered
      ellipseg segment cloud.ply --criterion parsimony
      ellipseg segment sim:roadway --threshold 12 --set graph.neighbours=15
      ellipseg segment drive.mcap --params config/segmenter.yaml --json > summary.json
    """
    add = command.add_argument
    add("source", help=options.SOURCES)
    add("-o", "--output", metavar="DIR", help="folder for the results (default: SOURCE_segmented)")
    options.add_source_options(command)
    options.add_segmentation_options(command)
    add("--no-pictures", action="store_true", help="write no pictures")
    add("--no-bag", action="store_true", help="write no bag")


def simulate(command: ArgumentParser) -> None:
    """Write a simulated drive as a bag, with truth.

    examples, two drives through one scene, and a town with the usual lidar or another one:
      ellipseg simulate woodland -o wood --seed 3
      ellipseg simulate woodland -o back --seed 3 --noise-seed 1 --start 30 --backwards
      ellipseg simulate town -o town --duration 10
      ellipseg simulate town -o town_raw --raw --lidar wide32 --odometry-stamp scan_end
    """
    command.add_argument("scene", help=options.SCENES)
    command.add_argument("-o", "--output", required=True, metavar="BAG", help="bag to write (new)")
    options.add_scene_options(command)
    add = command.add_argument_group("another drive through the same scene").add_argument
    add("--noise-seed", type=int, help="of noise and drift (that of the scene)")
    add(
        "--speed",
        type=float,
        metavar="M/S",
        help="of the vehicle, m/s (10 in town, 18 in forest, else 3)",
    )
    add("--start", type=float, metavar="M", help="m along the lane (0)")
    add("--aside", type=float, metavar="M", help="m to the left of the lane (0)")
    about = "against the lane, from the start"
    add("--backwards", action="store_true", default=None, help=about)
    about = "for any lidar but sick: clouds as a driver publishes them, with an odometry and tf"
    add = command.add_argument_group("raw sweeps", about).add_argument
    add("--raw", action="store_true", help="in the frame of the lidar, with times of points")
    about = "whose field of time: ouster, velodyne, hesai or livox (that of the lidar)"
    add("--vendor", metavar="NAME", help=about)
    about = "beams without a return: left_out, zero or nan (as the lidar)"
    add("--missing", metavar="ROWS", help=about)
    add("--stamp", metavar="END", help="of the sweep that stamps the cloud: begin or end (begin)")
    about = "exact, or the pose of a sweep's end stamped with its begin or end: scan_begin, "
    about += "scan_end (exact)"
    add("--odometry-stamp", metavar="MEANING", help=about)
    add("--odometry-rate", type=int, metavar="HZ", help="poses per second, if exact (50)")


def tune(command: ArgumentParser) -> None:
    """Find the threshold with the lowest AICc.

    examples:
      ellipseg tune drive.mcap                           windows of 25 s, end to end
      ellipseg tune sim:woodland --criterion all -o wood_tuned
      ellipseg tune monday.mcap tuesday.mcap --every 10 --jobs 4
      ellipseg tune drive.mcap --scheduler tcp://10.0.0.1:8786
    The result is a parameter file: ros2 run ellipseg_ros segmenter --ros-args --params-file FILE
    """
    command.add_argument("sources", nargs="+", metavar="SOURCE", help=options.SOURCES)
    about = "folder for the results (default: SOURCE_tuned); finished windows in it are reused"
    command.add_argument("-o", "--output", metavar="DIR", help=about)
    options.add_source_options(command)
    options.add_segmentation_options(command, "(shape), or all")
    add = command.add_argument_group("windows and thresholds").add_argument
    add("--every", type=float, metavar="S", help="s from window to window (window_duration)")
    add("--from", dest="lowest", type=float, help="lowest threshold tried")
    add("--to", dest="highest", type=float, help="highest threshold tried")
    add("--count", type=int, help="thresholds of the grid (40), then refined")
    add = command.add_argument_group("parallel execution").add_argument
    add("--jobs", type=int, metavar="N", help="processes (default: one per core)")
    add("--scheduler", metavar="ADDRESS", help="of a Dask cluster, which then does the work")
    command.add_argument("--no-pictures", action="store_true", help="write no pictures")


def replay(command: ArgumentParser) -> None:
    """Publish any source on ROS topics, with /clock.

    examples:
      ellipseg replay drive.mcap --topic /velodyne/registered --rate 0.5
      ellipseg replay sim:industrial --loop
      ellipseg replay drive.mcap --rate 0 --ahead 2     as fast as the node segments, without loss
    """
    add = command.add_argument
    add("source", help=options.SOURCES)
    options.add_source_options(command)
    about = "times real time; 0: as fast as --ahead allows (1)"
    add("--rate", type=float, default=1.0, help=about)
    add("--loop", action="store_true", help="start again at the end, until Ctrl-C")
    about = "stay at most this far ahead of the node's `segments`, so that nothing is lost"
    add("--ahead", type=float, metavar="SECONDS", help=about)
    add("--paused", action="store_true", help="start paused; see the services")


def demo(command: ArgumentParser) -> None:
    """Run the node on a source and check its output.

    examples:
      ellipseg demo
      ellipseg demo --data drive.mcap --topic /velodyne/registered -o drive_demo
    """
    add = command.add_argument
    add("--data", default="sim:industrial", metavar="SOURCE", help=options.SOURCES)
    add("-o", "--output", default="demo", metavar="DIR", help="results (demo)")
    options.add_source_options(command)
    options.add_segmentation_options(command)
    add("--no-pictures", action="store_true", help="write no pictures")


def doctor(command: ArgumentParser) -> None:
    """Check installation, environment, running graph or a recording, and speed.

    examples:
      ellipseg doctor                           installation, environment, graph, speed
      ellipseg doctor drive.mcap --no-speed     how a recording is understood; odometry_stamp
      ellipseg doctor --topic /cloud_registered --seconds 10
      ellipseg doctor --namespace /front
      ellipseg doctor --offline --no-speed --json

    Exit code 1: at least one finding is an error.
    """
    add = command.add_argument
    add("source", nargs="?", default="", help=f"in place of the graph: {options.SOURCES}")
    about = "with the clouds (what a segmenter subscribes to, or points)"
    add("--topic", default="", help=about)
    about = "of the recording's raw clouds: topic, /tf, file of poses or kiss-icp"
    add("--odometry", default="", metavar="POSES", help=about)
    add("--namespace", default="/", metavar="NS", help="of topic and segmenter (all)")
    add("--seconds", type=float, default=5.0, metavar="S", help="to observe the clouds (5)")
    add("--offline", action="store_true", help="do not observe the running graph")
    add("--no-speed", action="store_true", help="skip the speed check, up to 20 s of computing")
