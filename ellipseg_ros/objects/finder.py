"""Segments -> objects: the second level.

A wall or a road is more than one ellipsoid, a tree is many: those that touch are grouped by the
shape around their points.
"""

import math
from typing import NamedTuple

import numpy as np

from ellipseg_ros.config import ObjectsConfig
from ellipseg_ros.core.flat_moments import EIGENVALUES, V1, V2, V3, united
from ellipseg_ros.core.jit import for_rows, kernel
from ellipseg_ros.core.members import group_boxes
from ellipseg_ros.objects.agglomeration import merge_segments
from ellipseg_ros.records import Array, Hierarchy, SegmentAdjacency

FEATURES = 4  # linearity, planarity, scattering, twice the verticality


class Level(NamedTuple):
    """The objects of now; o of them."""

    of_segment: Array  # (s,) int32: the object of every segment
    nodes: Array  # (o, 24) moments of their points
    low: Array  # (o, 3) m, local origin: corners of the box around them
    high: Array  # (o, 3)
    hierarchy: Hierarchy


def find_objects(
    points: Array,
    nodes: Array,
    labels: Array,
    own: Array,
    adjacency: SegmentAdjacency,
    config: ObjectsConfig,
) -> Level:
    """Group segments into objects, numbered by their lowest segment.

    points (rows, 3) m; nodes (rows and more, 24): initial ellipsoids; labels (rows,) int32: the
    segment of every vertex, -1 for none; own (s, 24): moments of the segments' points; adjacency:
    which of them touch.
    """
    features = segment_features(nodes, labels, len(own))
    hierarchy = merge_segments(own, features, adjacency, config.thickness)
    of_segment = hierarchy.labels_after(hierarchy.merges_up_to(config.scale))
    count = int(of_segment.max(initial=-1)) + 1
    low, high = group_boxes(points, labels, of_segment, count)
    return Level(of_segment, united(own, of_segment, count), low, high, hierarchy)


def segment_features(nodes: Array, labels: Array, segments: int) -> Array:
    """Features (s, 4) of segments: means over their points, summed in the order of rows.

    nodes (rows and more, 24): initial ellipsoids, labels (rows,) int32, -1 for none. Linearity,
    planarity, scattering and verticality of a point's neighbourhood, from the square roots of the
    eigenvalues: Guinard & Landrieu (2017), Weakly supervised segmentation-aided classification
    of urban scenes from 3D LiDAR point clouds. Verticality counts twice, as they do it.
    """
    features = np.empty((len(labels), FEATURES))
    for_rows(_features, len(labels), nodes, labels, features)
    means = np.zeros((segments, FEATURES))
    _means(features, labels, means)
    return means


@kernel
def _features(start, stop, nodes, labels, features):
    for i in range(start, stop):
        if labels[i] < 0:
            continue
        s1, s2, s3 = (
            math.sqrt(nodes[i, EIGENVALUES + 2]),
            math.sqrt(nodes[i, EIGENVALUES + 1]),
            math.sqrt(nodes[i, EIGENVALUES]),
        )
        squared = 0.0
        up = 0.0
        for axis in range(3):
            up = (
                s1 * abs(nodes[i, V1 + axis])
                + s2 * abs(nodes[i, V2 + axis])
                + s3 * abs(nodes[i, V3 + axis])
            )  # of z, at last
            squared += up * up
        if s1 > 0.0:
            features[i, 0], features[i, 1], features[i, 2] = (
                (s1 - s2) / s1,
                (s2 - s3) / s1,
                s3 / s1,
            )
            features[i, 3] = 2.0 * up / math.sqrt(squared)
        else:
            features[i, :] = 0.0


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
