"""Landmarks that have left the window, kept to be recognized later."""

from dataclasses import dataclass, replace

import numpy as np

from ellipseg_ros.config import MapConfig
from ellipseg_ros.errors import InputError
from ellipseg_ros.records import SECOND, Array, Kind, Landmarks

LARGEST = 1e8  # m: as with points, a coordinate beyond is no measurement
WIDEST = 1e12  # m^2, rad^2: nor is what is uncertain by more than 1000 km
ROUNDING = 1e-6  # of a covariance, by its largest value
ROW_SHAPES = {  # of the arrays of Landmarks: of one row, and type
    "ids": ((), np.uint32),
    "kind": ((), np.uint8),
    "count": ((), np.int64),
    "position": ((3,), np.float64),
    "axes": ((3, 3), np.float64),
    "sigma": ((3,), np.float64),
    "box_min": ((3,), np.float64),
    "box_max": ((3,), np.float64),
    "covariance": ((6, 6), np.float64),
    "stability": ((), np.float64),
    "first_seen_ns": ((), np.int64),
}


@dataclass(frozen=True)
class Stored:
    """What a map holds; row i of every array is one landmark, ascending by id."""

    landmarks: Landmarks  # with ids of the map
    last_seen_ns: Array  # (l,) int64: end of the last window in which it was a landmark
    frame_id: str  # empty: not known yet
    next_id: int  # from 1, never used twice

    def __post_init__(self) -> None:
        check(self.landmarks)
        ids = self.landmarks.ids.astype(np.int64)
        if len(self.last_seen_ns) != len(ids):
            raise InputError(f"{len(self.last_seen_ns)} times for {len(ids)} landmarks", "map")
        if (np.diff(ids) <= 0).any() or (ids < 1).any() or (ids >= self.next_id).any():
            raise InputError("ids of a map must ascend from 1 and be below its next id", "map")

    def __len__(self) -> int:
        return len(self.landmarks)


def no_landmarks() -> Landmarks:
    """A set of none."""
    return Landmarks(
        **{name: np.zeros((0, *row), kind) for name, (row, kind) in ROW_SHAPES.items()}
    )


def take(landmarks: Landmarks, rows: Array) -> Landmarks:
    """Some rows of a set."""
    return Landmarks(**{name: getattr(landmarks, name)[rows] for name in ROW_SHAPES})


def join(one: Landmarks, other: Landmarks) -> Landmarks:
    """The rows of both, those of the one first."""
    return Landmarks(
        **{name: np.concatenate([getattr(one, name), getattr(other, name)]) for name in ROW_SHAPES}
    )


def check(landmarks: Landmarks) -> None:
    """Refuse what are no landmarks: shapes, types, kinds, values, axes that are no rotation."""
    count = len(landmarks.ids)
    for name, (row, kind) in ROW_SHAPES.items():
        column = getattr(landmarks, name)
        if column.shape != (count, *row) or column.dtype != kind:
            expected = f"{np.dtype(kind).name} of shape {(count, *row)}"
            raise InputError(
                f"{name} is {column.dtype} of shape {column.shape}; it must be {expected}", "map"
            )
        if not np.isfinite(column).all():
            raise InputError(f"{name} has a value that is not finite", "map")
    if (landmarks.kind >= len(Kind)).any():
        raise InputError(f"kind is {landmarks.kind.max()}; it must be below {len(Kind)}", "map")
    for name in ("position", "sigma", "box_min", "box_max", "axes"):
        if np.abs(getattr(landmarks, name)).max(initial=0.0) > LARGEST:
            raise InputError(f"{name} has a value beyond {LARGEST:g}; it is no measurement", "map")
    if (landmarks.sigma < 0.0).any() or (landmarks.box_min > landmarks.box_max).any():
        raise InputError("sigma is below 0, or box_min above box_max, of a landmark", "map")
    _check_covariance(landmarks.covariance)
    product = np.einsum("nki,nkj->nij", landmarks.axes, landmarks.axes)
    if np.abs(product - np.eye(3)).max(initial=0.0) > 1e-6:
        raise InputError("axes of a landmark are no rotation", "map")


def _check_covariance(covariance: Array) -> None:
    """Refuse what is none: every one must be symmetric, no variance negative or too large."""
    largest = np.abs(covariance).max(axis=(1, 2), initial=0.0)
    if largest.max(initial=0.0) > WIDEST:
        raise InputError(f"covariance has a value beyond {WIDEST:g}; it is no measurement", "map")
    apart = np.abs(covariance - np.swapaxes(covariance, 1, 2)).max(axis=(1, 2), initial=0.0)
    least = np.linalg.eigvalsh(covariance).min(axis=1, initial=0.0)
    if (apart > ROUNDING * largest).any() or (least < -ROUNDING * largest).any():
        raise InputError("covariance of a landmark is not symmetric, or below 0", "map")


class LandmarkMap:
    """Takes landmarks that expire, if they were stable; gives those that expired long enough ago.

    The frame of the landmarks is that of the map: the odometry's, with its drift. A map without
    landmarks takes that of the first that enter it.
    """

    def __init__(self, config: MapConfig) -> None:
        self.config = config
        self.stored = Stored(no_landmarks(), np.zeros(0, np.int64), "", 1)
        self._live = no_landmarks()
        self._live_frame = ""
        self._seen_ns = 0  # stamp of the last update
        self._sequence = -1  # its number
        self._known: set[int] = set()  # ids of live ones that the map has already

    def clear(self) -> None:
        """Forget all landmarks, live ones too, and their frame; ids go on."""
        self.stored = Stored(no_landmarks(), np.zeros(0, np.int64), "", self.stored.next_id)
        self._forget_live()

    def load(self, stored: Stored) -> None:
        """Take what was saved, instead of what is there."""
        _compare(stored.frame_id, self._frame() or self._live_frame)
        self.stored = stored
        self._known.clear()

    def update(self, live: Landmarks, stamp_ns: int, frame_id: str, sequence: int) -> None:
        """Take the landmarks of an update; those that it has no more expire.

        All of before expire if time, or the number of the update, does not go on: ids may have
        begun anew. If the frame is another, they are forgotten instead. Raises InputError for
        landmarks of another frame than that of those stored, and changes nothing.
        """
        check(live)
        _compare(frame_id, self._frame())
        if frame_id and self._live_frame not in ("", frame_id):
            self._forget_live()
        anew = self._begins_anew(live, stamp_ns, sequence)
        self._expire(take(self._live, anew | ~np.isin(self._live.ids, live.ids)))
        self._known &= set() if anew else set(live.ids.tolist())
        if len(live):
            self._live_frame = frame_id or self._live_frame
        self._live, self._seen_ns, self._sequence = live, stamp_ns, sequence

    def recognized(self, ids: Array) -> None:
        """Note ids of live landmarks that the map has: they do not enter it once more."""
        self._known |= set(ids.tolist())

    def known(self) -> Stored:
        """What expired at least `delay` before the last update: what is to be recognized."""
        ripe = self.stored.last_seen_ns <= self._seen_ns - round(self.config.delay * SECOND)
        # A map of another run may have later stamps: all of it is from before.
        ripe |= self.stored.last_seen_ns > self._seen_ns
        return replace(
            self.stored,
            landmarks=take(self.stored.landmarks, ripe),
            last_seen_ns=self.stored.last_seen_ns[ripe],
        )

    def _begins_anew(self, live: Landmarks, stamp_ns: int, sequence: int) -> bool:
        """Whether an update is not of the run that the live landmarks are of.

        The last one may come again. A landmark of one id keeps its kind, and when it was seen
        first: that tells of a restart whose first updates were lost.
        """
        again = (sequence, stamp_ns) == (self._sequence, self._seen_ns)
        if stamp_ns < self._seen_ns or (sequence <= self._sequence and not again):
            return True
        _, old, new = np.intersect1d(self._live.ids, live.ids, return_indices=True)
        return any(
            (getattr(self._live, name)[old] != getattr(live, name)[new]).any()
            for name in ("kind", "first_seen_ns")
        )

    def _forget_live(self) -> None:
        self._live, self._live_frame = no_landmarks(), ""
        self._known.clear()

    def _frame(self) -> str:
        """That of the landmarks stored; empty if there are none, or if it is not known."""
        return self.stored.frame_id if len(self.stored) else ""

    def _expire(self, gone: Landmarks) -> None:
        """Add those that are worth it; the oldest go if there are too many."""
        age = self._seen_ns - gone.first_seen_ns
        worth = gone.stability <= self.config.max_stability
        worth &= age >= round(self.config.min_age * SECOND)
        worth &= ~np.isin(gone.ids, np.fromiter(self._known, np.int64, len(self._known)))
        added = take(gone, worth)
        ids = np.arange(self.stored.next_id, self.stored.next_id + len(added), dtype=np.uint32)
        landmarks = join(self.stored.landmarks, replace(added, ids=ids))
        seen = np.append(self.stored.last_seen_ns, np.full(len(added), self._seen_ns, np.int64))
        kept = slice(max(0, len(seen) - self.config.max_landmarks), None)
        self.stored = Stored(
            take(landmarks, kept),
            seen[kept],
            self._frame() or (self._live_frame if len(added) else ""),
            self.stored.next_id + len(added),
        )


def _compare(frame_id: str, known: str) -> None:
    if known and frame_id and known != frame_id:
        raise InputError(f"landmarks are in frame {frame_id}; the map is in {known}", "frame")
