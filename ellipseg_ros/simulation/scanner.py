"""The path of the vehicle, the rotating scanner on it, and the error of its registration.

The scanner is that of Pauling, Bosse & Zlot (ACRA 2009): a SICK LMS, 181 beams over 180 degrees,
75 lines a second, its plane turning at 0.5 Hz about its forward axis.
"""

from typing import NamedTuple

import numpy as np

from ellipseg_ros.records import Array
from ellipseg_ros.simulation import rays
from ellipseg_ros.simulation.rays import Lines, Terrain
from ellipseg_ros.simulation.shapes import Frame, yaw_rotation

SICK = "sick"  # name of this scanner
ANGLES = np.radians(np.arange(-90.0, 91.0))  # of the beams, from the forward axis
LINES_PER_SECOND = 75
SPIN = 1.0041 * np.pi  # rad/s: about 0.5 Hz; as with real motors, no whole number of lines a turn
HEIGHT = 1.9  # m above the ground
NEAREST, FARTHEST = 0.6, 40.0  # m
STRENGTH = 3.0e3  # m^2: a signal of 1 / STRENGTH m^-2 gives a return with probability 63 %
SWEEPS_PER_SECOND = 10
STEP = 0.25  # m between the nodes of a path


class Path(NamedTuple):
    """A winding lane on rolling ground, along which the scene is laid out.

    s is the distance along it, 0 where the drive begins; d the distance to its left.
    """

    terrain: Terrain
    start: float  # m: smallest s
    xy: Array  # (n, 2) m, every STEP
    heading: Array  # (n,) rad

    @property
    def nodes(self) -> Array:
        """(n,) m: s of the nodes."""
        return self.start + STEP * np.arange(len(self.xy))

    @property
    def end(self) -> float:
        """m: greatest s."""
        return self.start + STEP * (len(self.xy) - 1)

    def at(self, s: float, d: float = 0.0, yaw: float = 0.0) -> Frame:
        """Upright frame on the ground at (s, d), x along the lane, rotated by `yaw` rad."""
        x, y, heading = self.place(s)
        x, y = x - d * np.sin(heading), y + d * np.cos(heading)
        z = rays.elevation(self.terrain, x, y)
        return Frame(np.array([x, y, z]), yaw_rotation(heading + yaw))

    def place(self, s: float) -> tuple[float, float, float]:
        """x, y (m) and heading (rad) of the lane at s."""
        nodes = self.nodes
        columns = (self.xy[:, 0], self.xy[:, 1], self.heading)
        x, y, heading = (float(np.interp(s, nodes, column)) for column in columns)
        return x, y, heading


def make_path(
    terrain: Terrain, start: float, end: float, swing: float, period: float = 150.0
) -> Path:
    """A path whose heading oscillates by `swing` rad, with a period of `period` m."""
    s = np.arange(start, end + STEP, STEP)
    heading = swing * np.sin(2.0 * np.pi * s / period)
    steps = STEP * np.column_stack([np.cos(heading), np.sin(heading)])
    xy = np.cumsum(steps, axis=0) - steps
    return Path(terrain, start, xy - xy[np.searchsorted(s, 0.0)], heading)


class Drive(NamedTuple):
    """Motion of a vehicle along a path."""

    speed: float  # m/s
    start: float = 0.0  # m: s at time 0
    aside: float = 0.0  # m: d, to the left of the path
    backwards: bool = False  # against the path

    @property
    def direction(self) -> float:
        """1 along the path, -1 against it."""
        return -1.0 if self.backwards else 1.0

    def distance(self, time: float) -> float:
        """m: s at a time in s."""
        return self.start + self.direction * self.speed * time


def scan_lines(path: Path, times: Array, drive: Drive) -> Lines:
    """True scan lines at `times` (l,) s; the vehicle tilts with the ground, and sways."""
    frames = [vehicle_pose(path, drive, time) for time in times]
    origin = np.array([frame.point((0.0, 0.0, HEIGHT)) for frame in frames]).reshape(-1, 3)
    axes = np.array([frame.axes for frame in frames]).reshape(-1, 3, 3)
    spin = SPIN * times[:, None]
    side = np.cos(spin) * axes[:, :, 1] + np.sin(spin) * axes[:, :, 2]
    return Lines(origin, np.ascontiguousarray(axes[:, :, 0]), side)


def directions(lines: Lines, line: Array, beam: Array) -> Array:
    """Unit vectors (n, 3) of beam `beam` (n,) of scan line `line` (n,)."""
    angle = ANGLES[beam][:, None]
    return np.asarray(np.cos(angle) * lines.forward[line] + np.sin(angle) * lines.side[line])


def vehicle_pose(path: Path, drive: Drive, time: float) -> Frame:
    """Pose of the vehicle, x ahead, y to the left: on its wheels, with some sway."""
    way, d = drive.direction, drive.aside
    s = drive.distance(time)
    frame = path.at(s, d)
    ahead, behind = path.at(s + way * 1.3, d).origin, path.at(s - way * 1.3, d).origin
    left, right = path.at(s, d + way * 0.8).origin, path.at(s, d - way * 0.8).origin
    x = ahead - behind
    x[2] += 2.6 * np.radians(0.4) * np.sin(2.0 * np.pi * 0.9 * time)
    y = left - right
    y[2] += 1.6 * np.radians(0.6) * np.sin(2.0 * np.pi * 0.7 * time + 1.0)
    x /= np.linalg.norm(x)
    y -= (y @ x) * x
    y /= np.linalg.norm(y)
    return Frame(frame.origin, np.column_stack([x, y, np.cross(x, y)]))


class Drift(NamedTuple):
    """Error of the registration: a slow random walk of position and heading."""

    knots: Array  # (k,) s
    shift: Array  # (k, 3) m
    yaw: Array  # (k,) rad

    def apply(self, times: Array, points: Array, origins: Array) -> Array:
        """Points (n, 3) as registered at `times` (n,), seen from `origins` (n, 3)."""
        yaw = np.interp(times, self.knots, self.yaw)
        beam = points - origins
        turned = np.column_stack([-yaw * beam[:, 1], yaw * beam[:, 0], np.zeros(len(yaw))])
        shift = [np.interp(times, self.knots, column) for column in self.shift.T]
        return np.asarray(points + turned + np.column_stack(shift))


def make_drift(duration: float, size: float, rng: np.random.Generator) -> Drift:
    """A drift with a standard deviation of `size` m after 25 s."""
    knots = np.arange(0.0, duration + 2.0)
    steps = rng.normal(size=(len(knots), 4)) / np.sqrt(25.0)
    walk = size * (np.cumsum(steps, axis=0) - steps)
    walk[:, 2] *= 0.5  # height is more accurate
    return Drift(knots, walk[:, :3], 0.02 * walk[:, 3])  # 0.001 rad at a position error of 5 cm


def return_probability(distance: Array, cosine: Array, reflectivity: Array) -> Array:
    """Probability of a return, which is lower from distant, dark and oblique surfaces."""
    signal = reflectivity * cosine / np.maximum(distance, NEAREST) ** 2
    in_range = (distance > NEAREST) & (distance < FARTHEST)
    return np.where(in_range, 1.0 - np.exp(-STRENGTH * signal), 0.0)
