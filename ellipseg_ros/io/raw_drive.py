"""Drives of raw sweeps with poses in one NPZ file.

`xyz` (n, 3) m in the sensor's frame, or integers such as `xyz_3mm` in units of 3 mm; `count`
(s,) points of each sweep in turn, or `frame` (n,) the sweep of each point; `t` (s,) s; `poses`
(s, 4, 4), p_world = pose p_sensor. Other arrays of n rows are fields of the points.
"""

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ellipseg_ros.errors import InputError, reason
from ellipseg_ros.io.formats import npz
from ellipseg_ros.io.formats.common import table
from ellipseg_ros.io.pose_files import FIXED_FRAME
from ellipseg_ros.poses.series import PoseSample
from ellipseg_ros.poses.transforms import from_matrix
from ellipseg_ros.records import SECOND, Array, Sweep

SENSOR_FRAME = "lidar"
SCALED = re.compile(r"xyz_(\d+)mm")


class RawDrive:
    """The sweeps of such a file, in the sensor's frame; may be iterated several times."""

    def __init__(self, path: Path) -> None:
        try:
            npz.check_archive(path, npz.MAX_UNPACKED_BYTES)
            with np.load(path, allow_pickle=False) as file:
                self._arrays = {name: file[name] for name in file.files}
            self._read()
        except InputError as error:
            raise InputError(f"{path}: {error}", error.reason) from error
        except Exception as error:  # damaged files make numpy raise nearly anything
            problem = f"{path} can't be read ({reason(error)})"
            raise InputError(f"{problem}; it must be a complete NPZ file", "bad_cloud") from error
        self.frame_id = SENSOR_FRAME
        self.count = len(self._stamps)
        self.duration = (self._stamps[-1] - self._stamps[0]) / SECOND  # s

    def _read(self) -> None:
        arrays = self._arrays
        self._stamps = [round(t * SECOND) for t in arrays.pop("t").astype(float).tolist()]
        name = next((name for name in arrays if name == "xyz" or SCALED.fullmatch(name)), "")
        if not name or not self._stamps:
            problem = "it has no sweeps" if name else "it has no array xyz"
            raise InputError(
                f"{problem}; a drive has xyz, t, poses and count or frame", "bad_cloud"
            )
        self._xyz = arrays.pop(name)
        if self._xyz.ndim != 2 or self._xyz.shape[1] != 3:
            raise InputError(f"{name} has shape {self._xyz.shape}; it must be (n, 3)", "shape")
        scaled = SCALED.fullmatch(name)
        self._unit = int(scaled[1]) / 1000.0 if scaled else 1.0  # m
        counts = self._counts(len(self._stamps))
        for what, number, expected in (
            ("sweeps", len(counts), len(self._stamps)),
            ("points", int(np.abs(counts).sum()), len(self._xyz)),
        ):
            if number != expected:
                problem = f"count or frame has {number} {what}; the other arrays have {expected}"
                raise InputError(f"{problem}, and these must be equal", "shape")
        self._ends = np.cumsum(counts).tolist()
        poses = [from_matrix(pose) for pose in arrays.pop("poses")]
        self.poses = [
            PoseSample(t, FIXED_FRAME, SENSOR_FRAME, pose)
            for t, pose in zip(self._stamps, poses, strict=True)
        ]

    def _counts(self, sweeps: int) -> Array:
        """(s,) points of every sweep; the points are brought into the order of the sweeps."""
        if "count" in self._arrays:
            return self._arrays.pop("count")
        frame = self._arrays.pop("frame")
        if frame.shape != self._xyz.shape[:1]:
            problem = f"frame has shape {frame.shape}; there are {len(self._xyz)} points"
            raise InputError(f"{problem}, and it must have one entry for each", "shape")
        order = np.argsort(frame, kind="stable")
        self._xyz = self._xyz[order]
        columns = {n: a[order] for n, a in self._arrays.items() if a.shape[:1] == frame.shape}
        self._arrays |= columns
        return np.bincount(frame, minlength=sweeps)

    def __iter__(self) -> Iterator[Sweep]:
        start = 0
        count = len(self._xyz)
        columns = {n: a for n, a in self._arrays.items() if a.ndim in (1, 2) and len(a) == count}
        for stamp_ns, end in zip(self._stamps, self._ends, strict=True):
            points = self._xyz[start:end]
            if self._unit != 1.0 or points.dtype.kind != "f":
                points = np.multiply(points, self._unit, dtype=np.float64)
            fields = table(
                {axis: points[:, k] for k, axis in enumerate("xyz")}
                | {name: column[start:end] for name, column in columns.items()}
            )
            yield Sweep(stamp_ns, points, fields=fields, frame_id=SENSOR_FRAME)
            start = end


def is_raw_drive(path: Path) -> bool:
    """Whether an NPZ file holds raw sweeps with a pose for each."""
    try:
        with np.load(path, allow_pickle=False) as file:
            names = set(file.files)
            if not {"t", "poses"} <= names or not names & {"count", "frame"}:
                return False
            return file["t"].shape == (len(file["poses"]),)
    except Exception:  # the reader of clouds reports damaged files
        return False
