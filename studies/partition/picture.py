"""Quality against the number of segments, as curves; and what segments and objects look like.

matplotlib, for the reasons that plots.py gives.
"""

from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator, NullLocator

from ellipseg_ros.config import Config
from ellipseg_ros.io.sources import Source
from ellipseg_ros.plots.style import legend, save, sheet, style, title
from ellipseg_ros.plots.window import INK, draw_levels
from ellipseg_ros.records import join_sweeps
from ellipseg_ros.segmenter import Segmenter
from studies.partition.cells import OWN
from studies.partition.means import kinds, means

Results = dict[str, Any]

# Okabe and Ito (2008), Color universal design; a marker each, for those who see no colours.
LOOKS = {
    "objects": ("#ffffff", "o", "-"),
    "cut-pursuit": ("#e69f00", "s", "-"),
    "ellipsoids, shape": ("#56b4e9", "^", "-"),
    "ellipsoids, density": ("#009e73", "v", "-"),
    "ellipsoids, parsimony": ("#f0e442", "D", "-"),
    "Open3D DBSCAN": ("#d55e00", "P", "--"),
    "Open3D planar patches": ("#cc79a7", "X", "--"),
    "HDBSCAN": ("#999999", "*", "--"),
}
OTHER = ("#8b949e", ".", ":")
PANELS = {
    "mean_iou": "Mean IoU by majority class",
    "purity": "Purity",
    "under_segmentation": "Under-segmentation error (less is better)",
    "boundary_recall": "Boundary recall",
    "boundary_precision": "Boundary precision",
    "cpu_s": "CPU time (less is better)",
}
LOGARITHMIC = "cpu_s"
LONG = 3600.0  # s: longer than a simulated drive can be


def draw(results: Results, path: Path) -> None:
    """Write the picture: a panel a measure, a line a method, hollow marks at own numbers."""
    heading, scans = kinds(results)[0]
    names = [method["name"] for method in results["methods"]]
    curves = {wanted: means(scans, names, wanted) for wanted in (OWN, *results["counts"])}
    figure = sheet(19.0, 11.0)
    for number, (measure, text) in enumerate(PANELS.items()):
        axes = figure.add_subplot(2, 3, number + 1)
        style(axes)
        for name in names:
            _line(axes, name, measure, curves)
        _scales(axes, measure, results["counts"])
        title(axes, text, "segments", "s" if measure == LOGARITHMIC else "")
    shown, texts = figure.axes[0].get_legend_handles_labels()
    if shown:
        legend(figure, handles=shown, labels=texts, loc="outside lower left", ncols=8)
    what = f"{heading}: means over clouds on which the methods shown came to the number"
    figure.suptitle(f"{what}; hollow: own number", color=INK, x=0.01, ha="left", size=13)
    save(figure, path)


def draw_scene(source: Source, path: Path) -> None:
    """Write a picture of a whole drive: by segment, by object, by truth."""
    config = Config(window_duration=LONG)
    draw_levels(Segmenter(config).process(join_sweeps(list(source))), path)


def _line(axes: Axes, name: str, measure: str, curves: dict[Any, list[Results]]) -> None:
    colour, marker, dash = LOOKS.get(name, OTHER)
    found = [row for group in curves.values() for row in group if row["method"] == name]
    least = 0.0 if measure == LOGARITHMIC else -1.0
    found = [row for row in found if row[measure] is not None and row[measure] > least]
    line = sorted((row["count"], row[measure]) for row in found if row["wanted"] != OWN)
    own = [(row["count"], row[measure]) for row in found if row["wanted"] == OWN]
    look: dict[str, Any] = {"color": colour, "marker": marker}
    if line:
        axes.plot(*zip(*line, strict=True), linestyle=dash, label=name, **look)
    if own:
        look |= {"fillstyle": "none", "linestyle": "none", "markersize": 11}
        axes.plot(*zip(*own, strict=True), label="" if line else name, **look)


def _scales(axes: Axes, measure: str, counts: list[int]) -> None:
    axes.set_xscale("log")
    axes.set_xticks(counts, [f"{count:,}" for count in counts])
    axes.xaxis.set_minor_locator(NullLocator())
    if measure == LOGARITHMIC and axes.lines:
        axes.set_yscale("log")
        axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.yaxis.set_major_formatter("{x:g}")
        axes.yaxis.set_minor_locator(NullLocator())
