"""Numbers of every scene at the minima of its AICc, by which the findings are judged."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ellipseg_ros.config import Config
from ellipseg_ros.core.criteria import CRITERIA
from ellipseg_ros.errors import InputError
from ellipseg_ros.io.sources import SIMULATED, Source
from ellipseg_ros.records import Array, Segmentation
from ellipseg_ros.segmenter import segment
from ellipseg_ros.tuning.curve import Curve
from ellipseg_ros.tuning.tasks import Curves, in_force
from ellipseg_ros.tuning.windows import Cut, windows

Facts = dict[str, Any]  # JSON-ready

SMALL = 12  # points; an ellipsoid has 9 parameters, so fewer points hardly determine one
KINDS = ("simulated", "recorded")


@dataclass(frozen=True)
class Scene:
    """One window and its curves."""

    name: str
    kind: str  # one of KINDS
    cut: Cut
    curves: Curves

    def at_minimum(self, criterion: str, config: Config) -> Segmentation:
        """The window segmented at the threshold of lowest AICc."""
        config = with_threshold(config, self.curves[criterion])
        return segment(self.cut.points, config, self.cut.origin)


def kind_of(spec: str) -> str:
    """The kind of a source: simulated or recorded."""
    return KINDS[0] if spec.startswith(SIMULATED) else KINDS[1]


def first_window(source: Source, config: Config) -> Cut:
    """The first window of a source; InputError if it has no points."""
    cut = next(windows(source.name, source, config), None)
    if cut is None or not len(cut.points):
        raise InputError(
            f"{source.name} has no points; the study needs a window of points", "empty"
        )
    return cut


def with_threshold(config: Config, curve: Curve) -> Config:
    """`config` with the criterion of the curve, at its minimum."""
    threshold = float(curve.threshold[curve.best])
    return replace(config, criterion=curve.criterion, threshold=threshold)


def scene_facts(scene: Scene) -> Facts:
    """Properties of the window; `criteria` is to be filled with `criterion_facts`."""
    cut = scene.cut
    seconds = round(cut.end_s - cut.start_s, 1)
    return {
        "name": scene.name,
        "kind": scene.kind,
        "points": len(cut.points),
        "seconds": seconds,
        "criteria": {},
    }


def criterion_facts(curve: Curve, segmentation: Segmentation, config: Config) -> Facts:
    """Numbers of a curve and of the segmentation at its minimum; AICc and its terms per point.

    size_m: median over the points of the geometric mean of the semi-axes (1 sigma) of their
    ellipsoid. half: number of largest segments that hold half of the points.
    """
    best, points = curve.best, max(1, curve.points)
    count = segmentation.ellipsoids.count
    default = in_force(config, curve.criterion).tau
    size = np.prod(segmentation.ellipsoids.eigenvalues, axis=1) ** (1.0 / 6.0)
    return {
        "threshold": float(curve.threshold[best]),
        "aicc": float(curve.aicc[best]) / points,
        "variance": float(curve.variance[best]) / points,
        "bias": float(curve.bias[best]) / points,
        "singletons": curve.singletons / points,
        "count": int(curve.count[best]),
        "completion": float(curve.completion[best]),
        "loss_at_lowest": float(curve.loss[0]),
        "loss_at_highest": float(curve.loss[-1]),
        "default": default,
        "loss_at_default": float(curve.loss[curve.row(default)]),
        "small": int((count < SMALL).sum()),
        "largest": float(count.max(initial=0)) / points,
        "half": _count_of_half(count),
        "size_m": _weighted_median(size, count),
    }


def shared(curves: Iterable[Curve]) -> Facts:
    """The threshold with the lowest maximum loss over the curves (at least one), and that loss."""
    curves = list(curves)
    candidates = np.unique(np.concatenate([curve.threshold for curve in curves]))
    worst = np.array([curve.loss_at(candidates) for curve in curves]).max(axis=0)
    best = int(np.argmin(worst))
    return {"threshold": float(candidates[best]), "worst_loss": float(worst[best])}


def shared_facts(scenes: list[Scene]) -> Facts:
    """`shared` by criterion, and by kind of scene or "all", if there are such scenes."""
    groups = {kind: [s for s in scenes if s.kind == kind] for kind in KINDS} | {"all": scenes}
    return {
        name: {
            kind: shared(scene.curves[name] for scene in group)
            for kind, group in groups.items()
            if group
        }
        for name in CRITERIA
    }


def _count_of_half(count: Array) -> int:
    held = np.cumsum(np.sort(count)[::-1])
    return int(np.searchsorted(held, 0.5 * held[-1]) + 1) if len(held) else 0


def _weighted_median(values: Array, weights: Array) -> float:
    order = np.argsort(values, kind="stable")
    held = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(held, 0.5 * held[-1])]) if len(held) else 0.0
