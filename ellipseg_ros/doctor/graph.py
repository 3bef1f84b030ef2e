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
        settings = "ROS_DOMAIN_ID, discovery range, middleware and firewall of all machines"
        yield warn("there is no other node", f"start a node, or compare {settings}")
    yield from _publishers(graph)
    yield from _mismatches(graph.topic)
    if graph.topic.publishers:
        yield from check_clouds(graph, receive_buffer)
    yield from _segmenters(graph)


def _publishers(graph: GraphSnapshot) -> Iterator[Finding]:
    name, remapping = graph.topic.name, _remapping(graph)
    wrong_types = {end.msg_type for end in graph.topic.publishers} - {CLOUD}
    if wrong_types:
        text = f"{name} is published as {', '.join(sorted(wrong_types))}, not as {CLOUD}"
        yield error(text, remapping or "give the topic with the clouds")
    publishers = [end for end in graph.topic.publishers if end.msg_type == CLOUD]
    if not graph.topic.publishers:
        remedy = "start the lidar odometry, or `ellipseg replay` a recording"
        yield error(f"{name} has no publisher", remapping or remedy)
    elif len(publishers) > 1:
        nodes = ", ".join(end.node for end in publishers)
        remedy = "correct only if their clouds are registered in one frame, with one clock"
        yield warn(f"{len(publishers)} publishers of {name}: {nodes}", remedy)
    elif publishers:
        yield ok(f"{name} is published by {publishers[0].node} ({publishers[0].qos})")


def _remapping(graph: GraphSnapshot) -> str:
    """The command that subscribes to another topic with clouds; empty if there is none."""
    other = graph.other_cloud_topics
    topics = [name for name in other if not name.endswith(SEGMENTED_POINTS.name)]
    if not topics:
        return ""
    base = graph.topic.name.rpartition("/")[2]
    command = f"ros2 run ellipseg_ros segmenter --ros-args -r {base}:={topics[0]}"
    return f"clouds are on {', '.join(topics)}; `{command}`"


def _mismatches(topic: Topic) -> Iterator[Finding]:
    for text in topic.mismatches:
        remedy = "segmenter: input_reliability auto; viewer: reliability best effort, volatile"
        yield error(f"{topic.name}: incompatible QoS, nothing is received: {text}", remedy)


def _segmenters(graph: GraphSnapshot) -> Iterator[Finding]:
    for name in sorted(name for name, count in Counter(graph.nodes).items() if count > 1):
        text = f"several nodes are named {name}: services and parameters reach any of them"
        yield error(text, "start them with different names: `-r __node:=` or `-r __ns:=`")
    namespaces = Counter(segmenter.node.rpartition("/")[0] for segmenter in graph.segmenters)
    for namespace, count in namespaces.items():
        if count > 1:
            where = f"{count} segmenters in the namespace {namespace or '/'}"
            remedy = "give each a namespace: `-r __ns:=/front`"
            yield error(f"{where} publish conflicting ids", remedy)
    if not graph.segmenters:
        remedy = f"ros2 run ellipseg_ros segmenter --ros-args -r points:={_cloud_topic(graph)}"
        yield warn(f"no segmenter runs in the namespace {graph.namespace}", remedy)
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
        remedy = "wait until it logs `ready`: the first start compiles its kernels, half a minute"
        yield warn(f"{segmenter.node} has not subscribed to clouds yet", remedy)
    for topic in segmenter.inputs:
        text = f"{segmenter.node} subscribes to {topic.name}"
        if topic.name != graph.topic.name and topic.publishers:
            yield ok(f"{text}, not to {graph.topic.name}")
        elif topic.name != graph.topic.name:
            remedy = f"start it with `-r points:={_cloud_topic(graph)}`"
            yield error(f"{text}, which has no publisher", remedy)


def _health(segmenter: SegmenterInfo, seconds: float) -> Finding:
    if segmenter.level is None:
        text = f"no /diagnostics of {segmenter.node} within {seconds:g} s"
        return error(text, "it publishes every second: read its log, restart it if it hangs")
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
        remedy = "read its log; with DDS security, allow the requests in the policy"
        yield error(f"{segmenter.node} does not respond on its parameter services", remedy)
        return
    simulated = segmenter.parameters.get("use_sim_time")
    if simulated and not graph.has_clock:
        remedy = "publish it (`ros2 bag play --clock`, `ellipseg replay`), or set it to false"
        yield warn(f"{segmenter.node} has use_sim_time, and /clock has no publisher", remedy)
    elif graph.has_clock and not simulated:
        text = f"{segmenter.node} has no use_sim_time though there is a /clock"
        yield ok(f"{text}, which affects only the stamps of its /diagnostics")


def _outputs(segmenter: SegmenterInfo) -> Iterator[Finding]:
    subscribed = [
        f"{topic.name.rpartition('/')[2]} by {', '.join(end.node for end in topic.subscribers)}"
        for topic in segmenter.outputs
        if topic.subscribers
    ]
    if subscribed:
        yield ok(f"subscribers of {segmenter.node}: {'; '.join(subscribed)}")
    else:
        remedy = "rviz2 -d config/ellipseg.rviz, or `ros2 topic echo` of segments"
        yield warn(f"{segmenter.node} has no subscribers, so it builds no messages", remedy)
    for topic in segmenter.outputs:
        yield from _mismatches(topic)
