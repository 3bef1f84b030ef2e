"""`ellipseg evaluate scale`: what the scale of objects does, and how stable it is."""

import json
from argparse import Namespace
from dataclasses import replace
from pathlib import Path
from typing import Any

from ellipseg_ros.cli.report import progress, say, show_page
from ellipseg_ros.cli.settings import read_settings
from ellipseg_ros.cli.sources import open_input
from ellipseg_ros.config import Config, flatten
from ellipseg_ros.errors import ConfigError, EllipsegError
from ellipseg_ros.io.atomic_files import write_text
from ellipseg_ros.io.sources import SIMULATED
from studies.partition.scale import study_scene
from studies.partition.scale_page import blocks, page
from studies.partition.scale_picture import draw

NAMES = ("scale.md", "scale.json", "scale.png")


def scale(args: Namespace) -> int:
    """Cut the objects of every scene at many scales; returns 0."""
    config = read_settings(args).config
    if config.objects.scale == 0.0:
        raise ConfigError("objects.scale is 0; it must be above 0 here, to be doubled and halved")
    scenes = []
    for spec in args.sources:  # a wrong name is told before the work begins
        open_input(spec, args)
    with progress(len(args.sources), "scenes", args) as bar:
        for spec in args.sources:
            say(f"{spec} ...", args)
            scenes.append(one_scene(spec, config, args))
            bar.update()
    results = {"scale": config.objects.scale, "settings": changed(config), "scenes": scenes}
    show_page(results, blocks, args)
    if args.output:
        write(results, Path(args.output), args)
    return 0


def changed(config: Config) -> dict[str, Any]:
    """The settings that are not the defaults, by name."""
    defaults = flatten(Config())
    return {name: value for name, value in flatten(config).items() if value != defaults[name]}


def one_scene(spec: str, config: Config, args: Namespace) -> dict[str, Any]:
    """Measure a scene; a single cloud isn't thinned, as it has no rate."""
    source = open_input(spec, args)
    if not source.duration:
        config = replace(config, max_points_per_second=0)
    try:
        measured = study_scene(source, config)
    except EllipsegError as error:
        raise type(error)(f"{spec}: {error}") from error
    return {"name": source.name, "simulated": spec.startswith(SIMULATED)} | measured


def write(results: dict[str, Any], folder: Path, args: Namespace) -> None:
    """Write page, numbers and picture, over those of an earlier run."""
    folder.mkdir(parents=True, exist_ok=True)
    text, numbers, picture = (folder / name for name in NAMES)
    write_text(text, page(results))
    lines = json.dumps(results).replace('{"scale": ', '\n{"scale": ').lstrip()
    write_text(numbers, f"{lines}\n")
    draw(results, picture)
    for path in (text, numbers, picture):
        say(f"wrote {path}", args)
