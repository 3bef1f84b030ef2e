"""Loop closure in a pose graph: associations of landmarks as factors of GTSAM.

    pip install '.[slam,plots]'
    python examples/close_loop.py [PICTURE.png]

A vehicle drives around a block while its odometry drifts. The landmarks at the end of the drive
are associated with those at its start. Each pair becomes a factor between the two poses that
observed the landmark, in the directions that its shape determines and in no other.
"""

import sys
from dataclasses import dataclass, replace
from functools import partial

import gtsam
import numpy as np

from ellipseg_ros import (
    Association,
    Kind,
    Landmarks,
    associate,
    concatenate_landmarks,
    no_landmarks,
    pair_residual,
    select_landmarks,
)
from ellipseg_ros.records import DETERMINED

BLOCK_SIDE = 40.0  # m
POSE_DISTANCE = 2.0  # m between consecutive poses
MAX_RANGE = 15.0  # m, farthest observed landmark
# Error of the odometry per step: rotation (rad), translation (m), in the order of GTSAM.
STEP_BIAS = (0.0002, 0.0002, 0.0016, 0.002, 0.01, 0.002)
STEP_SIGMA = (0.001, 0.001, 0.002, 0.01, 0.01, 0.005)
# Standard deviations of the determined motions of a landmark, m and rad.
LANDMARK_SIGMA = {
    Kind.PLANE: (0.02, 0.004, 0.004),
    Kind.LINE: (0.02, 0.02, 0.01, 0.01),
    Kind.BLOB: (0.08, 0.08, 0.08),
}


# --- factors: the part that a back-end needs -----------------------------------------------------


def landmark_factor(
    pose_a: int, pose_b: int, landmark_a: Landmarks, landmark_b: Landmarks
) -> gtsam.CustomFactor:
    """Factor between two poses that observed the same landmark.

    landmark_a, landmark_b: the landmark as observed from each pose, in the frame of that pose;
    sets of one row.
    """
    covariance = pair_residual(landmark_a, landmark_b, (0, 0), np.eye(4)).covariance
    noise = gtsam.noiseModel.Gaussian.Covariance(covariance)
    robust = gtsam.noiseModel.Robust.Create(gtsam.noiseModel.mEstimator.Huber.Create(2.0), noise)
    return gtsam.CustomFactor(robust, [pose_a, pose_b], partial(_error, landmark_a, landmark_b))


def _error(landmark_a, landmark_b, factor, values, jacobians):
    """Residual, and its derivatives by both poses as GTSAM perturbs them (rotation first)."""
    pose_a, pose_b = (values.atPose3(key) for key in factor.keys())
    T_a_b = pose_a.between(pose_b)
    residual = pair_residual(landmark_a, landmark_b, (0, 0), T_a_b.matrix())
    if jacobians is not None:
        by_motion = np.hstack([residual.jacobian[:, 3:], residual.jacobian[:, :3]])
        jacobians[0] = -by_motion
        jacobians[1] = by_motion @ T_a_b.AdjointMap()
    return residual.residual


# --- a drive around a block ----------------------------------------------------------------------


@dataclass(frozen=True)
class Observation:
    """Landmarks observed from a pose, in the frame of the pose."""

    pose: int
    landmarks: Landmarks


def true_poses() -> list[gtsam.Pose3]:
    """Poses once around the block and some metres beyond the start."""
    poses = []
    for distance in np.arange(0.0, 4.0 * BLOCK_SIDE + 12.0, POSE_DISTANCE):
        side, along = divmod(distance / BLOCK_SIDE, 1.0)
        corner = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]])[int(side) : int(side) + 2]
        corner = corner if len(corner) == 2 else np.array([[0, 0], [1, 0]])
        x, y = BLOCK_SIDE * (corner[0] + along * (corner[1] - corner[0]))
        poses.append(gtsam.Pose3(gtsam.Rot3.Yaw(side * np.pi / 2.0), np.array([x, y, 1.5])))
    return poses


def simulated_town(rng: np.random.Generator) -> Landmarks:
    """Walls, poles and bushes on both sides of the road, and the ground."""
    landmarks = no_landmarks()
    for _ in range(110):
        kind = Kind(rng.integers(0, 3))
        place = rng.uniform(-12.0, BLOCK_SIDE + 12.0, 2)
        if np.abs(np.clip(place, 0.0, BLOCK_SIDE) - place).max() < 3.0 and not inside_block(place):
            continue  # on the road
        azimuth = rng.choice([0.0, np.pi / 2.0]) + rng.normal(scale=0.1)
        landmarks = concatenate_landmarks(
            landmarks, landmark(kind, np.append(place, 1.5), azimuth, rng)
        )
    ground = landmark(Kind.PLANE, np.zeros(3), 0.0, rng)
    half = np.array([[80.0, 80.0, 0.05]])
    return concatenate_landmarks(
        landmarks, replace(ground, axes=np.eye(3)[None], box_min=-half, box_max=half)
    )


def inside_block(place: np.ndarray) -> bool:
    """Whether a place is inside the block and off the road."""
    return bool((np.abs(place - BLOCK_SIDE / 2.0) < BLOCK_SIDE / 2.0 - 3.0).all())


def landmark(kind: Kind, place: np.ndarray, azimuth: float, rng: np.random.Generator) -> Landmarks:
    """A set of one landmark with random size."""
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
    covariance[motions, motions] = np.square(LANDMARK_SIGMA[kind])
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
        instability=np.zeros(1),
        first_seen_ns=np.zeros(1, np.int64),
    )


def transformed(landmarks: Landmarks, pose: gtsam.Pose3) -> Landmarks:
    """The landmarks in the frame that a transform leads to."""
    rotation, translation = pose.rotation().matrix(), pose.translation()
    return replace(
        landmarks,
        position=landmarks.position @ rotation.T + translation,
        axes=rotation @ landmarks.axes,
    )


def observe(
    world: Landmarks, poses: list[gtsam.Pose3], indices: range, rng: np.random.Generator
) -> list[Observation]:
    """Observe each landmark in range from the nearest pose, with errors of its covariance."""
    places = np.array([poses[k].translation() for k in indices])
    distance = np.linalg.norm(world.position[:, None] - places[None], axis=2)
    observations = []
    for n, pose in enumerate(indices):
        rows = np.flatnonzero((distance.argmin(axis=1) == n) & (distance.min(axis=1) < MAX_RANGE))
        error = np.einsum(
            "nij,nj->ni", np.sqrt(world.covariance[rows]), rng.normal(size=(len(rows), 6))
        )
        rotations = [gtsam.Rot3.Expmap(w).matrix() for w in error[:, 3:]]
        exact = select_landmarks(world, rows)
        noisy = replace(
            exact,
            position=exact.position + np.einsum("nij,nj->ni", exact.axes, error[:, :3]),
            axes=exact.axes @ np.array(rotations).reshape(-1, 3, 3),
        )
        observations.append(Observation(pose, transformed(noisy, poses[pose].inverse())))
    return observations


def in_odometry_frame(observations: list[Observation], poses: list[gtsam.Pose3]) -> Landmarks:
    """The observed landmarks in the frame of the odometry, as the node publishes them."""
    landmarks = no_landmarks()
    for observation in observations:
        observed = transformed(observation.landmarks, poses[observation.pose])
        landmarks = concatenate_landmarks(landmarks, observed)
    return landmarks


# --- the pose graph ------------------------------------------------------------------------------


@dataclass(frozen=True)
class Result:
    """Positions of all poses, and the association that closed the loop."""

    truth: np.ndarray  # (n, 3) m
    odometry: np.ndarray  # (n, 3) m
    closed: np.ndarray  # (n, 3) m, optimised
    association: Association

    def error(self, places: np.ndarray) -> float:
        """Root mean square distance from the truth, m."""
        return float(np.sqrt(((places - self.truth) ** 2).sum(axis=1).mean()))


def drive(seed: int = 1) -> Result:
    """Drive around the block, associate the landmarks, optimise the pose graph."""
    rng = np.random.default_rng(seed)
    truth = true_poses()
    steps = [a.between(b) for a, b in zip(truth[:-1], truth[1:], strict=True)]
    measured = [
        step.compose(gtsam.Pose3.Expmap(rng.normal(STEP_BIAS, STEP_SIGMA))) for step in steps
    ]
    odometry = [truth[0]]
    for step in measured:
        odometry.append(odometry[-1].compose(step))

    world = simulated_town(rng)
    start = observe(world, truth, range(8), rng)
    end = observe(world, truth, range(len(truth) - 8, len(truth)), rng)
    earlier, later = in_odometry_frame(start, odometry), in_odometry_frame(end, odometry)
    association = associate(earlier, later)

    graph = gtsam.NonlinearFactorGraph()
    graph.add(gtsam.PriorFactorPose3(0, truth[0], gtsam.noiseModel.Isotropic.Sigma(6, 1e-3)))
    noise = gtsam.noiseModel.Diagonal.Sigmas(np.hypot(STEP_BIAS, STEP_SIGMA))
    for k, step in enumerate(measured):
        graph.add(gtsam.BetweenFactorPose3(k, k + 1, step, noise))
    start_rows, end_rows = observed_rows(start), observed_rows(end)
    for row_a, row_b in association.pairs:
        (pose_a, landmark_a), (pose_b, landmark_b) = start_rows[row_a], end_rows[row_b]
        graph.add(landmark_factor(pose_a, pose_b, landmark_a, landmark_b))

    values = gtsam.Values()
    for k, pose in enumerate(odometry):
        values.insert(k, pose)
    optimised = gtsam.LevenbergMarquardtOptimizer(graph, values).optimize()
    closed = [optimised.atPose3(k) for k in range(len(truth))]
    tracks = (np.array([p.translation() for p in poses]) for poses in (truth, odometry, closed))
    return Result(*tracks, association)


def observed_rows(observations: list[Observation]) -> list[tuple[int, Landmarks]]:
    """Pose and landmark of every row of `in_odometry_frame`."""
    return [
        (observation.pose, select_landmarks(observation.landmarks, [row]))
        for observation in observations
        for row in range(len(observation.landmarks))
    ]


def draw(result: Result, path: str) -> None:
    """Draw the track before and after optimisation, from above."""
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
    """Print the result; draw it if a file is given."""
    result = drive()
    association = result.association
    print(f"{len(association)} pairs, {association.verdict.name}")
    print(f"undetermined: {association.undetermined_names or 'nothing'}")
    print(f"error of the odometry {result.error(result.odometry):.3f} m")
    print(f"error of the closed loop {result.error(result.closed):.3f} m")
    if len(sys.argv) > 1:
        draw(result, sys.argv[1])


if __name__ == "__main__":
    main()
