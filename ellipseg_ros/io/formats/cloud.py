"""Single clouds in files: PCD, PLY, LAS/LAZ and NPZ.

Read with pypcd4 (PCD in all three encodings; BSD), trimesh (PLY; MIT, where plyfile is GPL) and
laspy with lazrs (LAS, LAZ; BSD, MIT): each maintained, with wheels for every Python from 3.10 on.
They are imported when a file needs them, since a node never does.
"""

import re
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, cast

import numpy as np

from ellipseg_ros.errors import InputError, reason
from ellipseg_ros.io.atomic_files import replacing
from ellipseg_ros.io.formats.header_checks import check_arrays, check_las, check_pcd, check_ply
from ellipseg_ros.io.limits import LAST_STAMP
from ellipseg_ros.io.point_times import time_offsets
from ellipseg_ros.io.pointcloud2 import (
    append_fields,
    as_native,
    check_xyz,
    labelled_fields,
    places,
    xyz,
)
from ellipseg_ros.records import SECOND, Array, Segmentation, Sweep

FRAME = "odom"  # files name none; a world-fixed frame by REP-105
SLICE = 0.1  # s: clouds with times but without sweep numbers are cut into such sweeps
LAS_CHUNK = 500_000  # points that are read at once: a header may claim more than there are
PLY_TYPES = {
    "i1": "char",
    "u1": "uchar",
    "i2": "short",
    "u2": "ushort",
    "i4": "int",
    "u4": "uint",
    "f4": "float",
    "f8": "double",
}


class CloudSweeps:
    """The sweeps of a cloud file; may be iterated again and again.

    PCD, PLY, LAS, LAZ: one sweep with stamp 0; whatever times it has are kept as fields and mean
    what time_offsets makes of them, so a survey of an hour is one cloud, not a drive.

    NPZ: arrays `xyz` (n, 3) m, or `x`, `y`, `z`; others of n rows are kept as fields. With `t`
    (n,) in seconds it is a drive: its sweeps are those of `sweep` (n,), in ascending order, or
    else slices of 0.1 s; the stamp of a sweep is the time of its earliest point.
    """

    def __init__(self, path: Path) -> None:
        fields = read_fields(path)
        number = _sweep_numbers(fields, path) if path.suffix.lower() == ".npz" else None
        if number is None:
            number = np.zeros(len(fields), np.int64)
        order = np.argsort(number, kind="stable")
        _, starts = np.unique(number[order], return_index=True)
        self._fields = fields[order]
        self._cuts = [*starts.tolist(), len(fields)]
        self._timed = path.suffix.lower() == ".npz" and "t" in (fields.dtype.names or ())
        self.frame_id = FRAME
        self.count = len(starts)
        ends = self._fields["t"] if self._timed else np.zeros(1)
        self.duration = float(np.ptp(ends))  # s

    def __iter__(self) -> Iterator[Sweep]:
        for start, end in zip(self._cuts[:-1], self._cuts[1:], strict=True):
            fields = self._fields[start:end]
            stamp_ns = round(float(fields["t"].min()) * SECOND) if self._timed else 0
            offsets = time_offsets(fields, stamp_ns)
            yield Sweep(stamp_ns, xyz(fields), offsets, fields, self.frame_id)


def _sweep_numbers(fields: Array, path: Path) -> Array | None:
    """(n,) which sweep each point of an NPZ belongs to; None for all in one."""
    names = fields.dtype.names or ()
    if "t" in names and not (np.abs(fields["t"]) <= LAST_STAMP).all():
        raise InputError(
            f"{path}: t holds NaN, Inf or more than {LAST_STAMP}; it must be seconds, for every "
            "point",
            "times",
        )
    if "sweep" in names:
        return np.asarray(fields["sweep"])
    return np.floor(fields["t"] / SLICE) if "t" in names else None


# --- reading ---------------------------------------------------------------------------------


def read_fields(path: Path) -> Array:
    """Everything that a cloud file says of its points: (n,) structured with x, y and z.

    Raises InputError, in one line, if the file can't be read or holds no point.
    """
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise InputError(f"{path} is no cloud; there are {', '.join(READERS)}", "suffix")
    with _one_line(path):
        fields = as_native(reader(path))
        check_xyz(fields.dtype)
    if not len(fields):
        raise InputError(f"{path} holds no points; it must have at least one", "empty")
    return fields


@contextmanager
def _one_line(path: Path) -> Iterator[None]:
    """Damaged files make the libraries raise nearly anything, hence every Exception."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{path}: {error}", error.reason) from error
    except Exception as error:
        kind = path.suffix.lstrip(".").upper()
        raise InputError(
            f"{path} can't be read ({reason(error)}); it must be a complete {kind} file",
            "bad_cloud",
        ) from error


def _read_pcd(path: Path) -> Array:
    from pypcd4.pypcd4 import PointCloud

    check_pcd(path)
    cloud = PointCloud.from_path(path)
    meta = cloud.metadata
    data = np.atleast_1d(cloud.pc_data)
    if len(data) != meta.points:
        raise InputError(f"it holds {len(data)} points where its header says {meta.points}")
    names: list[str] = []
    formats: list[Any] = []
    offsets: list[int] = []
    columns = iter(places(data.dtype).values())
    for name, count in zip(meta.fields, meta.count, strict=True):
        kind, place = [next(columns) for _ in range(count)][0]  # there is a column per value
        if name.isidentifier():  # the library gives padding, `_`, an odd name
            names.append(name)
            formats.append(kind if count == 1 else (kind, (count,)))
            offsets.append(place)
    size = data.dtype.itemsize
    layout = {"names": names, "formats": formats, "offsets": offsets, "itemsize": size}
    return np.asarray(data.view(np.dtype(cast(Any, layout))))


def _read_ply(path: Path) -> Array:
    from trimesh.exchange.ply import load_ply

    check_ply(path)
    with path.open("rb") as file:
        elements = load_ply(file)["metadata"]["_ply_raw"]
    if "vertex" not in elements:
        raise InputError("it has no element vertex")
    data = elements["vertex"]["data"]
    if isinstance(data, dict):  # of an ASCII file: a column each, (n, 1)
        data = _table({name: column[:, 0] for name, column in data.items()})
    if len(data) != elements["vertex"]["length"]:
        raise InputError(f"it holds {len(data)} points of {elements['vertex']['length']}")
    return np.asarray(data)


def _read_las(path: Path) -> Array:
    import laspy

    check_las(path)
    with laspy.open(path, read_evlrs=False) as file:
        names = [n for n in file.header.point_format.dimension_names if n not in ("X", "Y", "Z")]
        tables = [
            _table({name: chunk[name] for name in ("x", "y", "z", *names)})
            for chunk in file.chunk_iterator(LAS_CHUNK)
        ]
        read = sum(len(table) for table in tables)
        if not read or read != file.header.point_count:
            raise InputError(f"it holds {read} points of {file.header.point_count}")
    return np.concatenate(tables)


def _read_npz(path: Path) -> Array:
    check_arrays(path)
    with np.load(path, allow_pickle=False) as file:
        arrays = {name: file[name] for name in file.files}
    if "xyz" in arrays:
        points = arrays.pop("xyz")
        if points.ndim != 2 or points.shape[1] != 3:
            raise InputError(f"xyz has shape {points.shape}; it must be (n, 3)", "shape")
        arrays = dict(zip("xyz", points.T, strict=True)) | arrays
    if not {"x", "y", "z"} <= arrays.keys():
        names = ", ".join(arrays) or "nothing"
        raise InputError(f"it has no array xyz, nor x, y, z; it has {names}", "no_xyz")
    count = len(arrays["x"])
    if "t" in arrays:
        arrays["t"] = arrays["t"].astype(np.float64)
    of_points = {n: a for n, a in arrays.items() if a.ndim in (1, 2) and len(a) == count}
    return _table({name: arrays[name] for name in "xyz"} | of_points)


READERS: dict[str, Callable[[Path], Array]] = {
    ".pcd": _read_pcd,
    ".ply": _read_ply,
    ".las": _read_las,
    ".laz": _read_las,
    ".npz": _read_npz,
}


def _table(columns: dict[str, Any]) -> Array:
    """Columns (n,) or (n, k) of numbers as one structured array."""
    arrays = {name: np.asarray(column) for name, column in columns.items()}
    for name, array in arrays.items():
        if array.dtype.kind not in "iufb":
            raise InputError(f"{name} holds {array.dtype.name}; fields must hold numbers")
    kinds = [(name, array.dtype, array.shape[1:]) for name, array in arrays.items()]
    table = np.zeros(len(next(iter(arrays.values()))), kinds)
    for name, array in arrays.items():
        table[name] = array
    return table


# --- writing ---------------------------------------------------------------------------------


def write_npz(path: Path, found: Segmentation) -> None:
    """The labelled window, compressed: `xyz`, `t` (s), all input fields, `label` and `object`.

    The last two are ids, 0 for none. Of the segments, a row each: `segment_id`, `segment_object`,
    `segment_count`, `segment_mean`, `segment_covariance`. Of the objects: `object_id`,
    `object_count`, `object_mean`, `object_low`, `object_high`. Reads back as a drive.
    """
    fields = _with_times(found)
    arrays = {
        name: fields[name] for name in fields.dtype.names or () if name not in (*"xyz", "rgb")
    }
    shape = found.ellipsoids
    arrays |= {
        "xyz": np.column_stack([fields[name] for name in "xyz"]),
        "segment_id": found.ids,
        "segment_object": found.object_ids,
        "segment_count": shape.count,
        "segment_mean": shape.mean,
        "segment_covariance": shape.covariance,
    }
    if found.objects is not None:
        for name in ("count", "mean", "box_min", "box_max"):
            arrays[f"object_{name}"] = getattr(found.objects, name)
        arrays["object_id"] = found.objects.ids
    with replacing(path) as part, part.open("wb") as file:
        # Not savez: it would take fields that are named as its parameters are for those.
        with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
            for name, array in arrays.items():
                with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                    np.lib.format.write_array(member, np.asanyarray(array), allow_pickle=False)


def write_ply(path: Path, found: Segmentation) -> None:
    """The labelled window as a binary PLY: all input fields, `label`, and red, green, blue.

    Written here, in a header and one block: of the libraries for PLY, plyfile is GPL, trimesh
    writes float32 coordinates only, and meshio misreads what others write.
    """
    fields = labelled_fields(found)
    columns: dict[str, Array] = {}
    for name in fields.dtype.names or ():
        column = fields[name]
        if name == "rgb":
            packed = np.ascontiguousarray(column).view(np.uint32)
            for shift, colour in ((16, "red"), (8, "green"), (0, "blue")):
                columns[_unused(colour, columns)] = (packed >> shift & 255).astype(np.uint8)
        elif column.ndim == 1:
            columns[_unused(re.sub(r"\s+", "_", name), columns)] = column
        else:
            flat = column.reshape(len(column), -1)
            for k in range(flat.shape[1]):
                columns[_unused(f"{name}_{k}", columns)] = flat[:, k]
    table = _table(columns)
    table = table.astype(table.dtype.newbyteorder("<"))
    properties = [f"property {PLY_TYPES[table.dtype[name].str[1:]]} {name}" for name in columns]
    header = ["ply", "format binary_little_endian 1.0", f"comment frame {found.frame_id}"]
    header += [f"element vertex {len(table)}", *properties, "end_header", ""]
    with replacing(path) as part:
        part.write_bytes("\n".join(header).encode() + table.tobytes())


def _unused(name: str, taken: dict[str, Array]) -> str:
    while name in taken:
        name = f"{name}_"
    return name


def _with_times(found: Segmentation) -> Array:
    """The labelled points with a field `t` in seconds; an input's other `t` becomes input_t."""
    fields = labelled_fields(found)
    seconds = found.times_ns / SECOND
    if "t" in (fields.dtype.names or ()) and np.array_equal(fields["t"], seconds):
        return fields
    return append_fields(fields, {"t": seconds}, ("t",))
