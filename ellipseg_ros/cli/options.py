"""Groups of options that several commands, and the studies in a checkout, have in common.

Imports nothing heavy, so that `--help` is instant.
"""

from argparse import ArgumentParser, RawDescriptionHelpFormatter, _ArgumentGroup

SICK_SCENES = "woodland, industrial, roadway, mixed"
SCENES = f"{SICK_SCENES}, town, forest"
SOURCES = (
    "a bag (ROS 1 or 2), a cloud (pcd, ply, las, laz, npz) or a simulated scene (sim:industrial)"
)


def new_parser(program: str, description: str, examples: str) -> ArgumentParser:
    """A parser whose help ends with `examples`, line breaks kept."""
    return ArgumentParser(
        program, None, description, examples, formatter_class=RawDescriptionHelpFormatter
    )


def add_source_options(command: ArgumentParser) -> None:
    """--topic, --lidar, --seed and --duration: options of the sources that the command reads."""
    command.add_argument("--topic", default="", help="of the clouds, if a bag has several")
    about = (
        "poses of clouds in a sensor's frame: a topic, /tf, a file (TUM or KITTI), kiss-icp, or "
        "registered for none (default: the only one in the bag)"
    )
    command.add_argument("--odometry", default="", metavar="POSES", help=about)
    add_scene_options(command)


def add_scene_options(command: ArgumentParser) -> None:
    """--lidar, --seed and --duration."""
    add = command.add_argument_group("simulated scenes").add_argument
    about = "sick, hdl64e, wide32 or solid_state (hdl64e in town and forest, otherwise sick)"
    add("--lidar", metavar="NAME", help=about)
    add("--seed", type=int, help="of the scene and of its noise")
    add("--duration", type=float, metavar="S", help="seconds of driving")


def add_parameter_options(command: ArgumentParser) -> _ArgumentGroup:
    """--params and --set; returns their group."""
    about = "of the node; --set overrides --params, and the specific options both"
    group = command.add_argument_group("parameters", about)
    group.add_argument("--params", metavar="FILE", help="YAML file, as for the node")
    about = "any parameter; may be repeated: --set graph.neighbours=15"
    group.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", help=about)
    return group


def add_segmentation_options(command: ArgumentParser, criteria: str = "(shape)") -> None:
    """--params, --set, --criterion and --threshold; criteria: end of the help of --criterion."""
    add = add_parameter_options(command).add_argument
    add("--criterion", metavar="NAME", help=f"merge criterion {criteria}")
    add("--threshold", metavar="T", help="merge while the criterion is at most this value")


def add_report_options(command: ArgumentParser) -> None:
    """--quiet and --json: how the command reports."""
    add = command.add_argument
    add("-q", "--quiet", action="store_true", help="print errors alone")
    add("--json", action="store_true", help="print the summary as JSON, no progress")
