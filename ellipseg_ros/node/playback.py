"""When each cloud of a source is sent: by its stamp, by pauses, by what the node has done."""

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from threading import Condition

from ellipseg_ros.config import Config
from ellipseg_ros.node.flow_control import FlowControl
from ellipseg_ros.records import SECOND, Sweep
from ellipseg_ros.settings import Checked, setting


@dataclass(frozen=True)
class ReplayOptions(Checked):
    """How a source is played."""

    rate: float = setting(
        1.0,
        "speed of the replay; 0: as fast as `ahead` allows",
        unit="x real time",
        low=0.0,
        high=1000.0,
        live=False,
    )
    loop: bool = setting(
        False, "begin again at the end; the stamps jump back, and the node starts anew", live=False
    )
    start_paused: bool = setting(
        False, "wait for the service ~/pause before the first cloud", live=False
    )
    wait: bool = setting(True, "wait for a subscriber before the first cloud", live=False)
    clock: bool = setting(True, "publish the stamps on /clock", live=False)
    ahead: float = setting(
        0.0,
        "sensor time that clouds may be ahead of the last `segments`, so that none is lost; "
        "0: the node is not waited for",
        unit="s",
        low=0.0,
        high=3600.0,
        live=False,
    )
    update_period: float = setting(
        Config().update_period,
        "the node's update_period, for `ahead`",
        unit="s",
        low=0.001,
        high=3600.0,
        live=False,
    )
    patience: float = setting(
        60.0,
        "with `ahead`: longest wait for an update; then the replay goes on",
        unit="s",
        low=0.1,
        high=86400.0,
        live=False,
    )


@dataclass(frozen=True)
class ReplaySummary:
    """What was played."""

    clouds: int
    points: int
    runs: int  # times that the source was played to its end
    updates: int  # that the node should have made of the clouds; 0 without `ahead`
    missed: int  # of those: not come back in time
    sensor_seconds: float  # from the first to the last stamp, over all runs
    wall_seconds: float  # from the first cloud to the end, pauses included


class Playback:
    """Plays a source in the thread of the caller; the other methods are for other threads.

    send: publishes a cloud. say: tells the user, in one line, what is waited for.
    """

    def __init__(
        self,
        options: ReplayOptions,
        send: Callable[[Sweep], None],
        say: Callable[[str], None],
    ) -> None:
        self._options = options
        self._send = send
        self._say = say
        self._flow = FlowControl(Config(update_period=options.update_period), options.ahead)
        self._pace = Pace(options.rate)
        self._changed = Condition()
        self._paused = options.start_paused
        self._listening = not options.wait
        self._stopped = False
        self._clouds = self._points = self._runs = self._missed = 0
        self._sensor_ns = 0

    def play(
        self, source: Iterable[Sweep], progress: Callable[[Sweep], None] = lambda _: None
    ) -> ReplaySummary:
        """Send every cloud in its time; with `ahead`, wait until the last update has come back.

        progress: called after every cloud.
        """
        self._wait_for_listeners()
        started = time.monotonic()
        while self._run(source, progress) and self._options.loop:
            pass
        self._wait_for_the_rest()
        return ReplaySummary(
            clouds=self._clouds,
            points=self._points,
            runs=self._runs,
            updates=self._flow.closed,
            missed=self._missed,
            sensor_seconds=self._sensor_ns / SECOND,
            wall_seconds=time.monotonic() - started,
        )

    def listening(self) -> None:
        """Somebody listens: the first cloud may go."""
        with self._changed:
            self._listening = True
            self._changed.notify_all()

    def pause(self, paused: bool) -> None:
        """Hold the clouds back, or let them go on."""
        with self._changed:
            self._paused = paused
            self._pace.begin()
            self._changed.notify_all()

    def come_back(self, end_ns: int) -> None:
        """An update whose newest point is of `end_ns` has come back."""
        with self._changed:
            self._flow.come_back(end_ns)
            self._changed.notify_all()

    def stop(self) -> None:
        """Send nothing more, and wait for nothing."""
        with self._changed:
            self._stopped = True
            self._changed.notify_all()

    def _wait_for_listeners(self) -> None:
        with self._changed:
            if not self._listening:
                self._say("waiting for a subscriber of `points`")
            self._changed.wait_for(lambda: self._listening or self._stopped)

    def _run(self, source: Iterable[Sweep], progress: Callable[[Sweep], None]) -> bool:
        """Play the source once; False if it was stopped, or had nothing to play."""
        newest = None
        self._pace.begin()
        for sweep in source:
            if not self._wait_for_turn(sweep):
                return False
            self._send(sweep)
            self._clouds += 1
            self._points += len(sweep)
            if newest is not None:
                self._sensor_ns += max(0, sweep.stamp_ns - newest)
            newest = sweep.stamp_ns
            progress(sweep)
        self._runs += 1
        return newest is not None

    def _wait_for_turn(self, sweep: Sweep) -> bool:
        """Wait until the cloud may go, and count on it; False if the playback was stopped."""
        with self._changed:
            while not self._stopped:
                if self._paused:
                    self._changed.wait()
                elif self._waits_for_node and not self._flow.may_send(sweep):
                    self._wait_for_node()
                elif (left := self._pace.left(sweep.stamp_ns)) > 0.0:
                    self._changed.wait(left)
                else:
                    if self._waits_for_node:
                        self._flow.send(sweep)
                    return True
            return False

    def _wait_for_the_rest(self) -> None:
        with self._changed:
            while self._flow.outstanding and not self._stopped:
                self._wait_for_node()

    def _wait_for_node(self) -> None:
        """Wait until anything happens; after too long, expect nothing of what was sent."""
        if not self._changed.wait(self._options.patience):
            missed = self._flow.give_up()
            self._missed += missed
            self._say(
                f"no update has come back for {self._options.patience:g} s; going on without "
                f"{missed} (does the segmenter run, with update_period "
                f"{self._options.update_period:g}?)"
            )

    @property
    def _waits_for_node(self) -> bool:
        return self._options.ahead > 0.0


class Pace:
    """Says how long a stamp is still to come, at a rate; 0: everything is due."""

    def __init__(self, rate: float) -> None:
        self._rate = rate
        self.begin()

    def begin(self) -> None:
        """The next stamp is due at once, and the others by their distance from it."""
        self._start: tuple[float, int] | None = None  # s, wall; ns, its stamp
        self._newest = 0

    def left(self, stamp_ns: int) -> float:
        """Wall time until the stamp is due, s; 0 or less: it is."""
        if not self._rate:
            return 0.0
        now = time.monotonic()
        if self._start is None or stamp_ns < self._newest - SECOND:  # began, or jumped back
            self._start = (now, stamp_ns)
            self._newest = stamp_ns
        self._newest = max(self._newest, stamp_ns)
        wall, stamp = self._start
        return wall + (stamp_ns - stamp) / SECOND / self._rate - now
