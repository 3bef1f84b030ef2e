"""Opening of the source that a command line names."""

from argparse import Namespace
from typing import Any

from ellipseg_ros.cli.report import print_status
from ellipseg_ros.config import PlacementConfig
from ellipseg_ros.errors import EllipsegError
from ellipseg_ros.io.sources import SIMULATED, Source, open_source

SCENE_OPTIONS = ("lidar", "seed", "duration", "speed", "noise_seed", "start", "aside", "backwards")


def open_input(spec: str, args: Namespace, placement: PlacementConfig | None = None) -> Source:
    """Open `spec`, with the SCENE_OPTIONS of `args` and, if it has them, --topic and --odometry.

    placement: settings for clouds in a sensor's frame. Says where their poses come from.
    """
    scene: dict[str, Any] = {name: getattr(args, name, None) for name in SCENE_OPTIONS}
    scene = {name: value for name, value in scene.items() if value is not None}
    if scene and not spec.startswith(SIMULATED):
        option = next(iter(scene)).replace("_", "-")
        raise EllipsegError(f"--{option} applies to simulated scenes only, not to {spec}")
    topic, odometry = getattr(args, "topic", ""), getattr(args, "odometry", "")
    source = open_source(spec, topic, odometry, placement, **scene)
    if source.about_poses:
        print_status(f"poses: {source.about_poses}", args)
    return source
