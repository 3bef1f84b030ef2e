"""Charts of results in one style: panels of lines or bars on one sheet."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogFormatter, LogLocator, NullLocator

from ellipseg_ros.plots.style import legend, save, sheet, style, title
from ellipseg_ros.plots.tuning import BLUE, GREEN, ORANGE, PURPLE, YELLOW
from ellipseg_ros.plots.window import INK

# With those of plots/tuning.py: Okabe and Ito (2008), the darkest lightened for the background.
RED, GREY = "#d55e00", "#999999"
COLOURS = (BLUE, ORANGE, GREEN, PURPLE, YELLOW, "#4d9bd6", RED, "#e6edf3", GREY, "#a371f7")

Panel: TypeAlias = Callable[[Axes], None]  # draws into axes that have the style


@dataclass(frozen=True)
class Line:
    """A line of a chart, perhaps with markers and a band from `low` to `high`."""

    x: Sequence[float]
    y: Sequence[float]
    label: str = ""
    colour: str = INK
    dash: str = "-"
    marker: str = ""
    width: float = 2.0
    alpha: float = 1.0
    hollow: bool = False  # large hollow markers
    low: Sequence[float] = ()
    high: Sequence[float] = ()


@dataclass(frozen=True)
class LinePanel:
    """Lines with a title and labelled axes; a Panel."""

    text: str
    across: str  # label of the x axis
    up: str  # label of the y axis
    lines: Sequence[Line]
    log_x: bool = False
    log_y: bool = False
    ticks: Sequence[float] = ()  # of the x axis
    place: str = ""  # of the legend; none: no legend

    def __call__(self, axes: Axes) -> None:
        """Draw into axes that have the style."""
        for line in self.lines:
            draw_line(axes, line)
        if self.log_x:
            axes.set_xscale("log")
        if self.log_y and self.lines:
            log_y(axes)
        if self.ticks:
            axes.set_xticks(self.ticks, [f"{tick:,g}" for tick in self.ticks])
            axes.xaxis.set_minor_locator(NullLocator())
        title(axes, self.text, self.across, self.up)
        if self.place:
            legend(axes, loc=self.place)


def draw_line(axes: Axes, line: Line) -> None:
    """Draw a line and, if it has one, its band."""
    if line.low:
        axes.fill_between(line.x, line.low, line.high, color=line.colour, alpha=0.25, linewidth=0)
    look: dict[str, Any] = {"color": line.colour, "marker": line.marker, "linestyle": line.dash}
    if line.hollow:
        look |= {"fillstyle": "none", "markersize": 11}
    axes.plot(line.x, line.y, label=line.label, linewidth=line.width, alpha=line.alpha, **look)


def log_y(axes: Axes) -> None:
    """Make the y axis logarithmic, with plain numbers at 1, 2 and 5."""
    axes.set_yscale("log")
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.yaxis.set_major_formatter("{x:,g}")
    axes.yaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_minor_formatter(LogFormatter(labelOnlyBase=False))


def chart(panels: Sequence[Panel], columns: int, size: tuple[float, float]) -> Figure:
    """A sheet of panels, row by row; size: of one panel, inches."""
    columns = min(columns, len(panels))
    rows = -(-len(panels) // columns)
    figure = sheet(size[0] * columns, size[1] * rows)
    for number, panel in enumerate(panels):
        axes = figure.add_subplot(rows, columns, number + 1)
        style(axes)
        panel(axes)
    return figure


def common_legend(figure: Figure, columns: int) -> None:
    """A legend below all panels, of the labels in the first one; equal labels once."""
    handles, texts = figure.axes[0].get_legend_handles_labels()
    named = dict(zip(reversed(texts), reversed(handles), strict=True))
    if named:
        shown = {text: named[text] for text in dict.fromkeys(texts)}
        place = {"loc": "outside lower left", "ncols": columns}
        legend(figure, handles=list(shown.values()), labels=list(shown), **place)


def draw_chart(
    path: Path, panels: Sequence[Panel], columns: int = 2, size: tuple[float, float] = (8.0, 5.0)
) -> None:
    """Write a sheet of panels."""
    save(chart(panels, columns, size), path)
