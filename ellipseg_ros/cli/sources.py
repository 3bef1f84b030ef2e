"""The source that a command line names."""

from argparse import Namespace

from ellipseg_ros.errors import EllipsegError
from ellipseg_ros.io.sources import SIMULATED, Source, open_source


def open_input(spec: str, args: Namespace) -> Source:
    """Open `spec`, with `args.seed`, `.duration` and, if it has one, `.topic`."""
    scene = {name: getattr(args, name) for name in ("seed", "duration")}
    scene = {name: value for name, value in scene.items() if value is not None}
    if scene and not spec.startswith(SIMULATED):
        raise EllipsegError(f"--{next(iter(scene))} is for simulated scenes; {spec} is none")
    return open_source(spec, getattr(args, "topic", ""), **scene)
