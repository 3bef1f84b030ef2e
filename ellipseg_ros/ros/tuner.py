"""Tuning of the threshold on the present window, in a thread beside the one that segments."""

import os
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial

from ellipseg_ros.config import Config
from ellipseg_ros.core.jit import single_threaded
from ellipseg_ros.records import ISOLATED, SECOND, Segmentation
from ellipseg_ros.ros.limits import Share
from ellipseg_ros.ros.process import OnError, start_thread
from ellipseg_ros.tuning.curve import Curve
from ellipseg_ros.tuning.live import LIVE_SEARCH
from ellipseg_ros.tuning.search import tune

NICENESS = 10  # of the thread: updates have priority
TUNING_SHARE = (0.3, 20.0)  # of the time, for all tunings, and burst in s
MIN_POINTS = 100  # below which a curve is meaningless


@dataclass(frozen=True)
class Tuned:
    """Outcome of a tuning."""

    window: Segmentation
    config: Config  # the settings of its segmentation
    curve: Curve | None
    problem: str = ""  # in one line, if there is no curve
    seconds: float = 0.0


Done = Callable[[Tuned], object]


class Tuner:
    """Tunes one window at a time, on one core and at low priority, while updates continue.

    Each tuning has a thread of its own, in which these are called:
    on_auto_tuned: after an automatic tuning.
    end: with an unexpected error; no tuning follows it.
    """

    def __init__(self, on_auto_tuned: Done, end: OnError) -> None:
        self._on_auto_tuned = on_auto_tuned
        self._end = end
        self._lock = threading.Lock()
        self._latest: tuple[Segmentation, Config] | None = None
        self._thread: threading.Thread | None = None  # of the last tuning
        self._busy = False
        self._share = Share(*TUNING_SHARE)
        self._period_ns = 0
        self._due_ns = 0  # sensor time of the next automatic tuning
        self._closed = False

    def observe(self, segmentation: Segmentation, config: Config, period: float) -> None:
        """Keep an update, and tune on it if `period` s of sensor time have passed; 0: never.

        The first automatic tuning is due a period after the start, a restart, or a change of the
        period, when the window has filled. It is postponed while another tuning runs, or while
        all tunings have exceeded their share: a period of a minute leaves 18 s to each.
        """
        with self._lock:
            self._latest = (segmentation, config)
            period_ns = round(period * SECOND)
            end_ns = segmentation.end_ns
            if segmentation.restart or period_ns != self._period_ns:
                self._period_ns, self._due_ns = period_ns, end_ns + period_ns
            elif period_ns and end_ns >= self._due_ns and not self._obstacle():
                self._due_ns = end_ns + period_ns
                self._start_job(self._on_auto_tuned)

    def reset(self) -> None:
        """Discard the latest update, whose window has been reset."""
        with self._lock:
            self._latest, self._period_ns = None, 0

    def request(self, done: Done) -> str:
        """Tune on the latest update, then call `done` in its thread; return why not, or ""."""
        with self._lock:
            return self._obstacle() or self._start_job(done)

    def _obstacle(self) -> str:
        """Return why no tuning may start now, or "".

        Queries the share only while no tuning counts on it, which another thread does.
        """
        if self._busy or self._closed:
            return "a tuning is running; call again when it has finished"
        wait = self._share.wait()
        return f"there were too many tunings; call again in {wait:.1f} s" if wait else ""

    def _start_job(self, done: Done) -> str:
        """Tune on the latest update in another thread; return why not, or ""."""
        if self._latest is None:
            return "there is no window yet; call again after the first update"
        points = self._latest[0].counts.segmented
        if points < MIN_POINTS:
            return f"the window has {points} segmented points; a curve needs {MIN_POINTS} or more"
        self._busy = True
        self._thread = start_thread("tuner", partial(self._tune, *self._latest, done), self._end)
        return ""

    def close(self, timeout: float) -> bool:
        """Start no more tunings; False if the present one takes longer than `timeout` s."""
        with self._lock:
            self._closed = True
        if self._thread is not None:
            self._thread.join(timeout)
        return not self._busy

    def _tune(self, window: Segmentation, config: Config, done: Done) -> None:
        lower_priority()
        with self._share.work():
            tuned = tune_window(window, config)
        self._busy = False
        if not self._closed:
            done(tuned)


def lower_priority() -> None:
    """Set the niceness of this thread to at least NICENESS.

    A lower one can't be restored without privileges. Tunings work without it, too, where the
    system forbids the call.
    """
    thread = threading.get_native_id()  # Linux: each has a priority of its own
    with suppress(OSError):
        niceness = os.getpriority(os.PRIO_PROCESS, thread)
        os.setpriority(os.PRIO_PROCESS, thread, max(niceness, NICENESS))


def tune_window(window: Segmentation, config: Config) -> Tuned:
    """Tune on the points of a window; errors become a problem, as they must not end the node."""
    started = time.monotonic()
    try:
        points = window.points[window.labels >= ISOLATED]
        with single_threaded():  # the thread pool is for the updates
            curve = tune(points, config, LIVE_SEARCH, window.origin)
    except Exception as error:
        problem = f"the tuning failed: {type(error).__name__}: {' '.join(str(error).split())}"
        return Tuned(window, config, None, problem)
    return Tuned(window, config, curve, "", time.monotonic() - started)
