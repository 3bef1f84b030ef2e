"""Drives with a lidar of many beams: distortion by motion, lost returns, moving items, truth."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from ellipseg_ros.records import SECOND, Array, Sweep
from ellipseg_ros.settings import setting
from ellipseg_ros.simulation import scanner
from ellipseg_ros.simulation.beams import Beams, Ends, cast_beams, measure
from ellipseg_ros.simulation.drive import START_NS, DriveSettings
from ellipseg_ros.simulation.grid import CELL, Grid, make_grid
from ellipseg_ros.simulation.items import SCREEN
from ellipseg_ros.simulation.lidars import LIDARS, SWEEP_NS, Lidar
from ellipseg_ros.simulation.scanner import SWEEPS_PER_SECOND
from ellipseg_ros.simulation.scenes import LAYOUTS
from ellipseg_ros.simulation.shapes import Class, Shapes, pitch_rotation, yaw_rotation
from ellipseg_ros.simulation.traffic import find_traffic

BLOCK = SWEEPS_PER_SECOND  # sweeps for which the surroundings are loaded at once
KNOTS_PER_SECOND = 100  # of the true trajectory, which is interpolated between them
MOUNT = (0.4, 0.1, 1.7)  # m: the lidar in base_link, the frame on the ground below the vehicle
MOUNT_YAW, MOUNT_PITCH = np.radians(2.0), np.radians(1.0)
GLASS = 0.005  # share of the light that a car's screen returns; the rest passes or glances off
FIELDS = np.dtype(
    [
        *((name, np.float32) for name in "xyz"),
        ("intensity", np.float32),  # 0 to 100
        ("t", np.uint32),  # ns from the stamp
        ("ring", np.uint16),  # beam, ascending with the elevation
        ("class", np.uint8),  # see Class
        ("instance", np.uint32),  # number of the item; 0: the ground
        ("moving", np.uint8),  # 1: the item moves
    ]
)


class Poses(NamedTuple):
    """Poses of a frame in the world at several times."""

    position: Array  # (n, 3) m
    rotation: Rotation  # n of them

    def placed(self, row: Array, points: Array) -> Array:
        """Points (m, 3) in the world that are given in frame row[i]."""
        axes = self.rotation.as_matrix()[row]
        return np.asarray(np.einsum("nij,nj->ni", axes, points) + self.position[row])

    def moved(self, position: Array, rotation: Rotation) -> "Poses":
        """The poses of a frame that has this pose in theirs."""
        return Poses(self.position + self.rotation.apply(position), self.rotation * rotation)


MOUNTING = Poses(
    np.array(MOUNT), Rotation.from_matrix(yaw_rotation(MOUNT_YAW) @ pitch_rotation(MOUNT_PITCH))
)


class Scan(NamedTuple):
    """What the lidar measures in a sweep of l lines; ray i of n is row i, in order of time."""

    begin_ns: int
    points: Array  # (n, 3) float64 m, in the sensor's frame; NaN without a valid return
    returned: Array  # (n,) bool
    line_ns: Array  # (l,) int64: time of each line
    line: Array  # (n,): that of the ray
    truth: Array  # (n,) of FIELDS; x, y, z and t are 0
    poses: Poses  # (l,): true ones of the sensor


class _Surroundings(NamedTuple):
    """What the rays of a block of sweeps may hit."""

    shapes: Shapes
    grid: Grid


@dataclass(frozen=True)
class LidarDrive(DriveSettings):
    """A drive with one of LIDARS: an iterable of sweeps of 0.1 s, identical in every iteration.

    Points are registered like those of a SLAM front end, `fields` has the layout FIELDS. See
    RawDrive for sweeps in the frame of the sensor.
    """

    name: str = setting("town", "kind of scene", allowed=tuple(LAYOUTS))
    speed: float = setting(-1.0, "of the vehicle; -1: that of the scene", "m/s", -1.0, 30.0)
    noise: float = setting(
        -1.0, "standard deviation of a range; -1: that of the lidar", "m", -1.0, 1.0
    )
    lidar: str = setting("hdl64e", "kind of lidar", allowed=tuple(LIDARS))
    nan_share: float = setting(0.0, "share of returns that are NaN", "", 0.0, 1.0)

    def __len__(self) -> int:
        return max(1, int(self.duration * SWEEPS_PER_SECOND + 1e-6))

    def __iter__(self) -> Iterator[Sweep]:
        return map(self._registered, self.scans())

    def scans(self) -> Iterator[Scan]:
        """Yield the measurements of the sweeps in turn."""
        for first in range(0, len(self), BLOCK):
            surroundings = self._surroundings(first)
            for number in range(first, min(first + BLOCK, len(self))):
                yield self._scan(number, surroundings)

    def poses(self, times_ns: Array) -> Poses:
        """True poses of base_link at ascending times (n,) ns."""
        times = (times_ns - START_NS) / SECOND
        knots = np.arange(
            np.floor(times[0] * KNOTS_PER_SECOND), np.floor(times[-1] * KNOTS_PER_SECOND) + 2.0
        )
        frames = [
            scanner.vehicle_pose(self._world.path, self._drive, knot / KNOTS_PER_SECOND)
            for knot in knots
        ]
        at = times * KNOTS_PER_SECOND
        origin = np.array([frame.origin for frame in frames])
        position = np.column_stack([np.interp(at, knots, column) for column in origin.T])
        axes = Rotation.from_matrix(np.array([frame.axes for frame in frames]))
        return Poses(position, Slerp(knots, axes)(at))

    def sensor_poses(self, times_ns: Array) -> Poses:
        """True poses of the lidar at ascending times (n,) ns."""
        return self.poses(times_ns).moved(*MOUNTING)

    def drifted(self, times_ns: Array, poses: Poses) -> Poses:
        """The poses as an odometry with the drift of this drive reports them."""
        times = (times_ns - START_NS) / SECOND
        knots, shift, yaw = self._drift
        moved = np.column_stack([np.interp(times, knots, column) for column in shift.T])
        turn = Rotation.from_rotvec(np.outer(np.interp(times, knots, yaw), [0.0, 0.0, 1.0]))
        return Poses(poses.position + moved, turn * poses.rotation)

    @property
    def _drive(self) -> scanner.Drive:
        speed = LAYOUTS[self.name].speed if self.speed < 0.0 else self.speed
        return scanner.Drive(speed, self.start, self.aside, self.backwards)

    @property
    def _lidar(self) -> Lidar:
        lidar = LIDARS[self.lidar]
        return lidar if self.noise < 0.0 else lidar._replace(noise=self.noise)

    @cached_property
    def _key(self) -> np.uint64:
        return np.uint64(self.generator(3).integers(1 << 62))

    def _surroundings(self, first: int) -> _Surroundings:
        ends = START_NS + SWEEP_NS * np.array([first, first + BLOCK])
        begin, end = self.poses(ends).position
        middle = 0.5 * (begin + end)
        reach = self._lidar.farthest + np.linalg.norm(end - begin) + 2.0 * CELL
        shapes = self._world.shapes.near(middle, reach)
        return _Surroundings(
            shapes, make_grid(shapes, self._world.path.terrain, middle[:2], reach)
        )

    def _scan(self, number: int, surroundings: _Surroundings) -> Scan:
        lidar, world = self._lidar, self._world
        directions = lidar.directions(lidar, number)
        begin_ns = START_NS + number * SWEEP_NS
        line_ns = begin_ns + np.arange(lidar.lines) * SWEEP_NS // lidar.lines
        poses = self.sensor_poses(line_ns)
        times = number / SWEEPS_PER_SECOND, (number + 1) / SWEEPS_PER_SECOND
        s = self._drive.distance(times[0])
        reach = lidar.farthest + 15.0
        moving = find_traffic(world.movers, world.path, times, (s - reach, s + reach))
        first = self._key + np.uint64(number * directions.shape[0] * directions.shape[1])
        rotation = np.ascontiguousarray(poses.rotation.as_matrix())
        beams = Beams(poses.position, rotation, directions, lidar.farthest, first)
        ends = cast_beams(beams, surroundings.grid, moving.movers)

        bodies = (surroundings.shapes, *moving.shapes)
        truth, reflectivity = _attributes(ends, bodies, world.soil)
        distance = _distances(lidar, directions, ends, reflectivity, first)
        truth["intensity"] = np.clip(100.0 * reflectivity * np.sqrt(ends.cosine), 0.0, 100.0)
        truth["ring"] = np.arange(directions.shape[1])
        returned = np.isfinite(distance)
        invalid = np.random.default_rng((int(self._key), number)).random(distance.shape)
        distance[invalid < self.nan_share] = np.nan
        points = (directions * distance[:, :, None]).reshape(-1, 3)
        line = np.repeat(np.arange(lidar.lines), directions.shape[1])
        return Scan(begin_ns, points, returned.ravel(), line_ns, line, truth.ravel(), poses)

    def _registered(self, scan: Scan) -> Sweep:
        poses = self.drifted(scan.line_ns, scan.poses)
        rows = np.flatnonzero(scan.returned)
        line = scan.line[rows]
        points = poses.placed(line, scan.points[rows])
        fields = scan.truth[rows]
        for name, column in zip("xyz", points.T, strict=True):
            fields[name] = column
        offsets_ns = scan.line_ns[line] - scan.begin_ns
        fields["t"] = offsets_ns
        points = np.column_stack([fields[name] for name in "xyz"]).astype(np.float64)
        return Sweep(scan.begin_ns, points, offsets_ns, fields, self.frame_id)


def _attributes(ends: Ends, bodies: tuple[Shapes, ...], soil: float) -> tuple[Array, Array]:
    """Truth (l, b) of FIELDS and reflectivity (l, b) of what the beams hit.

    bodies: the static ones, then those of every moving item.
    """

    def column(name: str, ground: float) -> Array:
        """The attribute of every beam's end; GROUND is row -2, NOTHING row -1."""
        return np.concatenate([*(getattr(part, name) for part in bodies), [ground, 0]])[ends.body]

    truth = np.zeros(ends.body.shape, FIELDS)
    truth["class"] = column("kind", Class.GROUND)
    truth["instance"] = column("instance", 0)
    truth["moving"] = ends.body >= len(bodies[0].kind)
    reflectivity = column("reflectivity", soil)
    glass = (truth["class"] == Class.VEHICLE) & (reflectivity <= SCREEN.reflectivity)
    reflectivity[glass] *= GLASS
    return truth, reflectivity


def _distances(
    lidar: Lidar, directions: Array, ends: Ends, reflectivity: Array, key: np.uint64
) -> Array:
    """Measured ranges (l, b) m, NaN without a return; key: of the first beam."""
    step = np.linalg.norm(np.diff(directions[:, 0], axis=0), axis=1).mean()
    strength = np.log(2.0) * lidar.half_power**2 / 0.1
    mixed = 0.5 * min(1.0, lidar.divergence / step)  # else the stronger of both returns alone
    rates = (strength, 1.0 - lidar.dropout, mixed, lidar.noise)
    measured = np.full(ends.distance.shape, np.nan)
    measure(ends, reflectivity, key, (lidar.nearest, lidar.farthest), rates, measured)
    return measured
