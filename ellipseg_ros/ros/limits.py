"""Bounds on what a flood of messages or calls can cost: lines of the log, and time."""

import time
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from rclpy.clock import Clock
from rclpy.clock_type import ClockType

STEADY = Clock(clock_type=ClockType.STEADY_TIME)
LONGEST_PAUSE = 0.05  # s: clouds may wait meanwhile


def throttled(seconds: float = 5.0) -> dict[str, Any]:
    """For a call of a logger: the line of that call comes once in so many seconds at most.

    rclpy would ask the clock of the system, and be silent for an hour that it is set back.
    """
    return {"throttle_duration_sec": seconds, "throttle_time_source_type": STEADY}


class Quota:
    """So many within so many seconds, and no more; for one thread."""

    def __init__(self, count: int, seconds: float) -> None:
        self._seconds = seconds
        self._times: deque[float] = deque(maxlen=count)

    def take(self) -> bool:
        """Whether there is one left, which is then taken."""
        now = time.monotonic()
        full = len(self._times) == self._times.maxlen
        if full and now - self._times[0] < self._seconds:
            return False
        self._times.append(now)
        return True


class Share:
    """The share of the time that a kind of work may take, however often it is asked for.

    burst: s of work that may be done at once, when there was none for a while. It may be used up
    from another thread than the one that asks, but by one at a time.
    """

    def __init__(self, share: float, burst: float) -> None:
        self._share, self._burst = share, burst
        self._credit = burst  # s of work, at the time `_at`
        self._at = time.monotonic()

    @contextmanager
    def work(self) -> Iterator[None]:
        """Count the time of the block."""
        started = time.monotonic()
        try:
            yield
        finally:
            self.spend(time.monotonic() - started)

    def spend(self, seconds: float) -> None:
        """Count work that has been done."""
        self._credit = self._now() - seconds

    def forgive(self) -> None:
        """Let no more be owed than a burst."""
        self._credit = max(self._credit, -self._burst)

    def wait(self) -> float:
        """How long until work may begin, s; 0: at once."""
        self._credit = self._now()
        return max(0.0, -self._credit) / self._share

    def _now(self) -> float:
        """The credit of now: work may begin above 0, and may then take longer."""
        now = time.monotonic()
        earned = (now - self._at) * self._share
        self._at = now
        return min(self._burst, self._credit + earned)


class Pauses:
    """Pauses of the thread that answers calls, which then takes a share of a core at the most.

    So a flood of calls leaves the cores, and Python's lock, to the work. After one that takes
    long the pause is short, as clouds wait meanwhile. Called in that thread.
    share, burst: of its own time on a core, as in Share.
    """

    def __init__(self, share: float, burst: float) -> None:
        self._share = Share(share, burst)
        self._spent: float | None = None  # s on a core, until the last pause
        self._exempt = False

    def exempt(self) -> None:
        """What is done until the next pause counts for nothing: it is the work."""
        self._exempt = True

    def take(self) -> None:
        """Wait a moment if too much was done."""
        before, self._spent = self._spent, time.thread_time()
        exempt, self._exempt = self._exempt, False
        if before is None or exempt:
            return
        self._share.spend(self._spent - before)
        self._share.forgive()  # clouds need not wait on and on for what was asked long ago
        if wait := self._share.wait():
            time.sleep(min(wait, LONGEST_PAUSE))
