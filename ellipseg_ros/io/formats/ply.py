"""PLY, ASCII and binary.

Read with trimesh: MIT and maintained, where plyfile is GPL. Written here, as a header and one
block: trimesh writes float32 coordinates only, and meshio misreads the files of other programs.
"""

import re
from pathlib import Path

import numpy as np

from ellipseg_ros.errors import InputError
from ellipseg_ros.io.atomic_files import replacing
from ellipseg_ros.io.formats.common import check_size, damaged, header_lines, table
from ellipseg_ros.io.pointcloud2 import NUMBERS, labelled_fields
from ellipseg_ros.records import Array, Segmentation

PLY_NAMES = ("char", "uchar", "short", "ushort", "int", "uint", "float", "double")
TYPES = dict(zip(NUMBERS, PLY_NAMES, strict=True))  # both in the order of PointField


def read(path: Path) -> Array:
    """All properties of the element `vertex`: (n,) structured."""
    from trimesh.exchange.ply import load_ply

    _check_header(path)
    with path.open("rb") as file:
        elements = load_ply(file)["metadata"]["_ply_raw"]
    if "vertex" not in elements:
        raise InputError("it has no element vertex")
    data = elements["vertex"]["data"]
    if isinstance(data, dict):  # of an ASCII file: columns (n, 1)
        data = table({name: column[:, 0] for name, column in data.items()})
    if len(data) != elements["vertex"]["length"]:
        raise InputError(f"it holds {len(data)} points of {elements['vertex']['length']}")
    return np.asarray(data)


def _check_header(path: Path) -> None:
    """Raise InputError if the header has no end, or an element more rows than the file bytes."""
    lines = header_lines(path, b"end_header")
    if not lines or lines[-1] != ["end_header"]:
        raise damaged("its header has no end")
    for line in lines:
        if line[:1] == ["element"]:
            check_size(path, int(line[2]), 1)


def write(path: Path, result: Segmentation) -> None:
    """Write the labelled window: all input fields, `label`, `object`, and red, green, blue."""
    fields = labelled_fields(result)
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
    points = table(columns)
    points = points.astype(points.dtype.newbyteorder("<"))
    properties = [f"property {TYPES[points.dtype[name].str[1:]]} {name}" for name in columns]
    header = ["ply", "format binary_little_endian 1.0", f"comment frame {result.frame_id}"]
    header += [f"element vertex {len(points)}", *properties, "end_header", ""]
    with replacing(path) as part:
        part.write_bytes("\n".join(header).encode() + points.tobytes())


def _unused(name: str, taken: dict[str, Array]) -> str:
    while name in taken:
        name = f"{name}_"
    return name
