"""The chart of the study of the object scale."""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from ellipseg_ros.plots.style import save, title
from ellipseg_ros.plots.tuning import BLUE, ORANGE, YELLOW
from ellipseg_ros.plots.window import INK
from studies.report.chart import Line, chart, common_legend, draw_line

Results = dict[str, Any]

PANELS = {
    "objects": "Objects",
    "moved_doubled": "Points that change their object when the scale doubles",
    "moved_next": "Points that change their object from update to update",
    "cost_share": "Cost of the merges that are made",
    "mean_iou": "Mean IoU of classes",
    "quality": "Panoptic quality of instances",
}
COUNT = "objects"  # the measure that is no share
SMALL = ("moved_doubled", "moved_next")  # far below 1


def draw(results: Results, path: Path) -> None:
    """Write a panel per measure, a line per scene, with the current scale marked."""
    panels = [partial(_panel, results=results, measure=measure) for measure in PANELS]
    figure = chart(panels, 3, (19.0 / 3.0, 5.5))
    common_legend(figure, 4)
    save(figure, path)


def _panel(axes: Axes, results: Results, measure: str) -> None:
    for scene in results["scenes"]:
        rows = [row for row in scene["rows"] if row.get(measure) is not None]
        colour, label = (BLUE, "simulated") if scene["simulated"] else (ORANGE, "recorded")
        scales, values = [row["scale"] for row in rows], [row[measure] for row in rows]
        draw_line(axes, Line(scales, values, label, colour, width=1.0, alpha=0.5))
    _draw_mean(axes, results["scenes"], measure)
    current = results["scale"]
    axes.axvline(current, color=YELLOW, linestyle="--", label=f"current scale: {current:g}")
    axes.set_xscale("log", base=2)
    axes.xaxis.set_major_formatter("{x:.3g}")
    if measure == COUNT:
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter("{x:,.0f}")
    else:
        axes.set_ylim(0.0, None if measure in SMALL else 1.0)
    title(axes, PANELS[measure], "scale", "objects" if measure == COUNT else "share")


def _draw_mean(axes: Axes, scenes: list[Results], measure: str) -> None:
    """The mean of the scenes that have the measure at all scales; of counts, the geometric one."""
    curves = [[row.get(measure) for row in scene["rows"]] for scene in scenes]
    values = np.array([curve for curve in curves if None not in curve], dtype=np.float64)
    if len(values) < 2:
        return
    logs = measure == COUNT
    mean = np.exp(np.log(values).mean(axis=0)) if logs else values.mean(axis=0)
    scales = [row["scale"] for row in scenes[0]["rows"]]
    draw_line(axes, Line(scales, mean.tolist(), "mean of the scenes", INK, width=2.5))
