"""Subject `inputs`: odd clouds, landmarks and segments, offline and to a running node."""

from dataclasses import dataclass

from ellipseg_ros.association.associate import warm_up as warm_up_association
from ellipseg_ros.config import Config
from ellipseg_ros.node.memory import peak_mb, resident_mb
from ellipseg_ros.segmenter import warm_up
from studies.endurance.conversion import Tally, convert
from studies.endurance.live_inputs import LiveResult, send_odd_clouds
from studies.endurance.odd_landmarks import associate_odd_landmarks, mirror_odd_segments
from studies.endurance.requirements import Options, Requirement
from studies.memory import reset_peak

MAX_SECONDS = 5.0  # for an odd cloud of some thousand points
MAX_GROWTH_MB = 500.0  # of memory, by all of them
SHOWN_FAULTS = 3


@dataclass(frozen=True)
class Cases:
    """Number of cases of each kind."""

    converted: int
    sent: int
    large: int  # points of the large cloud
    landmarks: int
    segments: int


FULL = Cases(10_000, 500, 5_000_000, 2000, 5000)
QUICK = Cases(400, 60, 200_000, 50, 500)


def inputs(options: Options) -> list[Requirement]:
    """Process odd input of all kinds."""
    cases = QUICK if options.quick else FULL
    warm_up()
    warm_up_association()
    reset_peak()
    before_mb = resident_mb()
    options.log(f"inputs: {cases.converted} clouds")
    clouds = _logged(convert(options.seed, range(cases.converted)), options)
    results = converted_requirements(clouds, peak_mb() - before_mb)
    options.log(f"inputs: {cases.landmarks} lists of landmarks, {cases.segments} of segments")
    landmarks = _logged(associate_odd_landmarks(options.seed, cases.landmarks), options)
    segments = _logged(mirror_odd_segments(options.seed, cases.segments), options)
    results += [_landmarks(landmarks), _segments(segments)]
    options.log(f"inputs: {cases.sent} clouds to the node, then one of {cases.large} points")
    live = send_odd_clouds(options.seed, cases.sent, cases.large)
    return results + live_requirements(live, cases.sent, cases.large)


def _logged(tally: Tally, options: Options) -> Tally:
    for fault in tally.faults[:SHOWN_FAULTS]:
        options.log(f"inputs: {fault}")
    return tally


def converted_requirements(tally: Tally, memory_mb: float) -> list[Requirement]:
    """Requirements on the conversion of odd clouds; memory_mb: by which memory grew."""
    test = f"{tally.cases:,} generated clouds with {tally.points:,} points in those accepted"
    return [
        Requirement(
            "an odd cloud gives an update or a short error message, never an exception or a "
            "warning; every point is in the window or counted, no number is NaN or infinite, and "
            "every message can be read",
            f"{test}; {tally.updates:,} updates checked, messages of {tally.decoded:,} read",
            f"{tally.accepted:,} accepted, {tally.rejected.total():,} rejected for "
            f"{len(tally.rejected)} reasons, {len(tally.faults)} faults",
            not tally.faults and tally.decoded > 0 and len(tally.rejected) > 1,
        ),
        Requirement(
            f"none of them takes long (at most {MAX_SECONDS:g} s) or much memory (at most "
            f"{MAX_GROWTH_MB:g} MB), whatever sizes it states",
            test,
            f"at most {tally.slowest_s:.2f} s; {memory_mb:.0f} MB more than before",
            tally.slowest_s < MAX_SECONDS and memory_mb < MAX_GROWTH_MB,
        ),
    ]


def _landmarks(tally: Tally) -> Requirement:
    return Requirement(
        "the associator rejects invalid landmarks, and its results are finite",
        f"{tally.cases:,} lists of 2 to 20 landmarks with invalid numbers and lengths",
        f"{tally.updates:,} associated, {tally.rejected.total():,} rejected for "
        f"{len(tally.rejected)} reasons, {len(tally.faults)} faults",
        not tally.faults and tally.updates > 0 and tally.rejected.total() > 0,
    )


def _segments(tally: Tally) -> Requirement:
    return Requirement(
        "`SegmentMirror` reports that it is in sync only if its copy holds all points",
        f"{tally.cases:,} lists of segments with contradictions",
        f"in sync after {tally.updates:,}, {len(tally.faults)} faults",
        not tally.faults and 0 < tally.updates < tally.cases,
    )


def live_requirements(live: LiveResult, sent: int, large: int) -> list[Requirement]:
    """Requirements on a running node; sent: odd clouds. large: points of the large cloud."""
    different = count_differences(live)
    growth = live.peak_mb - live.before_mb
    evicted = int(live.large_report["points evicted"]) - live.tally.evicted
    return [
        Requirement(
            "/diagnostics of a running node count every cloud, every reason and every point",
            f"{sent} odd clouds over DDS; each count compared with that of the same clouds "
            "without the node",
            f"{live.report['clouds rejected']} of {live.report['clouds received']} rejected, "
            f"{live.report['updates']} updates; {'; '.join(different) or 'no difference'}",
            not different,
        ),
        Requirement(
            "bytes that are not a message neither end nor block the node",
            f"{live.garbage} messages that are truncated or state wrong lengths, then a valid one",
            f"{live.large_report['clouds lost by DDS']} dropped and counted as lost; "
            f"{live.after_garbage} received afterwards",
            live.after_garbage >= 1,
        ),
        Requirement(
            "a cloud of millions of points in one message is segmented, and the node continues",
            f"{large:,} points, 16 bytes each, `max_points` at its default",
            f"segments after {live.large_s:.1f} s, {growth:.0f} MB more than before; "
            f"{evicted:,} points evicted, counted; the next cloud was segmented",
            evicted == max(0, large - Config().max_points),
        ),
    ]


def count_differences(live: LiveResult) -> list[str]:
    """Counts of the node that differ from those of the same code without it."""
    tally, report = live.tally, live.report
    counts = tally.last.counts if tally.last else None
    expected = {
        "clouds received": tally.cases,
        "clouds rejected": tally.rejected.total(),
        **{f"clouds rejected: {reason}": count for reason, count in tally.rejected.items()},
        "clouds lost by DDS": 0,
        "updates": tally.updates,
        "restarts": tally.restarts,
        "points late": tally.late,
        "points evicted": tally.evicted,
        "points segmented": counts.segmented if counts else 0,
        "points isolated": counts.isolated if counts else 0,
        "points rejected": counts.rejected if counts else 0,
    }
    different = [
        f"{name}: {report.get(name)}, not {count}"
        for name, count in expected.items()
        if report.get(name) != str(count)
    ]
    reasons = {name for name in report if name.startswith("clouds rejected: ")}
    unexpected = [f"{name}: not expected" for name in sorted(reasons - expected.keys())]
    return different + unexpected + tally.faults[:SHOWN_FAULTS]
