"""What the node counts, and what that says of its health; for /diagnostics, but without ROS."""

import math
import time
from collections import Counter, deque
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from threading import Lock

import numpy as np

from ellipseg_ros.node.memory import resident_mb
from ellipseg_ros.node.stamps import STALLED_CLOUDS
from ellipseg_ros.records import SECOND, Segmentation
from ellipseg_ros.tuning.curve import Curve

OK, WARN, ERROR = 0, 1, 2  # as in diagnostic_msgs/DiagnosticStatus
SILENCE = 5.0  # s without a cloud that deserve a warning
STUCK = 60.0  # s of one update that are an error
SLOW = 3  # updates in a row that are late before it is worth a warning
REMEMBERED = 100  # updates whose times make the median and the 99th percentile


@dataclass(frozen=True)
class Report:
    """The node's health: level, one line, details by name."""

    level: int
    message: str
    values: dict[str, str]


class Health:
    """Counts of clouds and updates; every method may be called from any thread.

    Levels of the report, each over the time since the last one:
    ERROR: an update takes longer than 60 s; clouds came and every one was rejected.
    WARN: kernels are being loaded; no cloud for 5 s (or none yet); clouds rejected or lost;
        updates taken together or given up; three updates in a row later than `update_period`;
        points expired early for `max_points`; stamps that stand still, or jump
        forward by more than the window; the frame looks like a sensor's; another node
        publishes the same topics; the window began anew more than once.
    OK: else.
    The table under /diagnostics in README.md says what to do about each.
    """

    def __init__(self) -> None:
        self._lock = Lock()
        self._total: Counter[str] = Counter()
        self._reported: Counter[str] = Counter()
        self._rejected: Counter[str] = Counter()  # by reason
        self._reported_reasons: Counter[str] = Counter()
        self._began = self._reported_at = time.monotonic()
        self._heard_at = self._began
        self._ready = False
        self._busy_since: float | None = None  # s, monotonic clock: when the worker began
        self._updated_at: float | None = None  # of the last update
        self._newest_ns: int | None = None  # its newest point
        self._late: deque[float] = deque(maxlen=SLOW)  # latency / update_period of the last ones
        self._latency: deque[float] = deque(maxlen=REMEMBERED)
        self._processing: deque[float] = deque(maxlen=REMEMBERED)
        self._window: dict[str, str] = {}
        self._still = 0  # clouds since the last one with a newer stamp
        self._last_restart = ""
        self._last_change = ""  # of the threshold
        self._last_tuning = ""
        self.rivals = 0  # other nodes that publish the same topics
        self.sensor_frame = ""  # the frame of the clouds, if it looks like a sensor's

    def ready(self) -> None:
        """All kernels are compiled: clouds can come."""
        with self._lock:
            self._ready = True

    @contextmanager
    def work(self) -> Iterator[None]:
        """The worker is at something for the time of the block."""
        self._busy_since = time.monotonic()
        try:
            yield
        finally:
            self._busy_since = None

    def cloud(self) -> None:
        """A cloud has come, good or bad."""
        with self._lock:
            self._total["clouds"] += 1
            self._heard_at = time.monotonic()

    def stamps(self, still: int, gaps: int) -> None:
        """What the stamps of the clouds are like: see stamps.StampMonitor."""
        with self._lock:
            self._still = still
            self._total["gaps"] = gaps

    def rejected(self, reason: str) -> None:
        """A cloud could not be used."""
        with self._lock:
            self._total["refused"] += 1
            self._count_rejected(reason)

    def group_rejected(self, reason: str) -> None:
        """Clouds that were good when they came could not be used together; counts as one."""
        with self._lock:
            self._count_rejected(reason)

    def _count_rejected(self, reason: str) -> None:
        self._total["rejected"] += 1
        self._rejected[reason] += 1

    def lost(self, clouds: int) -> None:
        """DDS has lost clouds on the way."""
        self._add("lost", clouds)

    def overloaded(
        self, joined: int, given_up: int, points_given_up: int = 0, evicted: int = 0
    ) -> None:
        """Updates were taken together with others, or given up before a restart.

        Points: of those given up; and of those that expired early, before their update.
        """
        self._add("joined", joined)
        self._add("given up", given_up)
        self._add("points given up", points_given_up)
        self._add("evicted", evicted)

    def _add(self, name: str, count: int) -> None:
        with self._lock:
            self._total[name] += count

    def updated(
        self, found: Segmentation, processing: float, latency: float, period: float = math.inf
    ) -> None:
        """An update was published. Times in s; latency: since its last cloud arrived.

        period: `update_period`, within which an update has to come to keep up in real time.
        """
        with self._lock:
            self._updated_at, self._newest_ns = time.monotonic(), found.end_ns
            self._late.append(latency / period)
            self._total["updates"] += 1
            self._total["late"] += found.late
            self._total["evicted"] += found.evicted
            self._processing.append(processing)
            self._latency.append(latency)
            if found.restart:
                self._total["restarts"] += 1
                self._last_restart = found.restart
            if found.threshold_change:
                self._total["threshold changes"] += 1
                self._last_change = f"{found.threshold_change}: {found.threshold:.6g}"
            self._window = describe(found)

    def tuned(self, curve: Curve, seconds: float) -> None:
        """A tuning has ended, which took so long."""
        with self._lock:
            self._total["tunings"] += 1
            best = curve.threshold[curve.best]
            self._last_tuning = f"{curve.criterion}: least AICc at {best:.6g}; {seconds:.2f} s"

    def report(self, waiting: int, now_ns: int | None = None) -> Report:
        """The health since the last report.

        waiting: updates in the backlog. now_ns: the node's time, by which stamps are judged.
        """
        with self._lock:
            now = time.monotonic()
            new = self._total - self._reported
            rate = new["clouds"] / max(now - self._reported_at, 1e-9)
            level, message = self._judge(new, now)
            self._reported, self._reported_at = self._total.copy(), now
            self._reported_reasons = self._rejected.copy()
            ages = self._ages(now, now_ns)
            return Report(level, message, {**self._values(rate, waiting), **ages})

    def _judge(self, new: Counter[str], now: float) -> tuple[int, str]:
        busy = self._busy(now)
        if busy > STUCK:
            return ERROR, f"an update has been under way for {busy:.0f} s"
        if new["clouds"] and new["refused"] >= new["clouds"]:
            reasons = sorted(self._rejected - self._reported_reasons)
            return ERROR, f"every cloud is rejected: {', '.join(reasons)}"
        warnings = self._about_input(now - self._heard_at)
        for name in ("rejected", "lost"):
            if new[name]:
                warnings.append(f"{new[name]} clouds {name}")
        for name in ("joined", "given up"):
            if new[name]:
                warnings.append(f"too slow: {new[name]} updates {name}")
        if len(self._late) == SLOW and min(self._late) > 1.0:
            warnings.append(
                f"too slow for real time: {SLOW} updates in a row came later than update_period, "
                f"the last after {self._latency[-1]:.2f} s"
            )
        if new["evicted"]:
            warnings.append(f"max_points reached: {new['evicted']} points expired early")
        if self._still >= STALLED_CLOUDS:
            warnings.append(f"the stamps stand still: {self._still} clouds are no newer")
        if new["restarts"] > 1:
            warnings.append(f"the window began anew {new['restarts']} times: {self._last_restart}")
        if new["gaps"]:
            warnings.append("the stamps jumped forward by more than the window")
        if self.sensor_frame:
            warnings.append(f"frame {self.sensor_frame} looks like a sensor's")
        if self.rivals:
            warnings.append(f"{self.rivals} other nodes publish segments in this namespace")
        return (WARN, "; ".join(warnings)) if warnings else (OK, "segmenting")

    def _about_input(self, silence: float) -> list[str]:
        if not self._ready:
            return ["loading the kernels, which are compiled the first time"]
        if not self._total["clouds"]:
            return ["no cloud yet"]
        if silence > SILENCE:
            self._late.clear()  # what was slow then says nothing of now
            return [f"no cloud for {silence:.0f} s"]
        return []

    def _busy(self, now: float) -> float:
        """How long the worker has been at what it does, s."""
        since = self._busy_since
        return 0.0 if since is None else now - since

    def _ages(self, now: float, now_ns: int | None) -> dict[str, str]:
        ages = {
            "update under way for [s]": f"{self._busy(now):.1f}",
            "running for [s]": f"{now - self._began:.0f}",
            "memory [MB]": f"{resident_mb():.0f}",
        }
        if self._updated_at is not None and self._newest_ns is not None:
            ages["time since the last update [s]"] = f"{now - self._updated_at:.1f}"
            if now_ns is not None:
                ages["age of the newest point [s]"] = f"{(now_ns - self._newest_ns) / SECOND:.1f}"
        return ages

    def _values(self, rate: float, waiting: int) -> dict[str, str]:
        total = self._total
        return {
            "input rate [1/s]": f"{rate:.2f}",
            "clouds received": str(total["clouds"]),
            "clouds rejected": str(total["rejected"]),
            **{f"clouds rejected: {why}": str(n) for why, n in sorted(self._rejected.items())},
            "clouds lost by DDS": str(total["lost"]),
            "points late": str(total["late"]),
            "points expired early": str(total["evicted"]),
            "points given up": str(total["points given up"]),
            "updates": str(total["updates"]),
            "updates waiting": str(waiting),
            "updates joined": str(total["joined"]),
            "updates given up": str(total["given up"]),
            "clouds since the stamps advanced": str(self._still),
            "gaps in the stamps": str(total["gaps"]),
            "restarts": str(total["restarts"]),
            "last restart": self._last_restart,
            "threshold changes": str(total["threshold changes"]),
            "last threshold change": self._last_change,
            "tunings": str(total["tunings"]),
            "last tuning": self._last_tuning,
            **quantiles("processing", self._processing),
            **quantiles("latency", self._latency),
            **self._window,
        }


def quantiles(name: str, seconds: deque[float]) -> dict[str, str]:
    """Median and 99th percentile of the last times; empty before the first."""
    if not seconds:
        return {}
    median, high = np.quantile(np.array(seconds), [0.5, 0.99])
    return {
        f"{name} last [s]": f"{seconds[-1]:.4f}",
        f"{name} median [s]": f"{median:.4f}",
        f"{name} p99 [s]": f"{high:.4f}",
    }


def describe(found: Segmentation) -> dict[str, str]:
    """The window and the model in numbers."""
    counts = found.counts
    return {
        "frame": found.frame_id,
        "window [s]": f"{(found.end_ns - found.start_ns) / SECOND:.3f}",
        "points segmented": str(counts.segmented),
        "points isolated": str(counts.isolated),
        "points rejected": str(counts.rejected),
        "points thinned": str(counts.thinned),
        "segments": str(len(found.ids)),
        "criterion": found.criterion,
        "threshold": f"{found.threshold:g}",
        "AICc": f"{found.aicc:.1f}",
    }
