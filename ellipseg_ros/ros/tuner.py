"""The thread that tunes on the window of now, beside the one that segments."""

import os
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass

from ellipseg_ros.config import Config
from ellipseg_ros.core.jit import single_threaded
from ellipseg_ros.records import ISOLATED, SECOND, Segmentation
from ellipseg_ros.ros.limits import Share
from ellipseg_ros.ros.process import End
from ellipseg_ros.tuning.curve import Curve
from ellipseg_ros.tuning.live import LIVE_SEARCH
from ellipseg_ros.tuning.search import tune

NICE = 10  # lower priority than the updates
TUNINGS = (0.3, 20.0)  # share of the time that tunings may take, and s at once
LEAST = 100  # points, below which a curve means nothing


@dataclass(frozen=True)
class Tuned:
    """What became of a tuning."""

    found: Segmentation  # the window
    config: Config  # the settings under which it was segmented
    curve: Curve | None
    problem: str = ""  # in one line, where there is no curve
    seconds: float = 0.0


Done = Callable[[Tuned], object]
Job = tuple[Segmentation, Config, Done]


class Tuner(threading.Thread):
    """Tunes one window at a time, on one core and at low priority, so that updates go on.

    on_auto: called, in this thread, with what a tuning by itself has found.
    end: called, in this thread, with an error that nobody expected; nothing is tuned after it.
    """

    def __init__(self, on_auto: Done, end: End) -> None:
        super().__init__(name="tuner", daemon=True)
        self._on_auto = on_auto
        self._end = end
        self._changed = threading.Condition()
        self._latest: tuple[Segmentation, Config] | None = None
        self._job: Job | None = None
        self._busy = False
        self._share = Share(*TUNINGS)
        self._period_ns = 0
        self._due_ns = 0  # sensor time of the next tuning by itself
        self._closed = False

    def look(self, found: Segmentation, config: Config, period: float) -> None:
        """Take note of an update, and tune on it if `period` s of sensor time have passed.

        0: never by itself. The first time is a period after the start, a restart, or a change of
        the period, when the window has filled.
        It waits while a tuning is under way, or while all tunings, also those asked for, have
        taken more than their share: a period of a minute leaves 18 s to each.
        """
        with self._changed:
            self._latest = (found, config)
            period_ns = round(period * SECOND)
            if found.restart or period_ns != self._period_ns:
                self._period_ns, self._due_ns = period_ns, found.end_ns + period_ns
            elif period_ns and found.end_ns >= self._due_ns and not self._waits():
                self._due_ns = found.end_ns + period_ns
                if not too_few(found):
                    self._start(self._on_auto)

    def forget(self) -> None:
        """The window has been reset."""
        with self._changed:
            self._latest, self._period_ns = None, 0

    def ask(self, done: Done) -> str:
        """Tune on the newest window, then call `done`, in this thread; or say why not."""
        with self._changed:
            if self._busy:
                return "a tuning is under way; call again when it is done"
            wait = self._share.wait()
            if wait:
                return f"there were too many tunings; call again in {wait:.1f} s"
            if self._latest is None:
                return "there is no window yet; call again after the first update"
            few = too_few(self._latest[0])
            if not few:
                self._start(done)
            return few

    def _waits(self) -> bool:
        """Whether no tuning may begin now; the share is looked at only while nothing uses it."""
        return self._busy or self._share.wait() > 0.0

    def _start(self, done: Done) -> None:
        if self._latest is not None:
            self._job, self._busy = (*self._latest, done), True
            self._changed.notify()

    def close(self) -> None:
        """Begin nothing more."""
        with self._changed:
            self._closed = True
            self._changed.notify()

    def run(self) -> None:
        """Work until closed."""
        try:
            give_way()
            for found, config, done in iter(self._next, None):
                with self._share.work():
                    tuned = work(found, config)
                self._busy = False
                if not self._closed:
                    done(tuned)
        except Exception as error:
            self._end(error)

    def _next(self) -> Job | None:
        """Wait for something to do; None when closed."""
        with self._changed:
            self._changed.wait_for(lambda: self._job or self._closed)
            job, self._job = self._job, None
            return None if self._closed else job


def give_way() -> None:
    """Lower the priority of this thread to NICE, unless it is lower already.

    Raising it takes a right. A system that forbids both lets tunings go on all the same.
    """
    thread = threading.get_native_id()  # Linux: each has a priority of its own
    with suppress(OSError):
        present = os.getpriority(os.PRIO_PROCESS, thread)
        os.setpriority(os.PRIO_PROCESS, thread, max(present, NICE))


def work(found: Segmentation, config: Config) -> Tuned:
    """Tune on the window of a segmentation; what goes wrong must not end the node."""
    started = time.monotonic()
    try:
        points = found.points[found.labels >= ISOLATED]
        with single_threaded():  # the pool is for the updates
            curve = tune(points, config, LIVE_SEARCH, found.origin)
    except Exception as error:
        problem = f"the tuning failed: {type(error).__name__}: {' '.join(str(error).split())}"
        return Tuned(found, config, None, problem)
    return Tuned(found, config, curve, "", time.monotonic() - started)


def too_few(found: Segmentation) -> str:
    """Why a window is not worth a tuning; empty if it is."""
    points = found.counts.segmented
    if points >= LEAST:
        return ""
    return f"the window has {points} segmented points; a curve needs {LEAST} or more"
