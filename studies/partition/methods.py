"""Partition methods: what defines one, and those of this package."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import TypeAlias

import numpy as np

from ellipseg_ros.config import Config, LandmarksConfig, ObjectsConfig
from ellipseg_ros.core.criteria import CRITERIA
from ellipseg_ros.errors import EllipsegError
from ellipseg_ros.records import Array, Segmentation, Sweep

Settings: TypeAlias = dict[str, float | str]  # JSON-ready
Run: TypeAlias = Callable[[Settings], Array]  # -> (n,) labels, negative: no segment


@dataclass(frozen=True)
class CountParameter:
    """The setting by which a method is brought to a number of segments: more gives fewer."""

    name: str
    low: float
    high: float
    integer: bool = False


@dataclass(frozen=True)
class Method:
    """A way to partition a cloud into segments."""

    name: str
    prepare: Callable[[Array], Run]  # (n, 3) points, m; what it prepares is used by many runs
    grid: tuple[Settings, ...]  # settings, of which the best result counts; the first: defaults
    parameter: CountParameter | None  # None: the number of segments is a setting itself
    package: str = ""  # of another library, on PyPI
    module: str = ""


SEGMENTS_ONLY = Config(
    objects=ObjectsConfig(enabled=False), landmarks=LandmarksConfig(enabled=False)
)
FINE_THRESHOLD = 2.0  # of smaller ellipsoids, for more objects
SEGMENTS = "segments"  # the setting of a method without a count parameter
THRESHOLDS = {
    "shape": CountParameter("threshold", 0.01, 1e6),
    "density": CountParameter("threshold", 1e-5, 1e4),
    "parsimony": CountParameter("threshold", 0.01, 1e7),
}


def prepare_ellipsoids(criterion: str, points: Array) -> Run:
    """Build graph and initial ellipsoids once; each run then merges at one threshold."""
    # numba, which the subprocess of another library does not need
    from ellipseg_ros.segmenter import Segmenter

    segmenter = Segmenter(SEGMENTS_ONLY)
    unprocessed = [points]

    def run(settings: Settings) -> Array:
        threshold = float(settings["threshold"])
        segmenter.configure(replace(SEGMENTS_ONLY, criterion=criterion, threshold=threshold))
        arrived = unprocessed.pop() if unprocessed else points[:0]
        return segmenter.process(Sweep(stamp_ns=0, points=arrived)).labels

    return run


def ellipsoids(criterion: str) -> Method:
    """The segments of one criterion."""
    return Method(
        name=f"ellipsoids, {criterion}",
        prepare=partial(prepare_ellipsoids, criterion),
        grid=({"threshold": CRITERIA[criterion].default_threshold},),
        parameter=THRESHOLDS[criterion],
    )


def prepare_objects(points: Array) -> Run:
    """Objects of segments of the criterion shape; one hierarchy gives every number of objects."""
    from ellipseg_ros.segmenter import segment  # numba, as above

    @cache
    def segmentation(threshold: float) -> Segmentation:
        return segment(points, Config(threshold=threshold))

    def run(settings: Settings) -> Array:
        segments = segmentation(float(settings["threshold"]))
        objects = segments.objects
        if objects is None:
            raise EllipsegError("the default settings give no objects; enable them")
        of_segment = objects.segment_labels
        if SEGMENTS in settings:
            merges = objects.hierarchy.merges_for_count(int(settings[SEGMENTS]))
            of_segment = objects.hierarchy.labels_after(merges)
        return np.append(of_segment, -1)[np.maximum(segments.labels, -1)]

    return run


OBJECTS = Method(
    name="objects",
    prepare=prepare_objects,
    grid=({"threshold": CRITERIA["shape"].default_threshold}, {"threshold": FINE_THRESHOLD}),
    parameter=None,
)
OURS = (*map(ellipsoids, CRITERIA), OBJECTS)
