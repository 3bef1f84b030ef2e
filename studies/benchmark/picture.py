"""The results as one picture: promises, stages, length of the window, points per second.

matplotlib, for the reasons that plots.py gives.
"""

from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.ticker import LogFormatter, NullLocator

from ellipseg_ros.plots.style import legend, save, sheet, style, title
from ellipseg_ros.plots.window import INK

Results = dict[str, Any]

GOOD, FAIR, BAD = "#3fb950", "#d29922", "#f85149"  # aim reached, must reached, neither
REACHED = {"aim": GOOD, "must": FAIR, "neither": BAD}
NAMES = {"aim": "aim reached", "must": "what must be", "neither": "neither"}
LINES = {"batch": "#8b949e", "1 s": "#58a6ff", "0.1 s": "#f778ba"}
STAGES = [
    "#58a6ff",
    "#3fb950",
    "#d29922",
    "#f778ba",
    "#a371f7",
    "#79c0ff",
    "#ffa657",
    "#56d4dd",
    "#8b949e",
]


def draw(results: Results, path: Path) -> None:
    """Write the picture; what was not measured has no panel."""
    sections = results["sections"]
    panels: list[tuple[Any, Any]] = [(_promises, results["rows"])]
    panels += [(_stages, sections["stages"])] if "stages" in sections else []
    panels += [(_lengths, sections["length"])] if "length" in sections else []
    panels += [(_densities, sections["density"])] if "density" in sections else []
    rows, columns = -(-len(panels) // 2), min(2, len(panels))
    figure = sheet(8.0 * columns, 5.0 * rows)
    for number, (panel, section) in enumerate(panels):
        axes = figure.add_subplot(rows, columns, number + 1)
        style(axes)
        panel(axes, section)
    save(figure, path)


def _promises(axes: Axes, rows: list[Results]) -> None:
    """Every row as a share of what must be; quartiles as a line, the aim as a tick."""
    rows = [row for row in rows if row["value"]][::-1]
    for place, row in enumerate(rows):
        value, must = row["value"], row["must"]
        share = {name: value[name] / must for name in ("low", "median", "high")}
        axes.barh(place, share["median"], 0.6, color=REACHED[row["reached"]])
        axes.plot([share["low"], share["high"]], [place, place], color=INK, linewidth=1.5)
        aim = row["aim"] / must
        axes.plot([aim, aim], [place - 0.38, place + 0.38], color=INK, linewidth=2)
        text = f"  {value['median']:.3g} {row['unit']}".rstrip()
        end = max(share["high"], share["median"], aim)
        axes.text(end, place, text, color=INK, va="center", fontsize=10)
    for reached, colour in REACHED.items():
        axes.barh(0, 0.0, color=colour, label=NAMES[reached])
    axes.axvline(1.0, color=BAD, linewidth=1.5, linestyle="--")
    axes.set_yticks(range(len(rows)), [_wrapped(row["title"]) for row in rows])
    axes.set_xlim(0.0, 1.15 * max([1.1, *(row["value"]["high"] / row["must"] for row in rows)]))
    title(axes, "Measured, as a share of what must be (dashed); tick: the aim")
    legend(axes, loc="lower right")


def _wrapped(title: str) -> str:
    """In two lines if it is long."""
    if len(title) < 32:
        return title
    cut = title.rfind(" ", 0, 34)
    return f"{title[:cut]}\n{title[cut + 1 :]}"


def _stages(axes: Axes, section: Results) -> None:
    """One bar for batch and for each period, cut into stages."""
    stages = section["stages"][:-1]  # the last one is the sum
    columns = [name for name in stages[0] if name != "stage"]
    left = dict.fromkeys(columns, 0.0)
    for number, row in enumerate(stages):
        widths = [row[name]["median"] for name in columns]
        starts = [left[name] for name in columns]
        colour = STAGES[number % len(STAGES)]
        places = range(len(columns) - 1, -1, -1)
        axes.barh(places, widths, 0.6, starts, color=colour, label=row["stage"])
        left = {name: left[name] + row[name]["median"] for name in columns}
    titles = ["batch", *(f"update\nof {name}" for name in columns[1:])]
    axes.set_yticks(range(len(columns) - 1, -1, -1), titles)
    title(axes, f"Where the time goes, {section['points']:,} points in the window", "ms")
    legend(axes, loc="lower right", ncols=2)


def _lengths(axes: Axes, section: Results) -> None:
    _curves(axes, section["cases"], "window_s")
    title(axes, "Length of the window, on one drive", "s of data in the window", "ms")


def _densities(axes: Axes, section: Results) -> None:
    _curves(axes, section["cases"], "points_per_second")
    text = f"Density, in a window of {section['window_s']:g} s"
    title(axes, text, "points per second", "ms")


def _curves(axes: Axes, cases: list[Results], across: str) -> None:
    """Batch and updates over `across`, both axes logarithmic, quartiles as a band."""
    for name, colour in LINES.items():
        key = "batch_ms" if name == "batch" else "update_ms"
        chosen = [case for case in cases if f"{case['period']:g} s" == name or name == "batch"]
        chosen = list({case[across]: case for case in chosen}.values())  # batch: of one period
        places = [case[across] for case in chosen]
        low, median, high = (
            [case[key][which] for case in chosen] for which in ("low", "median", "high")
        )
        axes.fill_between(places, low, high, color=colour, alpha=0.25, linewidth=0)
        label = name if name == "batch" else f"update every {name}"
        axes.plot(places, median, "o-", color=colour, linewidth=2, markersize=5, label=label)
    axes.set_xscale("log")
    axes.set_yscale("log")
    ticks = sorted({case[across] for case in cases})
    axes.set_xticks(ticks, [f"{tick:,g}" for tick in ticks])
    axes.xaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_formatter(LogFormatter(labelOnlyBase=False, minor_thresholds=(2.0, 0.5)))
    legend(axes, loc="upper left")
