"""Cloud files as sources of sweeps; the formats are in formats/."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ellipseg_ros.errors import InputError, missing_package, reason
from ellipseg_ros.io.formats import FORMATS, npz
from ellipseg_ros.io.pointcloud2 import as_native, check_xyz, xyz
from ellipseg_ros.poses.point_times import time_offsets
from ellipseg_ros.records import SECOND, Array, Sweep

FRAME = "odom"  # of all files, as they name none: a world-fixed frame by REP-105


class CloudSweeps:
    """The sweeps of a cloud file; may be iterated several times.

    PCD, PLY, LAS, LAZ: one sweep with stamp 0. Times are kept as fields and interpreted by
    `time_offsets`: a survey of an hour is one cloud.
    NPZ with times: the sweeps in ascending order; a sweep's stamp is the time of its first point.
    """

    def __init__(self, path: Path) -> None:
        fields = read_fields(path)
        is_npz = FORMATS[path.suffix.lower()] is npz
        number = npz.sweep_numbers(fields) if is_npz else np.zeros(len(fields))
        order = np.argsort(number, kind="stable")
        _, starts = np.unique(number[order], return_index=True)
        self._fields = fields[order]
        self._cuts = [*starts.tolist(), len(fields)]
        self._timed = is_npz and "t" in (fields.dtype.names or ())
        self.frame_id = FRAME
        self.count = len(starts)
        self.duration = float(np.ptp(self._fields["t"])) if self._timed else 0.0  # s

    def __iter__(self) -> Iterator[Sweep]:
        for start, end in zip(self._cuts[:-1], self._cuts[1:], strict=True):
            fields = self._fields[start:end]
            stamp_ns = round(float(fields["t"].min()) * SECOND) if self._timed else 0
            offsets = time_offsets(fields, stamp_ns)
            yield Sweep(stamp_ns, xyz(fields), offsets, fields, self.frame_id)


def read_fields(path: Path) -> Array:
    """All fields of the points of a cloud file: (n,) structured, with x, y and z.

    Raises InputError, in one line, if the file can't be read or holds no point.
    """
    suffix = path.suffix.lower()
    if suffix not in FORMATS:
        raise InputError(f"{path} is no cloud; there are {', '.join(FORMATS)}", "suffix")
    try:
        fields = as_native(FORMATS[suffix].read(path))
        check_xyz(fields.dtype)
    except InputError as error:
        raise InputError(f"{path}: {error}", error.reason) from error
    except ModuleNotFoundError as error:
        raise InputError(f"{path}: reading it {missing_package(error)}", "package") from error
    except Exception as error:  # damaged files make the libraries raise nearly anything
        problem = f"{path} can't be read ({reason(error)})"
        kind = suffix[1:].upper()
        raise InputError(f"{problem}; it must be a complete {kind} file", "bad_cloud") from error
    if not len(fields):
        raise InputError(f"{path} holds no points; it must have at least one", "empty")
    return fields
