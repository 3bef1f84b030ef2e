"""The look of all charts: the dark sheet of the pictures.

matplotlib, for the reasons that plots.py gives.
"""

from pathlib import Path
from typing import Any

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from ellipseg_ros.io.atomic_files import replacing
from ellipseg_ros.plots.window import BACKGROUND, FAINT, INK


def sheet(wide: float, tall: float) -> Figure:
    """An empty figure; inches."""
    return Figure(
        figsize=(wide, tall),
        facecolor=BACKGROUND,
        layout=ConstrainedLayoutEngine(w_pad=0.25, h_pad=0.25),
    )


def save(figure: Figure, path: Path) -> None:
    """Write a figure as its suffix says; the same figure gives the same bytes."""
    no_date = {"Date": None} if path.suffix == ".svg" else None
    with (
        matplotlib.rc_context({"svg.hashsalt": "ellipseg", "svg.fonttype": "none"}),
        replacing(path) as part,
    ):
        kind = path.suffix[1:]
        figure.savefig(part, format=kind, dpi=100, facecolor=BACKGROUND, metadata=no_date)


def style(axes: Axes) -> None:
    """Colours, grid, and no lines above and to the right."""
    axes.set_facecolor(BACKGROUND)
    axes.tick_params(colors=INK, which="both", labelsize=10)
    axes.grid(True, color=FAINT, alpha=0.2)
    axes.set_axisbelow(True)
    for side, spine in axes.spines.items():
        spine.set_visible(side in ("left", "bottom"))
        spine.set_color(FAINT)


def title(axes: Axes, text: str, below: str = "", left: str = "") -> None:
    """What the chart shows, and its two axes."""
    axes.set_title(text, color=INK, loc="left", fontsize=13, pad=12)
    axes.set_xlabel(below, color=INK, fontsize=10)
    axes.set_ylabel(left, color=INK, fontsize=10)


def legend(axes: Axes | Figure, **options: Any) -> None:
    """What the colours mean."""
    axes.legend(facecolor=BACKGROUND, edgecolor=FAINT, labelcolor=INK, fontsize=9, **options)
