"""Repeatability as a chart.

matplotlib, for the reasons that plots.py gives.
"""

from pathlib import Path

import numpy as np

from ellipseg_ros.plots.style import save, sheet, style, title
from ellipseg_ros.plots.window import INK
from studies.landmarks.study import Results, share

OURS, OTHER = "#e69f00", "#56b4e9"  # Okabe and Ito (2008), Color universal design


def draw(results: Results, path: Path) -> None:
    """Write the picture: a panel a scene, a bar a method, a dot a run."""
    few = {run["seed"] for run in results["runs"] if run["method"] != "landmarks"}
    runs = [run for run in results["runs"] if not few or run["seed"] in few]
    names = list(dict.fromkeys(run["method"] for run in runs))[::-1]
    figure = sheet(7.5 * len(results["scenes"]), 1.8 + 0.45 * len(names))
    for number, scene in enumerate(results["scenes"]):
        axes = figure.add_subplot(1, len(results["scenes"]), number + 1)
        style(axes)
        for row, name in enumerate(names):
            ours = [run for run in runs if run["method"] == name and run["scene"] == scene]
            values = share(ours, "all")
            count = np.mean([n for run in ours for n in run["landmarks"]])
            axes.barh(row, np.mean(values), 0.6, color=OURS if name == "landmarks" else OTHER)
            axes.plot(values, [row] * len(values), ".", color=INK, markersize=5)
            axes.text(1.02, row, f"{count:,.0f}", color=INK, fontsize=9, va="center")
        axes.text(1.02, len(names) - 0.4, "a window", color=INK, fontsize=9)
        axes.set_yticks(range(len(names)), names if number == 0 else [""] * len(names))
        axes.set_xlim(0.0, 1.0)
        axes.set_ylim(-0.6, len(names) - 0.1)
        title(axes, scene, "share found again, of those seen by the other pass")
    save(figure, path)
