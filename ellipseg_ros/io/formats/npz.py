"""NPZ, named arrays of numpy in a zip archive.

`xyz` (n, 3) m, or `x`, `y`, `z`; other arrays of n rows are kept as fields. With `t` (n,) in
seconds it is a drive, divided into sweeps by `sweep` (n,), or else into slices of 0.1 s.
"""

import math
import zipfile
from pathlib import Path

import numpy as np

from ellipseg_ros.errors import InputError
from ellipseg_ros.io.atomic_files import replacing
from ellipseg_ros.io.formats.common import damaged, table
from ellipseg_ros.io.limits import MAX_STAMP_S
from ellipseg_ros.io.pointcloud2 import append_fields, labelled_fields
from ellipseg_ros.records import SECOND, Array, Segmentation

SLICE_S = 0.1  # length of the sweeps of a drive without sweep numbers
MAX_UNPACKED_BYTES = 2**33  # of all arrays of a file
HEADER_READERS = {  # by the version of the format of an array
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}


def read(path: Path) -> Array:
    """All arrays with a row per point: (n,) structured."""
    check_archive(path, MAX_UNPACKED_BYTES)
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
        if not (np.abs(arrays["t"]) <= MAX_STAMP_S).all():
            problem = f"t holds NaN, Inf or more than {MAX_STAMP_S}"
            raise InputError(f"{problem}; it must be seconds of each point", "times")
    columns = {n: a for n, a in arrays.items() if a.ndim in (1, 2) and len(a) == count}
    return table({name: arrays[name] for name in "xyz"} | columns)


def sweep_numbers(fields: Array) -> Array:
    """(n,) the sweep of each point; zeros if there are neither times nor sweep numbers."""
    names = fields.dtype.names or ()
    if "sweep" in names:
        return np.asarray(fields["sweep"])
    return np.floor(fields["t"] / SLICE_S) if "t" in names else np.zeros(len(fields))


def check_archive(path: Path, max_bytes: int) -> None:
    """Raise InputError if an array has not the size that its header claims, or all are too big.

    max_bytes: of all arrays together, unpacked.
    """
    with zipfile.ZipFile(path) as archive:
        members = archive.infolist()
        size = sum(member.file_size for member in members)
        if size > max_bytes:
            raise damaged(f"it unpacks to {size} bytes; at most {max_bytes} are read")
        for member in members:
            with archive.open(member) as file:
                version = np.lib.format.read_magic(file)
                if version not in HEADER_READERS:
                    raise damaged(f"an array has format {version}; it must be 1 or 2")
                shape, _, kind = HEADER_READERS[version](file)
                needed = math.prod(shape, start=kind.itemsize)
                if needed != member.file_size - file.tell():
                    raise damaged(f"{member.filename} has another size than it says")


def write(path: Path, result: Segmentation) -> None:
    """Write the labelled window, compressed: `xyz`, `t` (s), input fields, `label` and `object`.

    `label` and `object` are ids, 0 for none. Arrays with a row per segment: `segment_id`,
    `segment_object`, `segment_count`, `segment_mean`, `segment_covariance`; per object:
    `object_id`, `object_count`, `object_mean`, `object_box_min`, `object_box_max`. It can be read
    again as a drive.
    """
    fields = _with_times(result)
    arrays = {name: fields[name] for name in fields.dtype.names or ()}
    arrays.pop("rgb")
    arrays |= {
        "xyz": np.column_stack([arrays.pop(name) for name in "xyz"]),
        "segment_id": result.ids,
        "segment_object": result.object_ids,
    }
    for name in ("count", "mean", "covariance"):
        arrays[f"segment_{name}"] = getattr(result.ellipsoids, name)
    if result.objects is not None:
        for name in ("count", "mean", "box_min", "box_max"):
            arrays[f"object_{name}"] = getattr(result.objects, name)
        arrays["object_id"] = result.objects.ids
    with replacing(path) as part, part.open("wb") as file:
        # Not savez: it would take a field named like one of its parameters for the parameter.
        with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
            for name, array in arrays.items():
                with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                    np.lib.format.write_array(member, np.asanyarray(array), allow_pickle=False)


def _with_times(result: Segmentation) -> Array:
    """The labelled points with `t` in seconds; another `t` of the input becomes `input_t`."""
    fields = labelled_fields(result)
    seconds = result.times_ns / SECOND
    if "t" in (fields.dtype.names or ()) and np.array_equal(fields["t"], seconds):
        return fields
    return append_fields(fields, {"t": seconds}, ("t",))
