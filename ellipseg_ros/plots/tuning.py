"""Charts of a tuning: AICc, its terms, and the loss over the threshold."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from ellipseg_ros.core.criteria import CRITERIA
from ellipseg_ros.plots.style import legend, save, sheet, style, title
from ellipseg_ros.plots.window import BACKGROUND, INK
from ellipseg_ros.records import Array
from ellipseg_ros.tuning.choice import Choice
from ellipseg_ros.tuning.curve import Curve

# Okabe & Ito (2008): distinguishable with any colour vision.
BLUE, ORANGE, GREEN, PURPLE, YELLOW = "#56b4e9", "#e69f00", "#009e73", "#cc79a7", "#f0e442"
MAX_SHOWN_LOSS = 0.5  # upper end of the axis; singletons have 1


def draw_tuning(curves: Sequence[Curve], choice: Choice, paths: Sequence[Path]) -> None:
    """Three panels: the AICc with its terms, the AICc over merge completion, the loss.

    curves: of the windows (at least one), all of one criterion. paths: files of the figure.
    """
    figure = sheet(19.0, 5.8)
    panels = figure.subplots(1, 3)
    for axes in panels:
        style(axes)
    terms(panels[0], curves, choice)
    completion(panels[1], curves)
    loss_over_threshold(panels[2], curves, choice)
    for path in paths:
        save(figure, path)


def terms(axes: Axes, curves: Sequence[Curve], choice: Choice) -> None:
    """AICc, variance and bias term over the threshold, summed over the windows."""
    points = max(1, sum(curve.points for curve in curves))
    thresholds = _thresholds(curves)
    labels = {"aicc": "AICc", "variance": "variance term", "bias": "bias term"}
    for (name, label), colour in zip(labels.items(), (INK, BLUE, ORANGE), strict=True):
        total = sum(curve.at(thresholds, getattr(curve, name)) for curve in curves)
        axes.semilogx(thresholds, total / points, color=colour, linewidth=2, label=label)
        if name == "aicc":
            row = int(np.argmin(np.abs(thresholds - choice.threshold)))
            mark(axes, choice.threshold, float(total[row]) / points, f"τ = {choice.threshold:.3g}")
    over = "one window" if len(curves) == 1 else f"{len(curves)} windows together"
    text = f"AICc, criterion {choice.criterion}, {over}"
    title(
        axes, text, threshold_label(choice.criterion, f" of {choice.criterion}"), "AICc per point"
    )
    legend(axes)


def completion(axes: Axes, curves: Sequence[Curve]) -> None:
    """AICc over merge completion: a line per window, each with its minimum."""
    for curve in curves:
        aicc = curve.aicc / max(1, curve.points)
        axes.plot(100.0 * curve.completion, aicc, color=BLUE, alpha=_opacity(curves))
    best = np.array([[c.completion[c.best], c.aicc[c.best] / max(1, c.points)] for c in curves])
    axes.plot(100.0 * best[:, 0], best[:, 1], "o", color=YELLOW, label="minimum of the window")
    if len(curves) == 1:
        count = curves[0].count[curves[0].best]
        text = f"{count:,} ellipsoids\n{best[0, 0]:.1%} merged"
        mark(axes, 100.0 * best[0, 0], best[0, 1], text, (-100.0, 6.0))
    text = "AICc over merge completion"
    title(axes, text, "merge completion: merges per point [%]", "AICc per point")
    legend(axes)


def loss_over_threshold(axes: Axes, curves: Sequence[Curve], choice: Choice) -> None:
    """The loss over the threshold near the minimum: a line per window, and their mean."""
    thresholds = _thresholds(curves)
    losses = np.array([curve.loss_at(thresholds) for curve in curves])
    if len(curves) > 1:
        lines = axes.plot(thresholds, losses.T, color=BLUE, alpha=_opacity(curves))
        lines[0].set_label("window")
    mean = losses.mean(axis=0)
    label = "mean" if len(curves) > 1 else "loss"
    axes.plot(thresholds, mean, color=INK, linewidth=2, label=label)
    label = f"present: {choice.present:g}"
    axes.axvline(choice.present, color=PURPLE, linestyle="--", label=label)
    axes.axhline(0.05, color=GREEN, linestyle=":", label="loss 0.05")
    mark(axes, choice.threshold, choice.mean_loss, f"τ = {choice.threshold:.3g}")
    near = thresholds[mean <= MAX_SHOWN_LOSS]
    limits = (near[0] / 1.5, near[-1] * 1.5)
    axes.set(xscale="log", xlim=limits, ylim=(-0.02, MAX_SHOWN_LOSS))
    text = "Loss: (AICc − minimum) / (AICc of singletons − minimum)"
    title(axes, text, threshold_label(choice.criterion, f" of {choice.criterion}"), "loss")
    legend(axes, loc="upper right")


def threshold_label(criterion: str, of: str = "") -> str:
    """Label of an axis of thresholds, with the unit; of: what the threshold belongs to."""
    unit = CRITERIA[criterion].unit
    return f"threshold τ{of}" + (f" [{unit}]" if unit else "")


def _thresholds(curves: Sequence[Curve]) -> Array:
    """All thresholds of some curves above 0, ascending."""
    thresholds = np.unique(np.concatenate([curve.threshold for curve in curves]))
    return thresholds[thresholds > 0.0]


def _opacity(curves: Sequence[Curve]) -> float:
    """Opacity of a line: the lower, the more there are."""
    return float(np.clip(3.0 / len(curves), 0.15, 0.9))


def mark(
    axes: Axes, x: float, y: float, text: str, offset: tuple[float, float] = (0.0, 34.0)
) -> None:
    """Mark a point with a text at an offset in points, in a box that hides the lines behind."""
    axes.plot([x], [y], "o", color=YELLOW, markersize=7, zorder=5)
    place: Any = {"xytext": offset, "textcoords": "offset points", "ha": "center"}
    box = {"boxstyle": "round", "facecolor": BACKGROUND, "edgecolor": "none", "alpha": 0.85}
    line = {"arrowstyle": "-", "color": YELLOW}
    axes.annotate(text, (x, y), color=YELLOW, fontsize=11, bbox=box, arrowprops=line, **place)
