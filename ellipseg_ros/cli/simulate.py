"""`ellipseg simulate`: write a drive through a simulated scene as a bag."""

import json
from argparse import Namespace
from collections.abc import Iterable
from pathlib import Path

from ellipseg_ros.cli.report import print_status, progress_bar
from ellipseg_ros.cli.sources import open_input
from ellipseg_ros.errors import EllipsegError
from ellipseg_ros.io.bag import BagSink
from ellipseg_ros.io.raw_bag import write_message
from ellipseg_ros.io.sources import SIMULATED, Source
from ellipseg_ros.poses.placer import RawEvent
from ellipseg_ros.records import Sweep
from ellipseg_ros.simulation.lidar_drive import LidarDrive
from ellipseg_ros.simulation.sensor_drive import SensorDrive

RAW_OPTIONS = ("vendor", "missing", "stamp", "odometry_stamp", "odometry_rate")


def run(args: Namespace) -> int:
    """Write the bag; returns the exit code."""
    source = open_input(f"{SIMULATED}{args.scene}", args)
    points, frame_id = 0, source.frame_id
    messages = _messages(source, args)
    with BagSink(Path(args.output)) as bag, progress_bar(source.count, "clouds", args) as bar:
        for time_ns, event in messages:
            write_message(bag, time_ns, event)
            if isinstance(event, Sweep):
                points, frame_id = points + len(event), event.frame_id
                bar.update()
    summary = {"bag": args.output, "points": points, "clouds": source.count}
    if args.json:
        print(json.dumps(summary | {"topic": "/points", "frame_id": frame_id}, indent=2))
    print_status(f"{args.output}: {points:,} points in {source.count} clouds on /points", args)
    return 0


def _messages(source: Source, args: Namespace) -> Iterable[tuple[int, RawEvent]]:
    """The messages of the bag, each with its time of publication in ns."""
    values = {name: getattr(args, name) for name in RAW_OPTIONS}
    values = {name: value for name, value in values.items() if value is not None}
    if not args.raw:
        if values:
            raise EllipsegError(f"--{next(iter(values)).replace('_', '-')} needs --raw")
        return ((sweep.stamp_ns, sweep) for sweep in source)
    if not isinstance(source.events, LidarDrive):
        raise EllipsegError("--raw needs a lidar that sees all around, such as --lidar hdl64e")
    return SensorDrive(source.events, **values)
