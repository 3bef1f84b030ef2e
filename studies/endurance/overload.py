"""More points than the machine can segment: what the node does then, and afterwards."""

import math
import time
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import chain

import numpy as np

from ellipseg_ros.cli.node_process import START_TIMEOUT_S
from ellipseg_ros.config import Config, NodeConfig
from ellipseg_ros.node.grouping import Grouping
from ellipseg_ros.node.playback import ReplayOptions
from ellipseg_ros.records import SECOND, Array, Sweep
from ellipseg_ros.ros.replayer import Replayer
from studies.endurance.endless_drive import Tape
from studies.endurance.last_word import last_word
from studies.endurance.promises import Promise, Trial
from studies.endurance.running import running

PATIENCE = 120.0  # s for one update
CALM = 0.5  # times the capacity: what comes before the end, for the recovery
GROWTH = 1.3  # times the latency, at most, from the middle of an overload to its end
NORMAL = 2.0  # times the latency of a calm node: what is normal again
MORE = 1.2  # times the memory at half the load, at most, where both are floods
FEW = 5  # updates: a message that DDS sends again after 3 s keeps those behind it waiting
USUAL = 0.95  # of the updates: a message that DDS has to send again comes seconds later
REPORTS = 120  # /diagnostics, one a second, until the last update must have come
COUNTS = (
    "clouds received",
    "clouds lost by DDS",
    "updates",
    "updates coalesced",
    "updates dropped",
)
SLACK = 0.5  # s that a cloud may be on its way


@dataclass(frozen=True)
class Load:
    """How much and how long."""

    factors: tuple[int, ...]  # times the capacity
    lap_s: float
    laps: int  # of overload; the same window is full after half of them
    calm: int  # laps after it
    window_s: float
    bound: float  # `max_points`: times the points of a window at the capacity
    first_rate: float  # points/s that the capacity is first measured with


FULL = Load((1, 2, 4, 8), 30.0, 4, 2, Config().window_duration, 3.0, 20_000.0)
QUICK = Load((2, 4), 6.0, 2, 2, 3.0, 1.5, 20_000.0)
# The window has `max_points` then, and so many wait for every update: there can't be more.
FLOOD = Load((16, 32), 10.0, 4, 1, Config().window_duration, 1.0, 20_000.0)
QUICK_FLOOD = Load((8, 16), 4.0, 2, 1, 3.0, 1.0, 20_000.0)


@dataclass(frozen=True)
class Case:
    """One run at `factor` times the capacity. Times in s; rows are updates."""

    factor: int
    rate: float  # points/s that were sent
    stamp: Array  # (u,) of the update's newest point, from the first cloud
    latency: Array  # (u,) from the newest cloud in it sent to its segments received
    stale: Array  # (u,) by how much the update lacks clouds sent before it could begin
    calm_from: float  # stamp
    clouds: int
    groups: int  # of clouds, that make an update each if none are taken together
    said: dict[str, str]  # the node's last diagnostics
    peak_mb: float


def overload(trial: Trial) -> list[Promise]:
    """Find the capacity, then exceed it."""
    load = QUICK if trial.quick else FULL
    capacity = _capacity(load, trial)
    cases = []
    for factor in load.factors:
        trial.say(f"overload: {factor} x {capacity:,.0f} points/s")
        cases.append(_case(factor, capacity, load, trial))
    how = (
        f"{', '.join(f'{factor}' for factor in load.factors)} times the {capacity:,.0f} points/s "
        f"that this machine can do, for {load.laps * load.lap_s:.0f} s each in real time, default "
        f"settings but for `max_points`{'' if load is FULL else ' and a short window'}"
    )
    flood = QUICK_FLOOD if trial.quick else FLOOD
    floods = []
    for factor in flood.factors:
        trial.say(f"overload: {factor} x {capacity:,.0f} points/s, few at a time")
        floods.append(_case(factor, capacity, flood, trial))
    return [
        _peaks(cases, how, load, _max_points(load, capacity)),
        _bound(floods, flood, _max_points(flood, capacity)),
        _newest(cases),
        _latency(cases, load),
        _recovery(cases, load),
        _counted(cases),
    ]


# --- running ---------------------------------------------------------------------------------


def _max_points(load: Load, capacity: float) -> int:
    return round(load.bound * capacity * load.window_s)


def _capacity(load: Load, trial: Trial) -> float:
    """Points/s at which an update takes as long as the time between two; measured twice."""
    rate = load.first_rate
    period = Config().update_period
    options = ReplayOptions(rate=0.0, clock=False, ahead=3.0 * period, update_timeout=PATIENCE)
    settings = {
        "window_duration": load.window_s,
        "input_reliability": "reliable",
        "max_backlog": 0,
    }
    for _ in range(2):
        trial.say(f"overload: how fast is {rate:,.0f} points/s segmented?")
        laps = int(np.ceil((load.window_s + 10.0) / load.lap_s))
        with running(settings) as (listener, _, ros_args):
            tape = Tape(load.lap_s, laps, rate, seed=trial.seed)
            with Replayer(tape, options, ros_args) as replayer:
                listener.wait_for_topics(START_TIMEOUT_S)
                replayer.run()
            arrived = np.array([listener.updates[stamp] for stamp in sorted(listener.updates)])
        seconds = float(np.median(np.diff(arrived)[-9:])) / SECOND
        rate *= period / seconds
    return rate


def _case(factor: int, capacity: float, load: Load, trial: Trial) -> Case:
    """Overload, then calm."""
    much = Tape(load.lap_s, load.laps, factor * capacity, seed=trial.seed)
    little = Tape(load.lap_s, load.calm, CALM * capacity, first=load.laps, seed=trial.seed)
    sent: dict[int, int] = {}  # newest time of a cloud, ns: when it was sent
    points = groups = 0
    config = Config(window_duration=load.window_s, max_points=_max_points(load, capacity))
    settings = {"window_duration": config.window_duration, "max_points": config.max_points}
    grouping = Grouping(config)

    def note(sweep: Sweep) -> None:
        nonlocal points, groups
        groups += len(grouping.push(sweep))
        sent[int(sweep.times_ns.max(initial=sweep.stamp_ns))] = time.monotonic_ns()
        points += len(sweep) if len(sent) <= len(much) else 0

    with running(settings) as (listener, node, ros_args):
        clouds: Iterable[Sweep] = chain(much, little)
        with Replayer(clouds, ReplayOptions(clock=False), ros_args) as replayer:
            listener.wait_for_topics(START_TIMEOUT_S)
            replayer.run(note)
        said = last_word(listener, REPORTS, PATIENCE)
        peak_mb = node.peak_memory_mb()
        came = dict(listener.updates)
    begun = min(sent)
    updates = sorted(stamp for stamp in came if stamp in sent)
    stamps, times = np.array(sorted(sent)), np.array([sent[stamp] for stamp in sorted(sent)])
    arrived = np.array([came[stamp] for stamp in updates])
    could = np.append(0, arrived[:-1]) - round(SLACK * SECOND)  # begin, with what was there
    there = stamps[np.maximum(np.searchsorted(times, could) - 1, 0)]
    seconds = load.laps * load.lap_s
    return Case(
        factor=factor,
        rate=points / seconds,
        stamp=(np.array(updates) - begun) / SECOND,
        latency=(arrived - np.array([sent[stamp] for stamp in updates])) / SECOND,
        stale=np.maximum(there - np.array(updates), 0) / SECOND,
        calm_from=seconds,
        clouds=len(sent),
        groups=groups,
        said=said,
        peak_mb=peak_mb,
    )


# --- promises --------------------------------------------------------------------------------


def _each(cases: list[Case], texts: Iterable[str]) -> str:
    return "; ".join(f"{case.factor} x: {text}" for case, text in zip(cases, texts, strict=True))


def _peaks(cases: list[Case], how: str, load: Load, max_points: int) -> Promise:
    early = [int(case.said["points evicted"]) for case in cases]
    full = [case.rate * load.window_s > max_points for case in cases]
    # What waited at last came with clouds of the calm, and some of it, or before, went by age.
    least = [case.rate * (case.calm_from - case.latency.max()) - max_points for case in cases]
    return Promise(
        "beyond `max_points` the oldest expire early, and are counted",
        f"{how}; `max_points` {max_points:,}: none of a load of which a window has less, else all "
        "that were sent but those, and what waited at last; most memory of the node",
        _memory(cases),
        any(full)
        and all(
            count >= low if more else count == 0
            for count, low, more in zip(early, least, full, strict=True)
        ),
    )


def _bound(floods: list[Case], load: Load, max_points: int) -> Promise:
    early = [int(case.said["points evicted"]) for case in floods]
    low, high = (case.peak_mb for case in floods)
    return Promise(
        "memory is bounded by `max_points`, however many come",
        f"the same for {load.laps * load.lap_s:.0f} s with `max_points` {max_points:,}, of which "
        "the window is full and as many wait for every update; most memory of the node, at most "
        f"{MORE:g} times that at half the load",
        _memory(floods),
        min(early) > 0,
        high <= MORE * low,
    )


def _memory(cases: list[Case]) -> str:
    texts = [
        f"{case.peak_mb:,.0f} MB ({int(case.said['points evicted']):,} points evicted)"
        for case in cases
    ]
    return _each(cases, texts)


def _newest(cases: list[Case]) -> Promise:
    behind = (NodeConfig().max_backlog + 1) * Config().update_period
    stale = [case.stale[case.stamp < case.calm_from] for case in cases]
    usual = [float(np.quantile(one, USUAL)) for one in stale]
    worst = [float(one.max()) for one in stale]
    texts = [f"{u:.1f} s, most {w:.1f} s" for u, w in zip(usual, worst, strict=True)]
    return Promise(
        "an update has the newest clouds",
        f"clouds that were sent {SLACK:g} s before an update could begin and are not in it: in "
        f"{USUAL:.0%} of the updates of the overload at most `max_backlog` + 1 periods "
        f"({behind:g} s) of them",
        _each(cases, texts),
        True,
        max(usual) <= behind,
    )


def _latency(cases: list[Case], load: Load) -> Promise:
    texts, kept = [], True
    for case in cases:
        full = case.latency[(case.stamp >= case.calm_from / 2) & (case.stamp < case.calm_from)]
        half = np.array_split(full, 2)
        kept &= float(np.median(half[1])) <= GROWTH * float(np.median(half[0]))
        texts.append(f"median {np.median(full):.1f} s, most {full.max():.1f} s")
    return Promise(
        "latency does not grow while the overload lasts",
        "from a cloud sent to its segments received, in the second half of the overload; median "
        f"of its last quarter at most {GROWTH:g} times that of the one before",
        _each(cases, texts),
        True,
        kept,
    )


def _recovery(cases: list[Case], load: Load) -> Promise:
    limit = 2.0 * load.window_s
    took = [recovery(case, load.window_s) for case in cases]
    usual = [calm(case, load.window_s) for case in cases]
    most = [
        float(case.latency[case.stamp > case.calm_from + seconds].max(initial=0.0))
        for case, seconds in zip(cases, took, strict=True)
    ]
    period = Config().update_period
    texts = [
        f"{seconds:.0f} s, then {median:.2f} s, most {longest:.1f} s"
        for seconds, median, longest in zip(took, usual, most, strict=True)
    ]
    return Promise(
        "the node recovers within two windows",
        f"then {CALM:g} times the capacity; time until the median latency of {FEW} updates in a "
        f"row is never more than {NORMAL:g} times that of the last window, at most {limit:g} s; "
        f"and the latter, at most `update_period` ({period:g} s)",
        _each(cases, texts),
        True,
        max(took) <= limit and max(usual) <= period,
    )


def calm(case: Case, window_s: float) -> float:
    """Median latency of the last window, s."""
    return float(np.median(case.latency[case.stamp >= case.stamp[-1] - window_s]))


def recovery(case: Case, window_s: float) -> float:
    """Seconds from the end of the overload until updates are not late any more, but a few."""
    after = case.stamp >= case.calm_from
    latency, stamp = case.latency[after], case.stamp[after]
    if len(latency) < FEW:
        return math.inf
    several = np.median(np.lib.stride_tricks.sliding_window_view(latency, FEW), axis=1)
    again = np.flatnonzero(several > NORMAL * calm(case, window_s)) + FEW // 2  # its middle
    return float(stamp[again[-1]]) - case.calm_from if len(again) else 0.0


def _counted(cases: list[Case]) -> Promise:
    counts = [{name: int(case.said[name]) for name in COUNTS} for case in cases]
    texts = [
        f"{case.rate:,.0f} points/s, {case.clouds} clouds sent, "
        f"{told['clouds received']} received, {told['clouds lost by DDS']} lost; "
        f"{case.groups} groups of clouds, {told['updates']} updates, "
        f"{told['updates coalesced']} joined, {told['updates dropped']} given up"
        for case, told in zip(cases, counts, strict=True)
    ]
    return Promise(
        "what is lost or taken together is counted",
        "`input_reliability` auto, and a reliable publisher; what /diagnostics count against what "
        "was sent, and against the groups that it makes (where no cloud is lost)",
        _each(cases, texts),
        all(_is_counted(case, told) for case, told in zip(cases, counts, strict=True)),
    )


def _is_counted(case: Case, told: dict[str, int]) -> bool:
    lost = told["clouds lost by DDS"]
    made = told["updates"] + told["updates coalesced"] + told["updates dropped"]
    # A group that has lost clouds may end later, or not at all.
    return case.clouds == told["clouds received"] + lost and (lost > 0 or made == case.groups)
