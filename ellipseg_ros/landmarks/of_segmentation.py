"""The landmarks of a segmentation that is there already."""

import numpy as np

from ellipseg_ros.config import LandmarksConfig
from ellipseg_ros.core.ellipsoids import segment_moments
from ellipseg_ros.core.moments import flat, no_moments
from ellipseg_ros.errors import InputError
from ellipseg_ros.landmarks.finder import find_landmarks
from ellipseg_ros.landmarks.stage import landmark_records
from ellipseg_ros.landmarks.tracking import LandmarkTracker
from ellipseg_ros.records import Landmarks, Segmentation


def landmarks(found: Segmentation, config: LandmarksConfig | None = None) -> Landmarks:
    """Choose the landmarks of a segmentation, whatever it was made with; ids from 1.

    InputError if it does not know which segments touch.
    """
    if found.adjacency is None:
        raise InputError("the segmentation has no `adjacency`; segment with objects or landmarks")
    points = found.points - found.origin
    count = len(found.ellipsoids)
    own = segment_moments(points, found.labels, np.full(count, -1), no_moments())
    chosen = find_landmarks(
        points, found.labels, flat(own), found.adjacency, config or LandmarksConfig()
    )
    followed = LandmarkTracker().follow(found.arrival, chosen, found.end_ns)
    return landmark_records(chosen, followed, found.labels, found.origin)
