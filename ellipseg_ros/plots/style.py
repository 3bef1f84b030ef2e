"""The style of all charts, with the dark background of the pictures (see window.py)."""

from pathlib import Path
from typing import Any

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from ellipseg_ros.io.atomic_files import replacing
from ellipseg_ros.plots.window import BACKGROUND, FAINT, INK


def sheet(wide: float, tall: float) -> Figure:
    """An empty figure; sizes in inches."""
    layout = ConstrainedLayoutEngine(w_pad=0.25, h_pad=0.25)
    return Figure((wide, tall), facecolor=BACKGROUND, layout=layout)


def save(figure: Figure, path: Path) -> None:
    """Write a figure in the format of the suffix; equal figures give equal bytes."""
    no_date = {"Date": None} if path.suffix == ".svg" else None
    with (
        matplotlib.rc_context({"svg.hashsalt": "ellipseg", "svg.fonttype": "none"}),
        replacing(path) as part,
    ):
        kind = path.suffix[1:]
        figure.savefig(part, format=kind, dpi=100, facecolor=BACKGROUND, metadata=no_date)


def style(axes: Axes) -> None:
    """Set colours and grid, and hide the upper and right lines."""
    axes.set_facecolor(BACKGROUND)
    axes.tick_params(colors=INK, which="both", labelsize=10)
    axes.grid(True, color=FAINT, alpha=0.2)
    axes.set_axisbelow(True)
    for side, spine in axes.spines.items():
        spine.set_visible(side in ("left", "bottom"))
        spine.set_color(FAINT)


def title(axes: Axes, text: str, below: str = "", left: str = "") -> None:
    """Set the title and the labels of the two axes."""
    axes.set_title(text, color=INK, loc="left", fontsize=13, pad=12)
    axes.set_xlabel(below, color=INK, fontsize=10)
    axes.set_ylabel(left, color=INK, fontsize=10)


def legend(axes: Axes | Figure, **options: Any) -> None:
    """Add the legend."""
    axes.legend(facecolor=BACKGROUND, edgecolor=FAINT, labelcolor=INK, fontsize=9, **options)
