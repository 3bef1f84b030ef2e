"""`ellipseg segment`: segment a recording like the node does, without ROS."""

import time
from argparse import Namespace
from collections.abc import Iterable, Iterator
from contextlib import nullcontext
from pathlib import Path

from ellipseg_ros.cli import results
from ellipseg_ros.cli.report import Meter, compile_kernels, heading, print_status, progress_bar
from ellipseg_ros.cli.settings import Settings, read_settings
from ellipseg_ros.cli.sources import open_input
from ellipseg_ros.config import Config
from ellipseg_ros.io.bag import BagSink
from ellipseg_ros.io.sources import Source
from ellipseg_ros.node.grouping import updates
from ellipseg_ros.node.stamps import StampMonitor
from ellipseg_ros.records import Segmentation, Sweep
from ellipseg_ros.segmenter import Segmenter


def run(args: Namespace) -> int:
    """Segment `args.source` and write the results; returns the exit code."""
    results.require_plots(args)
    settings = read_settings(args)
    source = open_input(args.source, args, settings.placement)
    folder = Path(args.output or f"{source.name}_segmented")
    results.prepare(folder, args.source)
    compile_kernels(args)
    meter = _segment(source, settings, folder, args)
    summary = heading(args.source, source.frame_id, settings) | meter.summary()
    results.finish(folder, summary, meter.last, args)
    return 0


def run_updates(
    sweeps: Iterable[Sweep], config: Config, meter: Meter
) -> Iterator[tuple[Sweep, Segmentation]]:
    """Yield the joined sweeps of every update with their result, timed by the meter."""
    segmenter = Segmenter(config)
    for group in updates(sweeps, config):
        start = time.perf_counter()
        result = segmenter.process(group)
        meter.add(group, result, time.perf_counter() - start)
        yield group, result


def _segment(source: Source, settings: Settings, folder: Path, args: Namespace) -> Meter:
    """Run all updates; write input and results to a bag unless there is --no-bag."""
    meter, stamps, config = Meter(), StampMonitor(), settings.config
    sink = nullcontext() if args.no_bag else BagSink(folder / results.BAG, settings.node)
    with progress_bar(source.count, "clouds", args) as bar, sink as bag:

        def observed() -> Iterator[Sweep]:
            """Yield the sweeps; report unusual stamps of each, and write it to the bag."""
            for sweep in source:
                bar.update()
                warning = stamps.check(sweep, config.window_duration, config.max_lateness)
                if warning:
                    print_status(warning, args)
                if bag is not None:
                    bag.write_event(sweep)
                yield sweep

        for _, result in run_updates(observed(), config, meter):
            if result.restart:
                print_status(f"the window restarts: {result.restart}", args)
            if bag is not None:
                bag.write_update(result)
    for text in source.problems.values():
        print_status(f"not all could be used: {text}", args)
    return meter
