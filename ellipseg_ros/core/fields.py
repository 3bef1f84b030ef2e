"""Sweeps joined to one, and the layouts of their structured fields."""

from dataclasses import replace
from typing import Any, TypeAlias

import numpy as np

from ellipseg_ros.errors import InputError
from ellipseg_ros.records import Array, Sweep

Layout: TypeAlias = "np.dtype[Any] | None"  # of structured arrays

MAX_FIELDS_BYTES = 1024  # of the fields of a point: a cloud that claims more is corrupt


def join_sweeps(sweeps: list[Sweep]) -> Sweep:
    """Join sweeps in order: the newest stamp, the frame and restart reason of the first."""
    if len(sweeps) == 1:
        return sweeps[0]
    newest = max(sweep.stamp_ns for sweep in sweeps)
    return replace(
        sweeps[0],
        stamp_ns=newest,
        points=np.concatenate([s.points for s in sweeps]),
        offsets_ns=np.concatenate([s.times_ns for s in sweeps]) - newest,
        fields=join_fields([s.fields for s in sweeps], [len(s) for s in sweeps]),
        ranges=_join_ranges(sweeps),
        filtered=sum(s.filtered for s in sweeps),
        unplaced=sum(s.unplaced for s in sweeps),
    )


def _join_ranges(sweeps: list[Sweep]) -> Array | None:
    """Ranges of all points, NaN where a sweep has none; None if no sweep has any."""
    if all(sweep.ranges is None for sweep in sweeps):
        return None
    parts = [np.full(len(s), np.nan) if s.ranges is None else s.ranges for s in sweeps]
    return np.concatenate(parts)


def join_fields(parts: list[Array | None], lengths: list[int]) -> Array | None:
    """Concatenate structured arrays; a field that a part lacks is NaN there, or 0 if integer.

    Parts of one layout keep it (offsets and padding too); others get the union of all fields.
    lengths: rows of the parts, for those that are None. None if all parts are.
    """
    given = [part for part in parts if part is not None and len(part)]
    if not given:
        return next((part for part in parts if part is not None), None)
    layout = given[0].dtype
    if any(part.dtype != layout for part in given):
        layout = _union([part.dtype for part in given])
    joined = np.zeros(sum(lengths), layout)
    start = 0
    for part, length in zip(parts, lengths, strict=True):
        rows = joined[start : start + length]
        start += length
        if part is not None and part.dtype == layout:
            rows[...] = part
            continue
        for name in layout.names or ():
            if part is not None and name in (part.dtype.names or ()):
                with np.errstate(invalid="ignore"):  # a signalling NaN becomes a quiet one
                    rows[name] = part[name]
            elif np.issubdtype(layout[name].base, np.floating):
                rows[name] = np.nan
    return joined


def record_layout(fields: dict[str, tuple[np.dtype[Any], int]], itemsize: int) -> np.dtype[Any]:
    """Layout of a structured array from the type and offset of every field."""
    formats, offsets = [kind for kind, _ in fields.values()], [at for _, at in fields.values()]
    return np.dtype(
        {"names": list(fields), "formats": formats, "offsets": offsets, "itemsize": itemsize}
    )


def layout_of(fields: Array | None) -> Layout:
    """The layout of structured fields (n,); None where there are none."""
    return None if fields is None else fields.dtype


def clashing_field(one: Layout, other: Layout) -> str:
    """Name of a field whose counts differ between the layouts; empty if they can be joined."""
    if one is None or other is None or one == other:
        return ""
    for name in one.names or ():
        if name in (other.names or ()) and one[name].shape != other[name].shape:
            return name
    return ""


def too_wide(one: Layout, other: Layout) -> bool:
    """Whether layouts that differ have together more than MAX_FIELDS_BYTES.

    Every point of a window has the fields of all: one cloud must not make all others larger.
    """
    joined = joined_layout(one, other)
    return joined not in (None, one, other) and joined.itemsize > MAX_FIELDS_BYTES


def joined_layout(one: Layout, other: Layout) -> Layout:
    """The layout with the fields of both, which must not clash."""
    if one is None or other is None or one == other:
        return one if other is None else other
    return _union([one, other])


def _union(layouts: list[np.dtype[Any]]) -> np.dtype[Any]:
    found: dict[str, np.dtype[Any]] = {}
    for layout in layouts:
        for name in layout.names or ():
            other = layout[name]
            known = found.get(name, other)
            if known.shape != other.shape:
                raise InputError(f"field {name} has different counts; it must have one", "fields")
            found[name] = np.dtype((np.promote_types(known.base, other.base), other.shape))
    return np.dtype(list(found.items()))
