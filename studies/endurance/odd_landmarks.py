"""Odd LandmarkArrays for what the associator consists of, and odd SegmentArrays for the mirror."""

import traceback
import warnings
from collections.abc import Callable
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np

from ellipseg_ros.association.associate import associate
from ellipseg_ros.association.landmark_map import LandmarkMap
from ellipseg_ros.config import AssociationConfig, MapConfig
from ellipseg_ros.errors import InputError
from ellipseg_ros.io.landmark_messages import read_landmarks
from ellipseg_ros.io.limits import read_stamp
from ellipseg_ros.io.segment_mirror import SegmentMirror
from ellipseg_ros.records import Array
from studies.endurance.conversion import LONGEST, Tally

ODD = (np.nan, np.inf, -np.inf, 5e-324, -1.0, 0.0, 1e-300, 1e9, 1e30, 1e300, -1e300)
NUMBERS = (0, 1, 2, 3, 2**31, 2**32 - 1)
FRESH = 50  # messages of one map, or of one mirror
VAST = 5e6  # by which some worlds are larger: nearly as far as is refused


def recognize(seed: int, cases: int) -> Tally:
    """Give odd landmarks to the map and to `associate`; `updates`: those that gave a verdict."""
    tally = Tally()
    stored = LandmarkMap(MapConfig())
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for case in range(cases):
            if case % FRESH == 0:
                stored = LandmarkMap(MapConfig(min_age=0.0, delay=0.0))
            _try(tally, case, partial(_recognize, stored, odd_landmarks(seed, case), tally))
    return tally


def reflect(seed: int, cases: int) -> Tally:
    """Give odd lists of segments to a mirror; `updates`: those after which it was in step."""
    tally = Tally()
    mirror = SegmentMirror()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for case in range(cases):
            if case % FRESH == 0:
                mirror = SegmentMirror()
            _try(tally, case, partial(_reflect, mirror, odd_segments(seed, case), tally))
    return tally


def _try(tally: Tally, case: int, do: Callable[[], None]) -> None:
    tally.cases += 1
    try:
        do()
    except InputError as error:
        tally.rejected[error.reason] += 1
        if len(str(error)) > LONGEST or not str(error).isprintable():
            tally.faults.append(f"case {case}: a reason that is no short line: {error}")
    except Exception:
        tally.faults.append(f"case {case}: {traceback.format_exc()}")


def _recognize(stored: LandmarkMap, message: Any, tally: Tally) -> None:
    live = read_landmarks(message)
    stamp_ns, frame_id = read_stamp(message.header.stamp), message.header.frame_id
    stored.update(live, stamp_ns, frame_id, message.sequence)
    found = associate(stored.recognizable().landmarks, live, AssociationConfig())
    tally.updates += 1
    for name in (
        "probability",
        "distance",
        "T_earlier_later",
        "covariance",
        "centre",
        "undetermined",
    ):
        if not np.isfinite(getattr(found, name)).all():
            raise FloatingPointError(f"{name} of the association is not finite")


def _reflect(mirror: SegmentMirror, message: Any, tally: Tally) -> None:
    if mirror.update(message):
        tally.updates += 1
        if sum(one.count for one in mirror.segments.values()) != message.segmented:
            raise FloatingPointError("the copy is said to be in step, and counts other points")


# --- messages --------------------------------------------------------------------------------


def odd_landmarks(seed: int, case: int) -> Any:
    """A LandmarkArray: mostly of things in a world that stays, some with nonsense in them.

    Some worlds are vast, and hardly anything is known of most that is in them.
    """
    rng = np.random.default_rng([seed, case])
    world = np.random.default_rng([seed, case // FRESH])
    vast = world.random() < 0.5
    size = int(world.integers(2, 6)) if vast else 20
    position = world.uniform(-20.0, 20.0, (size, 3)) * (VAST if vast else 1.0)
    position += rng.normal(0.0, 0.01, (size, 3))
    if case % 5 == 4:
        position += 100.0  # all of before has gone
    turns = world.normal(size=(size, 4))
    turns /= np.linalg.norm(turns, axis=1)[:, None]
    kinds = world.integers(0, 3, size)
    rows = [_landmark(k, kinds[k], position[k], turns[k], case) for k in range(size)]
    for row in rows if vast else ():
        row.covariance = _any_covariance(world)
    for row in rows if rng.random() < 0.5 else ():
        if rng.random() < 0.1:
            _spoil(row, rng)
    if rng.random() < 0.1:
        rows += rows[:2]
    if rng.random() < 0.1:
        rows = rows[: rng.integers(0, 3)]
    stamp = SimpleNamespace(sec=int(case if rng.random() < 0.9 else rng.integers(0, 2**31)))
    stamp.nanosec = 0
    frame = "odom" if rng.random() < 0.95 else "map"
    return SimpleNamespace(
        header=SimpleNamespace(stamp=stamp, frame_id=frame),
        sequence=int(case if rng.random() < 0.95 else rng.integers(0, 2**32)),
        landmarks=rows,
        removed=[],
    )


def _landmark(k: int, kind: int, position: Array, turn: Array, case: int) -> Any:
    covariance = np.zeros((6, 6))
    for motion in ((2, 3, 4), (1, 2, 4, 5), (0, 1, 2))[kind]:
        covariance[motion, motion] = 1e-4
    identity = 1000 * (case // 5) + k + 1  # others from time to time: those of before expire
    return SimpleNamespace(
        id=identity,
        kind=int(kind),
        count=100 + k,
        position=_vector(position),
        orientation=SimpleNamespace(**dict(zip("xyzw", turn.tolist(), strict=True))),
        sigma=[1.0, 0.5, 0.01],
        low=_vector(np.full(3, -1.0)),
        high=_vector(np.full(3, 1.0)),
        covariance=covariance.ravel().tolist(),
        stability=0.1,
        first_seen=SimpleNamespace(sec=0, nanosec=0),
        segments=[1, 2],
    )


def _vector(values: Array) -> Any:
    return SimpleNamespace(**dict(zip("xyz", values.tolist(), strict=True)))


def _any_covariance(world: np.random.Generator) -> list[float]:
    """Of all orders of magnitude that are let in."""
    turn = np.linalg.qr(world.normal(size=(6, 6)))[0] if world.random() < 0.3 else np.eye(6)
    variances = world.choice([0.0, 1e-300, 1e-20, 1e-6, 1.0, 1e10, 1e12], 6)
    covariance = turn * variances @ turn.T
    return np.ravel(0.5 * (covariance + covariance.T)).tolist()


def _spoil(row: Any, rng: np.random.Generator) -> None:
    """Put nonsense into one number, or all numbers, of a landmark."""
    value = float(rng.choice(ODD))
    which = rng.integers(9)
    if which < 3:
        name, size = (("id", 2**32), ("kind", 2**8), ("count", 2**32))[which]
        setattr(row, name, int(rng.choice(NUMBERS)) % size)
    elif which < 6:
        setattr((row.position, row.box_min, row.box_max)[which - 3], "xyz"[rng.integers(3)], value)
    elif which == 6:
        row.covariance = list(row.covariance)
        row.covariance[rng.integers(36)] = value
    elif which == 7:
        row.sigma = [value, *row.sigma[1:]][: rng.integers(2, 5)]
    else:
        row.orientation.w = value
        row.stability = float(rng.choice(ODD))


def odd_segments(seed: int, case: int) -> Any:
    """A SegmentArray: ids, counts and sequence numbers of all sorts, full ones and changes."""
    rng = np.random.default_rng([seed, case])
    ids = rng.integers(0, 9, rng.integers(0, 9))
    counts = (
        rng.integers(0, 3, len(ids)).tolist() if rng.random() < 0.8 else [2**32 - 1] * len(ids)
    )
    rows = [
        SimpleNamespace(id=int(i), count=n, state=int(rng.integers(0, 256)), parents=[1, 2])
        for i, n in zip(ids, counts, strict=True)
    ]
    things = [SimpleNamespace(id=int(i), state=0, parents=[]) for i in ids[:3]]
    return SimpleNamespace(
        sequence=int(case if rng.random() < 0.9 else rng.choice(NUMBERS)),
        full=bool(rng.random() < 0.4),
        segments=rows,
        objects=things,
        removed=rng.integers(0, 9, rng.integers(0, 3)).tolist(),
        removed_objects=[],
        segmented=sum({one.id: one.count for one in rows}.values()),
    )
