"""Whether the clouds that come are such as the node needs."""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from statistics import median

from ellipseg_ros.config import Config
from ellipseg_ros.doctor.findings import Finding, error, ok, warn
from ellipseg_ros.doctor.seen import Cloud, Graph
from ellipseg_ros.io.frames import looks_like_a_sensor
from ellipseg_ros.records import SECOND

BENCHED = 50_000  # points/s: the most for which docs/results/benchmark.md has updates in real time
GAP = 3.0  # median intervals without a cloud that are worth a word
LATE, EARLY = 0.5, 0.1  # s that stamps may be behind the clock, and ahead of it
EMPTY = 0.5  # share of points without coordinates that is worth a word


def check_clouds(graph: Graph, receive_buffer: int | None = None) -> Iterator[Finding]:
    """Yield what there is to say of the clouds that came."""
    clouds = graph.clouds
    if not clouds:
        yield error(
            f"no cloud came on {graph.topic.name} within {graph.seconds:g} s",
            "is it paused, or without input itself? `ros2 topic hz` on what it subscribes to; a "
            "firewall, or a cloud larger than the socket buffers?",
        )
        return
    yield from _contents(clouds)
    yield _rate(clouds)
    yield from _stamps(clouds, _setting(graph, "max_lateness", Config().max_lateness))
    yield from _clock(clouds, graph.clock)
    yield from _frames(clouds)
    yield from _points(clouds, graph)
    largest = max(cloud.size for cloud in clouds)
    if receive_buffer is not None and largest > receive_buffer:
        yield warn(
            f"a cloud has {largest / 2**10:.0f} KiB, a socket buffer at most "
            f"{receive_buffer / 2**10:.0f} KiB: from another machine, clouds get lost",
            f"sudo sysctl -w net.core.rmem_max={_power_of_two(4 * largest)}",
        )


def _setting(graph: Graph, name: str, default: float) -> float:
    """A parameter of the segmenter that runs, or its default."""
    known = [one.parameters[name] for one in graph.segmenters if name in one.parameters]
    return float(known[0]) if known else default


def _power_of_two(least: int) -> int:
    return 1 << (least - 1).bit_length()


def _contents(clouds: Sequence[Cloud]) -> Iterator[Finding]:
    bad = [cloud.problem for cloud in clouds if cloud.problem]
    if bad:
        some = f"{len(bad)} of {len(clouds)} clouds can't be used: {bad[-1]}"
        do = "mend the publisher; docs/guide/sensors.md says what a cloud must have"
        yield error(some, do) if len(bad) == len(clouds) else warn(some, do)
    good = [cloud for cloud in clouds if not cloud.problem]
    if good:
        own = "with" if good[-1].timed else "without"
        more = "" if "intensity" in good[-1].fields else "; no intensity, which is not needed"
        yield ok(f"fields {', '.join(good[-1].fields)}; {own} times of points{more}")
    points = sum(cloud.points for cloud in good)
    without = points - sum(cloud.finite for cloud in good)
    if good and not points:
        yield error("every cloud is empty", "look at the input of the publisher")
    elif without == points and good:
        yield error("no point has coordinates: all are NaN", "look at the input of the publisher")
    elif points and without > EMPTY * points:
        yield warn(
            f"{without / points:.0%} of the points are NaN: they cost bandwidth",
            "publish clouds without the rays that hit nothing",
        )


def _rate(clouds: Sequence[Cloud]) -> Finding:
    gaps = [b.arrived - a.arrived for a, b in pairwise(clouds)]
    if not gaps:
        return warn("a single cloud came", "listen longer: --seconds 20")
    usual, longest = median(gaps), max(gaps)
    rate = len(gaps) / max(sum(gaps), 1e-9)
    spread = median(abs(gap - usual) for gap in gaps)
    text = f"{rate:.1f} clouds a second, jitter {1e3 * spread:.0f} ms"
    if longest > max(GAP * usual, 0.5):
        return warn(
            f"{text}; none came for {longest:.1f} s",
            "is the publisher busy, or the network? `ros2 topic delay`, `top`",
        )
    return ok(text)


def _stamps(clouds: Sequence[Cloud], lateness: float) -> Iterator[Finding]:
    stamps = [cloud.stamp_ns for cloud in clouds]
    steps = [b - a for a, b in pairwise(stamps)]
    if len(stamps) > 2 and len(set(stamps)) == 1:
        where = "zero" if not stamps[0] else f"the same, {stamps[0] / SECOND:.3f} s"
        yield error(
            f"all stamps are {where}: time stands still, the window never moves",
            "have the publisher set header.stamp",
        )
        return
    jumps = sum(step < -lateness * SECOND for step in steps)
    back = sum(step < 0 for step in steps) - jumps
    if jumps:
        yield warn(
            f"stamps jumped back {jumps} times by more than max_lateness ({lateness:g} s): the "
            "window begins anew each time",
            "a recording in a loop? else, are there two publishers with clocks of their own?",
        )
    if back:
        yield warn(
            f"{back} clouds came after younger ones, within max_lateness ({lateness:g} s)",
            "they are taken; a publisher in order is better",
        )
    if steps and not jumps and not back:
        yield ok("stamps go forward")


def _clock(clouds: Sequence[Cloud], simulated: bool) -> Iterator[Finding]:
    age = median(cloud.age for cloud in clouds)
    if simulated or not clouds[-1].stamp_ns:
        return
    do = "updates go by stamps and do not mind; tf and RViz do: "
    if age > LATE:
        yield warn(
            f"stamps are {_duration(age)} behind the clock",
            f"{do}a recording? play it with /clock and use_sim_time; else, is the odometry slow, "
            "or is a clock wrong (chrony, PTP)?",
        )
    elif age < -EARLY:
        yield warn(
            f"stamps are {_duration(-age)} ahead of the clock",
            f"{do}synchronize the clocks of sensor and computer (chrony, PTP)",
        )
    else:
        yield ok(f"stamps are {1e3 * age:.0f} ms behind the clock")


def _duration(seconds: float) -> str:
    return f"{seconds:.1f} s" if seconds < 3600 else f"{seconds / 3600:.0f} h"


def _frames(clouds: Sequence[Cloud]) -> Iterator[Finding]:
    frames = list(dict.fromkeys(cloud.frame_id for cloud in clouds))
    if len(frames) > 1:
        yield error(
            f"the frame changes: {', '.join(frames)}; at every change the window begins anew",
            "one topic with clouds in one frame",
        )
    for frame in frames:
        if not frame:
            yield warn("header.frame_id is empty", "RViz shows nothing without: set it to odom")
        elif looks_like_a_sensor(frame):
            yield warn(
                f"frame {frame} looks like a sensor's: clouds of a moving sensor are smeared",
                "give the node registered clouds, in odom: docs/guide/sensors.md",
            )
        else:
            yield ok(f"frame {frame}")


def _points(clouds: Sequence[Cloud], graph: Graph) -> Iterator[Finding]:
    seconds = clouds[-1].arrived - clouds[0].arrived
    if len(clouds) < 2 or seconds <= 0.0:
        return
    rate = sum(cloud.finite for cloud in clouds[1:]) / seconds
    limit = _setting(graph, "max_points_per_second", Config().max_points_per_second)
    text = f"{rate:,.0f} points a second"
    if 0 < limit < rate:
        yield ok(f"{text}, thinned to {limit:,.0f} (max_points_per_second)")
    elif rate > BENCHED:
        yield warn(
            f"{text}; `ellipseg bench` took {BENCHED:,} in real time on two cores, in a window of "
            "5 s",
            "set max_points_per_second: 10000 to begin with, then watch the latency",
        )
    else:
        yield ok(text)
