"""Odd clouds, bytes that are not a message, and a very large cloud, sent to a running node."""

from dataclasses import dataclass, replace

from ellipseg_ros.cli.node_process import START_TIMEOUT_S
from ellipseg_ros.config import Config, NodeConfig
from ellipseg_ros.records import SECOND
from ellipseg_ros.settings import flatten
from studies.endurance.cloud_messages import Cloud, Header, Time, large_cloud, serialized
from studies.endurance.conversion import Consumer, Tally
from studies.endurance.idle_report import idle_report
from studies.endurance.odd_clouds import odd_cloud
from studies.endurance.ros.raw_publisher import RawPublisher
from studies.endurance.running import Session, running
from studies.report.timing import timed

CONFIG = Config(window_duration=2.0, update_period=0.3)
TIMEOUT_S = 300.0  # 2 million points take a minute on two busy cores
MAX_REPORTS = 300  # /diagnostics, one a second, until the odd clouds must be processed


@dataclass(frozen=True)
class LiveResult:
    """Counts and diagnostics of a node that was sent odd input."""

    tally: Tally  # of the same clouds without the node
    report: dict[str, str]  # diagnostics after the odd clouds
    garbage: int  # messages that are not a cloud
    after_garbage: int  # clouds received after them, of one that was sent
    large_s: float  # from the large cloud sent to its segments received
    large_report: dict[str, str]  # diagnostics after it
    before_mb: float  # peak memory of the node before the large cloud
    peak_mb: float  # and after it


def send_odd_clouds(seed: int, cases: int, large: int) -> LiveResult:
    """Send odd clouds, then garbage, a cloud of `large` points, and a small one.

    Raises EllipsegError if the node ends or stops publishing.
    """
    tally = Tally()
    offline = Consumer(CONFIG, tally)
    with running(_settings(cases)) as session:
        with RawPublisher("points", session.ros_args) as publisher:
            session.subscriber.wait_for_topics(START_TIMEOUT_S)
            publisher.wait_for_subscriber(START_TIMEOUT_S)
            for case in range(cases):
                cloud = after_transport(odd_cloud(seed, case))
                publisher.send(serialized(cloud))
                offline.process(str(case), cloud)
            publisher.wait_for_acknowledgement(TIMEOUT_S)
            report = idle_report(session.subscriber, MAX_REPORTS, TIMEOUT_S)
            invalid = garbage(serialized(large_cloud(100)))
            for message in invalid:
                publisher.send(message)
            publisher.wait_for_acknowledgement(TIMEOUT_S)
            after, before_mb = _small_cloud(session, publisher, large)
            seconds, large_report = _large_cloud(session, publisher, large)
            peak_mb = session.node.peak_memory_mb()
    return LiveResult(
        tally, report, len(invalid), after, seconds, large_report, before_mb, peak_mb
    )


def _settings(cases: int) -> dict[str, object]:
    """Parameters of the node that are not defaults."""
    settings = flatten(CONFIG) | {"input_depth": 10 * cases, "max_backlog": 0}
    settings["input_reliability"] = "reliable"
    defaults = flatten(Config()) | flatten(NodeConfig())
    return {name: value for name, value in settings.items() if value != defaults[name]}


def after_transport(cloud: Cloud) -> Cloud:
    """The cloud as DDS delivers it: strings end before the first NUL."""
    fields = [replace(field, name=field.name.partition("\0")[0]) for field in cloud.fields]
    frame = cloud.header.frame_id.partition("\0")[0]
    return replace(cloud, header=Header(cloud.header.stamp, frame), fields=fields)


def garbage(valid: bytes) -> list[bytes]:
    """Messages that start like `valid` and are truncated or state wrong lengths."""
    long = b"\xff\xff\xff\x7f"
    return [
        *(valid[:size] for size in (4, 10, 40, 100, len(valid) - 5)),
        valid[:12] + long + valid[16:],  # the length of frame_id
        *(valid[:at] + long + valid[at + 4 :] for at in (24, 28, 32)),
        valid[:4] + b"\xff" * 200,
    ]


def _small_cloud(session: Session, publisher: RawPublisher, large: int) -> tuple[int, float]:
    """Send a cloud older than the large one; returns clouds received, and peak memory in MB."""
    subscriber = session.subscriber
    received = int(subscriber.next_report(TIMEOUT_S)["clouds received"])
    second = large_cloud(large).header.stamp.sec - 10
    publisher.send(serialized(_at(large_cloud(100), second)))
    subscriber.wait_for_update(second * SECOND, TIMEOUT_S)
    after = int(subscriber.next_report(TIMEOUT_S)["clouds received"])
    return after - received, session.node.peak_memory_mb()


def _large_cloud(
    session: Session, publisher: RawPublisher, points: int
) -> tuple[float, dict[str, str]]:
    """Send a large cloud, then a small one; returns s until the update, and diagnostics."""
    subscriber = session.subscriber
    cloud = large_cloud(points)
    second = cloud.header.stamp.sec
    message = serialized(cloud)

    def send_and_wait() -> int:
        publisher.send(message)
        return subscriber.wait_for_update(second * SECOND, TIMEOUT_S)

    seconds, _ = timed(send_and_wait)
    report = subscriber.next_report(TIMEOUT_S)
    publisher.send(serialized(_at(large_cloud(100), second + 10)))
    subscriber.wait_for_update((second + 10) * SECOND, TIMEOUT_S)
    return seconds, report


def _at(cloud: Cloud, second: int) -> Cloud:
    return replace(cloud, header=Header(Time(second, 0), cloud.header.frame_id))
