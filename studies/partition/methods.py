"""What a method is, and those of this package."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from typing import TypeAlias

import numpy as np

from ellipseg_ros.config import (
    CRITERIA,
    DEFAULT_THRESHOLDS,
    Config,
    LandmarksConfig,
    ObjectsConfig,
)
from ellipseg_ros.errors import EllipsegError
from ellipseg_ros.records import Array, Segmentation, Sweep

Settings: TypeAlias = dict[str, float | str]  # JSON-ready
Run: TypeAlias = Callable[[Settings], Array]  # -> (n,) labels, negative: none


@dataclass(frozen=True)
class Dial:
    """The setting by which a method comes to a wanted number of segments: more makes fewer."""

    name: str
    low: float
    high: float
    whole: bool = False  # whole numbers only


@dataclass(frozen=True)
class Method:
    """A way to cut a cloud into segments."""

    name: str
    prepare: Callable[[Array], Run]  # points (n, 3) m; what is prepared serves many runs
    grid: tuple[Settings, ...]  # its own settings; of several, the best is shown
    dial: Dial | None  # None: `segments` is a setting, and is met
    package: str = ""  # on PyPI; of others
    module: str = ""


ALONE = ObjectsConfig(enabled=False)  # ellipsoids without a second level
FINE = 2.0  # threshold of smaller ellipsoids for more objects
NONE = LandmarksConfig(enabled=False)
SEGMENTS = "segments"  # setting of a method without a dial
DIALS = {
    "shape": Dial("threshold", 0.01, 1e6),
    "density": Dial("threshold", 1e-5, 1e4),
    "parsimony": Dial("threshold", 0.01, 1e7),
}


def prepare_ellipsoids(criterion: str, points: Array) -> Run:
    """Graph and initial ellipsoids once, then a merge for every threshold, equal to a batch."""
    from ellipseg_ros.segmenter import Segmenter  # numba, which a process of a peer does not need

    segmenter = Segmenter(Config(objects=ALONE, landmarks=NONE))
    waiting = [points]

    def run(settings: Settings) -> Array:
        config = Config(criterion, float(settings["threshold"]), objects=ALONE, landmarks=NONE)
        segmenter.configure(config)
        new = waiting.pop() if waiting else points[:0]
        return segmenter.process(Sweep(stamp_ns=0, points=new)).labels

    return run


def ellipsoids(criterion: str) -> Method:
    """The segments of one criterion."""
    return Method(
        name=f"ellipsoids, {criterion}",
        prepare=partial(prepare_ellipsoids, criterion),
        grid=({"threshold": DEFAULT_THRESHOLDS[criterion]},),
        dial=DIALS[criterion],
    )


def prepare_objects(points: Array) -> Run:
    """Objects of segments of the criterion shape; one hierarchy gives every number of them."""
    from ellipseg_ros.segmenter import segment  # numba, as above

    @cache
    def found(threshold: float) -> Segmentation:
        return segment(points, Config(threshold=threshold))

    def run(settings: Settings) -> Array:
        segments = found(float(settings["threshold"]))
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
    grid=({"threshold": DEFAULT_THRESHOLDS["shape"]}, {"threshold": FINE}),
    dial=None,
)
OURS = (*map(ellipsoids, CRITERIA), OBJECTS)
