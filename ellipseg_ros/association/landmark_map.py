"""Map of landmarks that have left the window, kept to be recognized later."""

from dataclasses import dataclass, replace

import numpy as np

from ellipseg_ros.config import MapConfig
from ellipseg_ros.errors import InputError
from ellipseg_ros.records import SECOND, Array, Kind, Landmarks

MAX_COORDINATE = 1e8  # m: as with points, a coordinate beyond is no measurement
MAX_COVARIANCE = 1e12  # m^2, rad^2: nor is an uncertainty of more than 1000 km
ROUNDING = 1e-6  # share of the largest value of a covariance that may be rounding
ROW_SHAPES = {  # of the arrays of Landmarks: shape of one row, and type
    "ids": ((), np.uint32),
    "kind": ((), np.uint8),
    "count": ((), np.int64),
    "position": ((3,), np.float64),
    "axes": ((3, 3), np.float64),
    "sigma": ((3,), np.float64),
    "box_min": ((3,), np.float64),
    "box_max": ((3,), np.float64),
    "covariance": ((6, 6), np.float64),
    "instability": ((), np.float64),
    "first_seen_ns": ((), np.int64),
}


@dataclass(frozen=True)
class StoredMap:
    """Content of a map; row i of every array is one landmark, ascending by id."""

    landmarks: Landmarks  # with ids of the map
    last_seen_ns: Array  # (l,) int64: end of the last window in which it was a landmark
    frame_id: str  # empty: not known yet
    next_id: int  # from 1, never used twice

    def __post_init__(self) -> None:
        check_landmarks(self.landmarks)
        ids = self.landmarks.ids.astype(np.int64)
        if len(self.last_seen_ns) != len(ids):
            raise InputError(f"{len(self.last_seen_ns)} times for {len(ids)} landmarks", "map")
        if (np.diff(ids) <= 0).any() or (ids < 1).any() or (ids >= self.next_id).any():
            raise InputError("ids of a map must ascend from 1 and be below its next id", "map")

    def __len__(self) -> int:
        return len(self.landmarks)


def no_landmarks() -> Landmarks:
    """The empty set."""
    return Landmarks(
        **{name: np.zeros((0, *row), kind) for name, (row, kind) in ROW_SHAPES.items()}
    )


def select_landmarks(landmarks: Landmarks, rows: Array | slice) -> Landmarks:
    """The given rows of a set, without the points and segments that they consist of."""
    return Landmarks(**{name: getattr(landmarks, name)[rows] for name in ROW_SHAPES})


def concatenate_landmarks(first: Landmarks, second: Landmarks) -> Landmarks:
    """The rows of two sets, without the points and segments that they consist of."""
    both = {name: (getattr(first, name), getattr(second, name)) for name in ROW_SHAPES}
    return Landmarks(**{name: np.concatenate(columns) for name, columns in both.items()})


def check_landmarks(landmarks: Landmarks) -> None:
    """Raise InputError for wrong shapes, types, kinds or values, or axes that are no rotation."""
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
        _check_size(name, getattr(landmarks, name), MAX_COORDINATE)
    if (landmarks.sigma < 0.0).any() or (landmarks.box_min > landmarks.box_max).any():
        raise InputError("sigma is below 0, or box_min above box_max, of a landmark", "map")
    _check_covariance(landmarks.covariance)
    product = np.einsum("nki,nkj->nij", landmarks.axes, landmarks.axes)
    if np.abs(product - np.eye(3)).max(initial=0.0) > 1e-6:
        raise InputError("axes of a landmark are no rotation", "map")


def _check_size(name: str, column: Array, largest: float) -> None:
    if np.abs(column).max(initial=0.0) > largest:
        raise InputError(f"{name} has a value beyond {largest:g}; it is no measurement", "map")


def _check_covariance(covariance: Array) -> None:
    """Refuse matrices that are too large, not symmetric, or have negative eigenvalues."""
    _check_size("covariance", covariance, MAX_COVARIANCE)
    rounding = ROUNDING * np.abs(covariance).max(axis=(1, 2), initial=0.0)
    asymmetry = np.abs(covariance - np.swapaxes(covariance, 1, 2)).max(axis=(1, 2), initial=0.0)
    smallest = np.linalg.eigvalsh(covariance).min(axis=1, initial=0.0)
    if (asymmetry > rounding).any() or (smallest < -rounding).any():
        raise InputError("covariance of a landmark is not symmetric, or below 0", "map")


class LandmarkMap:
    """Stores stable landmarks when they expire, and offers them for recognition after a delay.

    The landmarks are in the frame of the odometry, with its drift. An empty map takes the frame
    of the first landmarks that enter it.
    """

    def __init__(self, config: MapConfig) -> None:
        self.config = config
        self.stored = StoredMap(no_landmarks(), np.zeros(0, np.int64), "", 1)
        self._live = no_landmarks()
        self._live_frame = ""
        self._stamp_ns = 0  # of the last update
        self._sequence = -1  # number of the last update
        self._recognized: set[int] = set()  # ids of live landmarks that the map already has

    def clear(self) -> None:
        """Forget all landmarks, live ones too, and their frame; ids go on."""
        self.stored = StoredMap(no_landmarks(), np.zeros(0, np.int64), "", self.stored.next_id)
        self._forget_live()

    def load(self, stored: StoredMap) -> None:
        """Replace the content of the map. Raises InputError for another frame."""
        _check_frame(stored.frame_id, self._frame() or self._live_frame)
        self.stored = stored
        self._recognized.clear()

    def update(self, live: Landmarks, stamp_ns: int, frame_id: str, sequence: int) -> None:
        """Take the landmarks of an update; those of the previous one that are missing expire.

        All of the previous ones expire if the stamp or the sequence number goes back, as ids may
        have started over. If the frame changes, they are forgotten instead. Raises InputError,
        and changes nothing, for landmarks in another frame than the stored ones.
        """
        check_landmarks(live)
        _check_frame(frame_id, self._frame())
        if frame_id and self._live_frame not in ("", frame_id):
            self._forget_live()
        restarted = self._is_restart(live, stamp_ns, sequence)
        expired = restarted | ~np.isin(self._live.ids, live.ids)
        self._expire(select_landmarks(self._live, expired))
        self._recognized &= set() if restarted else set(live.ids.tolist())
        if len(live):
            self._live_frame = frame_id or self._live_frame
        self._live, self._stamp_ns, self._sequence = live, stamp_ns, sequence

    def mark_recognized(self, ids: Array) -> None:
        """Note the ids of live landmarks that the map has: they do not enter it again."""
        self._recognized |= set(ids.tolist())

    def recognizable(self) -> StoredMap:
        """Landmarks that expired at least `delay` before the last update."""
        seen_ns = self.stored.last_seen_ns
        old = seen_ns <= self._stamp_ns - round(self.config.delay * SECOND)
        old |= seen_ns > self._stamp_ns  # the map of another run may have later stamps
        landmarks = select_landmarks(self.stored.landmarks, old)
        return replace(self.stored, landmarks=landmarks, last_seen_ns=seen_ns[old])

    def _is_restart(self, live: Landmarks, stamp_ns: int, sequence: int) -> bool:
        """Whether an update comes from another run than the live landmarks.

        The last update may be repeated. Within a run, a landmark keeps its kind and the time when
        it was first seen: that reveals a restart whose first updates were lost.
        """
        repeated = (sequence, stamp_ns) == (self._sequence, self._stamp_ns)
        if stamp_ns < self._stamp_ns or (sequence <= self._sequence and not repeated):
            return True
        _, old, new = np.intersect1d(self._live.ids, live.ids, return_indices=True)
        return any(
            (getattr(self._live, name)[old] != getattr(live, name)[new]).any()
            for name in ("kind", "first_seen_ns")
        )

    def _forget_live(self) -> None:
        self._live, self._live_frame = no_landmarks(), ""
        self._recognized.clear()

    def _frame(self) -> str:
        """Frame of the stored landmarks; empty if there are none, or if it is not known."""
        return self.stored.frame_id if len(self.stored) else ""

    def _expire(self, expired: Landmarks) -> None:
        """Store the landmarks that are stable and new; the oldest go if there are too many."""
        age = self._stamp_ns - expired.first_seen_ns
        enters = expired.instability <= self.config.max_instability
        enters &= age >= round(self.config.min_age * SECOND)
        enters &= ~np.isin(expired.ids, np.array(sorted(self._recognized), np.int64))
        added = select_landmarks(expired, enters)
        next_id = self.stored.next_id + len(added)
        added = replace(added, ids=np.arange(self.stored.next_id, next_id, dtype=np.uint32))
        landmarks = concatenate_landmarks(self.stored.landmarks, added)
        times = np.full(len(added), self._stamp_ns, np.int64)
        seen_ns = np.concatenate([self.stored.last_seen_ns, times])
        kept = slice(max(0, len(seen_ns) - self.config.max_landmarks), None)
        frame = self._frame() or (self._live_frame if len(added) else "")
        self.stored = StoredMap(select_landmarks(landmarks, kept), seen_ns[kept], frame, next_id)


def _check_frame(frame_id: str, known: str) -> None:
    if known and frame_id and known != frame_id:
        raise InputError(f"landmarks are in frame {frame_id}; the map is in {known}", "frame")
