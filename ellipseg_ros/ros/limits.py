"""Bounds on the cost of a flood of messages or calls: log lines, and computing time."""

import time
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from rclpy.clock import Clock
from rclpy.clock_type import ClockType

STEADY = Clock(clock_type=ClockType.STEADY_TIME)
CALLBACK_SHARE = (0.2, 1.0)  # of a core, for all callbacks but the input's, and burst in s
MAX_PAUSE_S = 0.05  # of the thread of the callbacks, in which input may be waiting


def throttled(seconds: float = 5.0) -> dict[str, Any]:
    """Options of a logger call that limit it to one line per `seconds`.

    By default rclpy would use the system clock, and stop logging when that is set back.
    """
    return {"throttle_duration_sec": seconds, "throttle_time_source_type": STEADY}


class Quota:
    """At most `count` permits within `seconds`; for one thread."""

    def __init__(self, count: int, seconds: float) -> None:
        self._seconds = seconds
        self._times: deque[float] = deque(maxlen=count)

    def take(self) -> bool:
        """Take a permit if one is left."""
        now = time.monotonic()
        full = len(self._times) == self._times.maxlen
        if full and now - self._times[0] < self._seconds:
            return False
        self._times.append(now)
        return True


class Share:
    """Limits a kind of work to a share of the time (a token bucket).

    burst: s of work that may be done without a pause after a time without work. Work may be
    counted in another thread than the one that calls `wait`, but only in one at a time.
    """

    def __init__(self, share: float, burst: float) -> None:
        self._share, self._burst = share, burst
        self._credit = burst  # s of work, at `_time`
        self._time = time.monotonic()

    @contextmanager
    def work(self) -> Iterator[None]:
        """Count the duration of the block."""
        started = time.monotonic()
        try:
            yield
        finally:
            self.spend(time.monotonic() - started)

    def spend(self, seconds: float) -> None:
        """Count work that has been done."""
        self._accrue()
        self._credit -= seconds

    def limit_debt(self) -> None:
        """Reduce the debt to one burst."""
        self._credit = max(self._credit, -self._burst)

    def wait(self) -> float:
        """Time until work may start, s; 0: it may start now."""
        self._accrue()
        return max(0.0, -self._credit) / self._share

    def _accrue(self) -> None:
        """Add the credit earned since the last call; work may start above 0."""
        now = time.monotonic()
        self._credit = min(self._burst, self._credit + (now - self._time) * self._share)
        self._time = now


class Pauses:
    """Limits the thread of the callbacks to a share of a core by pauses.

    A flood of calls thus leaves the cores, and Python's lock, to the segmentation. Pauses are
    short, because input may be waiting. For that thread only.
    share, burst: of its CPU time, as in Share.
    """

    def __init__(self, share: float, burst: float) -> None:
        self._share = Share(share, burst)
        self._cpu_time: float | None = None  # s, at the last pause
        self._exempt = False

    def exempt(self) -> None:
        """Count nothing until the next pause: the callback processes input."""
        self._exempt = True

    def take(self) -> None:
        """Pause if the share is exceeded."""
        before, self._cpu_time = self._cpu_time, time.thread_time()
        exempt, self._exempt = self._exempt, False
        if before is None or exempt:
            return
        self._share.spend(self._cpu_time - before)
        self._share.limit_debt()  # old calls must not delay input for long
        if wait := self._share.wait():
            time.sleep(min(wait, MAX_PAUSE_S))
