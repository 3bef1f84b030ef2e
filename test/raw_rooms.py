"""Raw sweeps of a lidar that drives through a room, with an odometry."""

from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from ellipseg_ros.poses.series import PoseSample
from ellipseg_ros.poses.transforms import Transform
from ellipseg_ros.records import SECOND, Sweep

START_S = 5000.0
SWEEP_S = 0.1
STEP_S = 1e-4  # of the integration of the path
LOW, HIGH = np.array([-40.0, -30.0, -2.0]), np.array([60.0, 50.0, 6.0])  # corners of the room, m
FIELDS = [("x", "f4"), ("y", "f4"), ("z", "f4"), ("t", "u4")]


class Motion(NamedTuple):
    """Curves to both sides at constant speed.

    On a line or a circle a wrong time of the poses would displace all sweeps by the same motion.
    """

    speed: float = 12.0  # m/s
    turn: float = 30.0  # deg/s, maximum
    frequency: float = 0.5  # curves to both sides per second

    def pose(self, seconds):
        """Positions (n, 3) and rotations at times (n,)."""
        grid = np.arange(-1.0, 10.0, STEP_S)
        phase = 2.0 * np.pi * self.frequency
        heading = np.radians(self.turn) / phase * np.sin(phase * grid)
        steps = self.speed * STEP_S * np.array([np.cos(heading), np.sin(heading)])
        x, y = (np.interp(seconds, grid, np.cumsum(step)) for step in steps)
        angle = np.interp(seconds, grid, heading)
        return np.column_stack([x, y, 0.0 * x]), Rotation.from_euler("z", angle[:, None])


def clouds(sweeps, points=300, motion=None, noise=0.01, frame_id="lidar"):
    """Sweeps in the sensor's frame, stamped with their beginning."""
    motion = motion or Motion()
    rng = np.random.default_rng(5)
    found = []
    for k in range(sweeps):
        offsets = np.sort(rng.uniform(0.0, SWEEP_S, points))
        position, rotation = motion.pose(k * SWEEP_S + offsets)
        azimuth = 2.0 * np.pi * offsets / SWEEP_S
        sine = np.sin(np.radians(rng.uniform(-15.0, 15.0, points)))
        flat = np.sqrt(1.0 - sine**2)
        local = np.column_stack([flat * np.cos(azimuth), flat * np.sin(azimuth), sine])
        rays = rotation.apply(local)
        with np.errstate(divide="ignore"):
            reach = np.where(rays > 0.0, HIGH - position, LOW - position) / rays
        ranges = reach.min(axis=1) + rng.normal(scale=noise, size=points)
        fields = np.zeros(points, FIELDS)
        for axis, name in enumerate("xyz"):
            fields[name] = local[:, axis] * ranges
        fields["t"] = np.rint(offsets * SECOND)
        xyz = np.column_stack([fields[name] for name in "xyz"])
        stamp_ns = round((START_S + k * SWEEP_S) * SECOND)
        found.append(Sweep(stamp_ns, xyz, fields["t"], fields, frame_id))
    return found


def odometry(sweeps, stamp="exact", motion=None, rate=50, child="lidar"):
    """Poses: exact ones, or those of the ends of sweeps, stamped as given."""
    motion = motion or Motion()
    if stamp == "exact":
        times = np.arange(round(sweeps * SWEEP_S * rate) + 1) / rate
        stamps = times
    else:
        times = SWEEP_S * np.arange(sweeps + 1)
        stamps = times - (SWEEP_S if stamp == "scan_begin" else 0.0)
    position, rotation = motion.pose(times)
    return [
        PoseSample(round((START_S + s) * SECOND), "odom", child, Transform(p, q))
        for s, p, q in zip(stamps, position, rotation.as_quat(), strict=True)
    ]


def in_order(*streams):
    """Clouds and poses in the order of their stamps."""
    events = [event for stream in streams for event in stream]
    return sorted(events, key=lambda e: e.stamp_ns if isinstance(e, Sweep) else e.time_ns)
