"""`ellipseg segment`: a recording through the segmenter, as the node would do it, without ROS."""

from argparse import Namespace
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack
from pathlib import Path

from ellipseg_ros.cli.report import Meter, heading, progress, say, show
from ellipseg_ros.cli.results import BAG, finish, prepare
from ellipseg_ros.cli.settings import Settings, read_settings
from ellipseg_ros.cli.sources import open_input
from ellipseg_ros.config import Config
from ellipseg_ros.io.bag import BagSink
from ellipseg_ros.io.sources import Source
from ellipseg_ros.node.grouping import updates
from ellipseg_ros.node.stamps import StampMonitor
from ellipseg_ros.records import Segmentation, Sweep
from ellipseg_ros.segmenter import Segmenter, warm_up


def run(args: Namespace) -> int:
    """Segment `args.source` and write the results; returns the exit code."""
    settings = read_settings(args)
    source = open_input(args.source, args)
    folder = Path(args.output or f"{source.name}_segmented")
    prepare(folder, args.source)
    say("compiling kernels, which takes longer the first time ...", args)
    warm_up()
    meter = _segment(source, settings, folder, args)
    summary = heading(args.source, source.frame_id, settings) | meter.summary()
    finish(folder, summary, meter.last, args)
    show(summary, args)
    return 0


def run_updates(
    sweeps: Iterable[Sweep], config: Config, meter: Meter
) -> Iterator[tuple[Sweep, Segmentation]]:
    """Yield the joined sweeps of every update and what they give, timed: the node's work."""
    segmenter = Segmenter(config)
    for group in updates(sweeps, config):
        with meter.update(group):
            found = segmenter.process(group)
        meter.take(group, found)
        yield group, found


def _segment(source: Source, settings: Settings, folder: Path, args: Namespace) -> Meter:
    """Run all updates, into a bag if one is wanted."""
    meter = Meter()
    with ExitStack() as stack:
        bar = stack.enter_context(progress(source.count, "clouds", args))
        listeners: list[Callable[[Sweep], object]] = [
            lambda _: bar.update(),
            _look_at_stamps(settings.config, args),
        ]
        bag = None
        if not args.no_bag:
            bag = stack.enter_context(BagSink(folder / BAG, settings.node))
            listeners.append(bag.write_points)
        for _, found in run_updates(_overheard(source, listeners), settings.config, meter):
            if found.restart:
                say(f"the window begins anew: {found.restart}", args)
            if bag is not None:
                bag.write_update(found)
    return meter


def _look_at_stamps(config: Config, args: Namespace) -> Callable[[Sweep], None]:
    """What tells of stamps that stand still or jump forward, as the node does."""
    stamps = StampMonitor()

    def look(sweep: Sweep) -> None:
        if text := stamps.check(sweep, config.window_duration, config.max_lateness):
            say(text, args)

    return look


def _overheard(
    sweeps: Iterable[Sweep], listeners: list[Callable[[Sweep], object]]
) -> Iterator[Sweep]:
    """The same sweeps, each shown to the listeners as it passes."""
    for sweep in sweeps:
        for listen in listeners:
            listen(sweep)
        yield sweep
