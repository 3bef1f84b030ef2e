"""Groups of options that several commands, and the studies in a checkout, have in common.

Imports nothing heavy, so that `--help` is instant.
"""

import argparse

SCENES = "woodland, industrial, roadway, mixed"
SOURCES = (
    "a bag (ROS 1 or 2), a cloud (pcd, ply, las, laz, npz) or a simulated scene (sim:industrial)"
)


def new_parser(program: str, description: str, examples: str) -> argparse.ArgumentParser:
    """A parser whose help ends with `examples`, line breaks kept."""
    return argparse.ArgumentParser(
        prog=program,
        description=description,
        epilog=examples,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )


def add_command(
    commands: "argparse._SubParsersAction[argparse.ArgumentParser]",
    name: str,
    summary: str,
    examples: str,
) -> argparse.ArgumentParser:
    """Add a sub-command; `summary` is its line in the list, and the first line of its help."""
    return commands.add_parser(
        name,
        help=summary,
        description=f"{summary[0].upper()}{summary[1:]}.",
        epilog=examples,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )


def add_source_options(command: argparse.ArgumentParser) -> None:
    """--topic, --seed and --duration: options of the sources that the command reads."""
    command.add_argument("--topic", default="", help="of the clouds, if a bag has several")
    add_scene_options(command)


def add_scene_options(command: argparse.ArgumentParser) -> "argparse._ArgumentGroup":
    """--seed and --duration; returns their group."""
    group = command.add_argument_group("simulated scenes")
    group.add_argument("--seed", type=int, help="of the scene and of its noise")
    group.add_argument("--duration", type=float, metavar="S", help="seconds of driving")
    return group


def add_parameter_options(command: argparse.ArgumentParser) -> "argparse._ArgumentGroup":
    """--params and --set; returns their group."""
    group = command.add_argument_group(
        "parameters", "of the node; --set overrides --params, and the specific options both"
    )
    group.add_argument("--params", metavar="FILE", help="YAML file, as for the node")
    group.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="any parameter; may be repeated: --set graph.neighbours=15",
    )
    return group


def add_segmentation_options(
    command: argparse.ArgumentParser, criterion_help: str = "merge criterion (shape)"
) -> None:
    """--params, --set, --criterion and --threshold."""
    group = add_parameter_options(command)
    group.add_argument("--criterion", metavar="NAME", help=criterion_help)
    group.add_argument(
        "--threshold", metavar="T", help="merge while the criterion is at most this value"
    )


def add_report_options(command: argparse.ArgumentParser) -> None:
    """--quiet and --json: how the command reports."""
    command.add_argument("-q", "--quiet", action="store_true", help="print errors alone")
    command.add_argument(
        "--json", action="store_true", help="print the summary as JSON, no progress"
    )
