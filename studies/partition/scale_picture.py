"""What the scale of objects does, as curves.

matplotlib, for the reasons that plots.py gives.
"""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from ellipseg_ros.plots.style import legend, save, sheet, style, title
from ellipseg_ros.plots.tuning import BLUE, ORANGE, YELLOW
from ellipseg_ros.plots.window import INK

Results = dict[str, Any]

PANELS = {
    "objects": "Objects",
    "moved_wider": "Points that change their object when the scale doubles",
    "moved_next": "Points that change their object from update to update",
    "paid": "Cost of the merges made, of all",
    "mean_iou": "Mean IoU of classes",
    "quality": "Panoptic quality of things",
}
LOGARITHMIC = "objects"
LOW = ("moved_wider", "moved_next")  # far from 1


def draw(results: Results, path: Path) -> None:
    """Write the picture: a panel a measure, a line a scene, the scale in force marked."""
    figure = sheet(19.0, 11.0)
    for number, (measure, text) in enumerate(PANELS.items()):
        axes = figure.add_subplot(2, 3, number + 1)
        style(axes)
        for scene in results["scenes"]:
            _line(axes, scene, measure)
        _mean(axes, results["scenes"], measure)
        label = f"scale in force: {results['scale']:g}"
        axes.axvline(results["scale"], color=YELLOW, linestyle="--", label=label)
        axes.set_xscale("log", base=2)
        axes.xaxis.set_major_formatter("{x:.3g}")
        if measure == LOGARITHMIC:
            axes.set_yscale("log")
            axes.yaxis.set_major_formatter("{x:,.0f}")
        else:
            axes.set_ylim(0.0, None if measure in LOW else 1.0)
        title(axes, text, "scale", "objects" if measure == LOGARITHMIC else "share")
    texts = dict(reversed(list(zip(*_legend(figure.axes[0]), strict=True))))
    legend(figure.axes[0], handles=texts.values(), labels=texts.keys())
    save(figure, path)


def _legend(axes: Axes) -> tuple[list[str], list[Any]]:
    handles, texts = axes.get_legend_handles_labels()
    return texts, handles


def _line(axes: Axes, scene: Results, measure: str) -> None:
    known = [row for row in scene["rows"] if row.get(measure) is not None]
    colour, label = (BLUE, "simulated scene") if scene["simulated"] else (ORANGE, "recording")
    scales = [row["scale"] for row in known]
    values = [row[measure] for row in known]
    axes.plot(scales, values, color=colour, label=label, alpha=0.5, linewidth=1)


def _mean(axes: Axes, scenes: list[Results], measure: str) -> None:
    """Of the scenes that have the measure at all scales; of counts, the geometric one."""
    known = [[row.get(measure) for row in scene["rows"]] for scene in scenes]
    values = np.array([line for line in known if None not in line], dtype=np.float64)
    if len(values) > 1:
        logarithmic = measure == LOGARITHMIC
        mean = np.exp(np.log(values).mean(axis=0)) if logarithmic else values.mean(axis=0)
        scales = [row["scale"] for row in scenes[0]["rows"]]
        axes.plot(scales, mean, color=INK, label="mean of the scenes", linewidth=2.5)
