"""The records that the stages of the pipeline exchange, and that users get.

Row i of every array of a record belongs to the same thing.
"""

from dataclasses import dataclass, field, replace
from enum import IntEnum
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from ellipseg_ros.errors import InputError

Array: TypeAlias = npt.NDArray[Any]

SECOND = 1_000_000_000  # ns

# The fate of a point in a window is its entry in `labels`: 0 or more is the row of its segment.
ISOLATED = -1  # no neighbour within the isolation distance
REJECTED = -2  # NaN, infinite, or beyond the largest coordinate
LATE = -3  # older than the window on arrival, or evicted by `max_points`
THINNED = -4  # omitted by `max_points_per_second`

NEGLIGIBLE_SHARE = 0.2  # of a motion: its description omits a smaller part


@dataclass(frozen=True)
class Sweep:
    """One turn of the lidar, or any part of one; row i of every array is point i."""

    stamp_ns: int  # the message's stamp
    points: Array  # (n, 3) float64, m, world frame; may hold NaN and Inf
    offsets_ns: Array = field(default_factory=lambda: np.zeros(0, np.int64))
    # (n,) int64, ns from the stamp; zeros where not given
    fields: Array | None = None  # (n,) structured: every field of the input cloud, x, y, z too
    frame_id: str = ""
    restart: str = ""  # why the window must restart with this sweep; empty: it continues
    ranges: Array | None = None  # (n,) float64, m from the sensor; None or NaN: not known
    filtered: int = 0  # points of the same clouds that were removed by range or place
    unplaced: int = 0  # points of clouds before it that could not be placed for lack of a pose

    def __post_init__(self) -> None:
        points = np.ascontiguousarray(self.points, dtype=np.float64)
        if points.ndim != 2 or points.shape[1] != 3:
            raise InputError(
                f"points have shape {points.shape}; they must have shape (n, 3)", "shape"
            )
        offsets = np.ascontiguousarray(self.offsets_ns, dtype=np.int64)
        if not len(offsets):
            offsets = np.zeros(len(points), np.int64)
        columns = (("offsets_ns", offsets), ("fields", self.fields), ("ranges", self.ranges))
        for name, column in columns:
            if column is not None and len(column) != len(points):
                raise InputError(
                    f"{name} has {len(column)} rows for {len(points)} points", "shape"
                )
        if isinstance(self.stamp_ns, float):
            raise InputError("stamp_ns is a float, which loses ns; it must be an integer", "stamp")
        object.__setattr__(self, "points", points)
        object.__setattr__(self, "offsets_ns", offsets)

    def __len__(self) -> int:
        return len(self.points)

    @property
    def times_ns(self) -> Array:
        """(n,) int64, ns: the time of every point."""
        return self.stamp_ns + self.offsets_ns

    def keep(self, mask: Array | slice) -> "Sweep":
        """The rows that `mask` selects, of every array."""
        return replace(
            self,
            points=self.points[mask],
            offsets_ns=self.offsets_ns[mask],
            fields=None if self.fields is None else self.fields[mask],
            ranges=None if self.ranges is None else self.ranges[mask],
        )


@dataclass(frozen=True)
class Ellipsoids:
    """Segments as ellipsoids; row i is segment i. Moments are those of the labelled points."""

    count: Array  # (s,) int64, points
    mean: Array  # (s, 3) float64, m, world frame
    covariance: Array  # (s, 3, 3) float64, m^2, divided by count
    eigenvalues: Array  # (s, 3) float64, m^2, descending, at least 0
    axes: Array  # (s, 3, 3) float64, columns v1, v2, v3: a rotation, ellipsoid to world frame
    planarity: Array  # (s,) float64; the three add to 1
    cylindricality: Array  # (s,)
    sphericity: Array  # (s,)
    aicc: Array  # (s,) float64, of the model moments
    model_mean: Array  # (s, 3) m: of the union of the initial ellipsoids, which drives the merging
    model_covariance: Array  # (s, 3, 3) m^2

    def __len__(self) -> int:
        return len(self.count)


class State(IntEnum):
    """What an update did to a segment; the numbers are those of Segment.msg."""

    NEW = 0
    UPDATED = 1
    UNCHANGED = 2


@dataclass(frozen=True)
class Ragged:
    """Rows of different lengths: row i is values[starts[i]:starts[i + 1]]."""

    starts: Array  # (s + 1,) int64
    values: Array  # (v,)

    def __len__(self) -> int:
        return len(self.starts) - 1

    def __getitem__(self, row: int) -> Array:
        return self.values[self.starts[row] : self.starts[row + 1]]


class SegmentAdjacency(NamedTuple):
    """Region adjacency graph: pairs of segments a < b joined by edges of the point graph.

    Ascending by (a, b).
    """

    a: Array  # (p,) int32, row of the segment
    b: Array  # (p,) int32
    edge_count: Array  # (p,) int32: edges of the point graph between the two


@dataclass(frozen=True)
class Hierarchy:
    """Merge tree of s segments into objects: m merges in the order in which they were made.

    A group of segments is named by its lowest segment. Cutting the tree after the first k merges
    gives a partition.
    """

    parent: Array  # (m,) int32: the group that remains
    child: Array  # (m,) int32: the group that is merged into it; a higher number
    cost: Array  # (m,) float64: cost of the merge; 0 for merges of coplanar segments
    segments: int  # s

    def merges_up_to(self, cost: float) -> int:
        """Number of merges before the first one that costs more than `cost`."""
        dearer = np.flatnonzero(self.cost > cost)
        return int(dearer[0]) if len(dearer) else len(self.cost)

    def merges_for_count(self, objects: int) -> int:
        """Number of merges that leave `objects` groups, or the smallest possible number above."""
        return min(max(0, self.segments - objects), len(self.cost))

    def labels_after(self, merges: int) -> Array:
        """(s,) int32: the object of every segment after the first merges, by lowest segment."""
        group = np.arange(self.segments)
        group[self.child[:merges]] = self.parent[:merges]
        while not np.array_equal(group, group[group]):
            group = group[group]
        return np.unique(group, return_inverse=True)[1].astype(np.int32)


@dataclass(frozen=True)
class Objects:
    """Groups of segments; row i is object i, numbered by lowest point."""

    segment_labels: Array  # (s,) int32: the object of every segment
    count: Array  # (o,) int64, points
    mean: Array  # (o, 3) float64, m, world frame
    covariance: Array  # (o, 3, 3) float64, m^2, divided by count
    box_min: Array  # (o, 3) float64, m, world frame: corners of the axis-aligned bounding box
    box_max: Array  # (o, 3)
    planarity: Array  # (o,) float64: of the covariance; the three add to 1
    cylindricality: Array  # (o,)
    sphericity: Array  # (o,)
    hierarchy: Hierarchy  # from which the objects are cut
    ids: Array  # (o,) uint32, from 1, never reused in a run; segments are numbered separately
    state: Array  # (o,) uint8, see State
    parents: Ragged  # (o,) rows of uint32: other old ids that gave points to the object

    def __len__(self) -> int:
        return len(self.count)

    @property
    def members(self) -> Ragged:
        """(o,) rows of int64: the segments of every object, ascending."""
        counts = np.bincount(self.segment_labels, minlength=len(self))
        starts = np.append(0, np.cumsum(counts))
        return Ragged(starts, np.argsort(self.segment_labels, kind="stable"))


class Kind(IntEnum):
    """Shape of a landmark; the numbers are those of Landmark.msg."""

    PLANE = 0  # determines an offset and a normal
    LINE = 1  # determines two lateral offsets and a direction
    BLOB = 2  # determines a centre


# By kind: which of the six small motions in the landmark's own axes (translations along x, y, z,
# rotations about x, y, z) its shape determines. The longest axis is x, the shortest is z.
DETERMINED = {Kind.PLANE: (2, 3, 4), Kind.LINE: (1, 2, 4, 5), Kind.BLOB: (0, 1, 2)}


@dataclass(frozen=True)
class Landmarks:
    """Planes, lines and blobs that can be observed again; row i is landmark i, ascending by id."""

    ids: Array  # (l,) uint32, from 1, never reused in a run
    kind: Array  # (l,) uint8, see Kind
    count: Array  # (l,) int64, points
    position: Array  # (l, 3) float64, m, world frame: mean of the points; of a line, on its axis
    axes: Array  # (l, 3, 3) float64, columns x, y, z: a rotation, landmark to world frame
    sigma: Array  # (l, 3) float64, m: standard deviations of the points along the axes
    box_min: Array  # (l, 3) float64, m: corners of the box around the points, along the
    box_max: Array  # (l, 3) landmark's axes and relative to its position
    covariance: Array  # (l, 6, 6), m, rad: of the determined motions, see DETERMINED; else 0
    instability: Array  # (l,) float64: RMS motion in the last updates, in standard deviations
    first_seen_ns: Array  # (l,) int64: end of the window in which it was first a landmark
    segments: Ragged = field(
        default_factory=lambda: Ragged(np.zeros(1, np.int64), np.zeros(0, np.int64))
    )
    # (l,) rows of int64: the segments, ascending, that its points are in
    point_labels: Array = field(default_factory=lambda: np.zeros(0, np.int32))
    # (n,) int32: the landmark of every point of the window, -1 for none
    removed: Array = field(default_factory=lambda: np.zeros(0, np.uint32))
    # (r,) uint32: ids of the last update that are not in this one

    def __len__(self) -> int:
        return len(self.ids)


class Verdict(IntEnum):
    """Outcome of an association; the numbers are those of Association.msg."""

    KNOWN = 0  # the transform is known in all six directions
    PARTIAL = 1  # the landmarks leave some directions undetermined
    AMBIGUOUS = 2  # another transform explains the landmarks nearly as well
    TOO_FEW = 3  # the matches may be due to chance

    @property
    def has_transform(self) -> bool:
        """Whether the transform is unique and known in some directions at least."""
        return self in (Verdict.KNOWN, Verdict.PARTIAL)


@dataclass(frozen=True)
class Association:
    """Correspondences between two sets of landmarks, with the aligning transform.

    A small motion, as in `covariance` and `undetermined`, is a translation (m) and a rotation
    vector (rad) of the later set in the earlier one's frame, applied after the transform (left
    perturbation) about the moved `centre`: p -> exp(rotation) (T p - T centre) + T centre +
    translation.
    """

    pairs: Array  # (m, 2) int64: rows of the earlier and of the later set, ascending
    probability: Array  # (m,) float64: that the pair is right
    distance: Array  # (m,) float64: Mahalanobis distance of the pair after the transform
    T_earlier_later: Array  # (4, 4) float64: p_earlier = T p_later
    covariance: Array  # (6, 6) m, rad: of the transform; that of the prior where it is not known
    centre: Array  # (3,) m: centroid of the later set, in its frame
    undetermined: Array  # (6, k) float64: orthonormal columns, motions that are not known; their
    # rotations are multiplied by the characteristic length
    characteristic_length: float  # m: RMS distance of the later landmarks from the centre, >= 1
    verdict: Verdict
    transform_probability: float  # that the transform is right, in the directions that are known

    def __len__(self) -> int:
        return len(self.pairs)

    @property
    def undetermined_names(self) -> list[str]:
        """Descriptions of `undetermined`, such as "translation along (1.00, 0.00, 0.00)"."""
        return [_motion_name(column[:3], column[3:]) for column in self.undetermined.T]


def _motion_name(translation: Array, rotation: Array) -> str:
    """Description of a small motion: its translation, its rotation, or both if both matter."""
    parts = []
    for name, vector in (("translation along", translation), ("rotation about", rotation)):
        length = float(np.linalg.norm(vector))
        if length > NEGLIGIBLE_SHARE:
            x, y, z = vector / length + 0.0
            parts.append(f"{name} ({x:.2f}, {y:.2f}, {z:.2f})")
    return " with ".join(parts)


@dataclass(frozen=True)
class Counts:
    """Number of points in a window by fate; they add up to all points."""

    segmented: int
    isolated: int
    rejected: int  # NaN, Inf, or beyond the largest coordinate
    thinned: int


def _counts(labels: Array) -> Counts:
    tally = np.bincount(labels - THINNED, minlength=5)
    return Counts(int(tally[4:].sum()), int(tally[3]), int(tally[2]), int(tally[0]))


@dataclass(frozen=True)
class Segmentation:
    """A window of points and its segments, numbered by their lowest point.

    n points in the order of arrival, s segments.
    """

    labels: Array  # (n,) int32: row of `ellipsoids`, or ISOLATED, REJECTED, THINNED
    ellipsoids: Ellipsoids
    aicc: float  # of the whole model: the sum over the segments
    criterion: str
    threshold: float
    origin: Array  # (3,) m: subtracted before anything was computed; exact in float64

    points: Array  # (n, 3) float64, m, world frame, as received
    arrival: Array  # (n,) int64: serial number since the last reset
    times_ns: Array  # (n,) int64
    fields: Array | None  # (n,) structured: the input's own fields
    frame_id: str

    ids: Array  # (s,) uint32, from 1, never reused in a run
    state: Array  # (s,) uint8, see State
    parents: Ragged  # (s,) rows of uint32: other old ids that gave points to the segment
    removed: Array  # (r,) uint32: ids of the last update that are not in this one
    objects: Objects | None  # None: not enabled
    removed_objects: Array  # (r,) uint32: ids of the last update that are not in this one
    adjacency: SegmentAdjacency | None  # None: neither objects nor landmarks are enabled
    landmarks: Landmarks | None  # None: not enabled
    first_seen_ns: Array  # (s,) int64: time of the oldest point
    last_seen_ns: Array  # (s,) int64: of the newest

    start_ns: int  # the window holds the points with start_ns < t <= end_ns
    end_ns: int
    late: int  # points of this update that were older than the window, and are not in it
    evicted: int  # points that `max_points` removed from the window in this update
    filtered: (
        int  # points of this update that were removed by range or place in the sensor's frame
    )
    unplaced: int  # points since the last update for which there was no pose
    hits: Array  # (n,) int64: points that every point of the window represents, itself too
    means: Array  # (n, 3) float64, m: mean of the first of these, at most 16
    sweep: Sweep  # the points of this update, m of them
    sweep_rows: Array  # (m,) int64: row of every point or of its representative in the window, or
    # REJECTED, LATE
    sequence: int  # number of this update, from 0, not restarted by a reset
    restart: str  # why the window restarted with this update; empty: it did not
    threshold_change: str = ""  # why criterion or threshold changed; empty: they did not

    @property
    def counts(self) -> Counts:
        """Number of points of each fate."""
        return _counts(self.labels)

    @property
    def sweep_labels(self) -> Array:
        """(m,) int32: of every point of this update, as in `labels`; or LATE."""
        return self._of_sweep(self.labels)

    @property
    def sweep_objects(self) -> Array:
        """(m,) int32: row of the object of every point of this update; negative as its label."""
        if self.objects is None:
            raise ValueError("objects are not enabled; set objects.enabled")
        labels = self.sweep_labels
        return np.where(labels >= 0, np.append(self.objects.segment_labels, 0)[labels], labels)

    def _of_sweep(self, column: Array) -> Array:
        rows = self.sweep_rows
        return np.where(rows >= 0, np.append(column, 0)[rows], rows).astype(np.int32)

    @property
    def point_ids(self) -> Array:
        """(n,) uint32: the id of every point's segment, 0 where it has none (field `label`)."""
        ids = np.append(self.ids, np.uint32(0))  # row -1 is this 0
        return ids[np.maximum(self.labels, -1)]

    @property
    def object_ids(self) -> Array:
        """(s,) uint32: the id of every segment's object, 0 without objects."""
        if self.objects is None:
            return np.zeros(len(self.ids), np.uint32)
        return np.asarray(self.objects.ids[self.objects.segment_labels])

    @property
    def point_object_ids(self) -> Array:
        """(n,) uint32: the id of every point's object, 0 where it has none (field `object`)."""
        ids = np.append(self.object_ids, np.uint32(0))  # row -1 is this 0
        return ids[np.maximum(self.labels, -1)]
