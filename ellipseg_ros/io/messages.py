"""Serialized SegmentArray, LandmarkArray and MarkerArray messages of a segmentation."""

from typing import Any, NamedTuple

import numpy as np

from ellipseg_ros.config import NodeConfig
from ellipseg_ros.io.cdr import Cdr, sequences, texts
from ellipseg_ros.io.colours import GOLDEN, id_colours, shape_colours
from ellipseg_ros.records import SECOND, Array, Landmarks, Ragged, Segmentation, State

SPHERE = 2  # of visualization_msgs/Marker
ADD, DELETE, DELETE_ALL = 0, 2, 3
NAMESPACE = "ellipsoids"
MIN_AXIS_M = 1e-3  # m: shortest axis of a marker: RViz rejects a scale of 0
OPACITY = 0.7
LIFETIME_S = 10  # s, of the viewer's clock
REPEAT_NS = 4 * SECOND  # ns of sensor time after which a marker is sent again
NO_UPDATE = -2  # a sequence number that precedes no other
# Types of the fields of a Marker after `lifetime`, all empty: frame_locked, points, colors,
# texture_resource, texture (stamp, frame_id, format, data), uv_coordinates, text, mesh_resource,
# mesh_file (filename, data), mesh_use_embedded_materials.
EMPTY = "bool sequence sequence text time text text sequence sequence text text text sequence bool"


# --- segments --------------------------------------------------------------------------------


class Selection(NamedTuple):
    """The rows of s segments and o objects that a message lists."""

    segments: Array  # (s,) bool
    objects: Array  # (o,) bool


def write_segments(segmentation: Segmentation, selection: Selection | None = None) -> bytes:
    """Serialize an ellipseg_ros/SegmentArray in ascending order of id; selection: None for all."""
    out = Cdr()
    out.header(segmentation.end_ns, segmentation.frame_id)
    out.put("I?", segmentation.sequence, selection is None)
    out.time(segmentation.start_ns)
    out.time(segmentation.end_ns)
    out.text(segmentation.criterion)
    out.put("d", segmentation.threshold)
    out.text(segmentation.threshold_change)
    out.put("d", segmentation.aicc)
    counts = segmentation.counts
    out.put("IIII", counts.segmented, counts.isolated, counts.rejected, counts.thinned)
    out.put("II", segmentation.late, segmentation.evicted)
    out.put("II", segmentation.filtered, segmentation.unplaced)
    order = _ascending(segmentation.ids, None if selection is None else selection.segments)
    shape = "count mean covariance axes eigenvalues planarity cylindricality sphericity aicc"
    columns = _columns(segmentation, "ids object_ids state", order)
    columns |= _columns(segmentation.ellipsoids, shape, order)
    columns |= _columns(segmentation, "first_seen_ns last_seen_ns", order)
    out.records(columns, sequences(_rows(segmentation.parents, order)))
    out.numbers(np.sort(segmentation.removed).astype(np.uint32))
    _write_objects(out, segmentation, None if selection is None else selection.objects)
    out.numbers(np.sort(segmentation.removed_objects).astype(np.uint32))
    return out.bytes()


def _write_objects(out: Cdr, segmentation: Segmentation, selection: Array | None) -> None:
    """Append the objects; selection: (o,) bool, None for all."""
    objects = segmentation.objects
    if objects is None:
        out.put("I", 0)
        return
    order = _ascending(objects.ids, selection)
    names = "ids state count mean covariance box_min box_max planarity cylindricality sphericity"
    members = _segment_ids(objects.members, segmentation.ids)
    tail = sequences(_rows(members, order), _rows(objects.parents, order))
    out.records(_columns(objects, names, order), tail)


def id_pairs(segmentation: Segmentation) -> Array:
    """(s,) uint64: the object id of every segment in the upper 32 bits, its own in the lower."""
    return segmentation.object_ids.astype(np.uint64) << 32 | segmentation.ids


def _ascending(ids: Array, selection: Array | None) -> Array:
    """Selection rows in ascending order of id."""
    order = np.argsort(ids, kind="stable")
    return order if selection is None else order[selection[order]]


def _columns(record: Any, names: str, rows: Any) -> dict[str, Array]:
    """Columns for the fields of a message, in its order, from rows of the fields of a record."""
    columns = {name: getattr(record, name)[rows] for name in names.split()}
    for name, convert in CONVERSIONS.items():
        if name in columns:
            columns[name] = convert(columns[name])
    return columns


def _rows(ragged: Ragged, order: Array) -> Ragged:
    lengths = np.diff(ragged.starts)[order]
    starts = np.append(0, np.cumsum(lengths))
    moved = np.repeat(ragged.starts[order] - starts[:-1], lengths)
    return Ragged(starts, ragged.values[moved + np.arange(len(moved))])


def _segment_ids(segments: Ragged, ids: Array) -> Ragged:
    """Ids instead of rows of segments, ascending in every row of the result."""
    values = ids[segments.values]
    owner = np.repeat(np.arange(len(segments)), np.diff(segments.starts))
    return Ragged(segments.starts, values[np.lexsort((values, owner))])


def quaternions(axes: Array) -> Array:
    """(s, 3, 3) rotation matrices -> (s, 4) unit quaternions x, y, z, w with w >= 0.

    Each is the row of 4 q q^T (linear in the rotation) with the largest diagonal (Shepperd 1978).
    scipy's Rotation, the reference in the test, takes ten times as long: it orthogonalizes.
    """
    r = np.moveaxis(axes, 0, -1)
    product = np.empty((len(axes), 4, 4))
    for i, j in ((0, 1), (0, 2), (1, 2)):
        product[:, i, j] = product[:, j, i] = r[i, j] + r[j, i]
    for k, (i, j) in enumerate(((1, 2), (2, 0), (0, 1))):
        product[:, k, 3] = product[:, 3, k] = r[j, i] - r[i, j]
        product[:, k, k] = 1.0 + r[k, k] - r[i, i] - r[j, j]
    product[:, 3, 3] = 1.0 + r[0, 0] + r[1, 1] + r[2, 2]
    largest = np.argmax(product[:, range(4), range(4)], axis=1)
    row = product[np.arange(len(axes)), largest]
    row *= np.where(row[:, 3:] < 0.0, -1.0, 1.0)
    return np.asarray(row / np.linalg.norm(row, axis=1, keepdims=True))


def _times(ns: Array) -> Array:
    """(s,) int64 -> (s, 2) uint32: seconds and nanoseconds."""
    return np.column_stack([ns // SECOND, ns % SECOND]).astype(np.int64).astype(np.uint32)


CONVERSIONS = {
    **dict.fromkeys(("ids", "object_ids", "count"), np.uint32),
    **dict.fromkeys(("state", "kind"), np.uint8),
    "axes": quaternions,
    "eigenvalues": np.sqrt,
    "first_seen_ns": _times,
    "last_seen_ns": _times,
}


# --- landmarks -------------------------------------------------------------------------------


def write_landmarks(segmentation: Segmentation, landmarks: Landmarks) -> bytes:
    """Serialize an ellipseg_ros/LandmarkArray in ascending order of id."""
    names = (
        "ids kind count position axes sigma box_min box_max covariance instability first_seen_ns"
    )
    out = Cdr()
    out.header(segmentation.end_ns, segmentation.frame_id)
    out.put("I", segmentation.sequence)
    segments = _segment_ids(landmarks.segments, segmentation.ids)
    out.records(_columns(landmarks, names, slice(None)), sequences(segments))
    out.numbers(landmarks.removed.astype(np.uint32))
    return out.bytes()


# --- markers ---------------------------------------------------------------------------------


class MarkerStream:
    """MarkerArray messages that keep the ellipsoids in a viewer up to date.

    An update sends changed markers immediately and repeats the others every 4 s of sensor time, a
    few at a time, so that a lost message has no lasting effect. Markers of removed segments are
    deleted. The first message and one after a restart delete all markers first: a viewer may
    still show those of a killed node.
    """

    def __init__(self, config: NodeConfig) -> None:
        self._config = config
        self._shown: Array | None = None  # id_pairs of the viewer's markers; None: not known
        self._sequence = NO_UPDATE  # of the last update; NO_UPDATE: the next sends all markers
        self._end_ns = 0  # its end

    def configure(self, config: NodeConfig) -> None:
        """Apply new settings; if they differ, the next update sends all markers."""
        if config != self._config:
            self._sequence = NO_UPDATE
        self._config = config

    def update(
        self, segmentation: Segmentation, send_all: bool = False, delete_all: bool = False
    ) -> bytes:
        """Serialize a visualization_msgs/MarkerArray.

        send_all: send all markers, not only the changed ones; a gap in the sequence of updates
        has the same effect. delete_all: send all, after a deletion of all markers.
        """
        shown = self._shown
        if shown is None or delete_all or segmentation.restart:
            shown, delete_all = np.zeros(0, np.uint64), True
        order = np.argsort(segmentation.ids)
        rows = order[segmentation.ellipsoids.count[order] >= self._config.marker_min_count]
        ids, pairs = segmentation.ids[rows], id_pairs(segmentation)[rows]
        is_next = segmentation.sequence == self._sequence + 1
        send = np.full(len(rows), send_all or delete_all or not is_next)
        send |= (segmentation.state[rows] != State.UNCHANGED) | ~np.isin(pairs, shown)
        send |= self._repeated(ids, segmentation.end_ns)
        removed = np.setdiff1d(shown.astype(np.uint32), ids, True)
        self._shown, self._sequence = pairs, segmentation.sequence
        self._end_ns = segmentation.end_ns
        return self._write(segmentation, rows[send], removed, delete_all)

    def _repeated(self, ids: Array, end_ns: int) -> Array:
        """(s,) bool: the markers to send again, which differ in phase by their ids."""
        phase = ids * GOLDEN % 1.0
        now, before = end_ns / REPEAT_NS, self._end_ns / REPEAT_NS
        return np.asarray(np.floor(now + phase) != np.floor(before + phase))

    def _write(
        self, segmentation: Segmentation, rows: Array, removed: Array, delete_all: bool
    ) -> bytes:
        """Serialize deletions, then the markers of the rows; delete_all: deletes all first."""
        shape = segmentation.ellipsoids
        if self._config.marker_colour == "object":
            rgb = id_colours(segmentation.object_ids[rows]) / 255.0
        else:
            rgb = shape_colours(shape.planarity, shape.cylindricality, shape.sphericity)[rows]
        axes_m = 2.0 * self._config.marker_sigmas * np.sqrt(shape.eigenvalues[rows])
        drawn = {
            "position": shape.mean[rows],
            "orientation": quaternions(shape.axes[rows]),
            "scale": np.maximum(axes_m, MIN_AXIS_M),
            "rgba": np.insert(rgb, 3, OPACITY, axis=1).astype(np.float32),
        }
        deletions = np.append(np.zeros(int(delete_all), np.uint32), removed)
        for name, column in drawn.items():
            drawn[name] = np.pad(column, ((len(deletions), 0), (0, 0)))
        drawn["orientation"][: len(deletions), 3] = 1.0
        count = len(deletions) + len(rows)
        empty = {
            "bool": np.zeros(count, np.uint8),
            "sequence": np.zeros(count, np.uint32),
            "text": texts("", count),
            "time": np.zeros((count, 2), np.uint32),
        }
        columns = {
            "stamp": empty["time"] + _times(np.array([segmentation.end_ns])),
            "frame_id": texts(segmentation.frame_id, count),
            "ns": texts(NAMESPACE, count),
            "id": np.append(deletions, segmentation.ids[rows]).astype(np.uint32).view(np.int32),
            "type": np.full(count, SPHERE, np.int32),
            "action": np.full(count, ADD, np.int32),
            **drawn,
            "lifetime": empty["time"] + np.array([LIFETIME_S, 0], np.uint32),
            **{f"empty {k}": empty[kind] for k, kind in enumerate(EMPTY.split())},
        }
        columns["action"][: len(deletions)] = DELETE
        columns["action"][: int(delete_all)] = DELETE_ALL
        out = Cdr()
        out.records(columns)
        return out.bytes()
