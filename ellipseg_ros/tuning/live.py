"""Tuning while the vehicle drives: the search, and when its result changes the threshold."""

import json
from dataclasses import dataclass

import numpy as np

from ellipseg_ros.tuning.choice import choose
from ellipseg_ros.tuning.curve import COLUMNS, Curve
from ellipseg_ros.tuning.search import Search

LIVE_SEARCH = Search(count=24, refinements=1, finer=6)  # a third of the work of the offline search
MIN_LOSS = 0.02  # at the present threshold: a smaller loss is not worth a change
MIN_CURVES = 2  # consecutive curves that must favour a change in the same direction


@dataclass(frozen=True)
class Decision:
    """The threshold that a curve leads to."""

    present: float  # the threshold in force when the window was segmented
    threshold: float  # to use from now on; `present` for no change
    reason: str

    @property
    def changed(self) -> bool:
        """Whether the threshold is to be changed."""
        return self.threshold != self.present


class Hysteresis:
    """Changes the threshold only where the gain is clear, so as not to follow noise.

    Where the loss at the present threshold is above MIN_LOSS in MIN_CURVES curves in a row, and
    all have their minimum on the same side of it, the least mean loss of these curves decides.
    """

    def __init__(self) -> None:
        self._present = 0.0
        self._curves: list[Curve] = []  # consecutive, that favour the same direction

    def decide(self, curve: Curve, present: float) -> Decision:
        """Decide after one more curve, which must include the threshold in force."""
        kept = self._curves if present == self._present else []
        self._present, self._curves = present, []
        side = _side(curve, present)
        loss = float(curve.loss[curve.row(present)])
        if loss <= MIN_LOSS:
            return Decision(present, present, f"loss {loss:.4f} is small enough")
        same = [k for k in kept if k.criterion == curve.criterion and _side(k, present) == side]
        self._curves = [*same, curve]
        if len(self._curves) < MIN_CURVES:
            return Decision(present, present, f"loss {loss:.4f}; waiting for another such curve")
        threshold = choose(self._curves, present).threshold
        self._curves = []
        return Decision(present, threshold, f"loss {loss:.4f} in {MIN_CURVES} curves in a row")


def decide_by_one(curve: Curve, present: float) -> Decision:
    """Decide for the best threshold of one curve, as on request."""
    loss = float(curve.loss[curve.row(present)])
    if loss == 0.0:
        return Decision(present, present, "it is the best already")
    return Decision(present, float(curve.threshold[curve.best]), f"loss {loss:.4f} before")


def report(curve: Curve, decision: Decision) -> str:
    """The curve as a table, and in the last line as JSON."""
    change = f"-> {decision.threshold:.4g}" if decision.changed else "stays"
    lines = [
        f"{curve.criterion}: threshold {decision.present:g} {change} ({decision.reason}); "
        f"{curve.points:,} points",
        f"{'threshold':>10} {'AICc':>13} {'variance':>13} {'bias':>12} {'ellipsoids':>10} "
        f"{'merged':>7} {'loss':>7}",
    ]
    row = "{:>10.4g} {:>13.6g} {:>13.6g} {:>12.5g} {:>10,} {:>7.1%} {:>7.4f}"
    columns = [getattr(curve, name) for name in COLUMNS]
    lines += [row.format(*values) for values in zip(*columns, strict=True)]
    facts = {"present": decision.present, "chosen": decision.threshold, "reason": decision.reason}
    return "\n".join([*lines, json.dumps(facts | curve.as_dict())])


def _side(curve: Curve, present: float) -> int:
    """Whether the minimum lies above (1), below (-1) or at (0) a threshold."""
    return int(np.sign(curve.threshold[curve.best] - present))
