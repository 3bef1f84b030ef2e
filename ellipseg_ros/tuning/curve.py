"""The AICc of one window over the threshold."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ellipseg_ros.records import Array

MIN_THRESHOLD = 1e-300  # in place of a threshold of 0, which has no logarithm


@dataclass(frozen=True)
class Curve:
    """AICc and number of segments of one window by threshold; t thresholds, ascending."""

    criterion: str
    points: int  # that have neighbours: the vertices of the graph
    singletons: float  # AICc of the model in which every point is a segment of its own
    threshold: Array  # (t,) float64, in the unit of the criterion
    aicc: Array  # (t,) float64: the sum over all segments, singletons included
    bias: Array  # (t,) its part that grows with the number of parameters
    count: Array  # (t,) int64: segments, the model's ellipsoids

    @property
    def variance(self) -> Array:
        """(t,) the part of the AICc that says how well the ellipsoids explain the points."""
        return np.asarray(self.aicc - self.bias)

    @property
    def completion(self) -> Array:
        """(t,) merges per point, 0 to 1: the paper's merge completion."""
        return np.asarray((self.points - self.count) / max(1, self.points))

    @property
    def best(self) -> int:
        """The row of the least AICc; of equal ones the lowest threshold."""
        return int(np.argmin(self.aicc))

    @property
    def loss(self) -> Array:
        """(t,) share of the possible gain by merging that is lost: 0 at the least AICc.

        (AICc - least) / (AICc of singletons - least). Where no merging gains anything: 0 at the
        least AICc, 1 elsewhere.
        """
        lost = self.aicc - self.aicc[self.best]
        gain = self.singletons - self.aicc[self.best]
        return np.asarray(lost / gain if gain > 0.0 else (lost > 0.0).astype(np.float64))

    def row(self, threshold: float) -> int:
        """The row of a threshold that is among those of the curve."""
        return int(np.flatnonzero(self.threshold == threshold)[0])

    def loss_at(self, thresholds: Array) -> Array:
        """The loss at any thresholds (m,); see `at`."""
        return self.at(thresholds, self.loss)

    def at(self, thresholds: Array, values: Array) -> Array:
        """Values (t,) at any thresholds (m,): between those of the curve linear in log threshold.

        Beyond the ends they are those at the end.
        """
        logs = [np.log(np.maximum(x, MIN_THRESHOLD)) for x in (thresholds, self.threshold)]
        return np.interp(*logs, values)

    def with_rows_of(self, other: "Curve") -> "Curve":
        """The curve joined with another one of the same window."""
        threshold = np.concatenate([self.threshold, other.threshold])
        threshold, rows = np.unique(threshold, return_index=True)
        pairs = {name: (getattr(self, name), getattr(other, name)) for name in VALUES}
        joined = {name: np.concatenate(pair)[rows] for name, pair in pairs.items()}
        return replace(self, threshold=threshold, **joined)

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready; `curve_from` reads it."""
        head = {name: getattr(self, name) for name in ("criterion", "points", "singletons")}
        return head | {name: getattr(self, name).tolist() for name in COLUMNS}


VALUES = ("aicc", "bias", "count")
COLUMNS = ("threshold", "aicc", "variance", "bias", "count", "completion", "loss")


def curve_from(values: dict[str, Any]) -> Curve:
    """The curve from the output of `Curve.as_dict`."""
    arrays = {name: np.array(values[name]) for name in ("threshold", *VALUES)}
    return Curve(values["criterion"], values["points"], values["singletons"], **arrays)
