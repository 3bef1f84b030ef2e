"""Flow control of a replayer by the updates that the node publishes."""

from collections import deque

import numpy as np

from ellipseg_ros.config import Config, PlacementConfig
from ellipseg_ros.node.grouping import Grouping
from ellipseg_ros.poses.placer import Event, Placer
from ellipseg_ros.records import SECOND, Sweep

REGISTERED = PlacementConfig(pose_source="registered")


class FlowControl:
    """Predicts the node's updates from what is sent, and which of them are outstanding.

    config: of the node, for its update period and lateness. placement: likewise.
    ahead: s of sensor time that a cloud may be ahead of the last acknowledged update. While no
        update is outstanding every cloud may be sent, so that neither gaps nor a short `ahead`
        block the replay.
    """

    def __init__(
        self, config: Config, ahead: float, placement: PlacementConfig = REGISTERED
    ) -> None:
        self._placer = Placer(placement)
        self._grouping = Grouping(config)
        self._ahead_ns = round(ahead * SECOND)
        self._outstanding: deque[tuple[int, int]] = deque()  # run between restarts; end, ns
        self._run = 0
        self._end_ns = 0  # newest point of this run
        self._acknowledged_ns = 0  # end of the last acknowledged update of this run
        self.updates = 0  # that the node makes of the sent clouds

    def may_send(self, sweep: Sweep) -> bool:
        """Whether the cloud is close enough to the last acknowledged update."""
        limit_ns = self._acknowledged_ns + self._ahead_ns
        return not self._outstanding or sweep.stamp_ns <= limit_ns

    def send(self, event: Event) -> None:
        """Register a cloud or a pose that is sent."""
        for sweep in self._placer.take(event):
            if not isinstance(sweep, Sweep):
                continue
            newest = [sweep.offsets_ns.argmax()] if len(sweep) else []
            # The newest point is enough: grouping depends on the stamps and fields only.
            for group in self._grouping.push(sweep.keep(np.array(newest, int))):
                self._expect(group)

    def acknowledge(self, end_ns: int) -> None:
        """Register a published update whose newest point is of `end_ns`."""
        if not self._outstanding:
            return
        unpredicted = (self._outstanding[0][0], end_ns)  # the node has another update period
        last = next((item for item in self._outstanding if item[1] == end_ns), unpredicted)
        while self._outstanding and self._outstanding[0] <= last:
            run, end = self._outstanding.popleft()
            if run == self._run:
                self._acknowledged_ns = max(self._acknowledged_ns, end)

    def abandon(self) -> int:
        """Expect no more of the outstanding updates; return their number."""
        count = len(self._outstanding)
        self._outstanding.clear()
        self._acknowledged_ns = self._end_ns
        return count

    @property
    def outstanding(self) -> int:
        """Number of updates that are not acknowledged."""
        return len(self._outstanding)

    def _expect(self, group: Sweep) -> None:
        if group.restart or not self.updates:
            self._run += 1
            self._acknowledged_ns = int(group.times_ns.min(initial=group.stamp_ns))
            self._end_ns = int(group.times_ns.max()) if len(group) else group.stamp_ns
        else:
            self._end_ns = int(group.times_ns.max(initial=self._end_ns))
        self._outstanding.append((self._run, self._end_ns))
        self.updates += 1
