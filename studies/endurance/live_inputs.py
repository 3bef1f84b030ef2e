"""Odd clouds, bytes that are no message, and a cloud of millions of points to the running node."""

from dataclasses import dataclass, replace

from ellipseg_ros.cli.node_process import START_TIMEOUT_S, NodeProcess
from ellipseg_ros.config import Config, NodeConfig, flatten
from ellipseg_ros.records import SECOND
from studies.endurance.clouds import Cloud, Header, Time, large_cloud, odd_cloud, serialized
from studies.endurance.conversion import Consumer, Tally
from studies.endurance.last_word import last_word
from studies.endurance.listener_process import Listening
from studies.endurance.ros.sender import Sender
from studies.endurance.running import running
from studies.report.timing import timed

CONFIG = Config(window_duration=2.0, update_period=0.3)
PATIENCE = 300.0  # s for what was sent: 2 million points take a minute on two cores that are busy
REPORTS = 300  # /diagnostics, one a second, until the odd clouds must have been dealt with


@dataclass(frozen=True)
class Heard:
    """What came of it."""

    tally: Tally  # of the same clouds, without the node
    said: dict[str, str]  # the node's diagnostics after the odd clouds
    garbage: int  # messages of bytes that are no cloud
    after_garbage: int  # good clouds received after them, of one that was sent
    large_s: float  # from the large cloud sent to its segments received
    large: dict[str, str]  # the diagnostics then
    before_mb: float  # most memory of the node before the large cloud
    peak_mb: float  # and with it


def listen(seed: int, cases: int, large: int) -> Heard:
    """Send so many odd clouds, then garbage, then a cloud of `large` points, then a small one.

    Raises EllipsegError if the node ends, or is silent.
    """
    tally = Tally()
    twin = Consumer(CONFIG, tally)
    settings = flatten(CONFIG) | {"input_depth": 10 * cases, "max_backlog": 0}
    settings["input_reliability"] = "reliable"
    defaults = flatten(Config()) | flatten(NodeConfig())
    settings = {name: value for name, value in settings.items() if value != defaults[name]}
    with running(settings) as (listener, node, ros_args), Sender("points", ros_args) as sender:
        listener.wait_for_topics(START_TIMEOUT_S)
        sender.wait_for_listener(START_TIMEOUT_S)
        for case in range(cases):
            cloud = carried(odd_cloud(seed, case))
            sender.send(serialized(cloud))
            twin.take(str(case), cloud)
        sender.wait_for_arrival(PATIENCE)
        said = last_word(listener, REPORTS, PATIENCE)
        bad = garbage(serialized(large_cloud(100)))
        for message in bad:
            sender.send(message)
        sender.wait_for_arrival(PATIENCE)
        after, seconds, told, before = _large(listener, node, sender, large)
        return Heard(tally, said, len(bad), after, seconds, told, before, node.peak_memory_mb())


def carried(cloud: Cloud) -> Cloud:
    """The cloud as it comes over DDS, where a text ends before its first NUL."""
    fields = [replace(field, name=field.name.partition("\0")[0]) for field in cloud.fields]
    frame = cloud.header.frame_id.partition("\0")[0]
    return replace(cloud, header=Header(cloud.header.stamp, frame), fields=fields)


def garbage(good: bytes) -> list[bytes]:
    """What begins as a message and is none: cut off, or with lengths that lie."""
    long = b"\xff\xff\xff\x7f"
    return [
        *(good[:size] for size in (4, 10, 40, 100, len(good) - 5)),
        good[:12] + long + good[16:],  # the length of frame_id
        *(good[:at] + long + good[at + 4 :] for at in (24, 28, 32)),
        good[:4] + b"\xff" * 200,
    ]


def _large(
    listener: Listening, node: NodeProcess, sender: Sender, points: int
) -> tuple[int, float, dict[str, str], float]:
    """A small cloud, a large one, a small one; what was received of the first, and s, and MB."""
    received = int(listener.next_report(PATIENCE)["clouds received"])
    big = large_cloud(points)
    second = big.header.stamp.sec
    sender.send(serialized(_at(large_cloud(100), second - 10)))
    listener.wait_for_update((second - 10) * SECOND, PATIENCE)
    came = int(listener.next_report(PATIENCE)["clouds received"]) - received
    before = node.peak_memory_mb()
    message = serialized(big)

    def send_and_wait() -> int:
        sender.send(message)
        return listener.wait_for_update(second * SECOND, PATIENCE)

    seconds, _ = timed(send_and_wait)
    told = listener.next_report(PATIENCE)
    sender.send(serialized(_at(large_cloud(100), second + 10)))
    listener.wait_for_update((second + 10) * SECOND, PATIENCE)
    return came, seconds, told, before


def _at(cloud: Cloud, second: int) -> Cloud:
    return replace(cloud, header=Header(Time(second, 0), cloud.header.frame_id))
