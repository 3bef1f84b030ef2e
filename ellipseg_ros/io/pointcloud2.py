"""Conversion between sensor_msgs/PointCloud2 and arrays.

Messages may be of rclpy or of rosbags. sensor_msgs_py is not used: it ignores row padding, treats
NaN by `is_dense`, and is not on PyPI.
"""

from collections.abc import Container
from typing import Any, TypeAlias

import numpy as np

from ellipseg_ros.core.fields import MAX_FIELDS_BYTES, record_layout
from ellipseg_ros.errors import InputError
from ellipseg_ros.io.cdr import Cdr
from ellipseg_ros.io.colours import id_colours
from ellipseg_ros.io.limits import check_name, read_stamp
from ellipseg_ros.poses.point_times import OFFSET, time_offsets
from ellipseg_ros.records import Array, Segmentation, Sweep

Layout: TypeAlias = np.dtype[Any]

# PointField's numbers for types.
TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
NUMBERS = {kind: number for number, kind in TYPES.items()}
WIDER = {"b1": "u1", "f2": "f4", "i8": "f8", "u8": "f8"}  # for types that PointField lacks
MAX_UNUSED_RATIO = 1.25  # bytes of a message to bytes of its points, above which it is copied
PADDING = ("", "_")  # names of gaps in PCL
OUTPUT_FIELDS = ("label", "rgb", "object")  # input fields with these names become input_...
MAX_DATA_BYTES = 2**32 - 1  # of a message
MAX_ROUNDING = 1e-3  # m: output coordinates with a larger error in float32 are float64


# --- reading ---------------------------------------------------------------------------------


def read_sweep(msg: Any) -> Sweep:
    """The points of a PointCloud2, row by row; InputError, in one line, if it is invalid.

    `points` are its x, y, z as float64, including NaN. `fields` has the names, offsets and
    point_step of the message, in native byte order, and shares its memory if possible.
    Times of points: see point_times.py.
    """
    stamp_ns = read_stamp(msg.header.stamp)
    frame_id = msg.header.frame_id
    check_name("frame_id", frame_id)
    if not msg.width * msg.height and not msg.fields:
        return Sweep(stamp_ns, np.zeros((0, 3)), frame_id=frame_id)
    fields = read_fields(msg)
    offsets = time_offsets(fields, stamp_ns)
    return Sweep(stamp_ns, xyz(fields), offsets, fields, frame_id)


def read_fields(msg: Any) -> Array:
    """Every field of a PointCloud2: (n,) structured, in native byte order."""
    count = msg.width * msg.height
    if msg.point_step > MAX_FIELDS_BYTES:
        problem = f"point_step is {msg.point_step}"
        raise InputError(f"{problem}; a point has at most {MAX_FIELDS_BYTES} bytes", "point_step")
    layout = _layout(msg, count)
    check_xyz(layout)
    if not count:
        return np.zeros(0, layout.newbyteorder("="))
    # With one row, row_step means nothing, and many publishers leave it 0.
    row_step = msg.row_step if msg.height > 1 else msg.width * msg.point_step
    _check_size(msg, row_step)
    data = memoryview(msg.data).cast("B")
    rows = np.ndarray((msg.height, msg.width), layout, data, strides=(row_step, msg.point_step))
    fields = as_native(rows.reshape(count))
    # Do not keep a large message alive for few points.
    return fields.copy() if len(data) > MAX_UNUSED_RATIO * count * msg.point_step else fields


def xyz(fields: Array) -> Array:
    """Coordinates of structured points as (n, 3) float64, m."""
    points = np.empty((len(fields), 3))
    for column, name in enumerate("xyz"):
        with np.errstate(invalid="ignore"):  # signalling NaN
            np.multiply(fields[name], 1.0, out=points[:, column])
    return points


def as_native(fields: Array) -> Array:
    """Structured points in the byte order of this machine, the same layout otherwise."""
    native = fields.dtype.newbyteorder("=")
    return fields if fields.dtype == native else _convert(fields, native)


def _convert(fields: Array, layout: Layout) -> Array:
    converted = np.zeros(len(fields), layout)
    for name in layout.names or ():
        converted[name] = fields[name]
    return converted


def _layout(msg: Any, count: int) -> Layout:
    """The message's fields as a structured dtype with an itemsize of point_step."""
    order = ">" if msg.is_bigendian else "<"
    fields: dict[str, tuple[Layout, int]] = {}
    point_step, total = msg.point_step, 0
    for field in msg.fields:
        if field.name in PADDING:
            continue
        check_name("field", field.name)
        if field.name in fields:
            problem = f"the cloud has two fields named {field.name!r}"
            raise InputError(f"{problem}; names must differ", "field_twice")
        kind = TYPES.get(field.datatype)
        if kind is None:
            problem = f"has datatype {field.datatype}; PointField has 1 to 8"
            raise InputError(f"field {field.name!r} {problem}", "datatype")
        number = max(field.count, 1)  # some publishers write 0 for 1
        size = number * np.dtype(kind).itemsize
        end = field.offset + size
        if end > (msg.point_step if count else MAX_FIELDS_BYTES):
            problem = f"field {field.name!r} ends at byte {end} of a point"
            limit = f"beyond point_step {msg.point_step}; it must end within"
            raise InputError(f"{problem}, {limit}", "point_step")
        total += size  # overlapping fields are separated when clouds are joined
        if total > MAX_FIELDS_BYTES:
            problem = f"the fields of a point hold more than {MAX_FIELDS_BYTES} bytes"
            raise InputError(f"{problem}, the maximum", "fields")
        shape = () if number == 1 else (number,)
        fields[field.name] = (np.dtype((order + kind, shape)), field.offset)
        point_step = max(point_step, end)
    return record_layout(fields, point_step)


def check_xyz(layout: Layout) -> None:
    """Raise InputError unless there are fields x, y and z of floating-point numbers."""
    names = layout.names or ()
    missing = [name for name in "xyz" if name not in names]
    if missing:
        problem = f"the cloud has no field {', '.join(missing)}"
        listed = ", ".join(names) or "none"
        raise InputError(f"{problem}; it has {listed}, and needs x, y and z", "no_xyz")
    for name in "xyz":
        kind = layout[name]
        if kind.kind != "f" or kind.shape:
            count = max(kind.shape, default=1)
            problem = f"field {name!r} is {kind.base.name} with count {count}"
            raise InputError(f"{problem}; it must be one float32 or float64", "xyz_type")


def _check_size(msg: Any, row_step: int) -> None:
    row_bytes = msg.width * msg.point_step
    if row_step < row_bytes:
        points = f"{msg.width} points of {msg.point_step} bytes"
        raise InputError(f"row_step is {row_step}; {points} need at least {row_bytes}", "row_step")
    needed = (msg.height - 1) * row_step + row_bytes
    if len(msg.data) < needed:
        problem = f"the cloud holds {len(msg.data)} bytes of data"
        points = f"{msg.height} x {msg.width} points"
        raise InputError(f"{problem}; {points} need {needed}", "short_data")


# --- writing ---------------------------------------------------------------------------------


def write_labelled(segmentation: Segmentation) -> bytes:
    """All points of the window as a serialized PointCloud2, with the fields of labelled_fields."""
    return write_cloud(labelled_fields(segmentation), segmentation.end_ns, segmentation.frame_id)


def write_sweep(sweep: Sweep) -> bytes:
    """A sweep as a serialized PointCloud2 that read_sweep reads as the same sweep.

    Times that are not in its fields are appended as `offset_time` (float64, ns).
    """
    fields = with_xyz(sweep.points, sweep.fields, max_rounding=0.0)
    if not np.array_equal(time_offsets(fields, sweep.stamp_ns), sweep.offsets_ns):
        fields = append_fields(fields, {OFFSET: sweep.offsets_ns.astype(np.float64)}, (OFFSET,))
    return write_cloud(fields, sweep.stamp_ns, sweep.frame_id)


def labelled_fields(segmentation: Segmentation) -> Array:
    """The input fields at their offsets, then `label`, `object`, `rgb`: (n,) structured.

    label, object: uint32 ids of the point's segment and object, 0 for none. rgb: like in PCL and
    RViz, the bytes of 0x00RRGGBB as float32. An input field with one of these names becomes
    input_...
    """
    red, green, blue = id_colours(np.append(segmentation.ids, 0)).astype(np.uint32).T
    packed = (red << 16 | green << 8 | blue).view(np.float32)
    added = {
        "label": segmentation.point_ids,
        "object": segmentation.point_object_ids,
        "rgb": packed[np.maximum(segmentation.labels, -1)],
    }
    fields = with_xyz(segmentation.points, segmentation.fields, MAX_ROUNDING)
    return append_fields(fields, added, OUTPUT_FIELDS)


def with_xyz(points: Array, fields: Array | None, max_rounding: float) -> Array:
    """`fields` in types of PointField, with x, y, z in front if they lack them.

    New coordinates are float32, or float64 if float32 has an error of more than `max_rounding` m.
    """
    names = () if fields is None else fields.dtype.names or ()
    if fields is not None and all(name in names for name in "xyz"):
        return _point_field_types(fields)
    finite = points[np.isfinite(points).all(axis=1)]
    with np.errstate(over="ignore"):
        moved = np.abs(finite - finite.astype(np.float32))
        kind = "f8" if moved.max(initial=0.0) > max_rounding else "f4"
        base = np.zeros(len(points), [(name, kind) for name in "xyz"])
        for column, name in enumerate("xyz"):
            base[name] = points[:, column]
    if fields is None:
        return base
    converted = _point_field_types(fields)
    return append_fields(base, {name: converted[name] for name in names}, ())


def append_fields(fields: Array, added: dict[str, Array], reserved: tuple[str, ...]) -> Array:
    """Append columns to fields; fields with a reserved name become input_..."""
    old = field_layout(fields.dtype)
    names = [_unused_name(name, old) if name in reserved else name for name in old]
    layout = dict(zip(names, old.values(), strict=True))
    size = end = fields.dtype.itemsize
    for name, column in added.items():
        kind = np.dtype((column.dtype, column.shape[1:]))
        end += -end % kind.base.itemsize
        layout[name] = (kind, end)
        end += kind.itemsize
    extended = np.zeros(len(fields), record_layout(layout, end + -end % 4))
    # As bytes: field by field is slower, and loses the gaps between fields.
    as_bytes(extended)[:, :size] = as_bytes(np.ascontiguousarray(fields))
    for name, column in added.items():
        extended[name] = column
    return extended


def field_layout(layout: Layout) -> dict[str, tuple[Layout, int]]:
    """Type and offset of every field."""
    return {name: (kind, place) for name, (kind, place, *_) in (layout.fields or {}).items()}


def as_bytes(fields: Array) -> Array:
    """(n,) structured, contiguous -> (n, itemsize) uint8, the same memory."""
    return fields.view(np.uint8).reshape(len(fields), fields.dtype.itemsize)


def _unused_name(name: str, taken: Container[str]) -> str:
    while name in taken:
        name = f"input_{name}"
    return name


def _point_field_types(fields: Array) -> Array:
    """The fields, with types that PointField lacks replaced by the next wider one."""
    kinds = {
        name: _point_field_type(name, fields.dtype[name]) for name in fields.dtype.names or ()
    }
    if all(fields.dtype[name] == kind for name, kind in kinds.items()):
        return fields
    return _convert(fields, np.dtype(list(kinds.items())))


def _point_field_type(name: str, kind: Layout) -> Layout:
    """bool -> uint8, float16 -> float32, 64-bit integers -> float64 (exact up to 2^53)."""
    code = kind.base.str[1:]
    code = WIDER.get(code, code)
    if code not in NUMBERS:
        problem = f"field {name!r} is {kind.base.name}; a cloud holds numbers only"
        raise InputError(problem, "field_type")
    return np.dtype((code, kind.shape))


def write_cloud(fields: Array, stamp_ns: int, frame_id: str) -> bytes:
    """Structured points with x, y, z as a serialized PointCloud2, little-endian, one row."""
    fields = np.ascontiguousarray(fields)
    if fields.nbytes > MAX_DATA_BYTES:
        problem = f"{len(fields)} points take {fields.nbytes} bytes"
        raise InputError(f"{problem}; a message holds {MAX_DATA_BYTES}", "bytes")
    out = Cdr()
    out.header(stamp_ns, frame_id)
    out.put("II", 1, len(fields))
    layout = fields.dtype
    out.put("I", len(layout.names or ()))
    for name, (kind, place) in field_layout(layout).items():
        out.text(name)
        out.put("IBI", place, NUMBERS[kind.base.str[1:]], int(np.prod(kind.shape, dtype=int)))
    out.put("?II", False, layout.itemsize, layout.itemsize * len(fields))
    out.put("I", fields.nbytes)
    out.bulk(fields.view(np.uint8).data)
    out.put("?", all(bool(np.isfinite(fields[name]).all()) for name in "xyz"))
    return out.bytes()
