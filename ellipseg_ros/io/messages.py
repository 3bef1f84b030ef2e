"""Serialized SegmentArray, LandmarkArray and MarkerArray messages of a segmentation."""

from typing import NamedTuple

import numpy as np

from ellipseg_ros.config import NodeConfig
from ellipseg_ros.io.cdr import Cdr, sequences, texts
from ellipseg_ros.io.colours import id_colours, shape_colours
from ellipseg_ros.records import SECOND, Array, Landmarks, Objects, Ragged, Segmentation, State

SPHERE = 2  # of visualization_msgs/Marker
ADD, DELETE, DELETE_ALL = 0, 2, 3
NAMESPACE = "ellipsoids"
MIN_AXIS_M = 1e-3  # m: shortest axis of a marker: RViz rejects a scale of 0
OPACITY = 0.7
LIFETIME_S = 10  # s, of the viewer's clock
REPEAT_NS = 5 * SECOND  # ns, sensor time within which every marker is sent again
GOLDEN_RATIO_CONJUGATE = 0.618033988749895  # its multiples modulo 1 are evenly spread


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
    order = _ascending(segmentation.ids, None if selection is None else selection.segments)
    columns = {name: column[order] for name, column in _segment_columns(segmentation).items()}
    out.records(columns, sequences(_rows(segmentation.parents, order)))
    out.numbers(np.sort(segmentation.removed).astype(np.uint32))
    if segmentation.objects is None:
        out.put("I", 0)
    else:
        order = _ascending(
            segmentation.objects.ids, None if selection is None else selection.objects
        )
        _write_objects(out, segmentation.objects, segmentation.ids, order)
    out.numbers(np.sort(segmentation.removed_objects).astype(np.uint32))
    return out.bytes()


def _ascending(ids: Array, selection: Array | None) -> Array:
    """Selection rows in ascending order of id."""
    order = np.argsort(ids, kind="stable")
    return order if selection is None else order[selection[order]]


def _write_objects(out: Cdr, objects: Objects, ids: Array, order: Array) -> None:
    """Append the objects of these rows; ids: (s,) of all segments."""
    columns = {name: column[order] for name, column in _object_columns(objects).items()}
    by_object = np.lexsort((ids, objects.segment_labels))
    members = Ragged(objects.members.starts, ids[by_object])
    out.records(columns, sequences(_rows(members, order), _rows(objects.parents, order)))


def _object_columns(objects: Objects) -> dict[str, Array]:
    """Columns for the fields of Object.msg up to `segments`, in the order of the message."""
    return {
        "id": objects.ids.astype(np.uint32),
        "state": objects.state.astype(np.uint8),
        "count": objects.count.astype(np.uint32),
        "mean": objects.mean,
        "covariance": objects.covariance.reshape(-1, 9),
        "box_min": objects.box_min,
        "box_max": objects.box_max,
        "planarity": objects.planarity,
        "cylindricality": objects.cylindricality,
        "sphericity": objects.sphericity,
    }


def _segment_columns(segmentation: Segmentation) -> dict[str, Array]:
    """Columns for the fields of Segment.msg up to `parents`, in the order of the message."""
    shape = segmentation.ellipsoids
    return {
        "id": segmentation.ids.astype(np.uint32),
        "object_id": segmentation.object_ids,
        "state": segmentation.state.astype(np.uint8),
        "count": shape.count.astype(np.uint32),
        "mean": shape.mean,
        "covariance": shape.covariance.reshape(-1, 9),
        "orientation": quaternions(shape.axes),
        "sigma": np.sqrt(shape.eigenvalues),
        "planarity": shape.planarity,
        "cylindricality": shape.cylindricality,
        "sphericity": shape.sphericity,
        "aicc": shape.aicc,
        "first_seen": _times(segmentation.first_seen_ns),
        "last_seen": _times(segmentation.last_seen_ns),
    }


def _rows(ragged: Ragged, order: Array) -> Ragged:
    lengths = np.diff(ragged.starts)[order]
    starts = np.append(0, np.cumsum(lengths))
    moved = np.repeat(ragged.starts[order] - starts[:-1], lengths)
    return Ragged(starts, ragged.values[moved + np.arange(len(moved))])


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


# --- landmarks -------------------------------------------------------------------------------


def write_landmarks(segmentation: Segmentation, landmarks: Landmarks) -> bytes:
    """Serialize an ellipseg_ros/LandmarkArray in ascending order of id."""
    out = Cdr()
    out.header(segmentation.end_ns, segmentation.frame_id)
    out.put("I", segmentation.sequence)
    ids = segmentation.ids[landmarks.segments.values]
    owner = np.repeat(np.arange(len(landmarks)), np.diff(landmarks.segments.starts))
    members = Ragged(landmarks.segments.starts, ids[np.lexsort((ids, owner))].astype(np.uint32))
    out.records(_landmark_columns(landmarks), sequences(members))
    out.numbers(landmarks.removed.astype(np.uint32))
    return out.bytes()


def _landmark_columns(landmarks: Landmarks) -> dict[str, Array]:
    """Columns for the fields of Landmark.msg up to `segments`, in the order of the message."""
    return {
        "id": landmarks.ids.astype(np.uint32),
        "kind": landmarks.kind.astype(np.uint8),
        "count": landmarks.count.astype(np.uint32),
        "position": landmarks.position,
        "orientation": quaternions(landmarks.axes),
        "sigma": landmarks.sigma,
        "box_min": landmarks.box_min,
        "box_max": landmarks.box_max,
        "covariance": landmarks.covariance.reshape(-1, 36),
        "stability": landmarks.stability,
        "first_seen": _times(landmarks.first_seen_ns),
    }


# --- markers ---------------------------------------------------------------------------------


class MarkerStream:
    """MarkerArray messages that keep the ellipsoids in a viewer up to date.

    An update sends changed markers immediately and repeats the others within 5 s of sensor time,
    a few at a time, so that a lost message has no lasting effect. Markers of removed segments
    are deleted. The first message and one after a restart delete all markers first: a viewer may
    still show those of a killed node.
    """

    def __init__(self, config: NodeConfig) -> None:
        self._config = config
        self._shown = np.zeros(0, np.uint32)  # ids of the viewer's markers, ascending
        self._objects = np.zeros(0, np.uint32)  # object id of each
        self._sent = np.zeros(0, np.int64)  # ns: when each was sent last
        self._sequence = -1  # of the last update
        self._end_ns = 0  # its end
        self._send_all = True
        self._first = True  # nothing was sent yet

    def configure(self, config: NodeConfig) -> None:
        """Apply new settings; if they differ, the next update sends all markers."""
        self._send_all = self._send_all or config != self._config
        self._config = config

    def update(
        self, segmentation: Segmentation, send_all: bool = False, delete_all: bool = False
    ) -> bytes:
        """Serialize a visualization_msgs/MarkerArray.

        send_all: send all markers, not only the changed ones; a gap in the sequence of updates
        has the same effect. delete_all: send all, after a deletion of all markers.
        """
        delete_all = delete_all or self._first or bool(segmentation.restart)
        order = np.argsort(segmentation.ids)
        rows = order[segmentation.ellipsoids.count[order] >= self._config.marker_min_count]
        ids = segmentation.ids[rows]
        if send_all or delete_all or self._send_all or segmentation.sequence != self._sequence + 1:
            send = np.ones(len(rows), bool)
        else:
            send = (segmentation.state[rows] != State.UNCHANGED) | self._due(
                ids, segmentation.end_ns
            )
            if self._config.marker_colour == "object":
                send |= self._lookup(self._objects, ids, 0) != segmentation.object_ids[rows]
        removed = np.setdiff1d(self._shown, ids, True)
        self._sent = np.where(send, segmentation.end_ns, self._last_sent(ids))
        self._objects = segmentation.object_ids[rows]
        self._shown, self._sequence, self._end_ns = ids, segmentation.sequence, segmentation.end_ns
        self._send_all = self._first = False
        return self._write(
            segmentation, rows[send], removed[:0] if delete_all else removed, delete_all
        )

    def _due(self, ids: Array, end_ns: int) -> Array:
        """(s,) bool: the markers whose repetition can't wait for the next update.

        A marker is repeated after 2.5 to 5 s, a pseudo-random interval each time, so that the
        repetitions stay spread over the updates.
        """
        last = self._last_sent(ids)
        fraction = (ids + last // 10**8 % 10**6) * GOLDEN_RATIO_CONJUGATE % 1.0
        step = end_ns - self._end_ns
        return np.asarray(end_ns + step - last > REPEAT_NS * (0.5 + 0.5 * fraction))

    def _last_sent(self, ids: Array) -> Array:
        """(s,) int64 ns; a time in the distant past for a marker that was never sent."""
        return self._lookup(self._sent, ids, -(2**62))

    def _lookup(self, column: Array, ids: Array, default: int) -> Array:
        """(s,) entries of a column of the shown markers by id; `default` for other ids."""
        place = np.searchsorted(self._shown, ids)
        known = np.append(self._shown, 0)[place] == ids
        return np.where(known, np.append(column, 0)[place], np.int64(default))

    def _write(
        self, segmentation: Segmentation, rows: Array, removed: Array, delete_all: bool
    ) -> bytes:
        """Serialize deletions, then the markers of the rows; delete_all: deletes all first."""
        deletions = np.append(np.zeros(int(delete_all), np.uint32), removed)
        action = np.full(len(deletions) + len(rows), ADD, np.int32)
        action[: len(deletions)] = DELETE
        action[: len(deletions) - len(removed)] = DELETE_ALL
        shape = segmentation.ellipsoids
        sigma = np.sqrt(shape.eigenvalues[rows])
        if self._config.marker_colour == "object":
            rgb = id_colours(segmentation.object_ids[rows]) / 255.0
        else:
            rgb = shape_colours(shape.planarity, shape.cylindricality, shape.sphericity)[rows]
        drawn = {
            "position": shape.mean[rows],
            "orientation": quaternions(shape.axes[rows]),
            "scale": np.maximum(2.0 * self._config.marker_sigmas * sigma, MIN_AXIS_M),
            "rgba": np.insert(rgb, 3, OPACITY, axis=1).astype(np.float32),
        }
        parts = {
            name: np.vstack([np.zeros((len(deletions), column.shape[1])), column])
            for name, column in drawn.items()
        }
        parts["orientation"][: len(deletions), 3] = 1.0
        out = Cdr()
        out.records(
            _marker_columns(
                segmentation, np.append(deletions, segmentation.ids[rows]), action, parts
            )
        )
        return out.bytes()


def _marker_columns(
    segmentation: Segmentation, ids: Array, action: Array, drawn: dict[str, Array]
) -> dict[str, Array]:
    """Columns for the fields of visualization_msgs/Marker; its sequences stay empty."""
    count = len(ids)
    zero = np.zeros(count, np.uint32)
    no_text = texts("", count)
    no_time = np.zeros((count, 2), np.uint32)
    return {
        "stamp": np.tile(_times(np.array([segmentation.end_ns])), (count, 1)),
        "frame_id": texts(segmentation.frame_id, count),
        "ns": texts(NAMESPACE, count),
        "id": ids.astype(np.uint32).view(np.int32),
        "type": np.full(count, SPHERE, np.int32),
        "action": action,
        "position": drawn["position"],
        "orientation": drawn["orientation"],
        "scale": drawn["scale"],
        "rgba": drawn["rgba"].astype(np.float32),
        "lifetime": no_time + np.array([LIFETIME_S, 0], np.uint32),
        "frame_locked": zero.astype(np.uint8),
        "points": zero,
        "colors": zero,
        "texture_resource": no_text,
        "texture stamp": no_time,
        "texture frame_id": no_text,
        "texture format": no_text,
        "texture data": zero,
        "uv_coordinates": zero,
        "text": no_text,
        "mesh_resource": no_text,
        "mesh_file filename": no_text,
        "mesh_file data": zero,
        "mesh_use_embedded_materials": zero.astype(np.uint8),
    }
