"""Checks of a recording: how its clouds are understood, and whether poses place them."""

from collections import Counter
from collections.abc import Iterator

from ellipseg_ros.doctor.findings import Finding, error, ok, warn
from ellipseg_ros.doctor.stamp_meaning import MEANINGS, StampScores, compare_stamps
from ellipseg_ros.errors import EllipsegError
from ellipseg_ros.io.frames import looks_like_a_sensor
from ellipseg_ros.io.sources import Source
from ellipseg_ros.poses.placement import Unplaced
from ellipseg_ros.poses.placer import Placer, outcomes
from ellipseg_ros.poses.point_times import point_times
from ellipseg_ros.records import Sweep

CHECKED_CLOUDS = 100  # that are placed to say how many can be


def check_recording(source: Source) -> Iterator[Finding]:
    """Findings about the clouds of a source and their poses."""
    cloud = next((event for event in source.events if isinstance(event, Sweep)), None)
    if cloud is None:
        yield error(f"{source.name} has no clouds", "give the topic of the clouds: --topic")
        return
    yield _times(cloud)
    if not source.about_poses:
        yield _frame(cloud.frame_id)
        return
    yield ok(f"the clouds are in frame {cloud.frame_id!r}; poses: {source.about_poses}")
    yield from _placed(source)
    if source.placement.pose_source == "odometry" and source.count:
        scores = compare_stamps(source.events, source.count, source.placement)
        yield _stamps(scores, source.placement.odometry_stamp)


def _times(cloud: Sweep) -> Finding:
    """How the times of points are read."""
    try:
        times = None if cloud.fields is None else point_times(cloud.fields, cloud.stamp_ns)
    except EllipsegError as problem:
        return warn(f"{problem}", "set time_field and time_unit, or deskew off")
    if times is None or not times.meaning:
        return ok("the points have no times, so clouds are not deskewed")
    span_ms = (times.offsets_ns.max(initial=0) - times.offsets_ns.min(initial=0)) / 1e6
    return ok(f"times of points: {times.meaning}, over {span_ms:.1f} ms")


def _frame(frame_id: str) -> Finding:
    if looks_like_a_sensor(frame_id):
        remedy = "give their poses: --odometry with a topic, /tf, a file of poses, or kiss-icp"
        return warn(f"the clouds are in frame {frame_id!r}, probably that of a sensor", remedy)
    return ok(f"the clouds are registered, in frame {frame_id!r}")


def _placed(source: Source) -> Iterator[Finding]:
    """How many of the first clouds are placed, and why others are not."""
    reasons: Counter[str] = Counter()
    placed = 0
    for outcome in outcomes(source.events, Placer(source.placement)):
        if isinstance(outcome, Sweep):
            placed += 1
        else:
            kind = "cloud not placed" if isinstance(outcome, Unplaced) else "pose refused"
            reasons[f"{kind}: {outcome.text}"] += 1
        if placed + sum(reasons.values()) >= CHECKED_CLOUDS:
            break
    yield (
        ok(f"{placed} clouds are placed")
        if placed
        else error(
            "no cloud is placed", "correct what follows; docs/reference/nodes.md lists the reasons"
        )
    )
    for text, count in reasons.most_common(3):
        yield warn(f"{count} times: {text}", "docs/reference/nodes.md lists the reasons")


def _stamps(found: StampScores, present: str) -> Finding:
    """The recommended meaning of the odometry's stamps, with the scores."""
    listed = ", ".join(
        f"{1e3 * score:.1f} mm as {MEANINGS[name]}" for name, score in found.scores.items()
    )
    if not listed:
        text = f"{found.pairs} pairs of sweeps do not show what the odometry's stamps mean"
        return warn(text, "use a longer recording, with walls or ground")
    text = f"neighbouring sweeps differ by {listed} ({found.pairs} pairs)"
    if not found.best:
        return ok(f"{text}: no clear difference; only changes of velocity or turn rate show one")
    same = found.best == ("scan_begin" if present == "scan_begin" else "exact")
    if same:
        return ok(f"{text}: odometry_stamp {present} is right")
    return warn(text, f"set odometry_stamp to {found.best}: --set odometry_stamp={found.best}")
