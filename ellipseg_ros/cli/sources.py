"""Opening of the source that a command line names."""

from argparse import Namespace

from ellipseg_ros.cli.report import print_status
from ellipseg_ros.errors import EllipsegError
from ellipseg_ros.io.frames import looks_like_a_sensor, warning
from ellipseg_ros.io.sources import SIMULATED, Source, open_source

SCENE_OPTIONS = ("seed", "duration", "speed", "noise_seed", "start", "aside", "backwards")


def open_input(spec: str, args: Namespace) -> Source:
    """Open `spec`, with the SCENE_OPTIONS of `args` and, if it has one, its `.topic`."""
    scene = {name: getattr(args, name, None) for name in SCENE_OPTIONS}
    scene = {name: value for name, value in scene.items() if value is not None}
    if scene and not spec.startswith(SIMULATED):
        option = next(iter(scene)).replace("_", "-")
        raise EllipsegError(f"--{option} applies to simulated scenes only, not to {spec}")
    source = open_source(spec, getattr(args, "topic", ""), **scene)
    if source.count != 1 and looks_like_a_sensor(source.frame_id):  # a single cloud is not smeared
        print_status(warning(source.frame_id), args)
    return source
