"""Subject `overload`: more points than the machine can segment, and the recovery afterwards."""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import chain

import numpy as np

from ellipseg_ros.config import Config
from ellipseg_ros.node.grouping import Grouping
from ellipseg_ros.node.playback import ReplayOptions
from ellipseg_ros.records import SECOND, Sweep
from studies.endurance.endless_drive import EndlessDrive
from studies.endurance.idle_report import idle_report
from studies.endurance.overload_requirements import CALM, SLACK_S, Case, Load, judge
from studies.endurance.requirements import Options, Requirement
from studies.endurance.running import UPDATE_TIMEOUT_S, SendTimes, connected_replayer, running

MAX_REPORTS = 120  # /diagnostics, one a second, until the node must be idle
PROBED_RATE = 20_000.0  # points/s with which the capacity is measured first

FULL = Load((1, 2, 4, 8), 30.0, 4, 2, Config().window_duration, 3.0)
QUICK = Load((2, 4), 6.0, 2, 2, 3.0, 1.5)
# The window then has `max_points`, and as many wait for every update: the most there can be.
FLOOD = Load((16, 32), 10.0, 4, 1, Config().window_duration, 1.0)
QUICK_FLOOD = Load((8, 16), 4.0, 2, 1, 3.0, 1.0)


@dataclass
class Sent:
    """Counts and times of what was sent in a run."""

    times: SendTimes
    grouping: Grouping
    overload: int  # clouds; the others follow at a low rate
    points: int = 0  # of the overload
    groups: int = 0

    def note(self, sweep: Sweep) -> None:
        """Note that a cloud was sent."""
        self.groups += len(self.grouping.push(sweep))
        self.times.note(sweep)
        self.points += len(sweep) if len(self.times) <= self.overload else 0


def overload(options: Options) -> list[Requirement]:
    """Measure the capacity, then exceed it."""
    load, flood = (QUICK, QUICK_FLOOD) if options.quick else (FULL, FLOOD)
    capacity = _capacity(load, options)
    cases = [_run(factor, capacity, load, options) for factor in load.factors]
    floods = [_run(factor, capacity, flood, options) for factor in flood.factors]
    test = (
        f"{', '.join(f'{factor}' for factor in load.factors)} times the {capacity:,.0f} points/s "
        f"that this machine can process, for {load.laps * load.lap_s:.0f} s each in real time, "
        f"default settings except `max_points`{'' if load is FULL else ' and a short window'}"
    )
    return judge(cases, load, floods, flood, test, capacity)


def _capacity(load: Load, options: Options) -> float:
    """Points/s at which an update takes as long as the period between two; measured twice."""
    rate = PROBED_RATE
    period = Config().update_period
    replay = ReplayOptions(
        rate=0.0, clock=False, ahead=3.0 * period, update_timeout=UPDATE_TIMEOUT_S
    )
    settings = {
        "window_duration": load.window_s,
        "input_reliability": "reliable",
        "max_backlog": 0,
    }
    laps = int(np.ceil((load.window_s + 10.0) / load.lap_s))
    for _ in range(2):
        options.log(f"overload: time per update at {rate:,.0f} points/s")
        drive = EndlessDrive(load.lap_s, laps, rate, seed=options.seed)
        with running(settings) as session:
            with connected_replayer(session, drive, replay) as replayer:
                replayer.run()
            updates = session.subscriber.updates
            arrivals = np.array([updates[stamp] for stamp in sorted(updates)])
        seconds = float(np.median(np.diff(arrivals)[-9:])) / SECOND
        rate *= period / seconds
    return rate


def _run(factor: int, capacity: float, load: Load, options: Options) -> Case:
    """Send `factor` times the capacity, then a fraction of it."""
    options.log(f"overload: {factor} x {capacity:,.0f} points/s")
    many = EndlessDrive(load.lap_s, load.laps, factor * capacity, seed=options.seed)
    few = EndlessDrive(
        load.lap_s, load.calm_laps, CALM * capacity, first=load.laps, seed=options.seed
    )
    config = Config(window_duration=load.window_s, max_points=load.max_points(capacity))
    settings = {"window_duration": config.window_duration, "max_points": config.max_points}
    sent = Sent(SendTimes(), Grouping(config), len(many))
    with running(settings) as session:
        clouds: Iterable[Sweep] = chain(many, few)
        with connected_replayer(session, clouds) as replayer:
            replayer.run(sent.note)
        report = idle_report(session.subscriber, MAX_REPORTS, UPDATE_TIMEOUT_S)
        peak_mb = session.node.peak_memory_mb()
        updates = dict(session.subscriber.updates)
    return _case(factor, load, sent, updates, report, peak_mb)


def _case(
    factor: int,
    load: Load,
    sent: Sent,
    updates: dict[int, int],
    report: dict[str, str],
    peak_mb: float,
) -> Case:
    """A Case from the times of clouds and updates; updates: stamp to arrival, ns."""
    stamps = np.array(sorted(updates.keys() & sent.times.keys()))
    arrivals = np.array([updates[stamp] for stamp in stamps.tolist()])
    newest, times = np.array(sorted(sent.times.items())).T
    # An update can contain what was sent before the one before it was published.
    starts = np.append(0, arrivals[:-1]) - round(SLACK_S * SECOND)
    available = newest[np.maximum(np.searchsorted(times, starts) - 1, 0)]
    seconds = load.laps * load.lap_s
    return Case(
        factor=factor,
        rate=sent.points / seconds,
        stamp=(stamps - newest[0]) / SECOND,
        latency=(arrivals - np.array([sent.times[s] for s in stamps.tolist()])) / SECOND,
        stale=np.maximum(available - stamps, 0) / SECOND,
        calm_from=seconds,
        clouds=len(sent.times),
        groups=sent.groups,
        report=report,
        peak_mb=peak_mb,
    )
