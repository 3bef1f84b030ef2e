"""Checks whether the received clouds meet the needs of the node."""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from statistics import median

from ellipseg_ros.config import Config
from ellipseg_ros.doctor.findings import Finding, error, ok, warn
from ellipseg_ros.doctor.snapshot import CloudInfo, GraphSnapshot
from ellipseg_ros.io.frames import looks_like_a_sensor
from ellipseg_ros.io.topics import TF
from ellipseg_ros.records import SECOND

GAP_RATIO = 3.0  # longest interval between clouds, in median intervals
MIN_GAP_S = 0.5  # a shorter interval is not reported
MAX_AGE_S, MAX_AHEAD_S = 0.5, 0.1  # stamps behind the system clock, and ahead of it
MAX_NAN_SHARE = 0.5  # points without coordinates


def check_clouds(graph: GraphSnapshot, receive_buffer: int | None = None) -> Iterator[Finding]:
    """Findings about the clouds; receive_buffer: of a socket, in bytes."""
    clouds = graph.clouds
    if not clouds:
        text = f"no cloud arrived on {graph.topic.name} within {graph.seconds:g} s"
        yield error(text, "check the publisher (`ros2 topic hz`), firewalls and socket buffers")
        return
    yield from _contents(clouds)
    yield _rate(clouds)
    yield from _stamps(clouds, graph.parameter("max_lateness", Config().max_lateness))
    if not graph.has_clock and clouds[-1].stamp_ns:
        yield _age(median(cloud.age for cloud in clouds))
    yield from _frames(graph)
    if rate := _points_per_second(clouds):
        limited = _thinned(rate, graph)
        thinned = f", thinned to {limited:,.0f} (max_points_per_second)" if limited < rate else ""
        yield ok(f"{rate:,.0f} points per second{thinned}")
    largest = max(cloud.size for cloud in clouds)
    if receive_buffer is not None and largest > receive_buffer:
        enough = 1 << (4 * largest - 1).bit_length()
        sizes = f"{largest / 2**10:.0f} KiB, a socket buffer {receive_buffer / 2**10:.0f} KiB"
        text = f"a cloud has up to {sizes}: clouds from another machine may be lost"
        yield warn(text, f"sudo sysctl -w net.core.rmem_max={enough}")


def check_speed(speed: float, graph: GraphSnapshot | None) -> Finding:
    """Finding about the speed of this machine, in points/s, and the density of the clouds."""
    text = f"this machine segments about {speed:,.0f} points per second (window of 5 s)"
    rate = 0.0 if graph is None else _thinned(_points_per_second(graph.clouds), graph)
    if not rate:
        return ok(text)
    text += f"; the clouds have {rate:,.0f}"
    if rate <= speed:
        return ok(text)
    limit = f"{max(1000, round(0.5 * speed, -3)):.0f}"
    remedy = f"set max_points_per_second to {limit}, then watch the latency in /diagnostics"
    return warn(f"{text}, more than can be segmented in real time", remedy)


def _contents(clouds: Sequence[CloudInfo]) -> Iterator[Finding]:
    problems = [cloud.problem for cloud in clouds if cloud.problem]
    good = [cloud for cloud in clouds if not cloud.problem]
    if problems:
        text = f"{len(problems)} of {len(clouds)} clouds can't be used: {problems[-1]}"
        remedy = "correct the publisher; docs/guide/sensors.md describes what a cloud must have"
        yield (warn if good else error)(text, remedy)
    if not good:
        return
    times = good[-1].times or "none"
    optional = "" if "intensity" in good[-1].fields else "; no intensity, which is optional"
    yield ok(f"fields {', '.join(good[-1].fields)}; times of points: {times}{optional}")
    points = sum(cloud.points for cloud in good)
    missing = points - sum(cloud.finite for cloud in good)
    if missing == points:
        text = "no point has coordinates: all are NaN" if points else "every cloud is empty"
        yield error(text, "check the input of the publisher")
    elif missing > MAX_NAN_SHARE * points:
        text = f"{missing / points:.0%} of the points are NaN, which costs bandwidth"
        yield warn(text, "publish clouds without the rays that hit nothing")


def _rate(clouds: Sequence[CloudInfo]) -> Finding:
    gaps = [b.arrived - a.arrived for a, b in pairwise(clouds)]
    if not gaps:
        return warn("only one cloud arrived", "observe for longer: --seconds 20")
    usual, longest = median(gaps), max(gaps)
    rate = len(gaps) / max(sum(gaps), 1e-9)
    jitter = median(abs(gap - usual) for gap in gaps)
    text = f"{rate:.1f} clouds per second, jitter {1e3 * jitter:.0f} ms"
    if longest <= max(GAP_RATIO * usual, MIN_GAP_S):
        return ok(text)
    remedy = "check the load of publisher and network: `ros2 topic delay`, `top`"
    return warn(f"{text}; none arrived for {longest:.1f} s", remedy)


def _stamps(clouds: Sequence[CloudInfo], lateness: float) -> Iterator[Finding]:
    """Findings about the order of the stamps; lateness: in s, `max_lateness`."""
    stamps = [cloud.stamp_ns for cloud in clouds]
    steps = [b - a for a, b in pairwise(stamps)]
    if len(stamps) > 2 and len(set(stamps)) == 1:
        value = "zero" if not stamps[0] else f"the same, {stamps[0] / SECOND:.3f} s"
        text = f"all stamps are {value}, so the window never moves"
        yield error(text, "have the publisher set header.stamp")
        return
    jumps = sum(step < -lateness * SECOND for step in steps)
    late = sum(step < 0 for step in steps) - jumps
    limit = f"max_lateness ({lateness:g} s)"
    if jumps:
        text = f"stamps jumped back {jumps} times by more than {limit}, each time with a restart"
        remedy = "normal for a recording in a loop; else compare the clocks of the publishers"
        yield warn(text, remedy)
    if late:
        text = f"{late} clouds arrived after later ones, within {limit}"
        yield warn(text, "they are accepted; publish in order if possible")
    if steps and not jumps and not late:
        yield ok("stamps increase")


def _age(age: float) -> Finding:
    """Finding about the median time from a stamp to the system clock, in s."""
    if -MAX_AHEAD_S <= age <= MAX_AGE_S:
        return ok(f"stamps are {1e3 * age:.0f} ms behind the clock")
    size = abs(age)
    text = f"{size:.1f} s" if size < 3600 else f"{size / 3600:.0f} h"
    side = "behind" if age > 0.0 else "ahead of"
    return warn(
        f"stamps are {text} {side} the clock",
        "no problem for updates, but for tf and RViz: play recordings with /clock and "
        "use_sim_time; synchronize the clocks of sensor and computer (chrony, PTP)",
    )


def _frames(graph: GraphSnapshot) -> Iterator[Finding]:
    frames = list(dict.fromkeys(cloud.frame_id for cloud in graph.clouds))
    placing = [segmenter.node for segmenter in graph.segmenters if segmenter.places_clouds]
    poses = f"poses on {', '.join(graph.pose_topics) or 'no topic'}"
    if len(frames) > 1:
        text = f"the frame changes: {', '.join(frames)}; every change restarts the window"
        yield error(text, "publish the clouds of a topic in one frame")
    for frame in frames:
        if not frame:
            yield warn("header.frame_id is empty, so RViz shows nothing", "set it to odom")
        elif looks_like_a_sensor(frame) and placing:
            yield ok(f"frame {frame}, placed by the poses that {placing[0]} takes; {poses}")
        elif looks_like_a_sensor(frame):
            text = f"frame {frame} is probably that of a sensor: a moving sensor smears the window"
            yield warn(f"{text}; {poses}", _pose_remedy(graph.pose_topics))
        else:
            yield ok(f"frame {frame}")


def _pose_remedy(topics: Sequence[str]) -> str:
    """How the segmenter gets the poses that the topics of a graph offer."""
    ways = [
        "-p fixed_frame:=odom" if topic == TF.name else f"-r odometry:={topic}" for topic in topics
    ]
    if not ways:
        return "start a lidar odometry, or publish registered clouds: docs/guide/sensors.md"
    return f"start the segmenter with {' or '.join(f'`{way}`' for way in ways)}"


def _points_per_second(clouds: Sequence[CloudInfo]) -> float:
    """Rate of finite points; 0 if it can't be computed from the clouds."""
    seconds = clouds[-1].arrived - clouds[0].arrived if clouds else 0.0
    return sum(cloud.finite for cloud in clouds[1:]) / seconds if seconds else 0.0


def _thinned(rate: float, graph: GraphSnapshot) -> float:
    """Rate of the points that the node segments of those received."""
    limit = graph.parameter("max_points_per_second", Config().max_points_per_second)
    return min(rate, limit) if limit > 0.0 else rate
