"""Odd PointCloud2 messages, as plain objects and as bytes: what sensors and strangers may send.

A cloud is made whole: points of some shape, spoiled numbers among them, fields of any name, type
and place. Most are left so; of the others, a number in the message is made a lie.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ellipseg_ros.io.cdr import Cdr
from ellipseg_ros.io.point_times import NAMES as TIMES
from ellipseg_ros.io.pointcloud2 import TYPES
from ellipseg_ros.records import SECOND, Array

BLOCK = 20  # cases of which most have the same fields, as those of one sensor would
START = 1_700_000_000 * SECOND  # ns
STEP = SECOND // 10  # ns, between two clouds
HUGE = (0, 1, 2**15, 2**16 - 1, 2**20 + 1, 2**31 - 1, 2**31, 2**32 - 1)  # uint32
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


@dataclass(frozen=True)
class Time:
    """builtin_interfaces/Time."""

    sec: int
    nanosec: int


@dataclass(frozen=True)
class Header:
    """std_msgs/Header."""

    stamp: Time
    frame_id: str


@dataclass(frozen=True)
class Field:
    """sensor_msgs/PointField."""

    name: str
    offset: int
    datatype: int
    count: int

    @property
    def size(self) -> int:
        """Bytes."""
        return self.count * np.dtype(TYPES[self.datatype]).itemsize


@dataclass(frozen=True)
class Cloud:
    """sensor_msgs/PointCloud2."""

    header: Header
    height: int
    width: int
    fields: list[Field]
    is_bigendian: bool
    point_step: int
    row_step: int
    data: bytes
    is_dense: bool


def odd_cloud(seed: int, case: int) -> Cloud:
    """The cloud of a case: the same for the same numbers, whatever came before."""
    rng = np.random.default_rng([seed, case])
    of_block = np.random.default_rng([seed, case // BLOCK, BLOCK])
    fields, step = _layout(of_block if rng.random() < 0.8 else rng)
    whole = _cloud(_points(rng), fields, step, rng)
    whole = replace(whole, header=_header(case, rng))
    if rng.random() < 0.3:
        return LIES[rng.integers(len(LIES))](whole, rng)
    return whole


def large_cloud(points: int, seed: int = 0) -> Cloud:
    """A wall of so many points, 300 a square metre, with an intensity; later than all others."""
    rng = np.random.default_rng([seed, points])
    fields = [Field(name, 4 * k, 7, 1) for k, name in enumerate(("x", "y", "z", "intensity"))]
    values = rng.random((points, 4), dtype=np.float32)
    values[:, :2] *= np.float32(np.sqrt(points / 300.0))
    values[:, 2] *= 0.02
    header = Header(Time(START // SECOND + 10**7, 0), "odom")
    data = values.tobytes()
    return Cloud(header, 1, points, fields, False, 16, 16 * points, data, True)


def serialized(cloud: Cloud) -> bytes:
    """The message as DDS carries it, lies and all."""
    out = Cdr()
    out.put("iI", cloud.header.stamp.sec, cloud.header.stamp.nanosec)
    out.text(cloud.header.frame_id)
    out.put("II", cloud.height, cloud.width)
    out.put("I", len(cloud.fields))
    for field in cloud.fields:
        out.text(field.name)
        out.put("IBI", field.offset, field.datatype, field.count)
    out.put("?II", cloud.is_bigendian, cloud.point_step, cloud.row_step)
    out.put("I", len(cloud.data))
    out.bulk(cloud.data)
    out.put("?", cloud.is_dense)
    return out.bytes()


# --- points ----------------------------------------------------------------------------------


def _points(rng: np.random.Generator) -> Array:
    """(n, 3) float64: of some shape, moved somewhere, some of them spoiled."""
    points = SHAPES[rng.integers(len(SHAPES))](rng)
    if rng.random() < 0.2:
        points = points + rng.choice([1e3, -1e5, 4.5e6, 9.99e7]) * rng.normal(size=3)
    if len(points) and rng.random() < 0.3:
        spoiled = rng.integers(0, len(points), rng.integers(1, 2 + len(points) // 2))
        points[spoiled, rng.integers(0, 3, len(spoiled))] = rng.choice(ODD, len(spoiled))
    return points


def _volume(rng: np.random.Generator) -> Array:
    return rng.uniform(-1.0, 1.0, (rng.integers(1, 400), 3)) * rng.choice([0.1, 3.0, 100.0])


def _flat(rng: np.random.Generator) -> Array:
    """Exactly coplanar or collinear, in any direction."""
    spans = rng.normal(size=(rng.integers(1, 3), 3))
    return rng.uniform(-2.0, 2.0, (rng.integers(1, 300), len(spans))) @ spans


def _grid(rng: np.random.Generator) -> Array:
    """Distances that are all alike, on one to three axes."""
    sizes = rng.integers(1, 8, 3)
    return np.stack(np.meshgrid(*map(np.arange, sizes)), axis=-1).reshape(-1, 3) * 0.25


def _repeated(rng: np.random.Generator) -> Array:
    """A few places, thousands of points."""
    places = rng.normal(size=(rng.integers(1, 6), 3))
    return places[rng.integers(0, len(places), rng.integers(1, 3000))]


def _minute(rng: np.random.Generator) -> Array:
    """All within less than any number squared can tell."""
    return rng.normal(size=(rng.integers(1, 100), 3)) * 10.0 ** rng.integers(-320, -3)


def _few(rng: np.random.Generator) -> Array:
    return rng.normal(size=(rng.integers(0, 4), 3))


def _sparse(rng: np.random.Generator) -> Array:
    return rng.uniform(-1e8, 1e8, (rng.integers(1, 200), 3))


SHAPES = (_volume, _volume, _flat, _grid, _repeated, _minute, _few, _sparse)


# --- layout ----------------------------------------------------------------------------------


def _layout(rng: np.random.Generator) -> tuple[list[Field], int]:
    """Fields in any order and place, x, y and z among them; and point_step."""
    wanted = [(name, int(rng.choice([7, 7, 7, 8])), 1) for name in "xyz"]
    for name in rng.choice(FIELDS, rng.integers(0, 4), replace=False).tolist():
        wanted.append((name, int(rng.integers(1, 9)), int(rng.choice([1, 1, 1, 3, 17]))))
    if rng.random() < 0.5:
        wanted.append((str(rng.choice(TIMES)), int(rng.integers(1, 9)), 1))
    fields = []
    end = 0
    for name, kind, count in [wanted[k] for k in rng.permutation(len(wanted))]:
        end += int(rng.choice([0, 0, 0, 1, 4]))
        fields.append(Field(name, end, kind, count))
        end += fields[-1].size
    return fields, end + int(rng.choice([0, 0, 3, 16]))


def _cloud(points: Array, fields: list[Field], step: int, rng: np.random.Generator) -> Cloud:
    """The points in rows with padding; other fields have random bytes, or times."""
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
    """What a field holds; None: whatever is there."""
    if field.name in ("x", "y", "z"):
        return points[:, "xyz".index(field.name)]
    if field.name not in TIMES or rng.random() < 0.3:
        return None
    unit, start = [(1.0, 0.0), (1e9, 0.0), (1.0, START / SECOND), (1e9, float(START))][
        rng.integers(4)
    ]
    return start + unit * rng.uniform(-0.1, 12.0) * np.linspace(0.0, 1.0, len(points))


def _header(case: int, rng: np.random.Generator) -> Header:
    """Mostly the next stamp of one frame."""
    stamp = START + case * STEP
    if rng.random() < 0.05:
        stamp += int(rng.choice([-1, 1, -20, 20, 10**5, -(10**8)])) * STEP
    sec, nanosec = divmod(stamp, SECOND)
    if rng.random() < 0.02:
        sec = int(rng.choice([0, -1, -(2**31), 2**31 - 1]))
        nanosec = int(rng.choice([0, SECOND - 1, SECOND, 2**32 - 1]))
    frame = str(rng.choice(FRAMES)) if rng.random() < 0.03 else "odom"
    return Header(Time(sec, nanosec), frame)


# --- lies ------------------------------------------------------------------------------------

Lie = Callable[[Cloud, np.random.Generator], Cloud]


def _size(name: str) -> Lie:
    """Another number where the message has a size."""

    def lie(cloud: Cloud, rng: np.random.Generator) -> Cloud:
        near = max(0, getattr(cloud, name) + int(rng.integers(-2, 3)))
        changes: dict[str, Any] = {name: int(rng.choice([*HUGE, near]))}
        return replace(cloud, **changes)

    return lie


def _sizes(cloud: Cloud, rng: np.random.Generator) -> Cloud:
    """Sizes whose products don't fit into 64 bits."""
    height, width, point_step, row_step = (int(n) for n in rng.choice(HUGE, 4))
    return replace(cloud, height=height, width=width, point_step=point_step, row_step=row_step)


def _cut(cloud: Cloud, rng: np.random.Generator) -> Cloud:
    return replace(cloud, data=cloud.data[: rng.integers(0, len(cloud.data) + 1)])


def _field(cloud: Cloud, rng: np.random.Generator) -> Cloud:
    """Another number, or another name, in one of the fields."""
    fields = list(cloud.fields)
    k = int(rng.integers(len(fields)))
    names = [*FIELDS, "x", "y", "z", "t", "n" * 10_000, "two\nlines", "nul\0"]
    change: dict[str, Any] = [
        {"name": str(rng.choice(names))},
        {"offset": int(rng.choice(HUGE))},
        {"offset": max(0, fields[k].offset + int(rng.integers(-3, 4)))},
        {"datatype": int(rng.integers(0, 256))},
        {"datatype": int(rng.integers(1, 9))},
        {"count": int(rng.choice(HUGE))},
    ][rng.integers(6)]
    fields[k] = replace(fields[k], **change)
    return replace(cloud, fields=fields)


def _fewer(cloud: Cloud, rng: np.random.Generator) -> Cloud:
    return replace(cloud, fields=cloud.fields[: rng.integers(0, len(cloud.fields))])


def _many(cloud: Cloud, rng: np.random.Generator) -> Cloud:
    """Thousands of fields in the bytes of one."""
    kind, size = cloud.fields[0].datatype, int(rng.choice([30, 300, 3000]))
    more = [Field(f"f{k}", cloud.fields[0].offset, kind, 1) for k in range(size)]
    return replace(cloud, fields=[*cloud.fields, *more])


def _wide(cloud: Cloud, rng: np.random.Generator) -> Cloud:
    """One point of as many bytes as there are."""
    step = max(len(cloud.data), cloud.point_step)
    more = Field(f"wide{rng.integers(9)}", 0, 2, step)
    data = cloud.data.ljust(step, b"\0")
    fields = [*cloud.fields, more]
    return replace(
        cloud, fields=fields, height=1, width=1, point_step=step, row_step=step, data=data
    )


def _other_order(cloud: Cloud, rng: np.random.Generator) -> Cloud:
    return replace(cloud, is_bigendian=not cloud.is_bigendian, is_dense=bool(rng.random() < 0.5))


LIES: tuple[Lie, ...] = (
    *(_size(name) for name in ("height", "width", "point_step", "row_step")),
    *(_sizes, _cut, _field, _field, _fewer, _many, _wide, _other_order),
)
