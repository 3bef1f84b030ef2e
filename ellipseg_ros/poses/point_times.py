"""Times of single points, from the fields of lidar drivers."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from ellipseg_ros.errors import InputError
from ellipseg_ros.records import SECOND, Array

MAX_OFFSET_NS = 10 * SECOND  # from the stamp; larger values are no times, or of another clock
MAX_DISTANCE_NS = SECOND  # of the nearest point of a cloud from its stamp
MIN_VALID = 0.9  # share of the given times that must be within MAX_OFFSET_NS
MAX_RATE = 2e7  # points/s: no lidar measures more, so shorter spans are of another unit
# A cloud with at least so many points in less time, whose times so often go back, is a sweep with
# times of packets (1.3 ms with a VLP-16); a sweep stored ring by ring lasts longer.
MIN_SWEEP_POINTS, MIN_SWEEP_NS, MIN_RESTARTS = 2000, 5_000_000, 10
INVALID_NS = -4 * 10**18  # for NaN and values beyond int64

OFFSET = "offset_time"  # ns from the stamp, of any type: Livox, and what this package writes
NAMES = (OFFSET, "t", "time", "timestamp", "time_stamp", "timestamps", "time_offset")
UNITS = {"s": SECOND, "ms": 10**6, "us": 1000, "ns": 1}  # ns
FROM_STAMP, ABSOLUTE, FROM_FIRST = "from the stamp", "absolute", "from the first point"


class PointTimes(NamedTuple):
    """Times of the points of a cloud, and how they were read."""

    offsets_ns: Array  # (n,) int64, ns from the stamp; 0 where not valid
    valid: Array  # (n,) bool
    meaning: str  # such as "t [ns] from the stamp"; empty: the cloud has no times


class TimeField(NamedTuple):
    """Which field holds the times, and its unit; empty: decided by names, types and values."""

    name: str = ""
    unit: str = ""


AUTOMATIC = TimeField()


def time_offsets(fields: Array, stamp_ns: int, chosen: TimeField = AUTOMATIC) -> Array:
    """Nanoseconds from the stamp to every point: (n,) structured -> (n,) int64.

    Points without a valid time, and all of a cloud without readable times, get 0: for registered
    clouds, where a time decides only when a point expires.
    """
    try:
        return point_times(fields, stamp_ns, chosen).offsets_ns
    except InputError:
        return np.zeros(len(fields), np.int64)


def point_times(fields: Array, stamp_ns: int, chosen: TimeField = AUTOMATIC) -> PointTimes:
    """Read the times of points: (n,) structured.

    The first field with one of the NAMES is used. Its type and values decide its meaning:

    - integers: ns from the stamp (Ouster `t`, Livox `offset_time`), or else the time itself;
    - float32: s from the stamp (Velodyne `time`);
    - float64: the time itself in s (Hesai, RoboSense `timestamp`) or ns (Livox `timestamp`), or
      else s from the stamp;
    - or any of these in another unit; or else the time of another clock, from its first point.

    The first meaning is used in which at least 90 % of the given times (neither NaN nor 0) are
    within 10 s of the stamp, one of them within 1 s, and the rate is below MAX_RATE. Raises
    InputError if there is none, or no field of a given name.
    """
    name = chosen.name or _find(fields)
    if not name:
        return no_times(len(fields))
    if name not in _numeric(fields):
        listed = ", ".join(_numeric(fields)) or "none"
        problem = f"the cloud has no time field {name!r}"
        raise InputError(f"{problem}; its fields of one number are {listed}", "point_times")
    values = fields[name]
    given = _given(values)
    for unit, reference, offsets in _meanings(values, stamp_ns, name == OFFSET, chosen.unit):
        valid = (-MAX_OFFSET_NS <= offsets) & (offsets <= MAX_OFFSET_NS)  # |-2^63| is -2^63
        used = valid & given
        enough = np.count_nonzero(used) >= MIN_VALID * np.count_nonzero(given)
        near = _is_near(offsets[used]) or name == OFFSET or reference == FROM_FIRST
        plausible = _is_plausible(offsets[used], values[used])
        if enough and near and plausible and (valid.any() or not len(values)):
            _check_restarts(name, offsets[used])
            return PointTimes(np.where(valid, offsets, 0), valid, f"{name} [{unit}] {reference}")
    numbers = values[np.isfinite(values)]
    seen = f"{numbers.min():g} to {numbers.max():g}" if len(numbers) else "not finite"
    problem = f"the times {name!r} of a cloud are {seen}"
    advice = "they must be within 10 s of each other (time_field, time_unit)"
    raise InputError(f"{problem}; {advice}", "point_times")


def no_times(count: int) -> PointTimes:
    """Those of a cloud of so many points without times."""
    return PointTimes(np.zeros(count, np.int64), np.ones(count, bool), "")


def _check_restarts(name: str, offsets: Array) -> None:
    """Refuse times that begin anew with every packet; offsets (n,) int64, ns, in storage order."""
    span = int(np.ptp(offsets)) if len(offsets) else 0
    restarts = int(np.count_nonzero(np.diff(offsets) < 0))
    if len(offsets) >= MIN_SWEEP_POINTS and span < MIN_SWEEP_NS and restarts >= MIN_RESTARTS:
        problem = f"the times {name!r} restart {restarts} times within {span / 1e6:.2f} ms"
        advice = "they must be those of a sweep, not of packets (time_field, or deskew off)"
        raise InputError(f"{problem}; {advice}", "point_times")


def _numeric(fields: Array) -> list[str]:
    """The fields that hold one number for each point."""
    names = fields.dtype.names or ()
    return [name for name in names if fields.dtype[name].kind in "iuf"]


def _find(fields: Array) -> str:
    times = {name for name in _numeric(fields) if fields.dtype[name].itemsize >= 4}
    return next((name for name in NAMES if name in times), "")


def _given(values: Array) -> Array:
    """(n,) bool: not NaN, and not 0, which many drivers write where there is no return."""
    return np.isfinite(values) & (values != 0)


def _is_near(offsets: Array) -> bool:
    """Whether the times begin, end or lie at the stamp; those of another clock hardly do."""
    return not len(offsets) or int(np.abs(offsets).min()) <= MAX_DISTANCE_NS


def _is_plausible(offsets: Array, values: Array) -> bool:
    """Whether the rate of points is one that a lidar can have; equal times are.

    offsets (n,) int64, ns, of values (n,): different values must not be rounded to one.
    """
    span = int(np.ptp(offsets)) if len(offsets) else 0
    if span == 0:
        return not len(values) or bool(values.min() == values.max())
    return len(offsets) * SECOND <= MAX_RATE * span


def _meanings(
    values: Array, stamp_ns: int, is_offset: bool, unit: str
) -> Iterator[tuple[str, str, Array]]:
    """Unit, reference and offsets (n,) int64, ns from the stamp, of meanings, likeliest first."""
    integer = values.dtype.kind in "iu"
    precise = integer or values.dtype.itemsize == 8
    units = ["ns", "us", "ms"] if integer or is_offset else list(UNITS)
    if _has_overflowed(values):
        units = []
        yield unit or "ns", FROM_FIRST, _from_first(values, UNITS[unit or "ns"])
    if unit:
        units = [unit]
    elif precise and not integer and not is_offset:  # float64: absolute times come first
        for name in ("s", "ns", "us"):
            yield name, ABSOLUTE, _nanoseconds(values, UNITS[name]) - stamp_ns
    for name in units:
        yield name, FROM_STAMP, _nanoseconds(values, UNITS[name])
        if precise:
            yield name, ABSOLUTE, _nanoseconds(values, UNITS[name]) - stamp_ns
    if precise and not is_offset:
        for name in units:
            yield name, FROM_FIRST, _from_first(values, UNITS[name])


def _has_overflowed(values: Array) -> bool:
    """Whether the times are a counter of 32 bits that passed its end within the cloud."""
    if values.dtype.kind not in "iu" or values.dtype.itemsize != 4 or not len(values):
        return False
    return int(np.ptp(_from_first(values, 1))) < int(values.max()) - int(values.min())


def _from_first(values: Array, unit: int) -> Array:
    """Offsets of another clock from its earliest time; counters of 32 bits may overflow."""
    if values.dtype.kind in "iu" and values.dtype.itemsize == 4 and len(values):
        steps = (values.astype(np.int64) - int(values[0]) + 2**31) % 2**32 - 2**31
        return (steps - steps.min()) * unit
    ns = _nanoseconds(values, unit)
    known = ns[(ns > INVALID_NS) & _given(values)]
    return np.where(ns > INVALID_NS, ns - (known.min() if len(known) else 0), INVALID_NS)


def _nanoseconds(values: Array, unit: int) -> Array:
    if values.dtype.kind in "iu":
        whole = values.astype(np.int64)
        return whole if unit == 1 else whole * unit
    with np.errstate(over="ignore", invalid="ignore"):
        ns = np.rint(values.astype(np.float64) * unit)
    return np.where(np.abs(ns) < -INVALID_NS, ns, INVALID_NS).astype(np.int64)
