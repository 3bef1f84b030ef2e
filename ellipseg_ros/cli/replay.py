"""`ellipseg replay`: publish a recording, a cloud or a scene on ROS topics."""

import json
from argparse import Namespace
from dataclasses import asdict

from ellipseg_ros.cli.report import print_status, progress_bar
from ellipseg_ros.cli.sources import open_input
from ellipseg_ros.io.sources import as_odometry
from ellipseg_ros.node.playback import ReplayOptions
from ellipseg_ros.ros.replayer import Replayer


def run(args: Namespace) -> int:
    """Publish until the end, or until Ctrl-C; returns the exit code."""
    options = ReplayOptions(
        rate=args.rate, loop=args.loop, start_paused=args.paused, ahead=args.ahead or 0.0
    )
    source = as_odometry(open_input(args.source, args))
    total = None if args.loop else source.count
    player = Replayer(source.events, options, placement=source.placement)
    with player as replayer, progress_bar(total, "clouds", args) as bar:
        sent = replayer.run(lambda _: bar.update())
    if args.json:
        print(json.dumps(asdict(sent), indent=2))
    text = f"{sent.points:,} points in {sent.clouds} clouds, {sent.wall_seconds:.1f} s"
    if sent.missed:
        text += f"; {sent.missed} of {sent.updates} updates were not received back"
    print_status(text, args)
    return 0
