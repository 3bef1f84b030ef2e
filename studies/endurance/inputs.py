"""The subject "inputs": odd clouds, landmarks and segments, and odd messages to a running node."""

from dataclasses import dataclass

from ellipseg_ros.association.associate import warm_up as warm_up_association
from ellipseg_ros.config import Config
from ellipseg_ros.node.memory import peak_mb, reset_peak, resident_mb
from ellipseg_ros.segmenter import warm_up
from studies.endurance.conversion import Tally, convert
from studies.endurance.live_inputs import Heard, listen
from studies.endurance.odd_landmarks import recognize, reflect
from studies.endurance.promises import Promise, Trial

SLOWEST = 5.0  # s that an odd cloud of some thousand points may take
GROWTH_MB = 500.0  # that all of them may add to the memory
SHOWN = 3  # faults that are told


@dataclass(frozen=True)
class Cases:
    """How many of each."""

    converted: int
    sent: int
    large: int  # points of the large cloud
    landmarks: int
    segments: int


FULL = Cases(10_000, 500, 5_000_000, 2000, 5000)
QUICK = Cases(400, 60, 200_000, 50, 500)


def inputs(trial: Trial) -> list[Promise]:
    """Try all of it; whatever must not be is a fault, and told."""
    cases = QUICK if trial.quick else FULL
    warm_up()
    warm_up_association()
    reset_peak()
    before = resident_mb()
    trial.say(f"inputs: {cases.converted} clouds")
    converted = _told(convert(trial.seed, range(cases.converted)), trial)
    found = _converted(converted, peak_mb() - before)
    trial.say(f"inputs: {cases.landmarks} lists of landmarks, {cases.segments} of segments")
    found.append(_landmarks(_told(recognize(trial.seed, cases.landmarks), trial)))
    found.append(_segments(_told(reflect(trial.seed, cases.segments), trial)))
    trial.say(f"inputs: {cases.sent} clouds to the node, then {cases.large} points in one")
    return found + of_node(listen(trial.seed, cases.sent, cases.large), cases)


def _told(tally: Tally, trial: Trial) -> Tally:
    for fault in tally.faults[:SHOWN]:
        trial.say(f"inputs: {fault}")
    return tally


def _converted(tally: Tally, memory_mb: float) -> list[Promise]:
    tried = f"{tally.cases:,} generated clouds, {tally.points:,} points in those accepted"
    return [
        Promise(
            "An odd cloud gives an update or a short reason, without an exception or a warning; "
            "every point is in the window or counted, no number is NaN or infinite, and every "
            "message can be read",
            f"{tried}; {tally.updates:,} updates looked at, messages of {tally.decoded:,} read",
            f"{tally.accepted:,} accepted, {tally.rejected.total():,} rejected for "
            f"{len(tally.rejected)} reasons, {len(tally.faults)} faults",
            not tally.faults and tally.decoded > 0 and len(tally.rejected) > 1,
        ),
        Promise(
            f"None of them takes long (at most {SLOWEST:g} s), or much memory (at most "
            f"{GROWTH_MB:g} MB), whatever sizes it claims",
            tried,
            f"{tally.slowest:.2f} s at most; {memory_mb:.0f} MB more than before",
            tally.slowest < SLOWEST and memory_mb < GROWTH_MB,
        ),
    ]


def _landmarks(tally: Tally) -> Promise:
    return Promise(
        "Nonsense in landmarks is refused by the associator, and gives no nonsense",
        f"{tally.cases:,} lists of 2 to 20, with numbers and lengths that cannot be",
        f"{tally.updates:,} associated, {tally.rejected.total():,} rejected for "
        f"{len(tally.rejected)} reasons, {len(tally.faults)} faults",
        not tally.faults and tally.updates > 0 and tally.rejected.total() > 0,
    )


def _segments(tally: Tally) -> Promise:
    return Promise(
        "`SegmentMirror` says that it is in step only if its copy holds all points",
        f"{tally.cases:,} lists of segments that contradict themselves and one another",
        f"in step after {tally.updates:,}, {len(tally.faults)} faults",
        not tally.faults and 0 < tally.updates < tally.cases,
    )


def of_node(heard: Heard, cases: Cases) -> list[Promise]:
    """The rows of what came of messages to the running node."""
    different = differences(heard)
    growth = heard.peak_mb - heard.before_mb
    early = int(heard.large["points evicted"]) - heard.tally.evicted
    return [
        Promise(
            "/diagnostics of the running node count every cloud, every reason, every point",
            f"{cases.sent} odd clouds over DDS; each count beside that of the same clouds without "
            "the node",
            f"{heard.said['clouds rejected']} of {heard.said['clouds received']} rejected, "
            f"{heard.said['updates']} updates; {'; '.join(different) or 'no difference'}",
            not different,
        ),
        Promise(
            "Bytes that are no message don't end the node, or silence it",
            f"{heard.garbage} messages cut off or with lengths that lie, then a good one",
            f"{heard.large['clouds lost by DDS']} dropped and counted as lost; "
            f"{heard.after_garbage} received afterwards",
            heard.after_garbage >= 1,
        ),
        Promise(
            "A cloud of millions of points in one message is segmented, and the node goes on",
            f"{cases.large:,} points, 16 bytes each, `max_points` at its default",
            f"segments after {heard.large_s:.1f} s, {growth:.0f} MB more than before; "
            f"{early:,} points evicted, counted; the next cloud was segmented",
            early == max(0, cases.large - Config().max_points),
        ),
    ]


def differences(heard: Heard) -> list[str]:
    """What the node counted otherwise than the same code without it."""
    tally, said = heard.tally, heard.said
    counts = tally.last.counts if tally.last else None
    expected = {
        "clouds received": tally.cases,
        "clouds rejected": tally.rejected.total(),
        **{f"clouds rejected: {why}": number for why, number in tally.rejected.items()},
        "clouds lost by DDS": 0,
        "updates": tally.updates,
        "restarts": tally.restarts,
        "points late": tally.late,
        "points evicted": tally.evicted,
        "points segmented": counts.segmented if counts else 0,
        "points isolated": counts.isolated if counts else 0,
        "points rejected": counts.rejected if counts else 0,
    }
    told = [
        f"{name}: {said.get(name)}, not {number}"
        for name, number in expected.items()
        if said.get(name) != str(number)
    ]
    others = {name for name in said if name.startswith("clouds rejected: ")} - expected.keys()
    return told + [f"{name}: not expected" for name in sorted(others)] + tally.faults[:SHOWN]
