"""Detection of stamps that stop advancing or jump forward; neither restarts the window."""

from ellipseg_ros.records import SECOND, Sweep

STALLED_CLOUDS = 100  # consecutive clouds without a newer stamp that are worth a warning


class StampMonitor:
    """Checks the stamps of the clouds in the order of arrival.

    Jumps back are not its concern: they restart the window (node/grouping.py).
    """

    def __init__(self) -> None:
        self._newest_ns: int | None = None
        self.stalled = 0  # clouds since the last one with a newer stamp
        self.gaps = 0  # forward jumps by more than the window

    def check(self, sweep: Sweep, window_s: float, lateness_s: float) -> str:
        """Count the stamp of a cloud; return a warning in one line, or an empty text.

        window_s, lateness_s: `window_duration` and `max_lateness`.
        """
        previous_ns = self._newest_ns
        ahead_ns = 0 if previous_ns is None else sweep.stamp_ns - previous_ns
        if previous_ns is None or ahead_ns > 0 or -ahead_ns > round(lateness_s * SECOND):
            self._newest_ns = sweep.stamp_ns
            self.stalled = 0
        else:
            self.stalled += 1
        if ahead_ns > round(window_s * SECOND):
            self.gaps += 1
            return (
                f"the stamps jumped forward by {ahead_ns / SECOND:.3f} s, more than the window of "
                f"{window_s:g} s: all points of the window have expired"
            )
        if self.stalled == STALLED_CLOUDS:
            return (
                f"{STALLED_CLOUDS} consecutive clouds are no newer than "
                f"{sweep.stamp_ns / SECOND:.3f} s: updates need advancing stamps; check the "
                "stamps of the publisher"
            )
        return ""
