"""Synthetic worlds of landmarks, and two noisy observations of each."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from ellipseg_ros.association.candidates import Bounds
from ellipseg_ros.association.landmark_map import select_landmarks
from ellipseg_ros.association.pairing import landmark_arrays
from ellipseg_ros.records import DETERMINED, Kind, Landmarks

BOUNDS = Bounds(3.0, np.radians(10.0), 0.5, 2.0)
PRIOR = np.repeat([1.0 / 3.0, 98.0], 3)  # of these bounds, 1/m^2 and 1/rad^2
NOISE = {  # m or rad: of the determined motions, by kind
    Kind.PLANE: (0.02, 0.004, 0.004),
    Kind.LINE: (0.03, 0.03, 0.01, 0.01),
    Kind.BLOB: (0.1, 0.1, 0.1),
}


@dataclass(frozen=True)
class TwoObservations:
    """Two sets of landmarks of one world."""

    earlier: Landmarks
    later: Landmarks
    T_earlier_later: np.ndarray
    correspondences: np.ndarray  # (m, 2) rows of both that are one landmark


def landmarks(kind, position, axes, half, covariance=None):
    """A set of landmarks; kind (n,), position (n, 3), axes (n, 3, 3), half (n, 3)."""
    n = len(kind)
    if covariance is None:
        covariance = np.zeros((n, 6, 6))
        for row, k in enumerate(kind):
            for motion, sigma in zip(DETERMINED[Kind(k)], NOISE[Kind(k)], strict=True):
                covariance[row, motion, motion] = sigma**2
    return Landmarks(
        ids=np.arange(1, n + 1, dtype=np.uint32),
        kind=np.asarray(kind, np.uint8),
        count=np.full(n, 100),
        position=np.asarray(position, np.float64).reshape(n, 3),
        axes=np.asarray(axes, np.float64).reshape(n, 3, 3),
        sigma=np.asarray(half, np.float64).reshape(n, 3) / np.sqrt(3.0),
        box_min=-np.asarray(half, np.float64).reshape(n, 3),
        box_max=np.asarray(half, np.float64).reshape(n, 3),
        covariance=covariance,
        instability=np.zeros(n),
        first_seen_ns=np.zeros(n, np.int64),
    )


def upright(n, rng, tilt):
    """(n, 3, 3) axes with x nearly upward."""
    frame = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
    lean = Rotation.from_rotvec(rng.normal(scale=tilt, size=(n, 3)))
    return (lean * Rotation.from_matrix(np.broadcast_to(frame, (n, 3, 3)))).as_matrix()


def wall_axes(azimuth, rng):
    """(n, 3, 3) axes of walls: x along the wall, y up, z the normal."""
    n = len(azimuth)
    x = np.column_stack([np.cos(azimuth), np.sin(azimuth), np.zeros(n)])
    y = np.tile([0.0, 0.0, 1.0], (n, 1))
    frame = np.stack([x, y, np.cross(x, y)], axis=2)
    lean = Rotation.from_rotvec(rng.normal(scale=0.01, size=(n, 3)))
    return (lean * Rotation.from_matrix(frame)).as_matrix() if n else frame


def world(rng, planes=12, lines=25, blobs=15, size=30.0):
    """Walls in a few directions, trunks, bushes and the ground in a square of 2 `size` metres."""
    azimuth = rng.choice([0.0, np.pi / 2, 0.6], planes) + rng.normal(scale=0.03, size=planes)
    n = planes + lines + blobs + 1
    kind = np.repeat([0, 1, 2, 0], [planes, lines, blobs, 1])
    position = rng.uniform([-size, -size, 0.5], [size, size, 3.0], (n, 3))
    position[-1] = 0.0
    ground = np.eye(3)[None]
    axes = np.concatenate(
        [
            wall_axes(azimuth, rng),
            upright(lines, rng, 0.05),
            Rotation.random(blobs, rng=rng).as_matrix() if blobs else np.zeros((0, 3, 3)),
            ground,
        ]
    )
    half = np.concatenate(
        [
            rng.uniform([2.0, 1.0, 0.02], [8.0, 3.0, 0.04], (planes, 3)),
            rng.uniform([1.0, 0.1, 0.1], [3.0, 0.3, 0.3], (lines, 3)),
            rng.uniform(0.5, 1.2, (blobs, 3)),
            [[size, size, 0.05]],
        ]
    )
    return landmarks(kind, position, axes, half)


def moved(found, transform):
    """The set under a transform (4, 4)."""
    return replace(
        found,
        position=found.position @ transform[:3, :3].T + transform[:3, 3],
        axes=transform[:3, :3] @ found.axes,
    )


def noisy(found, rng):
    """An observation: errors of the covariance, other parts of extended landmarks, other signs."""
    position, axes = found.position.copy(), found.axes.copy()
    for row in range(len(found)):
        kind = Kind(found.kind[row])
        error = np.zeros(6)
        error[list(DETERMINED[kind])] = rng.normal(
            scale=np.sqrt(np.diag(found.covariance[row])[list(DETERMINED[kind])])
        )
        slide = np.zeros(3)  # another part of it is observed
        free = {Kind.PLANE: 2, Kind.LINE: 1, Kind.BLOB: 0}[kind]
        slide[:free] = rng.uniform(-0.4, 0.4, free) * found.box_max[row, :free]
        position[row] += axes[row] @ (error[:3] + slide)
        axes[row] = axes[row] @ Rotation.from_rotvec(error[3:]).as_matrix()
        if rng.random() < 0.5:
            axes[row] = (
                axes[row] * (-1.0, -1.0, 1.0)
                if rng.random() < 0.5
                else axes[row] * (1.0, -1.0, -1.0)
            )
        if kind is Kind.LINE:
            axes[row] = axes[row] @ Rotation.from_euler("x", rng.uniform(0, 6)).as_matrix()
    ids = np.arange(1, len(found) + 1, dtype=np.uint32)
    return replace(found, ids=ids, position=position, axes=axes)


def drift(rng, length, degrees, about):
    """A transform of this size about a point, in random directions: (4, 4)."""
    axis, way = rng.normal(size=(2, 3))
    turn = Rotation.from_rotvec(np.radians(degrees) * axis / np.linalg.norm(axis)).as_matrix()
    transform = np.eye(4)
    transform[:3, :3] = turn
    transform[:3, 3] = about - turn @ about + length * way / np.linalg.norm(way)
    return transform


def observe_twice(found, rng, length, degrees, seen=0.75):
    """Two observations of a share of a world each; the later one has drifted (m, degrees)."""
    n = len(found)
    rows = [np.flatnonzero(rng.random(n) < seen) for _ in range(2)]
    orders = [rng.permutation(r) for r in rows]
    one, other = (noisy(select_landmarks(found, r), rng) for r in orders)
    transform = drift(
        rng, length, degrees, other.position.mean(axis=0) if len(other) else np.zeros(3)
    )
    inverse = np.linalg.inv(transform)
    place = {thing: row for row, thing in enumerate(orders[1])}
    pairs = [(row, place[thing]) for row, thing in enumerate(orders[0]) if thing in place]
    correspondences = np.array(pairs, np.int64).reshape(-1, 2)
    # `drift` rotates about the centroid of the later set before it is moved away.
    return TwoObservations(one, moved(other, inverse), transform, correspondences)


def walls(n, rng, spacing=9.0):
    """Parallel walls."""
    axes = np.repeat(wall_axes(np.zeros(1), rng), n, axis=0)
    across = spacing * np.arange(n) + rng.uniform(-1.0, 1.0, n)
    position = np.column_stack([rng.uniform(-5.0, 5.0, n), across, np.ones(n)])
    return landmarks(np.zeros(n, int), position, axes, np.tile([10.0, 3.0, 0.03], (n, 1)))


def poles(position, rng, tilt=0.01):
    """Poles at (n, 2) places."""
    n = len(position)
    position = np.column_stack([position, np.full(n, 1.5)])
    axes, half = upright(n, rng, tilt), np.tile([2.0, 0.15, 0.15], (n, 1))
    return landmarks(np.ones(n, int), position, axes, half)


def bushes(position):
    """Bushes at (n, 3) places."""
    n = len(position)
    axes, half = np.tile(np.eye(3), (n, 1, 1)), np.tile([0.8, 0.7, 0.6], (n, 1))
    return landmarks(np.full(n, 2), position, axes, half)


def arrays(found):
    """A set as the kernels take it."""
    return landmark_arrays(found, np.arange(len(found)), 0.02, np.radians(0.2))


def one_of_each_kind(rng):
    """Two observations of a plane, a line and a blob."""
    few = select_landmarks(world(rng, planes=1, lines=1, blobs=1), [0, 1, 2])
    return few, noisy(few, rng)
