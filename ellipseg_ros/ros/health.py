"""What the node counts, and what that says of its health; for /diagnostics, but without ROS."""

import time
from collections import Counter, deque
from dataclasses import dataclass
from threading import Lock

import numpy as np

from ellipseg_ros.data import SECOND, Segmentation
from ellipseg_ros.stamps import STILL
from ellipseg_ros.tuning.curve import Curve

OK, WARN, ERROR = 0, 1, 2  # as in diagnostic_msgs/DiagnosticStatus
SILENCE = 5.0  # s without a cloud that deserve a warning
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
    ERROR: clouds came and every one was rejected.
    WARN: no cloud for 5 s (or none yet); clouds rejected or lost; updates taken together or given
        up; points expired early for `max_points`; stamps that stand still, or jump forward by more
        than the window; the frame looks like a sensor's.
    OK: else.
    """

    def __init__(self) -> None:
        self._lock = Lock()
        self._total: Counter[str] = Counter()
        self._reported: Counter[str] = Counter()
        self._rejected: Counter[str] = Counter()
        self._began = self._reported_at = time.monotonic()
        self._heard_at = self._began
        self._latency: deque[float] = deque(maxlen=REMEMBERED)
        self._processing: deque[float] = deque(maxlen=REMEMBERED)
        self._window: dict[str, str] = {}
        self._still = 0  # clouds since the last one with a newer stamp
        self._last_restart = ""
        self._last_change = ""  # of the threshold
        self._last_tuning = ""
        self.sensor_frame = ""  # the frame of the clouds, if it looks like a sensor's

    def cloud(self) -> None:
        """A cloud has come, good or bad."""
        with self._lock:
            self._total["clouds"] += 1
            self._heard_at = time.monotonic()

    def stamps(self, still: int, gaps: int) -> None:
        """What the stamps of the clouds are like: see stamps.Stamps."""
        with self._lock:
            self._still = still
            self._total["gaps"] = gaps

    def rejected(self, reason: str) -> None:
        """A cloud, or a group of them, could not be used."""
        with self._lock:
            self._total["rejected"] += 1
            self._rejected[reason] += 1

    def lost(self, clouds: int) -> None:
        """DDS has lost clouds on the way."""
        self._add("lost", clouds)

    def overloaded(self, joined: int, given_up: int) -> None:
        """Updates were taken together with others, or given up before a restart."""
        self._add("joined", joined)
        self._add("given up", given_up)

    def _add(self, name: str, count: int) -> None:
        with self._lock:
            self._total[name] += count

    def updated(self, found: Segmentation, processing: float, latency: float) -> None:
        """An update was published. Both times in s; latency: since its last cloud arrived."""
        with self._lock:
            self._total["updates"] += 1
            self._total["late"] += found.late
            self._total["crowded out"] += found.crowded_out
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

    def report(self, waiting: int) -> Report:
        """The health since the last report; `waiting`: updates in the backlog."""
        with self._lock:
            now = time.monotonic()
            new = self._total - self._reported
            rate = new["clouds"] / max(now - self._reported_at, 1e-9)
            level, message = self._judge(new, now - self._heard_at)
            self._reported, self._reported_at = self._total.copy(), now
            return Report(level, message, self._values(rate, waiting))

    def _judge(self, new: Counter[str], silence: float) -> tuple[int, str]:
        if new["clouds"] and new["rejected"] >= new["clouds"]:
            return ERROR, f"every cloud is rejected: {', '.join(sorted(self._rejected))}"
        warnings = []
        if not self._total["clouds"]:
            warnings.append("no cloud yet")
        elif silence > SILENCE:
            warnings.append(f"no cloud for {silence:.0f} s")
        for name in ("rejected", "lost"):
            if new[name]:
                warnings.append(f"{new[name]} clouds {name}")
        for name in ("joined", "given up"):
            if new[name]:
                warnings.append(f"too slow: {new[name]} updates {name}")
        if new["crowded out"]:
            warnings.append(f"max_points reached: {new['crowded out']} points expired early")
        if self._still >= STILL:
            warnings.append(f"the stamps stand still: {self._still} clouds are no newer")
        if new["gaps"]:
            warnings.append("the stamps jumped forward by more than the window")
        if self.sensor_frame:
            warnings.append(f"frame {self.sensor_frame} looks like a sensor's")
        return (WARN, "; ".join(warnings)) if warnings else (OK, "segmenting")

    def _values(self, rate: float, waiting: int) -> dict[str, str]:
        total = self._total
        return {
            "input rate [1/s]": f"{rate:.2f}",
            "clouds received": str(total["clouds"]),
            "clouds rejected": str(total["rejected"]),
            **{f"clouds rejected: {why}": str(n) for why, n in sorted(self._rejected.items())},
            "clouds lost by DDS": str(total["lost"]),
            "points late": str(total["late"]),
            "points expired early": str(total["crowded out"]),
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
    return {f"{name} median [s]": f"{median:.4f}", f"{name} p99 [s]": f"{high:.4f}"}


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
