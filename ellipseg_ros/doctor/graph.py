"""Whether those who should talk to each other do: publishers, segmenters, subscribers."""

from collections import Counter
from collections.abc import Iterator

from ellipseg_ros.doctor.clouds import check_clouds
from ellipseg_ros.doctor.findings import Finding, error, ok, warn
from ellipseg_ros.doctor.seen import Graph, SegmenterSeen, Topic

CLOUD = "sensor_msgs/msg/PointCloud2"
OUTPUTS = ("segmented_points", "ellipsoids", "segments", "landmarks", "tuning_curve")


def check(graph: Graph, receive_buffer: int | None = None) -> Iterator[Finding]:
    """Yield what there is to say of a graph; receive_buffer: bytes, largest of a socket."""
    if not graph.nodes:
        yield warn(
            "nobody else is there",
            "start something, or compare ROS_DOMAIN_ID, discovery range, middleware and firewall "
            "with those of the other terminals and machines",
        )
    yield from _publishers(graph)
    yield from _mismatches(graph.topic)
    if graph.topic.publishers:
        yield from check_clouds(graph, receive_buffer)
    yield from _segmenters(graph)


def _publishers(graph: Graph) -> Iterator[Finding]:
    name = graph.topic.name
    kinds = {end.kind for end in graph.topic.publishers}
    if kinds - {CLOUD}:
        yield error(
            f"{name} is published as {', '.join(sorted(kinds - {CLOUD}))}, not as {CLOUD}",
            _remapping(graph, "give the topic with the clouds"),
        )
    senders = [end for end in graph.topic.publishers if end.kind == CLOUD]
    if not graph.topic.publishers:
        yield error(
            f"nobody publishes {name}",
            _remapping(graph, "start the lidar odometry, or `ellipseg replay` with a recording"),
        )
    elif len(senders) > 1:
        yield warn(
            f"{len(senders)} publishers of {name}: {', '.join(end.node for end in senders)}",
            "fine, if their clouds are registered in one frame, by one clock",
        )
    elif senders:
        how = f"{senders[0].reliability}, {senders[0].durability}"
        yield ok(f"{name} is published by {senders[0].node} ({how})")


def _remapping(graph: Graph, otherwise: str) -> str:
    """What to type to hear the clouds that there are."""
    others = [name for name in graph.elsewhere if not name.endswith("segmented_points")]
    if not others:
        return otherwise
    base = graph.topic.name.rpartition("/")[2]
    return (
        f"clouds are on {', '.join(others)}; `ros2 run ellipseg_ros segmenter --ros-args "
        f"-r {base}:={others[0]}`"
    )


def _mismatches(topic: Topic) -> Iterator[Finding]:
    for text in topic.mismatches:
        yield error(
            f"{topic.name}: QoS does not match, nothing arrives: {text}",
            "offer what is asked for: a segmenter with input_reliability auto and a viewer with "
            "reliability best effort and durability volatile match everybody",
        )


def _segmenters(graph: Graph) -> Iterator[Finding]:
    for name in graph.twins:
        yield error(
            f"several nodes are named {name}: services and parameters reach any of them",
            "end one of them, or start it with `-r __node:=` or `-r __ns:=` and another name",
        )
    crowded = Counter(one.node.rpartition("/")[0] for one in graph.segmenters)
    for namespace, count in crowded.items():
        if count > 1:
            yield error(
                f"{count} segmenters in the namespace {namespace or '/'}: they publish on the "
                "same topics, and their ids mean different things",
                "give each a namespace: `-r __ns:=/front`",
            )
    if not graph.segmenters:
        yield warn(
            f"no segmenter runs in the namespace {graph.namespace}",
            f"ros2 run ellipseg_ros segmenter --ros-args -r points:={_clouds_of(graph)}",
        )
    for one in graph.segmenters:
        yield from _segmenter(one, graph)


def _clouds_of(graph: Graph) -> str:
    return graph.topic.name if graph.topic.publishers else (*graph.elsewhere, "TOPIC")[0]


def _segmenter(one: SegmenterSeen, graph: Graph) -> Iterator[Finding]:
    yield from _input(one, graph)
    yield _health(one, graph.seconds)
    yield from _clock(one, graph)
    heard = [
        f"{topic.name.rpartition('/')[2]} by {', '.join(end.node for end in topic.subscribers)}"
        for topic in one.outputs
        if topic.subscribers
    ]
    if heard:
        yield ok(f"{one.node} is heard: {'; '.join(heard)}")
    else:
        yield warn(
            f"nobody subscribes to what {one.node} publishes, so it builds no messages",
            "rviz2 -d config/ellipseg.rviz, or `ros2 topic echo` of segments",
        )
    for topic in one.outputs:
        yield from _mismatches(topic)


def _input(one: SegmenterSeen, graph: Graph) -> Iterator[Finding]:
    if not one.inputs:
        yield warn(
            f"{one.node} does not subscribe to clouds yet",
            "wait until its log says `ready`: the first time it compiles its kernels, which takes "
            "half a minute",
        )
    for topic in one.inputs:
        if topic.name != graph.topic.name and not topic.publishers:
            yield error(
                f"{one.node} subscribes to {topic.name}, which nobody publishes",
                f"start it with `-r points:={_clouds_of(graph)}`",
            )
        elif topic.name != graph.topic.name:
            yield ok(f"{one.node} subscribes to {topic.name}, not to {graph.topic.name}")


def _health(one: SegmenterSeen, seconds: float) -> Finding:
    if one.level is None:
        return error(
            f"no /diagnostics of {one.node} within {seconds:g} s; they should come every second",
            "look at its log; restart it if it does not answer",
        )
    text = f"{one.node} says: {one.message}"
    latency, waiting = one.values.get("latency median [s]"), one.values.get("updates waiting")
    if latency:
        text += f" (latency {latency} s, {waiting} updates waiting)"
    if not one.level:
        return ok(text)
    return (warn if one.level == 1 else error)(text, "README.md says what to do: /diagnostics")


def _clock(one: SegmenterSeen, graph: Graph) -> Iterator[Finding]:
    if not one.parameters:
        yield error(
            f"{one.node} does not answer on its parameter services",
            "look at its log; with DDS security, allow the requests in the policy",
        )
        return
    simulated = one.parameters.get("use_sim_time")
    if simulated and not graph.clock:
        yield warn(
            f"{one.node} has use_sim_time, and nobody publishes /clock",
            "publish it (`ros2 bag play --clock`, `ellipseg replay`), or set it to false",
        )
    elif graph.clock and not simulated:
        yield ok(
            f"{one.node} has no use_sim_time beside a /clock: only the stamps of its "
            "/diagnostics differ, as updates go by the stamps of the clouds"
        )
