"""Segments -> objects: the second level.

A wall or a road consists of several ellipsoids, a tree of many: adjacent ones are grouped by the
shape of the neighbourhoods of their points.
"""

import math
from typing import NamedTuple

import numpy as np

from ellipseg_ros.config import ObjectsConfig
from ellipseg_ros.core.jit import for_rows, kernel
from ellipseg_ros.core.members import Boxes, group_boxes, groups_of_points
from ellipseg_ros.core.moments import united
from ellipseg_ros.objects.agglomeration import merge_segments
from ellipseg_ros.records import Array, Hierarchy, SegmentAdjacency

FEATURES = 4  # linearity, planarity, scattering, twice the verticality


class Grouping(NamedTuple):
    """Groups of segments: o objects."""

    segment_labels: Array  # (s,) int32: the object of every segment
    moments: Array  # (o,) MOMENTS of their points
    boxes: Boxes  # around their points, local origin
    hierarchy: Hierarchy


def find_objects(
    points: Array,
    point_moments: Array,
    labels: Array,
    moments: Array,
    adjacency: SegmentAdjacency,
    config: ObjectsConfig,
) -> Grouping:
    """Group segments into objects, numbered by their lowest segment.

    points (rows, 3) m; point_moments (rows and more,): initial ellipsoids; labels (rows,) int32:
    the segment of every vertex, -1 for none; moments (s,): of the segments' points.
    """
    features = segment_features(point_moments, labels, len(moments))
    hierarchy = merge_segments(moments, features, adjacency, config.thickness)
    of_segment = hierarchy.labels_after(hierarchy.merges_up_to(config.scale))
    count = int(of_segment.max(initial=-1)) + 1
    boxes = group_boxes(points, groups_of_points(labels, of_segment), count)
    return Grouping(of_segment, united(moments, of_segment, count), boxes, hierarchy)


def segment_features(moments: Array, labels: Array, segments: int) -> Array:
    """Features (s, 4) of segments: means over their points, summed in the order of rows.

    moments (rows and more,): initial ellipsoids; labels (rows,) int32, -1 for none. Linearity,
    planarity, scattering and verticality of a point's neighbourhood, from the square roots of the
    eigenvalues: Guinard & Landrieu (2017), Weakly supervised segmentation-aided classification
    of urban scenes from 3D LiDAR point clouds. Verticality counts twice, as in their work.
    """
    features = np.empty((len(labels), FEATURES))
    for_rows(_features, len(labels), moments, labels, features)
    means = np.zeros((segments, FEATURES))
    _means(features, labels, means)
    return means


@kernel
def _features(start, stop, moments, labels, features):
    for i in range(start, stop):
        if labels[i] < 0:
            continue
        m = moments[i]
        s1, s2, s3 = math.sqrt(m.e1), math.sqrt(m.e2), math.sqrt(m.e3)
        squared = up = 0.0
        for axis in range(3):  # z comes last
            up = s1 * abs(m.v1[axis]) + s2 * abs(m.v2[axis]) + s3 * abs(m.v3[axis])
            squared += up * up
        features[i, :] = 0.0
        if s1 > 0.0:
            features[i, 0], features[i, 1] = (s1 - s2) / s1, (s2 - s3) / s1
            features[i, 2], features[i, 3] = s3 / s1, 2.0 * up / math.sqrt(squared)


@kernel
def _means(features, labels, means):
    count = np.zeros(len(means), np.int64)
    for i in range(len(labels)):
        s = labels[i]
        if s >= 0:
            count[s] += 1
            for k in range(means.shape[1]):
                means[s, k] += features[i, k]
    for s in range(len(means)):
        for k in range(means.shape[1]):
            means[s, k] /= count[s]
