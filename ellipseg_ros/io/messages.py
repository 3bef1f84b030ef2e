"""Segmentation -> SegmentArray and MarkerArray, as serialized messages."""

import numpy as np
from scipy.spatial.transform import Rotation  # well tested with degenerate axes, and vectorised

from ellipseg_ros.colours import shape_colours
from ellipseg_ros.config import NodeConfig
from ellipseg_ros.data import Array, Ragged, Segmentation, State
from ellipseg_ros.io.cdr import Cdr, texts
from ellipseg_ros.io.times import SECOND

SPHERE = 2  # of visualization_msgs/Marker
ADD, DELETE, DELETE_ALL = 0, 2, 3
NAMESPACE = "ellipsoids"
THINNEST = 1e-3  # m: an axis of 0 would make a marker invalid
OPACITY = 0.7
LIFETIME = 10  # s, of the viewer's clock
REPEAT = 5 * SECOND  # ns of sensor time within which every marker is sent again
GOLDEN = 0.618033988749895


# --- segments --------------------------------------------------------------------------------


def write_segments(found: Segmentation) -> bytes:
    """A serialized ellipseg_ros/SegmentArray, in ascending order of id."""
    out = Cdr()
    out.header(found.end_ns, found.frame_id)
    out.time(found.start_ns)
    out.time(found.end_ns)
    out.text(found.criterion)
    out.put("dd", found.threshold, found.aicc)
    counts = found.counts
    out.put("IIII", counts.segmented, counts.isolated, counts.rejected, counts.thinned)
    out.put("?I", True, found.sequence)
    order = np.argsort(found.ids, kind="stable")
    columns = {name: column[order] for name, column in _segment_columns(found).items()}
    out.records(columns, _rows(found.parents, order))
    out.numbers(np.sort(found.removed).astype(np.uint32))
    return out.bytes()


def _segment_columns(found: Segmentation) -> dict[str, Array]:
    """The fields of Segment.msg up to `parents`, in its order."""
    shape = found.ellipsoids
    return {
        "id": found.ids.astype(np.uint32),
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
    """(s, 3, 3) rotations, columns v1, v2, v3 -> (s, 4) x, y, z, w with w at least 0."""
    if not len(axes):
        return np.zeros((0, 4))
    return np.asarray(Rotation.from_matrix(axes).as_quat(canonical=True))


def _times(ns: Array) -> Array:
    """(s,) int64 -> (s, 2) uint32: seconds and nanoseconds."""
    return np.column_stack([ns // SECOND, ns % SECOND]).astype(np.int64).astype(np.uint32)


# --- markers ---------------------------------------------------------------------------------


class Markers:
    """What a viewer must be told after each update, so that it shows the ellipsoids of now.

    Changed markers at once, the others again within 5 s of sensor time, in slices, so that no
    message is lost for long; the dead are deleted, at a restart all.
    """

    def __init__(self, config: NodeConfig) -> None:
        self._config = config
        self._shown = np.zeros(0, np.uint32)  # ids that the viewer has
        self._sequence = -1  # of the last update
        self._end = self._reach = 0  # ns: end of the last update, and the one expected next
        self._all = True

    def configure(self, config: NodeConfig) -> None:
        """Take new settings; if they change the markers, all are sent with the next update."""
        self._all = self._all or config != self._config
        self._config = config

    def update(self, found: Segmentation, everything: bool = False) -> bytes:
        """A serialized visualization_msgs/MarkerArray.

        everything: somebody new is looking. All markers are sent, too, if an update was left out.
        """
        shown = found.ellipsoids.count >= self._config.marker_min_count
        due = self._due(found)
        if everything or self._all or found.restart or found.sequence != self._sequence + 1:
            due[:] = True
        changed = (found.state != State.UNCHANGED) | ~np.isin(found.ids, self._shown)
        send = shown & (changed | due)
        ids = found.ids[shown]
        dead = np.zeros(0, np.uint32) if found.restart else np.setdiff1d(self._shown, ids)
        self._shown, self._sequence, self._all = ids, found.sequence, False
        return self._write(found, np.flatnonzero(send), dead)

    def _due(self, found: Segmentation) -> Array:
        """(s,) bool: the markers that must go now, or the next update would be too late for them.

        Every id has moments of its own, 5 s apart; one that lies between the update expected last
        and the one expected next makes its marker due.
        """
        step = max(0, found.end_ns - self._end) if self._sequence >= 0 else 0
        reach = max(found.end_ns + step, self._reach)
        own = (found.ids * GOLDEN % 1.0 * REPEAT).astype(np.int64)
        due = np.asarray((reach - own) // REPEAT > (self._reach - own) // REPEAT)
        self._end, self._reach = found.end_ns, reach
        return due

    def _write(self, found: Segmentation, rows: Array, dead: Array) -> bytes:
        """Markers for the `rows` of found, behind the deletions."""
        gone = np.append(np.zeros(1 if found.restart else 0, np.uint32), dead)
        action = np.full(len(gone) + len(rows), ADD, np.int32)
        action[: len(gone)] = DELETE
        action[: len(gone) - len(dead)] = DELETE_ALL
        shape = found.ellipsoids
        sigma = np.sqrt(shape.eigenvalues[rows])
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
