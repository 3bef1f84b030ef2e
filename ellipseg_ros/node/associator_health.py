"""What the associator counts, and what that says of its health; for /diagnostics."""

import time
from collections import Counter, deque

from ellipseg_ros.node.health import ERROR, OK, REMEMBERED, SILENCE, WARN, Report, quantiles
from ellipseg_ros.node.memory import resident_mb
from ellipseg_ros.records import Association


class AssociatorHealth:
    """Counts of updates; for one thread.

    ERROR: since the last report, every update was rejected. WARN: no landmarks for 5 s (or none
    yet), or some rejected. OK: else, whatever the verdict.
    """

    def __init__(self) -> None:
        self._new: Counter[str] = Counter()  # since the last report
        self._total: Counter[str] = Counter()
        self._why = ""  # the last one was rejected
        self._heard_at = time.monotonic()
        self._times: deque[float] = deque(maxlen=REMEMBERED)
        self._last: Association | None = None

    def rejected(self, why: str) -> None:
        """Landmarks could not be used."""
        self._heard_at = time.monotonic()
        self._new["rejected"] += 1
        self._why = why

    def updated(self, found: Association, seconds: float) -> None:
        """Landmarks were associated, which took so long."""
        self._heard_at = time.monotonic()
        self._new["updates"] += 1
        self._new[found.verdict.name] += 1
        self._new["pairs"] += len(found)
        self._times.append(seconds)
        self._last = found

    def report(self, stored: int) -> Report:
        """The health since the last report; `stored`: landmarks of the map."""
        self._total += self._new
        level, message = self._judge()
        self._new.clear()
        return Report(level, message, self._values(stored))

    def _judge(self) -> tuple[int, str]:
        if self._new["rejected"]:
            every = not self._new["updates"]
            return (ERROR if every else WARN), f"landmarks rejected: {self._why}"
        if not self._total["updates"]:
            return WARN, "no landmarks yet"
        silence = time.monotonic() - self._heard_at
        if silence > SILENCE:
            return WARN, f"no landmarks for {silence:.0f} s"
        return OK, "associating"

    def _values(self, stored: int) -> dict[str, str]:
        names = ("updates", "rejected", "pairs", "KNOWN", "PARTIAL", "AMBIGUOUS", "TOO_FEW")
        last = self._last
        return {
            "landmarks of the map": str(stored),
            **{name.lower().replace("_", " "): str(self._total[name]) for name in names},
            "last verdict": last.verdict.name if last else "",
            "last pairs": str(len(last)) if last else "",
            "last unknown": "; ".join(last.undetermined_names) if last else "",
            "time since the last landmarks [s]": f"{time.monotonic() - self._heard_at:.1f}",
            "memory [MB]": f"{resident_mb():.0f}",
            **quantiles("processing", self._times),
        }
