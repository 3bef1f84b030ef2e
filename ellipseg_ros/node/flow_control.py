"""Keeps a replayer from running ahead of the node, by the updates that come back."""

from collections import deque

import numpy as np

from ellipseg_ros.config import Config
from ellipseg_ros.node.grouping import Grouping
from ellipseg_ros.records import SECOND, Sweep


class FlowControl:
    """Knows which clouds close an update, and so which updates are still to come back.

    config: that of the node, for its update period and lateness.
    ahead: s of sensor time that a cloud may be ahead of the last update that came back. With no
        update outstanding a cloud may always go, so that neither gaps nor a short time block.
    """

    def __init__(self, config: Config, ahead: float) -> None:
        self._grouping = Grouping(config)
        self._ahead = round(ahead * SECOND)
        self._outstanding: deque[tuple[int, int]] = deque()  # (run between restarts, ns: its end)
        self._run = 0
        self._end = 0  # ns: newest point of this run
        self._back = 0  # ns: how far the node has come in this run
        self.closed = 0  # updates that the node makes of what was sent

    def may_send(self, sweep: Sweep) -> bool:
        """Whether the cloud is near enough to the last update that came back."""
        return not self._outstanding or sweep.stamp_ns <= self._back + self._ahead

    def send(self, sweep: Sweep) -> None:
        """Note that the cloud was sent."""
        rows = min(1, len(sweep))  # one point tells as much as all
        token = Sweep(
            sweep.stamp_ns,
            np.zeros((rows, 3)),
            np.full(rows, sweep.offsets_ns.max(initial=np.iinfo(np.int64).min)),
            None if sweep.fields is None else sweep.fields[:rows],
            sweep.frame_id,
            sweep.restart,
        )
        for group in self._grouping.push(token):
            self._close(group)

    def come_back(self, end_ns: int) -> None:
        """Note that the update whose newest point is of `end_ns` has come back."""
        for run, end in self._outstanding:
            if end == end_ns:
                return self._drop_until(run, end)
        # Not one of ours: the node's update period is another.
        if self._outstanding:
            first = self._outstanding[0][0]
            while self._outstanding and self._outstanding[0] <= (first, end_ns):
                self._drop_until(*self._outstanding[0])
        return None

    def give_up(self) -> int:
        """Expect nothing more of what was sent; returns how many updates that are."""
        lost = len(self._outstanding)
        self._outstanding.clear()
        self._back = self._end
        return lost

    @property
    def outstanding(self) -> int:
        """Updates that have not come back."""
        return len(self._outstanding)

    def _close(self, group: Sweep) -> None:
        begins = bool(group.restart) or not self.closed
        if begins:
            self._run += 1
            self._back = int(group.times_ns.min(initial=group.stamp_ns))
        if len(group):
            newest = int(group.times_ns.max())
            self._end = newest if begins else max(self._end, newest)
        elif begins:
            self._end = group.stamp_ns
        self._outstanding.append((self._run, self._end))
        self.closed += 1

    def _drop_until(self, run: int, end: int) -> None:
        while self._outstanding and self._outstanding[0] <= (run, end):
            self._outstanding.popleft()
        if run == self._run:
            self._back = max(self._back, end)
