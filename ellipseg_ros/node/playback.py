"""Sending the clouds of a source in time, with pauses and with flow control by the node."""

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from threading import Condition

from ellipseg_ros.config import Config, PlacementConfig
from ellipseg_ros.node.flow_control import REGISTERED, FlowControl
from ellipseg_ros.poses.placer import Event, RawEvent, RefusedPose, stamp_of
from ellipseg_ros.records import SECOND, Sweep
from ellipseg_ros.settings import Checked, fixed


@dataclass(frozen=True)
class ReplayOptions(Checked):
    """Settings of a replay."""

    rate: float = fixed(
        1.0, "speed of the replay; 0: as fast as `ahead` allows", "x real time", 0.0, 1000.0
    )
    loop: bool = fixed(
        False, "start again at the end; the stamps jump back, and the window restarts"
    )
    start_paused: bool = fixed(False, "wait for the service ~/pause before the first cloud")
    wait_for_subscriber: bool = fixed(True, "wait for a subscriber before the first cloud")
    clock: bool = fixed(True, "publish the stamps on /clock")
    ahead: float = fixed(
        0.0,
        "maximum sensor time between a cloud and the last update that `segments` acknowledges, "
        "so that none is lost; 0: no flow control",
        "s",
        0.0,
        3600.0,
    )
    update_period: float = fixed(
        Config().update_period, "update_period of the node, for `ahead`", "s", 0.001, 3600.0
    )
    update_timeout: float = fixed(
        60.0,
        "with `ahead`: longest wait for an update; then the replay continues without it",
        "s",
        0.1,
        86400.0,
    )


@dataclass
class ReplaySummary:
    """Totals of a replay."""

    clouds: int = 0
    points: int = 0
    runs: int = 0  # complete passes over the source
    updates: int = 0  # expected from the node for the clouds; 0 without `ahead`
    missed: int = 0  # of these: not published in time
    sensor_seconds: float = 0.0  # from the first to the last stamp, summed over all runs
    wall_seconds: float = 0.0  # from the first cloud to the end, pauses included


class Playback:
    """Plays a source in the calling thread; the other methods are for other threads.

    send: publishes a cloud or a pose. log: gets a line for the user when the replay waits.
    """

    def __init__(
        self,
        options: ReplayOptions,
        send: Callable[[Event], None],
        log: Callable[[str], None],
    ) -> None:
        self._options = options
        self._send = send
        self._log = log
        self._flow = self._new_flow(REGISTERED)
        self._pace = Pace(options.rate)
        self._changed = Condition()
        self._paused = options.start_paused
        self._subscribed = not options.wait_for_subscriber
        self._stopped = False
        self._summary = ReplaySummary()

    def _new_flow(self, placement: PlacementConfig) -> FlowControl:
        config = Config(update_period=self._options.update_period)
        return FlowControl(config, self._options.ahead, placement)

    def play(
        self,
        source: Iterable[Event],
        progress: Callable[[Sweep], None] = lambda _: None,
        placement: PlacementConfig = REGISTERED,
    ) -> ReplaySummary:
        """Send every cloud and pose when it is due; with `ahead`, wait for the last update.

        progress: called after every cloud. placement: how the segmenter places them.
        """
        with self._changed:
            self._flow = self._new_flow(placement)
            if not self._subscribed:
                self._log("waiting for a subscriber of `points`")
            self._changed.wait_for(lambda: self._subscribed or self._stopped)
        started = time.monotonic()
        while self._run(source, progress) and self._options.loop:
            pass
        with self._changed:
            while self._flow.outstanding and not self._stopped:
                self._wait_for_update()
        self._summary.updates = self._flow.updates
        self._summary.wall_seconds = time.monotonic() - started
        return self._summary

    def subscribed(self) -> None:
        """Note that there is a subscriber: the first cloud may be sent."""
        with self._changed:
            self._subscribed = True
            self._changed.notify_all()

    def pause(self, paused: bool) -> None:
        """Pause or continue the replay."""
        with self._changed:
            self._paused = paused
            self._pace.restart()
            self._changed.notify_all()

    def acknowledge(self, end_ns: int) -> None:
        """Note that the node has published the update whose newest point is of `end_ns`."""
        with self._changed:
            self._flow.acknowledge(end_ns)
            self._changed.notify_all()

    def stop(self) -> None:
        """End `play` without waiting for anything."""
        with self._changed:
            self._stopped = True
            self._changed.notify_all()

    def _run(self, source: Iterable[Event], progress: Callable[[Sweep], None]) -> bool:
        """Play the source once; False if the replay was stopped or the source is empty."""
        newest_ns = None
        self._pace.restart()
        for event in source:
            if isinstance(event, RefusedPose):
                continue
            if not self._wait_until_due(event):
                return False
            self._send(event)
            if isinstance(event, Sweep):
                self._summary.clouds += 1
                self._summary.points += len(event)
                if newest_ns is not None:
                    self._summary.sensor_seconds += max(0, event.stamp_ns - newest_ns) / SECOND
                newest_ns = event.stamp_ns
                progress(event)
        self._summary.runs += 1
        return newest_ns is not None

    def _wait_until_due(self, event: RawEvent) -> bool:
        """Wait until the cloud or pose is due, and register it; False if stopped meanwhile."""
        stamp_ns = stamp_of(event)
        with self._changed:
            while not self._stopped:
                if self._paused:
                    self._changed.wait()
                elif isinstance(event, Sweep) and not self._flow.may_send(event):
                    self._wait_for_update()
                elif (remaining := self._pace.remaining(stamp_ns)) > 0.0:
                    self._changed.wait(remaining)
                else:
                    if self._options.ahead:
                        self._flow.send(event)
                    return True
            return False

    def _wait_for_update(self) -> None:
        """Wait for any change; after the timeout, expect no more of the outstanding updates."""
        if not self._changed.wait(self._options.update_timeout):
            missed = self._flow.abandon()
            self._summary.missed += missed
            self._log(
                f"no update for {self._options.update_timeout:g} s; continuing without {missed} "
                "(does the segmenter run, with update_period "
                f"{self._options.update_period:g}?)"
            )


class Pace:
    """Converts stamps to wall time at a rate; rate 0: everything is due immediately."""

    def __init__(self, rate: float) -> None:
        self._rate = rate
        self.restart()

    def restart(self) -> None:
        """Make the next stamp due immediately, and later ones relative to it."""
        self._start: tuple[float, int] | None = None  # wall time, s; its stamp, ns
        self._newest_ns = 0

    def remaining(self, stamp_ns: int) -> float:
        """Wall time until the stamp is due, s; 0 or less: it is due."""
        if not self._rate:
            return 0.0
        now = time.monotonic()
        if self._start is None or stamp_ns < self._newest_ns - SECOND:  # started, or jumped back
            self._start = (now, stamp_ns)
            self._newest_ns = stamp_ns
        self._newest_ns = max(self._newest_ns, stamp_ns)
        start, start_ns = self._start
        return start + (stamp_ns - start_ns) / SECOND / self._rate - now
