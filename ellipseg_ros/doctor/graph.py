"""Checks of a running graph: publishers, segmenters and subscribers, and their connections."""

from collections import Counter
from collections.abc import Iterator

from ellipseg_ros.doctor.clouds import check_clouds
from ellipseg_ros.doctor.findings import Finding, error, ok, warn
from ellipseg_ros.doctor.snapshot import GraphSnapshot, SegmenterInfo, Topic
from ellipseg_ros.io.topics import CLOUD, SEGMENTED_POINTS


def check_graph(graph: GraphSnapshot, receive_buffer: int | None = None) -> Iterator[Finding]:
    """Findings about a graph; receive_buffer: maximum of a socket, in bytes."""
    if not graph.nodes:
        yield warn(
            "there is no other node",
            "start one, or compare ROS_DOMAIN_ID, discovery range, middleware and firewall with "
            "those of the other terminals and machines",
        )
    yield from _publishers(graph)
    yield from _mismatches(graph.topic)
    if graph.topic.publishers:
        yield from check_clouds(graph, receive_buffer)
    yield from _segmenters(graph)


def _publishers(graph: GraphSnapshot) -> Iterator[Finding]:
    name = graph.topic.name
    wrong_types = {end.msg_type for end in graph.topic.publishers} - {CLOUD}
    if wrong_types:
        yield error(
            f"{name} is published as {', '.join(sorted(wrong_types))}, not as {CLOUD}",
            _remapping(graph) or "give the topic with the clouds",
        )
    publishers = [end for end in graph.topic.publishers if end.msg_type == CLOUD]
    if not graph.topic.publishers:
        yield error(
            f"{name} has no publisher",
            _remapping(graph) or "start the lidar odometry, or `ellipseg replay` a recording",
        )
    elif len(publishers) > 1:
        yield warn(
            f"{len(publishers)} publishers of {name}: {', '.join(end.node for end in publishers)}",
            "correct only if their clouds are registered in one frame, with one clock",
        )
    elif publishers:
        qos = f"{publishers[0].reliability}, {publishers[0].durability}"
        yield ok(f"{name} is published by {publishers[0].node} ({qos})")


def _remapping(graph: GraphSnapshot) -> str:
    """The command that subscribes to another topic with clouds; empty if there is none."""
    other = graph.other_cloud_topics
    topics = [name for name in other if not name.endswith(SEGMENTED_POINTS.name)]
    if not topics:
        return ""
    base = graph.topic.name.rpartition("/")[2]
    return (
        f"clouds are on {', '.join(topics)}; `ros2 run ellipseg_ros segmenter --ros-args "
        f"-r {base}:={topics[0]}`"
    )


def _mismatches(topic: Topic) -> Iterator[Finding]:
    for text in topic.mismatches:
        yield error(
            f"{topic.name}: incompatible QoS, nothing is received: {text}",
            "compatible with any: a segmenter with input_reliability auto, a viewer with "
            "reliability best effort and durability volatile",
        )


def _segmenters(graph: GraphSnapshot) -> Iterator[Finding]:
    for name in graph.duplicate_names:
        yield error(
            f"several nodes are named {name}: services and parameters reach any of them",
            "end all but one, or start them with different names: `-r __node:=` or `-r __ns:=`",
        )
    namespaces = Counter(segmenter.node.rpartition("/")[0] for segmenter in graph.segmenters)
    for namespace, count in namespaces.items():
        if count > 1:
            yield error(
                f"{count} segmenters in the namespace {namespace or '/'} publish on the same "
                "topics, with conflicting ids",
                "give each a namespace: `-r __ns:=/front`",
            )
    if not graph.segmenters:
        yield warn(
            f"no segmenter runs in the namespace {graph.namespace}",
            f"ros2 run ellipseg_ros segmenter --ros-args -r points:={_cloud_topic(graph)}",
        )
    for segmenter in graph.segmenters:
        yield from _inputs(segmenter, graph)
        yield _health(segmenter, graph.seconds)
        yield from _clock(segmenter, graph)
        yield from _outputs(segmenter)


def _cloud_topic(graph: GraphSnapshot) -> str:
    if graph.topic.publishers:
        return graph.topic.name
    return (*graph.other_cloud_topics, "TOPIC")[0]


def _inputs(segmenter: SegmenterInfo, graph: GraphSnapshot) -> Iterator[Finding]:
    if not segmenter.inputs:
        yield warn(
            f"{segmenter.node} has not subscribed to clouds yet",
            "wait until it logs `ready`: the first start compiles its kernels, half a minute",
        )
    for topic in segmenter.inputs:
        if topic.name == graph.topic.name:
            continue
        if topic.publishers:
            yield ok(f"{segmenter.node} subscribes to {topic.name}, not to {graph.topic.name}")
        else:
            yield error(
                f"{segmenter.node} subscribes to {topic.name}, which has no publisher",
                f"start it with `-r points:={_cloud_topic(graph)}`",
            )


def _health(segmenter: SegmenterInfo, seconds: float) -> Finding:
    if segmenter.level is None:
        return error(
            f"no /diagnostics of {segmenter.node} within {seconds:g} s; it publishes every second",
            "read its log; restart it if it does not respond",
        )
    text = f"{segmenter.node} reports: {segmenter.message}"
    latency = segmenter.values.get("latency median [s]")
    if latency:
        waiting = segmenter.values.get("updates in backlog")
        text += f" (latency {latency} s, {waiting} updates in backlog)"
    if not segmenter.level:
        return ok(text)
    level = warn if segmenter.level == 1 else error
    return level(text, "see the table of /diagnostics in docs/reference")


def _clock(segmenter: SegmenterInfo, graph: GraphSnapshot) -> Iterator[Finding]:
    if not segmenter.parameters:
        yield error(
            f"{segmenter.node} does not respond on its parameter services",
            "read its log; with DDS security, allow the requests in the policy",
        )
        return
    simulated = segmenter.parameters.get("use_sim_time")
    if simulated and not graph.has_clock:
        yield warn(
            f"{segmenter.node} has use_sim_time, and /clock has no publisher",
            "publish it (`ros2 bag play --clock`, `ellipseg replay`), or set it to false",
        )
    elif graph.has_clock and not simulated:
        yield ok(
            f"{segmenter.node} has no use_sim_time though there is a /clock, which affects only "
            "the stamps of its /diagnostics"
        )


def _outputs(segmenter: SegmenterInfo) -> Iterator[Finding]:
    subscribed = [
        f"{topic.name.rpartition('/')[2]} by {', '.join(end.node for end in topic.subscribers)}"
        for topic in segmenter.outputs
        if topic.subscribers
    ]
    if subscribed:
        yield ok(f"subscribers of {segmenter.node}: {'; '.join(subscribed)}")
    else:
        yield warn(
            f"{segmenter.node} has no subscribers, so it builds no messages",
            "rviz2 -d config/ellipseg.rviz, or `ros2 topic echo` of segments",
        )
    for topic in segmenter.outputs:
        yield from _mismatches(topic)
