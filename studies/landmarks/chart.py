"""Repeatability as a chart."""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from ellipseg_ros.plots.style import title
from ellipseg_ros.plots.tuning import BLUE, ORANGE
from ellipseg_ros.plots.window import INK
from studies.landmarks.candidates import OURS
from studies.landmarks.study import (
    Results,
    compared_runs,
    methods_of,
    repeated_shares,
    runs_with,
)
from studies.report.chart import draw_chart


def draw(results: Results, path: Path) -> None:
    """Write a panel per scene, with a bar per method and a dot per run."""
    runs = compared_runs(results) or results["runs"]
    methods = methods_of(runs)[::-1]
    panels = [
        partial(_draw_scene, scene=scene, runs=runs_with(runs, scene=scene), methods=methods)
        for scene in results["scenes"]
    ]
    draw_chart(path, panels, columns=len(panels), size=(7.5, 1.8 + 0.45 * len(methods)))


def _draw_scene(axes: Axes, scene: str, runs: list[dict[str, Any]], methods: list[str]) -> None:
    for row, method in enumerate(methods):
        of_method = runs_with(runs, method=method)
        shares = repeated_shares(of_method, "all")
        count = np.mean([n for run in of_method for n in run["landmarks"]])
        axes.barh(row, np.mean(shares), 0.6, color=ORANGE if method == OURS.name else BLUE)
        axes.plot(shares, [row] * len(shares), ".", color=INK, markersize=5)
        axes.text(1.02, row, f"{count:,.0f}", color=INK, fontsize=9, va="center")
    axes.text(1.02, len(methods) - 0.4, "per window", color=INK, fontsize=9)
    axes.set_yticks(range(len(methods)), methods)
    axes.set_xlim(0.0, 1.0)
    axes.set_ylim(-0.6, len(methods) - 0.1)
    title(axes, scene, "share repeated of the landmarks visible to the other drive")
