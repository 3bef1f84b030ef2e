"""Drives as drivers and odometries publish them: sweeps in the sensor's frame, and poses."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import ClassVar, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from ellipseg_ros.poses.placer import RawEvent, TransformSample
from ellipseg_ros.poses.series import PoseSample
from ellipseg_ros.poses.transforms import Transform
from ellipseg_ros.records import SECOND, Array, Sweep
from ellipseg_ros.settings import Checked, setting
from ellipseg_ros.simulation.drive import START_NS
from ellipseg_ros.simulation.lidar_drive import FIELDS, MOUNTING, LidarDrive, Scan
from ellipseg_ros.simulation.lidars import (
    LIDARS,
    MISSING,
    SWEEP_NS,
    TIME_FIELDS,
    time_column,
)

TURN_PER_METRE = 0.02  # rad/m: noise of the odometry's rotation, relative to that of its position


class Published(NamedTuple):
    """A message of a sensor or of an odometry."""

    time_ns: int  # of its publication
    event: RawEvent


@dataclass(frozen=True)
class SensorDrive(Checked):
    """The messages of a LidarDrive in the order of time: an iterable of Published.

    A sweep is published at its end, in `lidar_frame`, with the fields of a driver and the truth:
    those of FIELDS, and `truth`, the point in the fixed frame as if the pose of the sensor at the
    time of the point were known. The odometry gives poses of `base_frame`, with the drift of the
    drive and noise, on its topic and as tf; the static extrinsic comes first, as tf.

    `odometry_stamp`: exact poses come at `odometry_rate`. Otherwise there is one per sweep, the
    pose at the end of the sweep, stamped with the sweep's beginning or end.
    """

    fixed_frame: ClassVar[str] = LidarDrive.frame_id
    base_frame: ClassVar[str] = "base_link"
    lidar_frame: ClassVar[str] = "lidar"

    drive: LidarDrive = field(default_factory=LidarDrive)
    vendor: str = setting(
        "", "whose field of time; empty: that of the lidar", allowed=("", *TIME_FIELDS)
    )
    missing: str = setting(
        "", "rows of beams without a return; empty: as the lidar", allowed=("", *MISSING)
    )
    stamp: str = setting("begin", "end of the sweep that stamps it", allowed=("begin", "end"))
    odometry_stamp: str = setting(
        "exact", "meaning of stamps", allowed=("exact", "scan_begin", "scan_end")
    )
    odometry_rate: int = setting(50, "exact poses per second", "Hz", 1, 1000)
    odometry_noise: float = setting(0.003, "standard deviation of a position", "m", 0.0, 1.0)

    def __iter__(self) -> Iterator[Published]:
        mounting = Transform(MOUNTING.position, MOUNTING.rotation.as_quat())
        extrinsic = PoseSample(START_NS, self.base_frame, self.lidar_frame, mounting)
        yield Published(START_NS, TransformSample(extrinsic, static=True))
        for number, scan in enumerate(self.drive.scans()):
            end_ns = scan.begin_ns + SWEEP_NS
            cloud = Published(end_ns, self._cloud(scan))
            if self.odometry_stamp == "exact":
                times_ns = self._pose_times(scan.begin_ns, end_ns)
                for sample in self._samples(number, times_ns, times_ns):
                    yield from _both(sample.time_ns, sample)
                yield cloud
            else:
                yield cloud
                stamp_ns = scan.begin_ns if self.odometry_stamp == "scan_begin" else end_ns
                for sample in self._samples(number, np.array([end_ns]), np.array([stamp_ns])):
                    yield from _both(end_ns, sample)

    def _pose_times(self, begin_ns: int, end_ns: int) -> Array:
        """Times (n,) ns of exact poses after the beginning of a sweep; of the first, at it too."""
        first, last = (
            (time_ns - START_NS) * self.odometry_rate // SECOND for time_ns in (begin_ns, end_ns)
        )
        numbers = np.arange(first + 1 if first else 0, last + 1)
        return START_NS + numbers * SECOND // self.odometry_rate

    def _samples(self, number: int, times_ns: Array, stamps_ns: Array) -> list[PoseSample]:
        """The poses (n,) that are reported of some times, with their stamps."""
        if not len(times_ns):
            return []
        poses = self.drive.drifted(times_ns, self.drive.poses(times_ns))
        rng = self.drive.generator(4, number)
        noise = self.odometry_noise * rng.normal(size=(2, len(times_ns), 3))
        turn = Rotation.from_rotvec(TURN_PER_METRE * noise[1])
        rows = zip(poses.position + noise[0], (poses.rotation * turn).as_quat(), strict=True)
        return [
            PoseSample(stamp_ns, self.fixed_frame, self.base_frame, Transform(*row))
            for stamp_ns, row in zip(stamps_ns.tolist(), rows, strict=True)
        ]

    def _cloud(self, scan: Scan) -> Sweep:
        lidar = LIDARS[self.drive.lidar]
        vendor, missing = self.vendor or lidar.vendor, self.missing or lidar.missing
        rows = np.arange(len(scan.points))
        if missing == "left_out":
            rows = np.flatnonzero(scan.returned)
        stamp_ns = scan.begin_ns + (SWEEP_NS if self.stamp == "end" else 0)
        line = scan.line[rows]
        times_ns = scan.line_ns[line]
        names = [name for name in FIELDS.names or () if name != "t"]
        layout = [(name, FIELDS[name]) for name in names]
        layout[5:5] = [TIME_FIELDS[vendor]]  # after the ring
        fields = np.zeros(len(rows), [*layout, ("truth", np.float64, 3)])
        returned = scan.returned[rows]
        for name in names:
            fields[name] = np.where(returned, scan.truth[name][rows], 0)
        for k, name in enumerate("xyz"):
            absent = 0.0 if missing == "zero" else np.nan
            fields[name] = np.where(returned, scan.points[rows, k], absent)
        name = TIME_FIELDS[vendor][0]
        fields[name] = time_column(vendor, stamp_ns, scan.begin_ns, times_ns)
        points = np.column_stack([fields[name] for name in "xyz"]).astype(np.float64)
        placed = scan.poses.placed(line, points)
        fields["truth"] = np.where(returned[:, None], placed, np.nan)
        return Sweep(stamp_ns, points, times_ns - stamp_ns, fields, self.lidar_frame)


def _both(time_ns: int, sample: PoseSample) -> tuple[Published, Published]:
    """A pose on the topic of the odometry and as tf."""
    return Published(time_ns, sample), Published(time_ns, TransformSample(sample, static=False))
