"""Tuning while the vehicle drives: what is tried, and when a change is worth it."""

import json
from dataclasses import dataclass

import numpy as np

from ellipseg_ros.tuning.choice import choose
from ellipseg_ros.tuning.curve import Curve
from ellipseg_ros.tuning.search import Search

LIVE = Search(count=24, refinements=1, finer=6)  # a third of the work of the offline search
CLEAR_LOSS = 0.02  # at the present threshold: less is not worth a change
AGREEING = 2  # curves in a row that must ask for a change in the same direction


@dataclass(frozen=True)
class Verdict:
    """What one curve leads to."""

    present: float  # the threshold in force when the window was segmented
    threshold: float  # the one to use from now on; `present` for no change
    reason: str

    @property
    def changed(self) -> bool:
        """Whether the threshold is to be changed."""
        return self.threshold != self.present


class Hysteresis:
    """Changes the threshold only where the gain is clear, so that it does not follow noise.

    Where the loss at the present threshold is above CLEAR_LOSS in AGREEING curves in a row, and
    all have their minimum on the same side of it, the least mean loss of these curves decides.
    """

    def __init__(self) -> None:
        self._present = 0.0
        self._curves: list[Curve] = []  # in a row, that ask for the same

    def judge(self, curve: Curve, present: float) -> Verdict:
        """Take the next curve, which must hold the threshold in force."""
        kept = self._curves if present == self._present else []
        self._present, self._curves = present, []
        side = _side(curve, present)
        loss = float(curve.loss[curve.row(present)])
        if loss <= CLEAR_LOSS:
            return Verdict(present, present, f"loss {loss:.4f} is small enough")
        same = [k for k in kept if k.criterion == curve.criterion and _side(k, present) == side]
        self._curves = [*same, curve]
        if len(self._curves) < AGREEING:
            return Verdict(present, present, f"loss {loss:.4f}; waiting for another such curve")
        threshold = choose(self._curves, present).threshold
        self._curves = []
        return Verdict(present, threshold, f"loss {loss:.4f} in {AGREEING} curves in a row")


def at_once(curve: Curve, present: float) -> Verdict:
    """The best threshold of one curve, as somebody has asked for it."""
    loss = float(curve.loss[curve.row(present)])
    if loss == 0.0:
        return Verdict(present, present, "it is the best already")
    return Verdict(present, float(curve.threshold[curve.best]), f"loss {loss:.4f} before")


def report(curve: Curve, verdict: Verdict) -> str:
    """The curve for people, and in the last line as JSON."""
    went = f"-> {verdict.threshold:.4g}" if verdict.changed else "stays"
    lines = [
        f"{curve.criterion}: threshold {verdict.present:g} {went} ({verdict.reason}); "
        f"{curve.points:,} points",
        f"{'threshold':>10} {'AICc':>13} {'variance':>13} {'bias':>12} {'ellipsoids':>10} "
        f"{'merged':>7} {'loss':>7}",
    ]
    columns = (curve.aicc, curve.variance, curve.bias, curve.count, curve.completion, curve.loss)
    for threshold, aicc, variance, bias, count, merged, loss in zip(
        curve.threshold, *columns, strict=True
    ):
        lines.append(
            f"{threshold:>10.4g} {aicc:>13.6g} {variance:>13.6g} {bias:>12.5g} {count:>10,} "
            f"{merged:>7.1%} {loss:>7.4f}"
        )
    facts = {"present": verdict.present, "chosen": verdict.threshold, "reason": verdict.reason}
    return "\n".join([*lines, json.dumps(facts | curve.as_dict())])


def _side(curve: Curve, present: float) -> int:
    """Whether the minimum lies above (1) or below (-1) a threshold, or there (0)."""
    return int(np.sign(curve.threshold[curve.best] - present))
