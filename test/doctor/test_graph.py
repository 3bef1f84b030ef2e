"""Findings about running graphs and their clouds."""

from dataclasses import replace

import pytest

from ellipseg_ros.doctor import graph
from ellipseg_ros.doctor.clouds import check_speed
from ellipseg_ros.doctor.findings import ERROR, OK, WARN, Finding
from ellipseg_ros.doctor.graph import check_graph
from ellipseg_ros.doctor.snapshot import CloudInfo, Endpoint, GraphSnapshot, SegmenterInfo, Topic
from ellipseg_ros.records import SECOND


def problems(findings: list[Finding]) -> list[tuple[str, str]]:
    """Level and text of warnings and errors; each of these has a remedy, and no other finding."""
    assert all(bool(finding.remedy) == (finding.level != OK) for finding in findings)
    return [(finding.level, finding.text) for finding in findings if finding.level != OK]


def cloud(k: int, **changes: object) -> CloudInfo:
    """The k-th cloud of a correct stream with ten per second."""
    made = CloudInfo(
        arrived=100.0 + k / 10,
        age=0.05,
        stamp_ns=50 * SECOND + k * SECOND // 10,
        frame_id="odom",
        points=1000,
        finite=1000,
        size=16_000,
        fields=("x", "y", "z", "intensity"),
    )
    return replace(made, **changes)  # type: ignore[arg-type]  # any field


PUBLISHER = Endpoint("/odometry", graph.CLOUD, "reliable, volatile")
SUBSCRIBER = Endpoint("/ellipseg_segmenter", graph.CLOUD, "best_effort, volatile")
VIEWER = Endpoint("/rviz", "ellipseg_ros/msg/SegmentArray", "reliable, volatile")
POINTS = Topic("/points", (PUBLISHER,), (SUBSCRIBER,))
SEGMENTER = SegmenterInfo(
    node="/ellipseg_segmenter",
    inputs=(POINTS,),
    outputs=(Topic("/segments", (), (VIEWER,)),),
    level=0,
    message="segmenting",
    parameters={"use_sim_time": False, "max_points_per_second": 0, "max_lateness": 1.0},
)
GRAPH = GraphSnapshot(
    POINTS,
    5.0,
    tuple(map(cloud, range(40))),
    (),
    (SEGMENTER,),
    nodes=("/odometry", "/ellipseg_segmenter", "/rviz"),
)
STREAM = GRAPH.clouds


def test_good_graph_has_no_problems() -> None:
    assert problems(list(check_graph(GRAPH, receive_buffer=212_992))) == []


def stream(**changes: object) -> dict[str, object]:
    """The correct stream with the same changes in every cloud."""
    return {"clouds": tuple(replace(c, **changes) for c in STREAM)}  # type: ignore[arg-type]  # any field


RAW = "start the segmenter with `-r odometry:=/kiss/odometry`"


def segmenter(**changes: object) -> dict[str, object]:
    """The correct segmenter with changes."""
    return {"segmenters": (replace(SEGMENTER, **changes),)}  # type: ignore[arg-type]  # any field


@pytest.mark.parametrize(
    ("changes", "level", "text"),
    [
        ({"clouds": ()}, ERROR, "no cloud arrived"),
        ({"clouds": STREAM[:1]}, WARN, "only one cloud"),
        ({"clouds": (*STREAM[:9], *STREAM[25:])}, WARN, "none arrived for 1.7 s"),
        (stream(stamp_ns=0), ERROR, "zero"),
        (stream(stamp_ns=7 * SECOND), ERROR, "7.000 s"),
        ({"clouds": (*STREAM[:9], cloud(9, stamp_ns=0))}, WARN, "jumped back 1 times"),
        ({"clouds": (*STREAM[:9], cloud(9, stamp_ns=50 * SECOND))}, WARN, "after later ones"),
        (stream(age=7200.0), WARN, "2 h behind"),
        (stream(age=7200.0) | {"has_clock": True}, OK, ""),
        (stream(age=-1.5), WARN, "1.5 s ahead"),
        (stream(frame_id="velodyne"), WARN, "velodyne"),
        (stream(frame_id="velodyne"), WARN, "start a lidar odometry"),
        (stream(frame_id="velodyne") | {"pose_topics": ("/kiss/odometry",)}, WARN, RAW),
        (stream(frame_id="velodyne") | segmenter(values={"pose source": "odometry"}), OK, ""),
        (stream(frame_id=""), WARN, "frame_id is empty"),
        ({"clouds": (*STREAM[:9], cloud(9, frame_id="map"))}, ERROR, "the frame changes"),
        (stream(finite=300), WARN, "70% of the points"),
        (stream(finite=0), ERROR, "all are NaN"),
        (stream(points=0, finite=0), ERROR, "is empty"),
        ({"clouds": (*STREAM[:9], cloud(9, problem="no x"))}, WARN, "1 of 10 clouds"),
        (stream(problem="no x"), ERROR, "no x"),
        (stream(size=10**6), WARN, "rmem_max=4194304"),
        ({"topic": replace(POINTS, mismatches=("/a to /b: x",))}, ERROR, "incompatible QoS"),
        ({"topic": replace(POINTS, publishers=(PUBLISHER, PUBLISHER))}, WARN, "2 publishers"),
        ({"nodes": ("/ellipseg_segmenter",) * 2}, ERROR, "several nodes are named"),
        ({"segmenters": ()}, WARN, "no segmenter runs"),
        ({"segmenters": (SEGMENTER, replace(SEGMENTER, node="/b"))}, ERROR, "2 segmenters"),
        ({"segmenters": (SEGMENTER, replace(SEGMENTER, node="/ns/b"))}, OK, ""),
        (segmenter(inputs=()), WARN, "not subscribed to clouds yet"),
        (segmenter(inputs=(Topic("/mute"),)), ERROR, "/mute, which has no publisher"),
        (segmenter(level=1, message="slow"), WARN, "slow"),
        (segmenter(level=2, message="stuck"), ERROR, "stuck"),
        (segmenter(level=None), ERROR, "no /diagnostics"),
        (segmenter(parameters={}), ERROR, "does not respond"),
        (segmenter(parameters={"use_sim_time": True}), WARN, "/clock has no publisher"),
        (segmenter(outputs=()), WARN, "has no subscribers"),
        ({"has_clock": True}, OK, ""),
    ],
)
def test_problem_of_a_graph(changes: dict[str, object], level: str, text: str) -> None:
    changed = replace(GRAPH, **changes)  # type: ignore[arg-type]  # as given above
    findings = list(check_graph(changed, 212_992))
    assert [found_level for found_level, _ in problems(findings)] == (
        [level] if level != OK else []
    )
    assert all(text in f"{f.text} {f.remedy}" for f in findings if f.level != OK)


def test_other_cloud_topics_are_proposed_as_remapping() -> None:
    without_publisher = replace(
        GRAPH,
        topic=Topic("/points"),
        clouds=(),
        segmenters=(),
        other_cloud_topics=("/cloud_registered",),
    )
    topic, segmenter = [f for f in check_graph(without_publisher) if f.level != OK]
    assert (topic.level, topic.text) == (ERROR, "/points has no publisher")
    assert "-r points:=/cloud_registered" in topic.remedy
    assert "-r points:=/cloud_registered" in segmenter.remedy


def test_topic_of_another_type_is_an_error() -> None:
    scan = replace(PUBLISHER, msg_type="sensor_msgs/msg/LaserScan")
    findings = list(check_graph(replace(GRAPH, topic=Topic("/points", (scan,)), clouds=())))
    assert findings[0].level == ERROR and "LaserScan" in findings[0].text


def test_speed_is_compared_with_the_density_of_the_clouds() -> None:
    dense = replace(GRAPH, clouds=tuple(cloud(k, points=9000, finite=9000) for k in range(40)))
    assert check_speed(40_000.0, None).level == OK
    assert check_speed(40_000.0, GRAPH).level == OK
    assert "the clouds have 10,000" in check_speed(40_000.0, GRAPH).text
    too_dense = check_speed(40_000.0, dense)
    assert too_dense.level == WARN and "the clouds have 90,000" in too_dense.text
    assert "max_points_per_second to 20000" in too_dense.remedy
    thinning = replace(SEGMENTER, parameters={"max_points_per_second": 5000})
    thinned = replace(dense, segmenters=(thinning,))
    assert check_speed(40_000.0, thinned).level == OK
    findings = list(check_graph(thinned))
    assert problems(findings) == []
    assert any("90,000 points per second, thinned to 5,000" in f.text for f in findings)
