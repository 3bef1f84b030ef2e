"""Placement of the clouds that arrive: arrival times, counters, and what /diagnostics show."""

import time
from collections import deque
from collections.abc import Iterable
from typing import NamedTuple, TypeAlias

from ellipseg_ros.config import PlacementConfig
from ellipseg_ros.node.health import Health
from ellipseg_ros.poses.placement import Unplaced
from ellipseg_ros.poses.placer import Event, Outcome, Placer, RefusedPose
from ellipseg_ros.poses.sources import OdometryPoses
from ellipseg_ros.records import Sweep

MAX_WAIT_S = 2.0  # of a cloud for its poses, before a warning


class Placed(NamedTuple):
    """A cloud in the fixed frame."""

    sweep: Sweep
    arrival: float  # s, monotonic clock: of the cloud, not of its last pose


Decision: TypeAlias = Placed | Unplaced | RefusedPose


class Placing:
    """Passes clouds and poses to a Placer and counts what becomes of them; for one thread.

    config: its pose source must be decided. topic: of the poses, for texts.
    """

    def __init__(self, config: PlacementConfig, health: Health, topic: str) -> None:
        self._config = config
        self._health = health
        self._topic = topic
        self._placer = Placer(config)
        self._arrivals: deque[float] = deque()  # of the clouds that wait, in their order
        self._described = ""

    @property
    def needs_poses(self) -> bool:
        """Whether clouds are in a sensor's frame and need poses."""
        return not self._placer.registered

    def take(self, event: Event) -> list[Decision]:
        """Take a cloud or a pose that arrives; return what is decided by it."""
        if isinstance(event, Sweep):
            self._arrivals.append(time.monotonic())
        else:
            self._health.count(poses=1)
        return self._decisions(self._placer.take(event))

    def reset(self) -> list[Decision]:
        """Decide the clouds that wait, and forget all poses but static transforms."""
        decisions = self._decisions(self._placer.flush()) if self.needs_poses else []
        self._placer.reset()
        return decisions

    def _decisions(self, outcomes: Iterable[Outcome]) -> list[Decision]:
        decisions: list[Decision] = []
        for outcome in outcomes:
            if isinstance(outcome, RefusedPose):
                self._health.refused(outcome)
                decisions.append(outcome)
                continue
            arrival = self._arrivals.popleft()  # clouds are decided in their order
            if isinstance(outcome, Unplaced):
                explained = self._explained(outcome.reason, outcome.text)
                outcome = outcome._replace(text=explained)
                self._health.unplaced(outcome)
                decisions.append(outcome)
            else:
                self._health.count(placed=1, points_filtered=outcome.filtered)
                decisions.append(Placed(outcome, arrival))
        return decisions

    def _explained(self, reason: str, text: str) -> str:
        """The text with the topic that poses are missing on, and what would be right."""
        if reason == "no_poses":
            return f"{text} on {self._topic}: is it published, and remapped correctly?"
        if reason == "late_poses":
            return f"{text}; poses come from {self._topic}"
        return text

    def new_description(self) -> str:
        """How the input is understood, if that has changed since the last call; else empty."""
        described = ", ".join(f"{key} {value}" for key, value in self._understood().items())
        if not self.needs_poses or described == self._described:
            return ""
        self._described = described
        return described

    def _understood(self) -> dict[str, str]:
        source = self._placer.source
        values = {**self._placer.placement.understood}
        if isinstance(source, OdometryPoses) and values:
            values["child frame"] = source.child_frame_id
        return values

    def values(self) -> dict[str, str]:
        """Values for /diagnostics."""
        values = {"pose source": self._config.pose_source}
        if not self.needs_poses:
            return values
        placement, source = self._placer.placement, self._placer.source
        understood, lag = self._understood(), placement.lag_s()
        return {
            **values,
            "odometry_stamp": self._config.odometry_stamp,
            "clouds waiting for poses": str(placement.waiting),
            "jumps of the poses": str(placement.jumps),
            "last jump": "; ".join(source.jumps(understood.get("cloud frame", ""))),
            **understood,
            "lag of the odometry [s]": "" if lag is None else f"{lag:.3f}",
        }

    def problem(self) -> str:
        """What clouds have been waiting for, for longer than MAX_WAIT_S; empty: none has."""
        waiting_for = self._placer.placement.waiting_for
        waited = time.monotonic() - self._arrivals[0] if self._arrivals else 0.0
        if waiting_for is None or waited <= MAX_WAIT_S:
            return ""
        return self._explained(*waiting_for)
