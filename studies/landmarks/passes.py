"""Two drives through one simulated scene, and how they truly lie to one another."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ellipseg_ros.core.fields import join_sweeps
from ellipseg_ros.records import Array, Sweep
from ellipseg_ros.simulation.simulator import simulate

# Settings of simulator.Scene. All go along the same 75 m of the lane: the second pass is faster,
# beside the track of the first, and has another noise and another drift.
LENGTH = 75.0  # m
FIRST: dict[str, Any] = {"duration": 25.0, "speed": 3.0, "noise_seed": 0}
SECOND: dict[str, dict[str, Any]] = {
    "same": {"duration": 20.0, "speed": 3.75, "noise_seed": 1, "aside": 0.7},
    "opposite": {
        "duration": 20.0,
        "speed": 3.75,
        "noise_seed": 2,
        "aside": 0.7,
        "start": LENGTH,
        "backwards": True,
    },
}


@dataclass(frozen=True)
class Pass:
    """One drive, as one window."""

    sweep: Sweep  # all of it, as registered
    T_world: Array  # (4, 4): from the registered frame to the true one


@dataclass(frozen=True)
class TwoPasses:
    """An earlier drive and a later one."""

    earlier: Pass
    later: Pass

    @property
    def T_earlier_later(self) -> Array:  # noqa: N802  # as transforms are named here
        """(4, 4): the true transform, from the frame of the later drive to that of the earlier."""
        transform: Array = np.linalg.inv(self.earlier.T_world) @ self.later.T_world
        return transform


def drive(scene: str, seed: int, **settings: Any) -> Pass:
    """Drive through a scene; settings as in simulator.Scene.

    The registration drifts within the drive, so its frame is not one rigid thing. What is taken
    for its true place is the rigid motion that brings the points nearest to where they truly are.
    """
    drifted, true = (
        join_sweeps(list(simulate(scene, seed=seed, **(settings | drift))))
        for drift in ({}, {"drift": 0.0})
    )
    return Pass(drifted, rigid(drifted.points, true.points))


def two_passes(scene: str, seed: int, direction: str) -> TwoPasses:
    """The two drives through a scene; direction, of the second one: a key of SECOND."""
    return TwoPasses(drive(scene, seed, **FIRST), drive(scene, seed, **SECOND[direction]))


def rigid(points: Array, targets: Array) -> Array:
    """The motion (4, 4) that brings points (n, 3) nearest to their targets, by least squares.

    Source: Kabsch (1976), with Umeyama's (1991) guard against reflections.
    """
    middle, goal = points.mean(axis=0), targets.mean(axis=0)
    u, _, vt = np.linalg.svd((points - middle).T @ (targets - goal))
    handed = np.diag([1.0, 1.0, np.linalg.det(vt.T @ u.T)])
    transform = np.eye(4)
    transform[:3, :3] = vt.T @ handed @ u.T
    transform[:3, 3] = goal - transform[:3, :3] @ middle
    return transform
