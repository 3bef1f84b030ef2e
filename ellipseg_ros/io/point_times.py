"""Times of single points, from the fields of lidar drivers."""

import numpy as np

from ellipseg_ros.records import SECOND, Array

MAX_OFFSET_NS = 10 * SECOND  # from the stamp; larger values are no times, or of another clock
INVALID_NS = -4 * 10**18  # for NaN and values beyond int64

OFFSET = "offset_time"  # ns from the stamp, of any type: Livox, and what this package writes
NAMES = (OFFSET, "t", "time", "timestamp", "time_stamp", "time_offset")


def time_offsets(fields: Array, stamp_ns: int) -> Array:
    """Nanoseconds from the stamp to every point: (n,) structured -> (n,) int64.

    The first field with one of the NAMES is used. Its type decides its meaning, as in drivers:

    - integers of 32 or 64 bits: ns from the stamp (Ouster `t`, Livox `offset_time`, Autoware
      `time_stamp`), or else the time itself in ns;
    - float32: s from the stamp (Velodyne `time`);
    - float64: the time itself in s (Hesai, RoboSense `timestamp`) or in ns (Livox `timestamp`), or
      else s from the stamp.

    The first meaning with at least half of the points within 10 s of the stamp is used. Points
    with other times or NaN get the time of the stamp, offset 0, and so do all points if no meaning
    fits or there is no such field. No cloud is refused because of its times.
    """
    kinds = {name: fields.dtype[name] for name in fields.dtype.names or ()}
    times = {name for name, kind in kinds.items() if kind.kind in "iuf" and kind.itemsize >= 4}
    name = next((name for name in NAMES if name in times), "")
    if name:
        for offsets in _meanings(fields[name], stamp_ns, relative=name == OFFSET):
            near = (-MAX_OFFSET_NS <= offsets) & (offsets <= MAX_OFFSET_NS)  # |-2^63| is -2^63
            if 2 * np.count_nonzero(near) >= len(offsets):
                return np.where(near, offsets, 0)
    return np.zeros(len(fields), np.int64)


def _meanings(values: Array, stamp_ns: int, relative: bool) -> list[Array]:
    """Possible meanings of the values, most likely first: (n,) int64 each, ns from the stamp."""
    if values.dtype.kind in "iu":
        ns = values.astype(np.int64)
        return [ns, ns - stamp_ns]
    if relative:
        return [_nanoseconds(values, 1.0)]
    from_s = _nanoseconds(values, SECOND)
    if values.dtype.itemsize == 4:
        return [from_s]
    return [from_s - stamp_ns, _nanoseconds(values, 1.0) - stamp_ns, from_s]


def _nanoseconds(values: Array, unit: float) -> Array:
    with np.errstate(over="ignore", invalid="ignore"):
        ns = np.rint(values.astype(np.float64) * unit)
    return np.where(np.abs(ns) < -INVALID_NS, ns, INVALID_NS).astype(np.int64)
