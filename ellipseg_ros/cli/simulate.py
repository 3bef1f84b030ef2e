"""`ellipseg simulate`: write a drive through a simulated scene as a bag."""

import json
from argparse import Namespace
from pathlib import Path

from ellipseg_ros.cli.report import print_status, progress_bar
from ellipseg_ros.cli.sources import open_input
from ellipseg_ros.io.bag import BagSink
from ellipseg_ros.io.sources import SIMULATED


def run(args: Namespace) -> int:
    """Write the bag; returns the exit code."""
    source = open_input(f"{SIMULATED}{args.scene}", args)
    points = 0
    with BagSink(Path(args.output)) as bag, progress_bar(source.count, "clouds", args) as bar:
        for sweep in source:
            bag.write_event(sweep)
            points += len(sweep)
            bar.update()
    summary = {"bag": args.output, "points": points, "clouds": source.count}
    if args.json:
        print(json.dumps(summary | {"topic": "/points", "frame_id": source.frame_id}, indent=2))
    print_status(f"{args.output}: {points:,} points in {source.count} clouds on /points", args)
    return 0
