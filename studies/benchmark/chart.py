"""The chart of the benchmark: requirements, stages, window length, points per second."""

from functools import partial
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes

from ellipseg_ros.plots.style import legend, title
from ellipseg_ros.plots.tuning import BLUE, GREEN, PURPLE, YELLOW
from ellipseg_ros.plots.window import INK
from studies.report.chart import COLOURS, GREY, RED, Line, LinePanel, Panel, draw_chart
from studies.report.requirements import AIM, MET, MISSED

Results = dict[str, Any]

RESULTS = {AIM: GREEN, MET: YELLOW, MISSED: RED}
LINES = {"batch": GREY, "1 s": BLUE, "0.1 s": PURPLE}


def draw(results: Results, path: Path) -> None:
    """Write the chart; what was not measured has no panel."""
    sections = results["sections"]
    panels: list[Panel] = [partial(_requirements, rows=results["rows"])]
    if "stages" in sections:
        panels.append(partial(_stages, section=sections["stages"]))
    if "length" in sections:
        cases = sections["length"]["cases"]
        text = "Update and batch over the window length, one drive"
        panels.append(_times(cases, "window_s", text, "s of data in the window"))
    if "density" in sections:
        cases, window = sections["density"]["cases"], sections["density"]["window_s"]
        text = f"Update and batch over the point rate, window of {window:g} s"
        panels.append(_times(cases, "points_per_second", text, "points per second"))
    draw_chart(path, panels)


def _requirements(axes: Axes, rows: list[Results]) -> None:
    """A bar per requirement relative to its limit, with its quartiles and a tick at the aim."""
    rows = [row for row in rows if row["measured"]][::-1]
    for place, row in enumerate(rows):
        must, aim = row["must"], row["aim"] / row["must"]
        share = {name: row["measured"][name] / must for name in ("low", "median", "high")}
        axes.barh(place, share["median"], 0.6, color=RESULTS[row["result"]])
        axes.plot([share["low"], share["high"]], [place, place], color=INK, linewidth=1.5)
        axes.plot([aim, aim], [place - 0.38, place + 0.38], color=INK, linewidth=2)
        text = f"  {row['measured']['median']:.3g} {row['unit']}".rstrip()
        end = max(share["high"], share["median"], aim)
        axes.text(end, place, text, color=INK, va="center", fontsize=10)
    for result, colour in RESULTS.items():
        axes.barh(0, 0.0, color=colour, label=result)
    axes.axvline(1.0, color=RED, linewidth=1.5, linestyle="--")
    axes.set_yticks(range(len(rows)), [_wrapped(row["requirement"]) for row in rows])
    longest = max([1.1, *(row["measured"]["high"] / row["must"] for row in rows)])
    axes.set_xlim(0.0, 1.15 * longest)
    title(axes, "Measured relative to the limit (dashed); tick: the aim")
    legend(axes, loc="lower right")


def _wrapped(text: str) -> str:
    """A long title in two lines."""
    if len(text) < 32:
        return text
    cut = text.rfind(" ", 0, 34)
    return f"{text[:cut]}\n{text[cut + 1 :]}"


def _stages(axes: Axes, section: Results) -> None:
    """A stacked bar for the batch and for each update period."""
    stages = section["stages"][:-1]  # the last one is the total
    columns = [name for name in stages[0] if name != "stage"]
    places = range(len(columns) - 1, -1, -1)
    left = [0.0] * len(columns)
    for number, row in enumerate(stages):
        widths = [row[name]["median"] for name in columns]
        colour = COLOURS[number % len(COLOURS)]
        axes.barh(places, widths, 0.6, left, color=colour, label=row["stage"])
        left = [start + width for start, width in zip(left, widths, strict=True)]
    axes.set_yticks(places, ["batch", *(f"update\nof {name}" for name in columns[1:])])
    title(axes, f"Time of the stages, {section['points']:,} points in the window", "ms")
    legend(axes, loc="lower right", ncols=2)


def _times(cases: list[Results], key: str, text: str, across: str) -> LinePanel:
    """Times of batch and updates over `key` with quartile bands, both axes logarithmic."""
    lines = []
    for name, colour in LINES.items():
        batch = name == "batch"
        chosen = [case for case in cases if batch or f"{case['period']:g} s" == name]
        chosen = list({case[key]: case for case in chosen}.values())  # batch: of one period
        values = [case["batch_ms" if batch else "update_ms"] for case in chosen]
        low, median, high = ([v[which] for v in values] for which in ("low", "median", "high"))
        label = name if batch else f"update every {name}"
        x = [case[key] for case in chosen]
        lines.append(Line(x, median, label, colour, marker="o", low=low, high=high))
    ticks = sorted({case[key] for case in cases})
    return LinePanel(
        text, across, "ms", lines, log_x=True, log_y=True, ticks=ticks, place="upper left"
    )
