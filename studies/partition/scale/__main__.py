"""`python -m studies.partition.scale`: effect and stability of the object scale."""

import sys
from argparse import ArgumentParser, Namespace
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from ellipseg_ros.cli.main import run_program
from ellipseg_ros.cli.options import SOURCES, add_segmentation_options, add_source_options
from ellipseg_ros.cli.settings import read_settings
from ellipseg_ros.cli.sources import open_input
from ellipseg_ros.config import Config
from ellipseg_ros.errors import ConfigError, EllipsegError
from ellipseg_ros.io.sources import SIMULATED
from ellipseg_ros.settings import flatten
from studies.partition.scale.chart import draw
from studies.partition.scale.cuts import study_scene
from studies.partition.scale.page import page
from studies.report.command import publish, run_command
from studies.report.progress import progress_steps

EXAMPLES = """examples:
  python -m studies.partition.scale sim:roadway
  python -m studies.partition.scale drive.mcap scan.npz --set max_points_per_second=15000

Every scene is segmented once; the hierarchy of its objects is then cut at 1/64 to 64 times
objects.scale. Scores need points with a class, as in `python -m studies.partition`."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the study; returns 0, whatever the scores are."""
    return run_command("partition.scale", _options, _run, argv, EXAMPLES)


def _options(parser: ArgumentParser) -> None:
    parser.add_argument("sources", nargs="+", metavar="SCENE", help=SOURCES)
    add_source_options(parser)
    add_segmentation_options(parser)


def _run(args: Namespace) -> int:
    config = read_settings(args).config
    if config.objects.scale == 0.0:
        raise ConfigError("objects.scale is 0; it must be above 0 here, to be doubled and halved")
    for spec in args.sources:  # a missing source is reported before the work begins
        open_input(spec, args)
    scenes = []
    with progress_steps(len(args.sources), "scenes", args) as begin:
        for spec in args.sources:
            begin(spec)
            scenes.append(_scene(spec, config, args))
    results = {"scale": config.objects.scale, "settings": _changed(config), "scenes": scenes}
    publish(results, page, args, draw)
    return 0


def _scene(spec: str, config: Config, args: Namespace) -> dict[str, Any]:
    """Measure a scene; a single cloud is not thinned, as it has no rate."""
    source = open_input(spec, args)
    if not source.duration:
        config = replace(config, max_points_per_second=0)
    try:
        measured = study_scene(source, config)
    except EllipsegError as error:
        raise type(error)(f"{spec}: {error}") from error
    return {"name": source.name, "simulated": spec.startswith(SIMULATED)} | measured


def _changed(config: Config) -> dict[str, Any]:
    """The settings that differ from the defaults, by name."""
    defaults = flatten(Config())
    return {name: value for name, value in flatten(config).items() if value != defaults[name]}


if __name__ == "__main__":
    sys.exit(run_program("studies.partition.scale", main))
