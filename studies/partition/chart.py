"""Charts of the partition study: scores over the number of segments, pictures of scenes."""

from pathlib import Path
from typing import Any

from ellipseg_ros.config import Config
from ellipseg_ros.core.fields import join_sweeps
from ellipseg_ros.io.sources import Source
from ellipseg_ros.plots.style import save
from ellipseg_ros.plots.tuning import BLUE, GREEN, ORANGE, PURPLE, YELLOW
from ellipseg_ros.plots.window import INK, draw_levels
from ellipseg_ros.segmenter import Segmenter
from studies.partition.evaluation import DEFAULT, Evaluation
from studies.partition.means import groups, means, targets
from studies.report.chart import GREY, RED, Line, LinePanel, chart, common_legend

Results = dict[str, Any]

LOOKS = {  # colour, marker, dash
    "objects": (INK, "o", "-"),
    "cut-pursuit": (ORANGE, "s", "-"),
    "ellipsoids, shape": (BLUE, "^", "-"),
    "ellipsoids, density": (GREEN, "v", "-"),
    "ellipsoids, parsimony": (YELLOW, "D", "-"),
    "Open3D DBSCAN": (RED, "P", "--"),
    "Open3D planar patches": (PURPLE, "X", "--"),
    "HDBSCAN": (GREY, "*", "--"),
}
OTHER = (GREY, ".", ":")
PANELS = {
    "mean_iou": "Mean IoU of the most frequent classes",
    "purity": "Purity",
    "under_segmentation": "Under-segmentation error (less is better)",
    "boundary_recall": "Boundary recall",
    "boundary_precision": "Boundary precision",
    "cpu_s": "CPU time (less is better)",
}
TIME = "cpu_s"
WHOLE_DRIVE_S = 3600.0  # longer than any simulated drive


def draw(results: Results, path: Path) -> None:
    """Write a panel per measure, a line per method; hollow markers at default settings."""
    heading, scans = groups(results)[0]
    names = [method["name"] for method in results["methods"]]
    rows = [row for target in targets(results) for row in means(scans, names, target)]
    panels = [
        LinePanel(
            text,
            "segments",
            "s" if measure == TIME else "",
            [line for name in names for line in _lines(name, measure, rows)],
            log_x=True,
            log_y=measure == TIME,
            ticks=results["counts"],
        )
        for measure, text in PANELS.items()
    ]
    figure = chart(panels, 3, (19.0 / 3.0, 5.5))
    common_legend(figure, 8)
    what = f"{heading}: means over clouds on which the methods shown reached the target"
    figure.suptitle(f"{what}; hollow: default settings", color=INK, x=0.01, ha="left", size=13)
    save(figure, path)


def draw_scene(source: Source, path: Path) -> None:
    """Write a picture of a whole drive: by segment, by object, by truth."""
    config = Config(window_duration=WHOLE_DRIVE_S)
    draw_levels(Segmenter(config).process(join_sweeps(list(source))), path)


def _lines(name: str, measure: str, rows: list[Evaluation]) -> list[Line]:
    """The line of a method over the target counts, and its marker at default settings."""
    colour, marker, dash = LOOKS.get(name, OTHER)
    floor = 0.0 if measure == TIME else -1.0  # the time axis is logarithmic
    shown = [row for row in rows if row["method"] == name and row[measure] is not None]
    shown = [row for row in shown if row[measure] > floor]
    points = sorted((row["count"], row[measure]) for row in shown if row["target"] != DEFAULT)
    default = [(row["count"], row[measure]) for row in shown if row["target"] == DEFAULT]
    lines = []
    if points:
        x, y = zip(*points, strict=True)
        lines.append(Line(x, y, name, colour, dash, marker))
    if default:
        x, y = zip(*default, strict=True)
        label = "" if points else name
        lines.append(Line(x, y, label, colour, "none", marker, hollow=True))
    return lines
