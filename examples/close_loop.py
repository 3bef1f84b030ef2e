"""A pose graph that landmarks close: associations of ellipseg_ros as factors of GTSAM.

    pip install gtsam matplotlib
    python examples/close_loop.py [PICTURE.png]

A vehicle drives around a block; its odometry drifts. Its last landmarks are associated with its
first ones, and each pair becomes a factor between the two poses that have seen them: in the
directions that the landmark's shape determines, and in no other.
"""

import sys
from dataclasses import dataclass, replace
from functools import partial

import gtsam
import numpy as np

from ellipseg_ros.association.associate import associate, pair_residual
from ellipseg_ros.association.landmark_map import (
    concatenate_landmarks,
    no_landmarks,
    select_landmarks,
)
from ellipseg_ros.records import DETERMINED, Association, Kind, Landmarks

SIDE = 40.0  # m, of the block
STEP = 2.0  # m between two poses
RANGE = 15.0  # m within which a landmark is seen
DRIFT = (0.0002, 0.0002, 0.0016, 0.002, 0.01, 0.002)  # rad, m: mean error of a step
STEP_SIGMA = (0.001, 0.001, 0.002, 0.01, 0.01, 0.005)  # and its deviations; GTSAM's order
NOISE = {Kind.PLANE: (0.02, 0.004, 0.004), Kind.LINE: (0.02, 0.02, 0.01, 0.01),
         Kind.BLOB: (0.08, 0.08, 0.08)}  # m, rad: of the determined motions  # fmt: skip


# --- the factors: this is what a back-end needs --------------------------------------------------


def landmark_factor(
    first: int, second: int, one: Landmarks, other: Landmarks
) -> gtsam.CustomFactor:
    """A factor between two poses that have seen one thing.

    one, other: the landmark as seen by the first and by the second pose, in their own frames; sets
    of one row.
    """
    covariance = pair_residual(one, other, (0, 0), np.eye(4)).covariance
    noise = gtsam.noiseModel.Gaussian.Covariance(covariance)
    robust = gtsam.noiseModel.Robust.Create(gtsam.noiseModel.mEstimator.Huber.Create(2.0), noise)
    return gtsam.CustomFactor(robust, [first, second], partial(_error, one, other))


def _error(one, other, factor, values, jacobians):
    """Residual, and its derivatives by the two poses as GTSAM perturbs them (rotation first)."""
    first, second = (values.atPose3(key) for key in factor.keys())
    between = first.between(second)
    found = pair_residual(one, other, (0, 0), between.matrix())
    if jacobians is not None:
        by_motion = np.hstack([found.jacobian[:, 3:], found.jacobian[:, :3]])
        jacobians[0] = -by_motion
        jacobians[1] = by_motion @ between.AdjointMap()
    return found.residual


# --- a drive around a block ----------------------------------------------------------------------


@dataclass(frozen=True)
class Sighting:
    """Landmarks that a pose has seen, in its own frame."""

    pose: int
    landmarks: Landmarks


def true_poses() -> list[gtsam.Pose3]:
    """Once around the block, and a little farther."""
    poses = []
    for distance in np.arange(0.0, 4.0 * SIDE + 12.0, STEP):
        side, along = divmod(distance / SIDE, 1.0)
        corner = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]])[int(side) : int(side) + 2]
        corner = corner if len(corner) == 2 else np.array([[0, 0], [1, 0]])
        x, y = SIDE * (corner[0] + along * (corner[1] - corner[0]))
        poses.append(gtsam.Pose3(gtsam.Rot3.Yaw(side * np.pi / 2.0), np.array([x, y, 1.5])))
    return poses


def town(rng: np.random.Generator) -> Landmarks:
    """Walls, poles and bushes on both sides of the road, and the ground."""
    found = no_landmarks()
    for _ in range(110):
        kind = Kind(rng.integers(0, 3))
        place = rng.uniform(-12.0, SIDE + 12.0, 2)
        if np.abs(np.clip(place, 0.0, SIDE) - place).max() < 3.0 and not inside(place):
            continue
        azimuth = rng.choice([0.0, np.pi / 2.0]) + rng.normal(scale=0.1)
        found = concatenate_landmarks(found, thing(kind, np.append(place, 1.5), azimuth, rng))
    ground = thing(Kind.PLANE, np.zeros(3), 0.0, rng)
    half = np.array([[80.0, 80.0, 0.05]])
    ground = replace(ground, axes=np.eye(3)[None], box_min=-half, box_max=half)
    return concatenate_landmarks(found, ground)


def inside(place: np.ndarray) -> bool:
    """Whether a place lies in the block, clear of the road."""
    return bool((np.abs(place - SIDE / 2.0) < SIDE / 2.0 - 3.0).all())


def thing(kind: Kind, place: np.ndarray, azimuth: float, rng: np.random.Generator) -> Landmarks:
    """A set of one landmark."""
    c, s = np.cos(azimuth), np.sin(azimuth)
    axes = {
        Kind.PLANE: np.array([[c, 0.0, s], [s, 0.0, -c], [0.0, 1.0, 0.0]]),
        Kind.LINE: np.array([[0.0, c, -s], [0.0, s, c], [1.0, 0.0, 0.0]]),
        Kind.BLOB: np.eye(3),
    }[kind]
    half = {
        Kind.PLANE: rng.uniform([2.0, 1.0, 0.02], [5.0, 1.5, 0.03]),
        Kind.LINE: rng.uniform([1.0, 0.1, 0.1], [1.5, 0.25, 0.25]),
        Kind.BLOB: np.sort(rng.uniform(0.4, 0.9, 3))[::-1],
    }[kind]
    covariance = np.zeros((6, 6))
    motions = list(DETERMINED[kind])
    covariance[motions, motions] = np.square(NOISE[kind])
    return Landmarks(
        ids=np.ones(1, np.uint32),
        kind=np.array([kind], np.uint8),
        count=np.full(1, 100),
        position=place[None],
        axes=axes[None],
        sigma=half[None] / np.sqrt(3.0),
        box_min=-half[None],
        box_max=half[None],
        covariance=covariance[None],
        stability=np.zeros(1),
        first_seen_ns=np.zeros(1, np.int64),
    )


def moved(landmarks: Landmarks, pose: gtsam.Pose3) -> Landmarks:
    """The set under a transform."""
    rotation, translation = pose.rotation().matrix(), pose.translation()
    return replace(
        landmarks,
        position=landmarks.position @ rotation.T + translation,
        axes=rotation @ landmarks.axes,
    )


def see(
    world: Landmarks, poses: list[gtsam.Pose3], which: range, rng: np.random.Generator
) -> list[Sighting]:
    """Each landmark in range, once: by the pose nearest to it, with errors of its covariance."""
    places = np.array([poses[k].translation() for k in which])
    apart = np.linalg.norm(world.position[:, None] - places[None], axis=2)
    found = []
    for n, pose in enumerate(which):
        rows = np.flatnonzero((apart.argmin(axis=1) == n) & (apart.min(axis=1) < RANGE))
        error = np.einsum(
            "nij,nj->ni", np.sqrt(world.covariance[rows]), rng.normal(size=(len(rows), 6))
        )
        turn = [gtsam.Rot3.Expmap(w).matrix() for w in error[:, 3:]]
        seen = select_landmarks(world, rows)
        seen = replace(
            seen,
            position=seen.position + np.einsum("nij,nj->ni", seen.axes, error[:, :3]),
            axes=seen.axes @ np.array(turn).reshape(-1, 3, 3),
        )
        found.append(Sighting(pose, moved(seen, poses[pose].inverse())))
    return found


def window(sightings: list[Sighting], poses: list[gtsam.Pose3]) -> Landmarks:
    """The landmarks of some sightings in the frame of the poses: what the node publishes."""
    found = no_landmarks()
    for sighting in sightings:
        found = concatenate_landmarks(found, moved(sighting.landmarks, poses[sighting.pose]))
    return found


# --- the pose graph ------------------------------------------------------------------------------


@dataclass(frozen=True)
class Result:
    """What came of it."""

    truth: np.ndarray  # (n, 3) m
    odometry: np.ndarray  # (n, 3)
    closed: np.ndarray  # (n, 3)
    association: Association

    def error(self, places: np.ndarray) -> float:
        """Root mean square distance from the truth, m."""
        return float(np.sqrt(((places - self.truth) ** 2).sum(axis=1).mean()))


def drive(seed: int = 1) -> Result:
    """Drive around the block, associate, close the loop."""
    rng = np.random.default_rng(seed)
    truth = true_poses()
    steps = [a.between(b) for a, b in zip(truth[:-1], truth[1:], strict=True)]
    measured = [step.compose(gtsam.Pose3.Expmap(rng.normal(DRIFT, STEP_SIGMA))) for step in steps]
    odometry = [truth[0]]
    for step in measured:
        odometry.append(odometry[-1].compose(step))

    world = town(rng)
    begin = see(world, truth, range(8), rng)
    end = see(world, truth, range(len(truth) - 8, len(truth)), rng)
    earlier, later = window(begin, odometry), window(end, odometry)
    association = associate(earlier, later)

    graph = gtsam.NonlinearFactorGraph()
    graph.add(gtsam.PriorFactorPose3(0, truth[0], gtsam.noiseModel.Isotropic.Sigma(6, 1e-3)))
    noise = gtsam.noiseModel.Diagonal.Sigmas(np.hypot(DRIFT, STEP_SIGMA))
    for k, step in enumerate(measured):
        graph.add(gtsam.BetweenFactorPose3(k, k + 1, step, noise))
    places = [[(s.pose, s.landmarks, r) for s in part for r in range(len(s.landmarks))]
              for part in (begin, end)]  # by row of the sets  # fmt: skip
    for i, j in association.pairs:
        (first, one, a), (second, other, b) = places[0][i], places[1][j]
        one, other = select_landmarks(one, [a]), select_landmarks(other, [b])
        graph.add(landmark_factor(first, second, one, other))

    values = gtsam.Values()
    for k, pose in enumerate(odometry):
        values.insert(k, pose)
    best = gtsam.LevenbergMarquardtOptimizer(graph, values).optimize()
    closed = [best.atPose3(k) for k in range(len(truth))]
    tracks = (np.array([p.translation() for p in poses]) for poses in (truth, odometry, closed))
    return Result(*tracks, association)


def draw(result: Result, path: str) -> None:
    """Before and after, from above."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 4.6), layout="constrained")
    for axes, places, title in zip(
        figure.subplots(1, 2, sharex=True, sharey=True),
        (result.odometry, result.closed),
        ("odometry", "closed by landmarks"),
        strict=True,
    ):
        axes.plot(*result.truth[:, :2].T, color="0.7", lw=3.0, label="truth")
        axes.plot(*places[:, :2].T, color="tab:blue", lw=1.5, label="estimate")
        axes.plot(*places[-1, :2], "o", color="tab:red", label="end")
        axes.set(
            title=f"{title}: error {result.error(places):.2f} m", xlabel="x [m]", aspect="equal"
        )
    figure.axes[0].set_ylabel("y [m]")
    figure.axes[0].legend(loc="center")
    figure.savefig(path, dpi=100)


def main() -> None:
    """Print what was found; draw it, if a file is named."""
    result = drive()
    found = result.association
    print(f"{len(found)} pairs, {found.verdict.name}")
    print(f"undetermined: {found.undetermined_names or 'nothing'}")
    print(f"error of the odometry {result.error(result.odometry):.3f} m")
    print(f"error of the closed loop {result.error(result.closed):.3f} m")
    if len(sys.argv) > 1:
        draw(result, sys.argv[1])


if __name__ == "__main__":
    main()
