"""Requirements on a node under overload, and whether the measured runs meet them."""

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ellipseg_ros.config import Config, NodeConfig
from ellipseg_ros.records import Array
from studies.endurance.requirements import Requirement

CALM = 0.5  # times the capacity: rate after the overload, for the recovery
MAX_LATENCY_GROWTH = 1.3  # ratio, from the middle of an overload to its end
NORMAL_LATENCY = 2.0  # times that of the calm node: limit of recovery
MAX_MEMORY_GROWTH = 1.2  # ratio to half the load, both of floods
WINDOW_OF_UPDATES = 5  # DDS resends a lost message after 3 s and delays the next few with it
FRESH_SHARE = 0.95  # of the updates; the others may have been resent by DDS
SLACK_S = 0.5  # that a cloud may be on its way
COUNTS = (
    "clouds received",
    "clouds lost by DDS",
    "updates",
    "updates coalesced",
    "updates dropped",
)


@dataclass(frozen=True)
class Load:
    """Rates and lengths of runs with overload."""

    factors: tuple[int, ...]  # times the capacity
    lap_s: float
    laps: int  # of overload; the window is full after half of them
    calm_laps: int  # after the overload
    window_s: float
    max_windows: float  # `max_points` in windows at the capacity

    def max_points(self, capacity: float) -> int:
        """The node's parameter; capacity in points/s."""
        return round(self.max_windows * capacity * self.window_s)


@dataclass(frozen=True)
class Case:
    """A run at `factor` times the capacity. Times in s; row i of the arrays is update i."""

    factor: int
    rate: float  # points/s that were sent during the overload
    stamp: Array  # (u,) of the update's newest point, from the first cloud
    latency: Array  # (u,) from its newest cloud sent to its segments received
    stale: Array  # (u,) age of the update relative to clouds that it could have contained
    calm_from: float  # stamp of the end of the overload
    clouds: int
    groups: int  # of clouds, each an update if none are coalesced
    report: dict[str, str]  # the node's last diagnostics
    peak_mb: float

    def count(self, name: str) -> int:
        """A count of the node's diagnostics."""
        return int(self.report[name])


def judge(
    cases: list[Case], load: Load, floods: list[Case], flood: Load, test: str, capacity: float
) -> list[Requirement]:
    """All requirements; test: how `cases` were run."""
    return [
        eviction(cases, load, test, load.max_points(capacity)),
        bounded_memory(floods, flood, flood.max_points(capacity)),
        fresh_updates(cases),
        steady_latency(cases),
        recovery(cases, load),
        counted_losses(cases),
    ]


def _per_case(cases: list[Case], texts: Iterable[str]) -> str:
    return "; ".join(f"{case.factor} x: {text}" for case, text in zip(cases, texts, strict=True))


def _memory(cases: list[Case]) -> str:
    texts = [
        f"{case.peak_mb:,.0f} MB ({case.count('points evicted'):,} points evicted)"
        for case in cases
    ]
    return _per_case(cases, texts)


def eviction(cases: list[Case], load: Load, test: str, max_points: int) -> Requirement:
    """Whether exactly the points beyond `max_points` are evicted."""

    def is_counted(case: Case) -> bool:
        early = case.count("points evicted")
        if case.rate * load.window_s <= max_points:
            return early == 0
        # Points that waited at the end of the overload may expire by age, in the calm.
        return early >= case.rate * (case.calm_from - case.latency.max()) - max_points

    return Requirement(
        "beyond `max_points` the oldest points are evicted and counted",
        f"{test}; `max_points` {max_points:,}: no point is evicted if a window has fewer, else "
        "all that were sent except these and what waited at the end; peak memory of the node",
        _memory(cases),
        any(case.rate * load.window_s > max_points for case in cases)
        and all(map(is_counted, cases)),
    )


def bounded_memory(floods: list[Case], load: Load, max_points: int) -> Requirement:
    """Whether memory does not depend on the load."""
    low, high = (case.peak_mb for case in floods)
    return Requirement(
        "memory is bounded by `max_points` for any load",
        f"the same for {load.laps * load.lap_s:.0f} s with `max_points` {max_points:,}, which "
        "fill the window and as many wait for every update; peak memory of the node, at most "
        f"{MAX_MEMORY_GROWTH:g} times that at half the load",
        _memory(floods),
        min(case.count("points evicted") for case in floods) > 0,
        high <= MAX_MEMORY_GROWTH * low,
    )


def fresh_updates(cases: list[Case]) -> Requirement:
    """Whether updates contain the newest clouds."""
    limit = (NodeConfig().max_backlog + 1) * Config().update_period
    stale = [case.stale[case.stamp < case.calm_from] for case in cases]
    usual = [float(np.quantile(values, FRESH_SHARE)) for values in stale]
    texts = [f"{u:.1f} s, at most {v.max():.1f} s" for u, v in zip(usual, stale, strict=True)]
    return Requirement(
        "updates contain the newest clouds",
        f"clouds that were sent {SLACK_S:g} s before an update could start and are not in it: at "
        f"most `max_backlog` + 1 periods ({limit:g} s) in {FRESH_SHARE:.0%} of the updates during "
        "the overload",
        _per_case(cases, texts),
        True,
        max(usual) <= limit,
    )


def steady_latency(cases: list[Case]) -> Requirement:
    """Whether latency stays constant during the overload."""
    second_half = [
        case.latency[(case.stamp >= case.calm_from / 2) & (case.stamp < case.calm_from)]
        for case in cases
    ]
    medians = [list(map(np.median, np.array_split(values, 2))) for values in second_half]
    texts = [f"median {np.median(v):.1f} s, at most {v.max():.1f} s" for v in second_half]
    return Requirement(
        "latency does not grow during the overload",
        "from a cloud sent to its segments received, in the second half of the overload; the "
        f"median of its last quarter is at most {MAX_LATENCY_GROWTH:g} times that of the quarter "
        "before",
        _per_case(cases, texts),
        True,
        all(late <= MAX_LATENCY_GROWTH * early for early, late in medians),
    )


def recovery(cases: list[Case], load: Load) -> Requirement:
    """Whether latency is normal soon after the overload."""
    limit = 2.0 * load.window_s
    period = Config().update_period
    times = [recovery_time(case, load.window_s) for case in cases]
    usual = [calm_latency(case, load.window_s) for case in cases]
    worst = [
        float(case.latency[case.stamp > case.calm_from + seconds].max(initial=0.0))
        for case, seconds in zip(cases, times, strict=True)
    ]
    texts = [
        f"{seconds:.0f} s, then {median:.2f} s, at most {most:.1f} s"
        for seconds, median, most in zip(times, usual, worst, strict=True)
    ]
    return Requirement(
        "the node recovers within two windows",
        f"then {CALM:g} times the capacity; time until the median latency of {WINDOW_OF_UPDATES} "
        f"successive updates is never more than {NORMAL_LATENCY:g} times that of the last window, "
        f"at most {limit:g} s; and the latter, at most `update_period` ({period:g} s)",
        _per_case(cases, texts),
        True,
        max(times) <= limit and max(usual) <= period,
    )


def calm_latency(case: Case, window_s: float) -> float:
    """Median latency over the last window, s."""
    return float(np.median(case.latency[case.stamp >= case.stamp[-1] - window_s]))


def recovery_time(case: Case, window_s: float) -> float:
    """Time from the end of the overload until no median of several updates is late, s."""
    after = case.stamp >= case.calm_from
    latency, stamp = case.latency[after], case.stamp[after]
    if len(latency) < WINDOW_OF_UPDATES:
        return math.inf
    windows = np.lib.stride_tricks.sliding_window_view(latency, WINDOW_OF_UPDATES)
    late = np.median(windows, axis=1) > NORMAL_LATENCY * calm_latency(case, window_s)
    middles = np.flatnonzero(late) + WINDOW_OF_UPDATES // 2
    return float(stamp[middles[-1]]) - case.calm_from if len(middles) else 0.0


def counted_losses(cases: list[Case]) -> Requirement:
    """Whether lost and coalesced clouds are counted."""
    texts = []
    for case in cases:
        received, lost, updates, coalesced, dropped = map(case.count, COUNTS)
        texts.append(
            f"{case.rate:,.0f} points/s, {case.clouds} clouds sent, {received} received, {lost} "
            f"lost; {case.groups} groups of clouds, {updates} updates, {coalesced} coalesced, "
            f"{dropped} dropped"
        )
    return Requirement(
        "lost and coalesced clouds are counted",
        "`input_reliability` auto, and a reliable publisher; counts of /diagnostics against the "
        "clouds sent, and against their groups (where no cloud is lost)",
        _per_case(cases, texts),
        all(map(_adds_up, cases)),
    )


def _adds_up(case: Case) -> bool:
    received, lost, *updates = map(case.count, COUNTS)
    # A group with lost clouds may end later or not at all.
    return case.clouds == received + lost and (lost > 0 or sum(updates) == case.groups)
