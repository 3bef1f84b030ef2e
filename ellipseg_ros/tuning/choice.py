"""One threshold for many windows."""

from dataclasses import dataclass

import numpy as np

from ellipseg_ros.tuning.curve import Curve


@dataclass(frozen=True)
class Choice:
    """The threshold that is best over all windows, and what it costs in each.

    Best is the lowest mean loss. The loss of a window is relative to what merging gains in it, so
    that all have the same weight, whatever their number of points. The worst loss is reported, but
    does not decide: it would depend on a single odd window and its noise.
    """

    criterion: str
    windows: int
    threshold: float
    mean_loss: float
    worst_loss: float
    present: float  # the threshold in force, for comparison
    present_mean_loss: float
    present_worst_loss: float
    lowest_minimum: float  # of the windows' own best thresholds
    median_minimum: float
    highest_minimum: float
    at_end: bool  # the minimum of a window lies at an end of its thresholds


def choose(curves: list[Curve], present: float) -> Choice:
    """Choose among all thresholds of the curves (at least one), all of one criterion.

    present: the threshold in force. The loss between the thresholds of a curve is interpolated.
    """
    candidates = np.unique(np.concatenate([curve.threshold for curve in curves]))
    losses = np.array([curve.loss_at(candidates) for curve in curves])
    best = int(np.argmin(losses.mean(axis=0)))
    at_present = np.array([curve.loss_at(np.array([present]))[0] for curve in curves])
    minima = np.array([curve.threshold[curve.best] for curve in curves])
    return Choice(
        criterion=curves[0].criterion,
        windows=len(curves),
        threshold=float(candidates[best]),
        mean_loss=float(losses[:, best].mean()),
        worst_loss=float(losses[:, best].max()),
        present=present,
        present_mean_loss=float(at_present.mean()),
        present_worst_loss=float(at_present.max()),
        lowest_minimum=float(minima.min()),
        median_minimum=float(np.median(minima)),
        highest_minimum=float(minima.max()),
        at_end=any(curve.best in (0, len(curve.threshold) - 1) for curve in curves),
    )
