"""Landmarks of an existing segmentation."""

import numpy as np

from ellipseg_ros.config import LandmarksConfig
from ellipseg_ros.core.ellipsoids import segment_moments
from ellipseg_ros.core.moments import no_moments
from ellipseg_ros.errors import InputError
from ellipseg_ros.landmarks.finder import find_landmarks
from ellipseg_ros.landmarks.stage import landmark_records
from ellipseg_ros.landmarks.tracking import LandmarkTracker
from ellipseg_ros.records import Landmarks, Segmentation


def landmarks(segmentation: Segmentation, config: LandmarksConfig | None = None) -> Landmarks:
    """Detect the planes, lines and blobs of a segmentation that can be observed again.

    They are numbered from 1, whatever landmarks the segmentation already has, and are in its
    frame. config: by default LandmarksConfig(). Raises InputError if the segmentation has no
    `adjacency`, since both objects and landmarks were disabled when it was made.
    """
    if segmentation.adjacency is None:
        raise InputError("the segmentation has no `adjacency`; segment with objects or landmarks")
    points, labels = segmentation.points - segmentation.origin, segmentation.labels
    unknown = np.full(len(segmentation.ellipsoids), -1)
    moments = segment_moments(points, labels, unknown, no_moments())
    config = config or LandmarksConfig()
    found = find_landmarks(points, labels, moments, segmentation.adjacency, config)
    tracks = LandmarkTracker().follow(segmentation.arrival, found, segmentation.end_ns)
    return landmark_records(found, tracks, labels, segmentation.origin)
