"""Odd LandmarkArrays through map and association, and odd SegmentArrays through the mirror."""

import warnings
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np

from ellipseg_ros.association.associate import associate
from ellipseg_ros.association.landmark_map import LandmarkMap
from ellipseg_ros.config import AssociationConfig, MapConfig
from ellipseg_ros.io.landmark_messages import read_landmarks
from ellipseg_ros.io.limits import read_stamp
from ellipseg_ros.io.segment_mirror import SegmentMirror
from ellipseg_ros.records import Array
from studies.endurance.conversion import Tally

ODD = (np.nan, np.inf, -np.inf, 5e-324, -1.0, 0.0, 1e-300, 1e9, 1e30, 1e300, -1e300)
NUMBERS = (0, 1, 2, 3, 2**31, 2**32 - 1)
CASES_PER_WORLD = 50  # messages to one map or mirror
VAST = 5e6  # factor by which some worlds are larger: nearly as far as is rejected


def associate_odd_landmarks(seed: int, cases: int) -> Tally:
    """Give odd landmarks to a map and to `associate`; `updates`: those that were associated."""

    def new_consumer() -> Callable[[int], bool]:
        stored = LandmarkMap(MapConfig(min_age=0.0, delay=0.0))
        return lambda case: _associate(stored, odd_landmarks(seed, case))

    return _run(cases, new_consumer)


def mirror_odd_segments(seed: int, cases: int) -> Tally:
    """Give odd lists of segments to a mirror; `updates`: those after which it was in sync."""

    def new_consumer() -> Callable[[int], bool]:
        mirror = SegmentMirror()
        return lambda case: _mirror(mirror, odd_segments(seed, case))

    return _run(cases, new_consumer)


def _run(cases: int, new_consumer: Callable[[], Callable[[int], bool]]) -> Tally:
    """Give each case to a consumer, which returns whether it counts as an update."""
    tally = Tally()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for case in range(cases):
            if case % CASES_PER_WORLD == 0:
                consume = new_consumer()
            with tally.case(str(case)):
                tally.updates += consume(case)
    return tally


def _associate(stored: LandmarkMap, message: Any) -> bool:
    live = read_landmarks(message)
    stamp_ns, frame_id = read_stamp(message.header.stamp), message.header.frame_id
    stored.update(live, stamp_ns, frame_id, message.sequence)
    result = associate(stored.recognizable().landmarks, live, AssociationConfig())
    for name in (
        "probability",
        "distance",
        "T_earlier_later",
        "covariance",
        "centre",
        "undetermined",
    ):
        if not np.isfinite(getattr(result, name)).all():
            raise FloatingPointError(f"{name} of the association is not finite")
    return True


def _mirror(mirror: SegmentMirror, message: Any) -> bool:
    if not mirror.update(message):
        return False
    if sum(segment.count for segment in mirror.segments.values()) != message.segmented:
        raise FloatingPointError("the mirror is in sync, but its counts differ from the message")
    return True


# --- messages --------------------------------------------------------------------------------


def odd_landmarks(seed: int, case: int) -> Any:
    """A LandmarkArray of mostly the same objects from case to case, some with invalid numbers.

    Some worlds are vast, and most of their landmarks have large covariances.
    """
    rng = np.random.default_rng([seed, case])
    world = np.random.default_rng([seed, case // CASES_PER_WORLD])
    vast = world.random() < 0.5
    rows = _world_landmarks(world, rng, case, vast)
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


def _world_landmarks(
    world: np.random.Generator, rng: np.random.Generator, case: int, vast: bool
) -> list[Any]:
    """The valid landmarks of a case; world: the same for all cases of a world."""
    size = int(world.integers(2, 6)) if vast else 20
    position = world.uniform(-20.0, 20.0, (size, 3)) * (VAST if vast else 1.0)
    position += rng.normal(0.0, 0.01, (size, 3))
    if case % 5 == 4:
        position += 100.0  # none of the earlier landmarks
    turns = world.normal(size=(size, 4))
    turns /= np.linalg.norm(turns, axis=1)[:, None]
    kinds = world.integers(0, 3, size)
    rows = [_landmark(k, kinds[k], position[k], turns[k], case) for k in range(size)]
    for row in rows if vast else ():
        row.covariance = _any_covariance(world)
    return rows


def _landmark(k: int, kind: int, position: Array, turn: Array, case: int) -> Any:
    covariance = np.zeros((6, 6))
    for motion in ((2, 3, 4), (1, 2, 4, 5), (0, 1, 2))[kind]:
        covariance[motion, motion] = 1e-4
    identity = 1000 * (case // 5) + k + 1  # changes from time to time: earlier landmarks expire
    return SimpleNamespace(
        id=identity,
        kind=int(kind),
        count=100 + k,
        position=_vector(position),
        orientation=SimpleNamespace(**dict(zip("xyzw", turn.tolist(), strict=True))),
        sigma=[1.0, 0.5, 0.01],
        box_min=_vector(np.full(3, -1.0)),
        box_max=_vector(np.full(3, 1.0)),
        covariance=covariance.ravel().tolist(),
        instability=0.1,
        first_seen=SimpleNamespace(sec=0, nanosec=0),
        segments=[1, 2],
    )


def _vector(values: Array) -> Any:
    return SimpleNamespace(**dict(zip("xyz", values.tolist(), strict=True)))


def _any_covariance(world: np.random.Generator) -> list[float]:
    """A covariance with variances of all orders of magnitude that are accepted."""
    turn = np.linalg.qr(world.normal(size=(6, 6)))[0] if world.random() < 0.3 else np.eye(6)
    variances = world.choice([0.0, 1e-300, 1e-20, 1e-6, 1.0, 1e10, 1e12], 6)
    covariance = turn * variances @ turn.T
    return np.ravel(0.5 * (covariance + covariance.T)).tolist()


def _spoil(row: Any, rng: np.random.Generator) -> None:
    """Make one number or all numbers of a landmark invalid."""
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
        row.instability = float(rng.choice(ODD))


def odd_segments(seed: int, case: int) -> Any:
    """A SegmentArray with any ids, counts and sequence number, full or incremental."""
    rng = np.random.default_rng([seed, case])
    ids = rng.integers(0, 9, rng.integers(0, 9))
    counts = (
        rng.integers(0, 3, len(ids)).tolist() if rng.random() < 0.8 else [2**32 - 1] * len(ids)
    )
    rows = [
        SimpleNamespace(id=int(i), count=n, state=int(rng.integers(0, 256)), parents=[1, 2])
        for i, n in zip(ids, counts, strict=True)
    ]
    objects = [SimpleNamespace(id=int(i), state=0, parents=[]) for i in ids[:3]]
    return SimpleNamespace(
        sequence=int(case if rng.random() < 0.9 else rng.choice(NUMBERS)),
        full=bool(rng.random() < 0.4),
        segments=rows,
        objects=objects,
        removed=rng.integers(0, 9, rng.integers(0, 3)).tolist(),
        removed_objects=[],
        segmented=sum({row.id: row.count for row in rows}.values()),
    )
