"""Counters of the segmenter and the health that follows from them, for /diagnostics."""

import math
import time
from collections import Counter, deque
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from threading import Lock

import numpy as np

from ellipseg_ros.node.memory import resident_mb
from ellipseg_ros.node.stamps import STALLED_CLOUDS, StampMonitor
from ellipseg_ros.poses.placement import Unplaced
from ellipseg_ros.poses.placer import RefusedPose
from ellipseg_ros.records import SECOND, Segmentation
from ellipseg_ros.tuning.curve import Curve

OK, WARN, ERROR = 0, 1, 2  # as in diagnostic_msgs/DiagnosticStatus
INPUT_TIMEOUT_S = 5.0  # without input, before a warning
UPDATE_TIMEOUT_S = 60.0  # of one update, before an error
LATE_UPDATES = 3  # consecutive late updates before a warning
TIMED_UPDATES = 100  # updates whose times give the median and the 99th percentile
# Prefixes of the counters by reason.
REJECTED, UNPLACED, REFUSED = "clouds rejected: ", "clouds unplaced: ", "poses refused: "
PREFIXES = (REJECTED, UNPLACED, REFUSED)
COUNTERS = {  # by key of /diagnostics
    "clouds received": "clouds",
    "clouds rejected": "rejected",
    "clouds lost by DDS": "lost",
    "clouds unplaced": "unplaced",
    "clouds with stalled stamps": "stalled",
    "stamp gaps": "gaps",
    "points unplaced": "points_unplaced",
    "points filtered": "points_filtered",
    "points late": "late",
    "points evicted": "evicted",
    "points dropped": "points_dropped",
    "poses received": "poses",
    "poses refused": "poses_refused",
    "poses lost by DDS": "poses_lost",
    "updates": "updates",
    "updates coalesced": "coalesced",
    "updates dropped": "dropped",
    "restarts": "restarts",
    "threshold changes": "threshold_changes",
    "tunings": "tunings",
}


@dataclass(frozen=True)
class Report:
    """A node's health as one diagnostic status."""

    level: int
    message: str  # one line
    values: dict[str, str]


class Health:
    """Counters of clouds and updates; every method is thread-safe.

    Levels of a report, each about the time since the previous one:
    ERROR: an update has taken more than 60 s so far; every cloud was rejected, or unplaced.
    WARN: kernels are loading; no cloud for 5 s (or none yet); clouds rejected, lost, unplaced or
        waiting for poses; poses refused or lost; updates
        coalesced or dropped; three consecutive updates later than `update_period`; points evicted
        for `max_points`; stamps that don't advance, or jump forward by more than the window; a
        frame that looks like a sensor's; another publisher of the same topics; more than one
        restart of the window.
    OK: otherwise.
    """

    def __init__(self) -> None:
        self._lock = Lock()
        self._total: Counter[str] = Counter()
        self._reported: Counter[str] = Counter()
        self._start = self._report_time = self._cloud_time = time.monotonic()
        self._work_start: float | None = None  # s, monotonic clock; None: the worker is idle
        self._update_time: float | None = None  # s, monotonic clock, of the last update
        self._newest_ns: int | None = None  # stamp of its newest point
        self._lateness: deque[float] = deque(maxlen=LATE_UPDATES)  # latency / update_period
        self._latency: deque[float] = deque(maxlen=TIMED_UPDATES)  # s
        self._processing: deque[float] = deque(maxlen=TIMED_UPDATES)  # s
        self._window: dict[str, str] = {}
        self._unplaced_text = self._refused_text = ""  # of the last one
        self._last = dict.fromkeys(("last restart", "last threshold change", "last tuning"), "")
        self.ready = False  # all kernels are compiled and clouds are subscribed to
        self.stamps = StampMonitor()  # of the received clouds
        self.other_publishers = 0  # other nodes that publish `segments`
        self.sensor_frame = ""  # the frame of the clouds, if it looks like a sensor's
        self.placement: dict[str, str] = {}  # values about poses and how clouds are read
        self.waiting_for = ""  # what clouds have been waiting for, for too long

    @contextmanager
    def work(self) -> Iterator[None]:
        """Measure how long the worker has been busy with the block."""
        self._work_start = time.monotonic()
        try:
            yield
        finally:
            self._work_start = None

    def cloud(self) -> None:
        """Count a received cloud, valid or not."""
        with self._lock:
            self._total["clouds"] += 1
            self._cloud_time = time.monotonic()

    def rejected(self, reason: str, group: bool = False) -> None:
        """Count an invalid cloud; group: valid clouds that can't be used together, as one."""
        with self._lock:
            self._total.update(["rejected", REJECTED + reason])
            self._total["refused"] += not group

    def unplaced(self, cloud: Unplaced) -> None:
        """Count a cloud without a pose."""
        with self._lock:
            self._total.update(["unplaced", UNPLACED + cloud.reason])
            self._total["points_unplaced"] += cloud.points
            self._unplaced_text = cloud.text

    def refused(self, pose: RefusedPose) -> None:
        """Count a pose that can't be used."""
        with self._lock:
            self._total.update(["poses_refused", REFUSED + pose.reason])
            self._refused_text = pose.text

    def count(self, **counts: int) -> None:
        """Add to counters, the values of COUNTERS; and placed (clouds)."""
        with self._lock:
            self._total.update(counts)

    def updated(
        self,
        segmentation: Segmentation,
        processing: float,
        latency: float,
        period: float = math.inf,
    ) -> None:
        """Count a published update.

        processing: s. latency: s since its last cloud arrived. period: s, `update_period`, which
        the latency must not exceed in real time.
        """
        with self._lock:
            self._update_time, self._newest_ns = time.monotonic(), segmentation.end_ns
            self._lateness.append(latency / period)
            self._processing.append(processing)
            self._latency.append(latency)
            self._total["updates"] += 1
            self._total["late"] += segmentation.late
            self._total["evicted"] += segmentation.evicted
            if segmentation.restart:
                self._total["restarts"] += 1
                self._last["last restart"] = segmentation.restart
            if segmentation.threshold_change:
                self._total["threshold_changes"] += 1
                change = f"{segmentation.threshold_change}: {segmentation.threshold:.6g}"
                self._last["last threshold change"] = change
            self._window = _describe_window(segmentation)

    def tuned(self, curve: Curve, seconds: float) -> None:
        """Count a tuning and its duration."""
        with self._lock:
            self._total["tunings"] += 1
            best = curve.threshold[curve.best]
            outcome = f"{curve.criterion}: least AICc at {best:.6g}; {seconds:.2f} s"
            self._last["last tuning"] = outcome

    def report(self, waiting: int, now_ns: int | None = None) -> Report:
        """Summarize the time since the last report.

        waiting: updates in the backlog. now_ns: the node's time, for the age of the points.
        """
        with self._lock:
            now, start = time.monotonic(), self._work_start
            busy = 0.0 if start is None else now - start
            self._total["stalled"] = self.stamps.stalled
            self._total["gaps"] = self.stamps.gaps
            new = self._total - self._reported
            rate = new["clouds"] / max(now - self._report_time, 1e-9)
            level, message = self._judge(new, now, busy)
            self._reported, self._report_time = self._total.copy(), now
            values = {
                "input rate [1/s]": f"{rate:.2f}",
                "updates in backlog": str(waiting),
                **{key: str(self._total[name]) for key, name in COUNTERS.items()},
                **{k: str(self._total[k]) for k in _reasons(self._total, *PREFIXES)},
                **self.placement,
                **self._last,
                **quantiles("processing", self._processing),
                **quantiles("latency", self._latency),
                **self._window,
                "current update duration [s]": f"{busy:.1f}",
                "uptime [s]": f"{now - self._start:.0f}",
                "memory [MB]": f"{resident_mb():.0f}",
            }
            if self._update_time is not None and self._newest_ns is not None:
                values["time since the last update [s]"] = f"{now - self._update_time:.1f}"
                if now_ns is not None:
                    age_s = (now_ns - self._newest_ns) / SECOND
                    values["age of the newest point [s]"] = f"{age_s:.1f}"
            return Report(level, message, values)

    def _judge(self, new: Counter[str], now: float, busy: float) -> tuple[int, str]:
        if busy > UPDATE_TIMEOUT_S:
            return ERROR, f"the current update has taken {busy:.0f} s so far"
        if new["clouds"] and new["refused"] >= new["clouds"]:
            reasons = ", ".join(key.removeprefix(REJECTED) for key in _reasons(new, REJECTED))
            return ERROR, f"every cloud is rejected: {reasons}"
        if new["unplaced"] and not new["placed"]:
            return ERROR, f"every cloud is unplaced: {self._unplaced_text}"
        warnings = [text for text, applies in self._warnings(new, now) if applies]
        return (WARN, "; ".join(warnings)) if warnings else (OK, "segmenting")

    def _warnings(self, new: Counter[str], now: float) -> list[tuple[str, object]]:
        """All warnings, and whether each applies."""
        idle, stalled = now - self._cloud_time, self.stamps.stalled
        if idle > INPUT_TIMEOUT_S:
            self._lateness.clear()  # earlier latencies say nothing about the present
        late = len(self._lateness) == LATE_UPDATES and min(self._lateness) > 1.0
        received, latency = self._total["clouds"], self._latency[-1] if late else 0.0
        return [
            ("loading the kernels, which are compiled at the first start", not self.ready),
            ("no cloud yet", self.ready and not received),
            (f"no cloud for {idle:.0f} s", self.ready and received and idle > INPUT_TIMEOUT_S),
            (f"{new['rejected']} clouds rejected", new["rejected"]),
            (f"{new['lost']} clouds lost", new["lost"]),
            (f"{new['unplaced']} clouds unplaced: {self._unplaced_text}", new["unplaced"]),
            (f"clouds wait for poses: {self.waiting_for}", self.waiting_for),
            (
                f"{new['poses_refused']} poses refused: {self._refused_text}",
                new["poses_refused"],
            ),
            (f"{new['poses_lost']} poses lost", new["poses_lost"]),
            (f"stamps do not advance: {stalled} clouds are no newer", stalled >= STALLED_CLOUDS),
            ("stamps jumped forward by more than the window", new["gaps"]),
            (
                f"the window restarted {new['restarts']} times: {self._last['last restart']}",
                new["restarts"] > 1,
            ),
            (f"frame {self.sensor_frame} looks like a sensor's", self.sensor_frame),
            (f"too slow: {new['coalesced']} updates coalesced", new["coalesced"]),
            (f"too slow: {new['dropped']} updates dropped", new["dropped"]),
            (
                f"too slow for real time: {LATE_UPDATES} consecutive updates were later than "
                f"update_period, the last after {latency:.2f} s",
                late,
            ),
            (f"max_points reached: {new['evicted']} points evicted", new["evicted"]),
            (f"{self.other_publishers} other nodes publish segments", self.other_publishers),
        ]


def _reasons(counts: Counter[str], *prefixes: str) -> list[str]:
    """Names of the counters by reason, sorted."""
    return sorted(name for name in counts if name.startswith(prefixes))


def quantiles(name: str, seconds: deque[float]) -> dict[str, str]:
    """Last value, median and 99th percentile of recent times; empty before the first."""
    if not seconds:
        return {}
    median, high = np.quantile(np.array(seconds), [0.5, 0.99])
    return {
        f"{name} last [s]": f"{seconds[-1]:.4f}",
        f"{name} median [s]": f"{median:.4f}",
        f"{name} p99 [s]": f"{high:.4f}",
    }


def _describe_window(segmentation: Segmentation) -> dict[str, str]:
    counts = segmentation.counts
    return {
        "frame": segmentation.frame_id,
        "window [s]": f"{(segmentation.end_ns - segmentation.start_ns) / SECOND:.3f}",
        "points segmented": str(counts.segmented),
        "points isolated": str(counts.isolated),
        "points rejected": str(counts.rejected),
        "points thinned": str(counts.thinned),
        "segments": str(len(segmentation.ids)),
        "criterion": segmentation.criterion,
        "threshold": f"{segmentation.threshold:g}",
        "AICc": f"{segmentation.aicc:.1f}",
    }
