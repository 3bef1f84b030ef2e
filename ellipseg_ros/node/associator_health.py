"""Counters of the associator and the health that follows from them, for /diagnostics."""

import time
from collections import Counter, deque

from ellipseg_ros.node import health
from ellipseg_ros.node.memory import resident_mb
from ellipseg_ros.records import Association, Verdict


class AssociatorHealth:
    """Counters of updates; for one thread.

    ERROR: every update since the last report was rejected. WARN: no landmarks for 5 s (or none
    yet), or some rejected. OK: otherwise, whatever the verdict.
    """

    def __init__(self) -> None:
        self._new: Counter[str] = Counter()  # since the last report
        self._total: Counter[str] = Counter()
        self._last_rejection = ""
        self._input_time = time.monotonic()
        self._processing: deque[float] = deque(maxlen=health.TIMED_UPDATES)  # s
        self._last: Association | None = None

    def rejected(self, reason: str) -> None:
        """Count landmarks that can't be used."""
        self._input_time = time.monotonic()
        self._new["rejected"] += 1
        self._last_rejection = reason

    def updated(self, association: Association, seconds: float) -> None:
        """Count an association and its duration."""
        self._input_time = time.monotonic()
        self._new["updates"] += 1
        self._new[association.verdict.name] += 1
        self._new["pairs"] += len(association)
        self._processing.append(seconds)
        self._last = association

    def report(self, map_size: int) -> health.Report:
        """Summarize the time since the last report; map_size: number of stored landmarks."""
        self._total += self._new
        level, message = self._judge()
        self._new.clear()
        return health.Report(level, message, self._values(map_size))

    def _judge(self) -> tuple[int, str]:
        if self._new["rejected"]:
            level = health.WARN if self._new["updates"] else health.ERROR
            return level, f"landmarks rejected: {self._last_rejection}"
        if not self._total["updates"]:
            return health.WARN, "no landmarks yet"
        idle = time.monotonic() - self._input_time
        if idle > health.INPUT_TIMEOUT_S:
            return health.WARN, f"no landmarks for {idle:.0f} s"
        return health.OK, "associating"

    def _values(self, map_size: int) -> dict[str, str]:
        names = ("updates", "rejected", "pairs", *(verdict.name for verdict in Verdict))
        last = self._last
        return {
            "map landmarks": str(map_size),
            **{name.lower().replace("_", " "): str(self._total[name]) for name in names},
            "last verdict": last.verdict.name if last else "",
            "last pairs": str(len(last)) if last else "",
            "last undetermined": "; ".join(last.undetermined_names) if last else "",
            "time since the last landmarks [s]": f"{time.monotonic() - self._input_time:.1f}",
            "memory [MB]": f"{resident_mb():.0f}",
            **health.quantiles("processing", self._processing),
        }
