"""Two drives through one simulated scene, and the true transform between their frames."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ellipseg_ros.core.fields import join_sweeps
from ellipseg_ros.records import Array, Sweep
from ellipseg_ros.simulation.simulator import simulate

DIRECTIONS = ("same", "opposite")  # of the second drive relative to the first


@dataclass(frozen=True)
class Route:
    """Two drives along the same stretch of the lane.

    The second is faster, beside the track of the first, and has other noise and another drift.
    """

    length: float  # m
    speeds: tuple[float, float] = (3.0, 3.75)  # m/s
    aside: float = 0.7  # m between the tracks

    def first(self) -> dict[str, Any]:
        """Settings of simulator.Scene for the first drive."""
        speed = self.speeds[0]
        return {"duration": self.length / speed, "speed": speed, "noise_seed": 0}

    def second(self, direction: str) -> dict[str, Any]:
        """Settings of simulator.Scene for the second drive."""
        speed = self.speeds[1]
        drive = {"duration": self.length / speed, "speed": speed, "aside": self.aside}
        if direction == "same":
            return drive | {"noise_seed": 1}
        return drive | {"noise_seed": 2, "start": self.length, "backwards": True}


FULL = Route(75.0)
QUICK = Route(18.0)


@dataclass(frozen=True)
class Pass:
    """One drive as one window."""

    sweep: Sweep  # all of its points, as registered
    T_world: Array  # (4, 4): from the registered frame to the true one


@dataclass(frozen=True)
class TwoPasses:
    """An earlier and a later drive."""

    earlier: Pass
    later: Pass

    @property
    def T_earlier_later(self) -> Array:  # noqa: N802  # the package's names of transforms
        """(4, 4): true transform from the frame of the later drive to that of the earlier."""
        transform: Array = np.linalg.inv(self.earlier.T_world) @ self.later.T_world
        return transform

    def clouds(self) -> tuple[Array, Array]:
        """The points of both drives in the frame of the earlier one, each (n, 3) m."""
        transform = self.T_earlier_later
        later = self.later.sweep.points @ transform[:3, :3].T + transform[:3, 3]
        return self.earlier.sweep.points, later


def drive(scene: str, seed: int, **settings: Any) -> Pass:
    """Simulate a drive through a scene; settings as in simulator.Scene.

    The registration drifts during the drive, so no rigid motion is exact. The one that brings the
    points nearest to their true places counts as the true pose.
    """
    drifted, true = (
        join_sweeps(list(simulate(scene, seed=seed, **(settings | drift))))
        for drift in ({}, {"drift": 0.0})
    )
    return Pass(drifted, rigid_transform(drifted.points, true.points))


def rigid_transform(points: Array, targets: Array) -> Array:
    """(4, 4) least-squares rigid motion from points (n, 3) to targets (n, 3).

    Source: Kabsch (1976), with the guard against reflections of Umeyama (1991).
    """
    centre, target_centre = points.mean(axis=0), targets.mean(axis=0)
    u, _, vt = np.linalg.svd((points - centre).T @ (targets - target_centre))
    handedness = np.diag([1.0, 1.0, np.linalg.det(vt.T @ u.T)])
    transform = np.eye(4)
    transform[:3, :3] = vt.T @ handedness @ u.T
    transform[:3, 3] = target_centre - transform[:3, :3] @ centre
    return transform
