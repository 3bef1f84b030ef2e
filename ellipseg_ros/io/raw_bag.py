"""Bags of raw sensor data: clouds in the sensor's frame with an odometry, or with tf."""

from collections.abc import Iterable, Iterator
from pathlib import Path

from ellipseg_ros.io.bag import BagSink
from ellipseg_ros.io.pointcloud2 import with_xyz, write_cloud
from ellipseg_ros.io.topics import POINTS
from ellipseg_ros.poses.placer import RawEvent, TransformSample, stamp_of
from ellipseg_ros.records import Sweep


def write_raw_bag(path: Path, events: Iterable[RawEvent]) -> None:
    """Write a new bag (mcap, zstd) whose messages are the events, in their order.

    Clouds go to /points, poses to /odometry, transforms to /tf and /tf_static, with their own
    stamps. Raises InputError if the path exists or can't be written.
    """
    with BagSink(path) as sink:
        for time_ns, event in _recorded(events):
            sink.write_event(event, time_ns)


def write_message(bag: BagSink, time_ns: int, event: RawEvent) -> None:
    """Write one message at a time of recording; a cloud with its fields alone, as a driver does.

    BagSink.write_event instead adds the times of points that a reader would not read exactly.
    """
    if not isinstance(event, Sweep):
        bag.write_event(event, time_ns)
        return
    fields = with_xyz(event.points, event.fields, max_rounding=0.0)
    bag.write(f"/{POINTS.name}", time_ns, write_cloud(fields, event.stamp_ns, event.frame_id))


def _recorded(events: Iterable[RawEvent]) -> Iterator[tuple[int, RawEvent]]:
    """The events, each with a time of recording that keeps their order.

    It is the stamp, or 1 ns after the event before if that is later. The stamps of static
    transforms, often 0, mean nothing: they are recorded with the event that follows.
    """
    time_ns = 0
    waiting: list[RawEvent] = []
    for event in events:
        waiting.append(event)
        if isinstance(event, TransformSample) and event.static:
            continue
        for each in waiting:
            time_ns = max(time_ns + 1, stamp_of(event))
            yield time_ns, each
        waiting.clear()
    for number, event in enumerate(waiting, 1):
        yield time_ns + number, event
