"""What the stages leave behind, as the record that users get."""

import numpy as np

from ellipseg_ros.core.contingency import contingency
from ellipseg_ros.core.ellipsoids import (
    COUNT,
    COVARIANCE,
    CYLINDRICALITY,
    EIGENVALUES,
    MEAN,
    PLANARITY,
    V1,
    V2,
    V3,
)
from ellipseg_ros.core.tracking import Tracks
from ellipseg_ros.landmarks.finder import Found
from ellipseg_ros.landmarks.fits import chosen
from ellipseg_ros.landmarks.tracking import Followed
from ellipseg_ros.objects.finder import Level
from ellipseg_ros.records import Array, Ellipsoids, Landmarks, Objects, Ragged


def ellipsoid_records(own: Array, model: Array, aicc: Array, origin: Array) -> Ellipsoids:
    """Nodes (s, 24) as a record in the world frame.

    own: moments of the points; model: of the unions; aicc (s,); origin (3,) m.
    """
    planarity, cylindricality = own[:, PLANARITY].copy(), own[:, CYLINDRICALITY].copy()
    axes = np.stack([own[:, v : v + 3] for v in (V1, V2, V3)], axis=-1)
    return Ellipsoids(
        count=own[:, COUNT].astype(np.int64),
        mean=own[:, MEAN : MEAN + 3] + origin,
        covariance=_matrices(own),
        eigenvalues=own[:, EIGENVALUES : EIGENVALUES + 3][:, ::-1].copy(),
        axes=axes,
        planarity=planarity,
        cylindricality=cylindricality,
        sphericity=np.maximum(0.0, 1.0 - planarity - cylindricality),
        aicc=aicc,
        model_mean=model[:, MEAN : MEAN + 3] + origin,
        model_covariance=_matrices(model),
    )


def object_records(level: Level, tracks: Tracks, origin: Array) -> Objects:
    """What was found of objects as a record in the world frame; origin (3,) m."""
    planarity, cylindricality = (
        level.nodes[:, PLANARITY].copy(),
        level.nodes[:, CYLINDRICALITY].copy(),
    )
    return Objects(
        segment_labels=level.of_segment,
        count=level.nodes[:, COUNT].astype(np.int64),
        mean=level.nodes[:, MEAN : MEAN + 3] + origin,
        covariance=_matrices(level.nodes),
        box_min=level.low + origin,
        box_max=level.high + origin,
        planarity=planarity,
        cylindricality=cylindricality,
        sphericity=np.maximum(0.0, 1.0 - planarity - cylindricality),
        hierarchy=level.hierarchy,
        ids=tracks.ids,
        state=tracks.state,
        parents=tracks.parents,
    )


def landmark_records(found: Found, followed: Followed, labels: Array, origin: Array) -> Landmarks:
    """What was found of landmarks as a record in the world frame, ascending by id.

    labels (n,) int32: the segment of every point; origin (3,) m.
    """
    order = np.argsort(followed.ids)
    rank = np.full(len(order) + 1, -1, np.int32)
    rank[order] = np.arange(len(order))
    fits, point_labels = chosen(found.fits, order), rank[found.of_point]
    landmarks = Landmarks(
        ids=followed.ids[order],
        kind=found.kind[order],
        count=fits.count,
        position=fits.position + origin,
        axes=fits.axes,
        sigma=fits.sigma,
        box_min=fits.low,
        box_max=fits.high,
        covariance=fits.covariance,
        stability=followed.stability[order],
        first_seen_ns=followed.first_seen_ns[order],
        segments=_segments_of(point_labels, labels, len(order)),
        point_labels=point_labels,
        removed=followed.removed,
    )
    return landmarks


def _segments_of(point_labels: Array, labels: Array, landmarks: int) -> Ragged:
    """The segments that the points of every landmark are in."""
    shared = contingency(point_labels, labels, (landmarks, int(labels.max(initial=-1)) + 1))
    return Ragged(shared.starts, shared.columns.astype(np.int64))


def _matrices(nodes: Array) -> Array:
    """(s, 3, 3) from xx, xy, xz, yy, yz, zz."""
    six = nodes[:, COVARIANCE : COVARIANCE + 6]
    return six[:, [0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(-1, 3, 3)
