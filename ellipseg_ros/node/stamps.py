"""Stamps that stand still, and gaps: what a window outlives, but a user wants to know."""

from ellipseg_ros.records import SECOND, Sweep

STILL = 100  # clouds in a row without a newer stamp that deserve a word


class Stamps:
    """Looks at the stamps of the clouds, in the order of arrival.

    A jump back is not its business: that restarts the window, which says so (grouping.py).
    """

    def __init__(self) -> None:
        self._newest_ns: int | None = None
        self.still = 0  # clouds since the last one with a newer stamp
        self.gaps = 0

    def look(self, sweep: Sweep, window_s: float, lateness_s: float) -> str:
        """One line about the cloud, or an empty text, which is the rule.

        window_s, lateness_s: `window_duration` and `max_lateness`.
        """
        before = self._newest_ns
        ahead = 0 if before is None else sweep.stamp_ns - before
        if before is None or ahead > 0 or -ahead > round(lateness_s * SECOND):
            self._newest_ns = sweep.stamp_ns
            self.still = 0
        else:
            self.still += 1
        if ahead > round(window_s * SECOND):
            self.gaps += 1
            return (
                f"the stamps jumped forward by {ahead / SECOND:.3f} s, more than the window of "
                f"{window_s:g} s: all that was in it has expired"
            )
        if self.still == STILL:
            return (
                f"{STILL} clouds came that are no newer than {sweep.stamp_ns / SECOND:.3f} s: "
                "updates are made as stamps advance, so the publisher must stamp its clouds"
            )
        return ""
