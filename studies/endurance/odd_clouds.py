"""Odd PointCloud2 messages, as plain objects and as bytes.

A cloud has points of some shape, some with invalid coordinates, and fields of any name, type and
offset. Most clouds are consistent; the others get a wrong size, offset, type or name.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from ellipseg_ros.io.pointcloud2 import TYPES
from ellipseg_ros.poses.point_times import NAMES as TIMES
from ellipseg_ros.records import SECOND, Array
from studies.endurance.cloud_messages import START_NS, Cloud, Field, Header, Time

CASES_PER_LAYOUT = 20  # most of which have the same fields, as those of one sensor would
STEP_NS = SECOND // 10  # between two clouds
SIZES = (0, 1, 2**15, 2**16 - 1, 2**20 + 1, 2**31 - 1, 2**31, 2**32 - 1)  # uint32
ODD = (
    np.nan,
    np.inf,
    -np.inf,
    5e-324,
    1e-310,
    -0.0,
    1e30,
    -1e30,
    1e300,
    3.4e38,
    1e8,
    -1.0000001e8,
)
FRAMES = ("map", "", "base_link", "ödom/ß", "a b", "/odom", "x" * 300, "two\nlines", "nul\0", "…")
FIELDS = (
    "intensity",
    "ring",
    "label",
    "object",
    "rgb",
    "input_label",
    "file",
    "é",
    "_",
    "",
    "x y",
)


def odd_cloud(seed: int, case: int) -> Cloud:
    """The cloud of a case; deterministic."""
    rng = np.random.default_rng([seed, case])
    layout_rng = np.random.default_rng([seed, case // CASES_PER_LAYOUT, CASES_PER_LAYOUT])
    fields, step = _layout(layout_rng if rng.random() < 0.8 else rng)
    cloud = _cloud(_points(rng), fields, step, rng)
    cloud = replace(cloud, header=_header(case, rng))
    if rng.random() < 0.3:
        return CORRUPTIONS[rng.integers(len(CORRUPTIONS))](cloud, rng)
    return cloud


# --- points ----------------------------------------------------------------------------------


def _points(rng: np.random.Generator) -> Array:
    """(n, 3) float64: points of some shape at some place, some with invalid coordinates."""
    points = SHAPES[rng.integers(len(SHAPES))](rng)
    if rng.random() < 0.2:
        points = points + rng.choice([1e3, -1e5, 4.5e6, 9.99e7]) * rng.normal(size=3)
    if len(points) and rng.random() < 0.3:
        invalid = rng.integers(0, len(points), rng.integers(1, 2 + len(points) // 2))
        points[invalid, rng.integers(0, 3, len(invalid))] = rng.choice(ODD, len(invalid))
    return points


def _volume(rng: np.random.Generator) -> Array:
    return rng.uniform(-1.0, 1.0, (rng.integers(1, 400), 3)) * rng.choice([0.1, 3.0, 100.0])


def _flat(rng: np.random.Generator) -> Array:
    """Exactly coplanar or collinear points in any direction."""
    spans = rng.normal(size=(rng.integers(1, 3), 3))
    return rng.uniform(-2.0, 2.0, (rng.integers(1, 300), len(spans))) @ spans


def _grid(rng: np.random.Generator) -> Array:
    """A grid, with equal distances, along one to three axes."""
    sizes = rng.integers(1, 8, 3)
    return np.stack(np.meshgrid(*map(np.arange, sizes)), axis=-1).reshape(-1, 3) * 0.25


def _repeated(rng: np.random.Generator) -> Array:
    """Thousands of points at a few places."""
    places = rng.normal(size=(rng.integers(1, 6), 3))
    return places[rng.integers(0, len(places), rng.integers(1, 3000))]


def _minute(rng: np.random.Generator) -> Array:
    """Points so close that the squares of their distances underflow."""
    return rng.normal(size=(rng.integers(1, 100), 3)) * 10.0 ** rng.integers(-320, -3)


def _few(rng: np.random.Generator) -> Array:
    return rng.normal(size=(rng.integers(0, 4), 3))


def _sparse(rng: np.random.Generator) -> Array:
    return rng.uniform(-1e8, 1e8, (rng.integers(1, 200), 3))


SHAPES = (_volume, _volume, _flat, _grid, _repeated, _minute, _few, _sparse)


# --- layout ----------------------------------------------------------------------------------


def _layout(rng: np.random.Generator) -> tuple[list[Field], int]:
    """Fields in any order and at any offset, including x, y and z; and point_step."""
    columns = [(name, int(rng.choice([7, 7, 7, 8])), 1) for name in "xyz"]
    for name in rng.choice(FIELDS, rng.integers(0, 4), replace=False).tolist():
        columns.append((name, int(rng.integers(1, 9)), int(rng.choice([1, 1, 1, 3, 17]))))
    if rng.random() < 0.5:
        columns.append((str(rng.choice(TIMES)), int(rng.integers(1, 9)), 1))
    fields = []
    end = 0
    for name, kind, count in [columns[k] for k in rng.permutation(len(columns))]:
        end += int(rng.choice([0, 0, 0, 1, 4]))
        fields.append(Field(name, end, kind, count))
        end += fields[-1].size
    return fields, end + int(rng.choice([0, 0, 3, 16]))


def _cloud(points: Array, fields: list[Field], step: int, rng: np.random.Generator) -> Cloud:
    """The points in rows with padding; other fields hold random bytes or times."""
    height = int(rng.choice([1, 1, 2, 5]))
    width = len(points) // height
    row_step = width * step + int(rng.choice([0, 0, 1, 40]))
    bigendian = bool(rng.random() < 0.2)
    data = bytearray(rng.bytes(height * row_step))
    for field in fields:
        values = _values(field, points[: height * width], rng)
        if values is not None:
            kind = np.dtype(TYPES[field.datatype]).newbyteorder(">" if bigendian else "<")
            strides = (row_step, step)
            rows = (
                np.ndarray((height, width), kind, data, field.offset, strides) if width else None
            )
            with np.errstate(over="ignore", invalid="ignore"):
                if rows is not None:
                    rows[...] = values.reshape(height, width).astype(kind)
    return Cloud(
        _header(0, rng), height, width, fields, bigendian, step, row_step, bytes(data), True
    )


def _values(field: Field, points: Array, rng: np.random.Generator) -> Array | None:
    """Values of a field; None: random bytes."""
    if field.name in ("x", "y", "z"):
        return points[:, "xyz".index(field.name)]
    if field.name not in TIMES or rng.random() < 0.3:
        return None
    unit, start = [(1.0, 0.0), (1e9, 0.0), (1.0, START_NS / SECOND), (1e9, float(START_NS))][
        rng.integers(4)
    ]
    return start + unit * rng.uniform(-0.1, 12.0) * np.linspace(0.0, 1.0, len(points))


def _header(case: int, rng: np.random.Generator) -> Header:
    """Mostly the next stamp, in the same frame."""
    stamp = START_NS + case * STEP_NS
    if rng.random() < 0.05:
        stamp += int(rng.choice([-1, 1, -20, 20, 10**5, -(10**8)])) * STEP_NS
    sec, nanosec = divmod(stamp, SECOND)
    if rng.random() < 0.02:
        sec = int(rng.choice([0, -1, -(2**31), 2**31 - 1]))
        nanosec = int(rng.choice([0, SECOND - 1, SECOND, 2**32 - 1]))
    frame = str(rng.choice(FRAMES)) if rng.random() < 0.03 else "odom"
    return Header(Time(sec, nanosec), frame)


# --- corruptions -----------------------------------------------------------------------------

Corruption = Callable[[Cloud, np.random.Generator], Cloud]


def _size(name: str) -> Corruption:
    """A corruption of one size of the message."""

    def corrupt(cloud: Cloud, rng: np.random.Generator) -> Cloud:
        near = max(0, getattr(cloud, name) + int(rng.integers(-2, 3)))
        changes: dict[str, Any] = {name: int(rng.choice([*SIZES, near]))}
        return replace(cloud, **changes)

    return corrupt


def _sizes(cloud: Cloud, rng: np.random.Generator) -> Cloud:
    """Set sizes whose products exceed 64 bits."""
    height, width, point_step, row_step = (int(n) for n in rng.choice(SIZES, 4))
    return replace(cloud, height=height, width=width, point_step=point_step, row_step=row_step)


def _cut(cloud: Cloud, rng: np.random.Generator) -> Cloud:
    return replace(cloud, data=cloud.data[: rng.integers(0, len(cloud.data) + 1)])


def _field(cloud: Cloud, rng: np.random.Generator) -> Cloud:
    """Change a number or the name of one field."""
    fields = list(cloud.fields)
    k = int(rng.integers(len(fields)))
    names = [*FIELDS, "x", "y", "z", "t", "n" * 10_000, "two\nlines", "nul\0"]
    change: dict[str, Any] = [
        {"name": str(rng.choice(names))},
        {"offset": int(rng.choice(SIZES))},
        {"offset": max(0, fields[k].offset + int(rng.integers(-3, 4)))},
        {"datatype": int(rng.integers(0, 256))},
        {"datatype": int(rng.integers(1, 9))},
        {"count": int(rng.choice(SIZES))},
    ][rng.integers(6)]
    fields[k] = replace(fields[k], **change)
    return replace(cloud, fields=fields)


def _fewer(cloud: Cloud, rng: np.random.Generator) -> Cloud:
    return replace(cloud, fields=cloud.fields[: rng.integers(0, len(cloud.fields))])


def _many(cloud: Cloud, rng: np.random.Generator) -> Cloud:
    """Add thousands of fields at the offset of one."""
    kind, size = cloud.fields[0].datatype, int(rng.choice([30, 300, 3000]))
    more = [Field(f"f{k}", cloud.fields[0].offset, kind, 1) for k in range(size)]
    return replace(cloud, fields=[*cloud.fields, *more])


def _wide(cloud: Cloud, rng: np.random.Generator) -> Cloud:
    """Make one point of all bytes."""
    step = max(len(cloud.data), cloud.point_step)
    more = Field(f"wide{rng.integers(9)}", 0, 2, step)
    data = cloud.data.ljust(step, b"\0")
    fields = [*cloud.fields, more]
    return replace(
        cloud, fields=fields, height=1, width=1, point_step=step, row_step=step, data=data
    )


def _other_order(cloud: Cloud, rng: np.random.Generator) -> Cloud:
    return replace(cloud, is_bigendian=not cloud.is_bigendian, is_dense=bool(rng.random() < 0.5))


CORRUPTIONS: tuple[Corruption, ...] = (
    *(_size(name) for name in ("height", "width", "point_step", "row_step")),
    *(_sizes, _cut, _field, _field, _fewer, _many, _wide, _other_order),
)
