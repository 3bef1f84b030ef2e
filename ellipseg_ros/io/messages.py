"""Segmentation -> SegmentArray, LandmarkArray and MarkerArray, as serialized messages."""

from typing import NamedTuple

import numpy as np

from ellipseg_ros.config import NodeConfig
from ellipseg_ros.io.cdr import Cdr, sequences, texts
from ellipseg_ros.io.colours import id_colours, shape_colours
from ellipseg_ros.records import SECOND, Array, Landmarks, Objects, Ragged, Segmentation, State

SPHERE = 2  # of visualization_msgs/Marker
ADD, DELETE, DELETE_ALL = 0, 2, 3
NAMESPACE = "ellipsoids"
THINNEST = 1e-3  # m: an axis of 0 would make a marker invalid
OPACITY = 0.7
LIFETIME = 10  # s, of the viewer's clock
REPEAT = 5 * SECOND  # ns of sensor time within which every marker is sent again
GOLDEN = 0.618033988749895  # multiples of it, modulo 1, are spread evenly


# --- segments --------------------------------------------------------------------------------


class Listed(NamedTuple):
    """What a message of changes lists of s segments and o objects."""

    segments: Array  # (s,) bool
    objects: Array  # (o,) bool


def write_segments(found: Segmentation, listed: Listed | None = None) -> bytes:
    """A serialized ellipseg_ros/SegmentArray, in ascending order of id; listed: None for all."""
    out = Cdr()
    out.header(found.end_ns, found.frame_id)
    out.put("I?", found.sequence, listed is None)
    out.time(found.start_ns)
    out.time(found.end_ns)
    out.text(found.criterion)
    out.put("d", found.threshold)
    out.text(found.threshold_change)
    out.put("d", found.aicc)
    counts = found.counts
    out.put("IIII", counts.segmented, counts.isolated, counts.rejected, counts.thinned)
    out.put("II", found.late, found.evicted)
    order = _ascending(found.ids, None if listed is None else listed.segments)
    columns = {name: column[order] for name, column in _segment_columns(found).items()}
    out.records(columns, sequences(_rows(found.parents, order)))
    out.numbers(np.sort(found.removed).astype(np.uint32))
    if found.objects is None:
        out.put("I", 0)
    else:
        order = _ascending(found.objects.ids, None if listed is None else listed.objects)
        _write_objects(out, found.objects, found.ids, order)
    out.numbers(np.sort(found.removed_objects).astype(np.uint32))
    return out.bytes()


def _ascending(ids: Array, listed: Array | None) -> Array:
    """The rows that are listed, in ascending order of id."""
    order = np.argsort(ids, kind="stable")
    return order if listed is None else order[listed[order]]


def _write_objects(out: Cdr, objects: Objects, ids: Array, order: Array) -> None:
    """The objects of these rows; ids (s,) of all segments."""
    columns = {name: column[order] for name, column in _object_columns(objects).items()}
    by_object = np.lexsort((ids, objects.segment_labels))
    members = Ragged(objects.members.starts, ids[by_object])
    out.records(columns, sequences(_rows(members, order), _rows(objects.parents, order)))


def _object_columns(objects: Objects) -> dict[str, Array]:
    """The fields of Object.msg up to `segments`, in its order."""
    return {
        "id": objects.ids.astype(np.uint32),
        "state": objects.state.astype(np.uint8),
        "count": objects.count.astype(np.uint32),
        "mean": objects.mean,
        "covariance": objects.covariance.reshape(-1, 9),
        "low": objects.box_min,
        "high": objects.box_max,
        "planarity": objects.planarity,
        "cylindricality": objects.cylindricality,
        "sphericity": objects.sphericity,
    }


def _segment_columns(found: Segmentation) -> dict[str, Array]:
    """The fields of Segment.msg up to `parents`, in its order."""
    shape = found.ellipsoids
    return {
        "id": found.ids.astype(np.uint32),
        "object_id": found.object_ids,
        "state": found.state.astype(np.uint8),
        "count": shape.count.astype(np.uint32),
        "mean": shape.mean,
        "covariance": shape.covariance.reshape(-1, 9),
        "orientation": quaternions(shape.axes),
        "sigma": np.sqrt(shape.eigenvalues),
        "planarity": shape.planarity,
        "cylindricality": shape.cylindricality,
        "sphericity": shape.sphericity,
        "aicc": shape.aicc,
        "first_seen": _times(found.first_seen_ns),
        "last_seen": _times(found.last_seen_ns),
    }


def _rows(ragged: Ragged, order: Array) -> Ragged:
    lengths = np.diff(ragged.starts)[order]
    starts = np.append(0, np.cumsum(lengths))
    moved = np.repeat(ragged.starts[order] - starts[:-1], lengths)
    return Ragged(starts, ragged.values[moved + np.arange(len(moved))])


def quaternions(axes: Array) -> Array:
    """(s, 3, 3) rotations, columns v1, v2, v3 -> (s, 4) x, y, z, w with w at least 0.

    Each is the row of 4 q q^T (linear in the rotation) with the largest diagonal (Shepperd 1978).
    scipy's Rotation, the twin in the test, takes ten times as long, for it doubts the axes.
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


def write_landmarks(found: Segmentation, landmarks: Landmarks) -> bytes:
    """A serialized ellipseg_ros/LandmarkArray, in ascending order of id."""
    out = Cdr()
    out.header(found.end_ns, found.frame_id)
    out.put("I", found.sequence)
    ids = found.ids[landmarks.segments.values]
    owner = np.repeat(np.arange(len(landmarks)), np.diff(landmarks.segments.starts))
    members = Ragged(landmarks.segments.starts, ids[np.lexsort((ids, owner))].astype(np.uint32))
    out.records(_landmark_columns(landmarks), sequences(members))
    out.numbers(landmarks.removed.astype(np.uint32))
    return out.bytes()


def _landmark_columns(landmarks: Landmarks) -> dict[str, Array]:
    """The fields of Landmark.msg up to `segments`, in its order."""
    return {
        "id": landmarks.ids.astype(np.uint32),
        "kind": landmarks.kind.astype(np.uint8),
        "count": landmarks.count.astype(np.uint32),
        "position": landmarks.position,
        "orientation": quaternions(landmarks.axes),
        "sigma": landmarks.sigma,
        "low": landmarks.box_min,
        "high": landmarks.box_max,
        "covariance": landmarks.covariance.reshape(-1, 36),
        "stability": landmarks.stability,
        "first_seen": _times(landmarks.first_seen_ns),
    }


# --- markers ---------------------------------------------------------------------------------


class Markers:
    """What a viewer must be told after each update, so that it shows the ellipsoids of now.

    Changed markers at once, the others again within 5 s of sensor time, in slices, so that no
    message is lost for long; the dead are deleted, at a restart all. So they are with the first
    message, as a viewer may still have those of a node that was killed.
    """

    def __init__(self, config: NodeConfig) -> None:
        self._config = config
        self._shown = np.zeros(0, np.uint32)  # ids that the viewer has, ascending
        self._objects = np.zeros(0, np.uint32)  # that they belong to
        self._sent = np.zeros(0, np.int64)  # ns: when each of them was sent last
        self._sequence = -1  # of the last update
        self._end = 0  # ns: its end
        self._all = True
        self._anew = True  # nothing was sent yet

    def configure(self, config: NodeConfig) -> None:
        """Take new settings; if they change the markers, all are sent with the next update."""
        self._all = self._all or config != self._config
        self._config = config

    def update(self, found: Segmentation, everything: bool = False, anew: bool = False) -> bytes:
        """A serialized visualization_msgs/MarkerArray.

        everything: send all markers, as is done, too, if an update was left out. anew: somebody
        new is looking; send all, and before them take away whatever is on show.
        """
        anew = anew or self._anew or bool(found.restart)
        order = np.argsort(found.ids)
        rows = order[found.ellipsoids.count[order] >= self._config.marker_min_count]
        ids = found.ids[rows]
        if everything or anew or self._all or found.sequence != self._sequence + 1:
            send = np.ones(len(rows), bool)
        else:
            send = (found.state[rows] != State.UNCHANGED) | self._due(ids, found.end_ns)
            if self._config.marker_colour == "object":
                send |= self._known(self._objects, ids, 0) != found.object_ids[rows]
        dead = np.setdiff1d(self._shown, ids, True)
        self._sent = np.where(send, found.end_ns, self._last_sent(ids))
        self._objects = found.object_ids[rows]
        self._shown, self._sequence, self._end = ids, found.sequence, found.end_ns
        self._all = self._anew = False
        return self._write(found, rows[send], dead[:0] if anew else dead, anew)

    def _due(self, ids: Array, end_ns: int) -> Array:
        """(s,) bool: the markers that must go now, or the next update would be too late for them.

        A marker waits for 2.5 to 5 s, each time another while, so that they never fall in step.
        """
        last = self._last_sent(ids)
        chance = (ids + last // 10**8 % 10**6) * GOLDEN % 1.0
        step = end_ns - self._end
        return np.asarray(end_ns + step - last > REPEAT * (0.5 + 0.5 * chance))

    def _last_sent(self, ids: Array) -> Array:
        """(s,) int64 ns; long ago if never."""
        return self._known(self._sent, ids, -(2**62))

    def _known(self, column: Array, ids: Array, unknown: int) -> Array:
        """(s,) what a column of the markers shown says of these ids, or `unknown`."""
        place = np.searchsorted(self._shown, ids)
        known = np.append(self._shown, 0)[place] == ids
        return np.where(known, np.append(column, 0)[place], np.int64(unknown))

    def _write(self, found: Segmentation, rows: Array, dead: Array, anew: bool) -> bytes:
        """Markers for the `rows` of found, behind the deletions; anew: of all that there are."""
        gone = np.append(np.zeros(int(anew), np.uint32), dead)
        action = np.full(len(gone) + len(rows), ADD, np.int32)
        action[: len(gone)] = DELETE
        action[: len(gone) - len(dead)] = DELETE_ALL
        shape = found.ellipsoids
        sigma = np.sqrt(shape.eigenvalues[rows])
        if self._config.marker_colour == "object":
            rgb = id_colours(found.object_ids[rows]) / 255.0
        else:
            rgb = shape_colours(shape.planarity, shape.cylindricality, shape.sphericity)[rows]
        drawn = {
            "position": shape.mean[rows],
            "orientation": quaternions(shape.axes[rows]),
            "scale": np.maximum(2.0 * self._config.marker_sigmas * sigma, THINNEST),
            "rgba": np.insert(rgb, 3, OPACITY, axis=1).astype(np.float32),
        }
        parts = {
            name: np.vstack([np.zeros((len(gone), column.shape[1])), column])
            for name, column in drawn.items()
        }
        parts["orientation"][: len(gone), 3] = 1.0
        out = Cdr()
        out.records(_marker_columns(found, np.append(gone, found.ids[rows]), action, parts))
        return out.bytes()


def _marker_columns(
    found: Segmentation, ids: Array, action: Array, drawn: dict[str, Array]
) -> dict[str, Array]:
    """The fields of visualization_msgs/Marker in its order; sequences stay empty."""
    count = len(ids)
    zero = np.zeros(count, np.uint32)
    no_text = texts("", count)
    no_time = np.zeros((count, 2), np.uint32)
    return {
        "stamp": np.tile(_times(np.array([found.end_ns])), (count, 1)),
        "frame_id": texts(found.frame_id, count),
        "ns": texts(NAMESPACE, count),
        "id": ids.astype(np.uint32).view(np.int32),
        "type": np.full(count, SPHERE, np.int32),
        "action": action,
        "position": drawn["position"],
        "orientation": drawn["orientation"],
        "scale": drawn["scale"],
        "rgba": drawn["rgba"].astype(np.float32),
        "lifetime": no_time + np.array([LIFETIME, 0], np.uint32),
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
