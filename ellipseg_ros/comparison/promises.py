"""Objects beside cut-pursuit at its own counts: what must be reached, what is aimed at."""

from statistics import mean, median
from typing import Any

from ellipseg_ros.comparison.cells import OWN, Cell
from ellipseg_ros.comparison.means import cell_at, kinds
from ellipseg_ros.comparison.methods import OBJECTS
from ellipseg_ros.comparison.peers import CUT_PURSUIT

AT = (OWN, 250, 1000)  # of cut-pursuit
BETTER = (0.03, 0.05)  # mean IoU above cut-pursuit's: must, aim
TIME = (0.2, 0.1)  # share of cut-pursuit's; of the cores: a busy machine spoils the clock's
Results = dict[str, Any]
Row = dict[str, Any]


def rows(results: Results) -> list[Row]:
    """Every promise with what was measured; none where objects and cut-pursuit did not run."""
    scans = kinds(results)[0][1]  # labelled scans, if there are any
    table: list[Row] = []
    for wanted in AT:
        found = pairs(scans, wanted)
        if not found:
            continue
        where = "its own count" if wanted == OWN else f"{wanted:,} segments"
        gains = [ours["mean_iou"] - theirs["mean_iou"] for ours, theirs in found.values()]
        times = [time_ratio(ours, theirs) for ours, theirs in found.values()]
        above, count = sum(gain > 0.0 for gain in gains), len(gains)
        table += [
            row(f"scans of {count} with a higher mean IoU, at {where}", above, count - 1, count),
            row(f"mean IoU higher by, mean, at {where}", mean(gains), *BETTER),
            row(f"CPU time / cut-pursuit's, median, at {where}", median(times), *TIME),
        ]
    return table


def pairs(scans: list[Results], wanted: int | str) -> dict[str, tuple[Cell, Cell]]:
    """By cloud: objects and cut-pursuit, at the count to which cut-pursuit came."""
    found = {}
    for scan in scans:
        theirs = cell_at(scan, CUT_PURSUIT.name, wanted)
        ours = cell_at(scan, OBJECTS.name, theirs["count"]) if theirs else None
        if theirs and ours:
            found[scan["name"]] = (ours, theirs)
    return found


def time_ratio(ours: Cell, theirs: Cell) -> float:
    """CPU time of one to the other's, of which no digit is known below 0.1 ms."""
    return float(ours["cpu_s"] / max(theirs["cpu_s"], 1e-4))


def row(title: str, value: float, must: float, aim: float) -> Row:
    """One promise: at least so much if the aim is more than what must be, else at most."""
    sign = 1.0 if aim > must else -1.0
    reached = "neither"
    if sign * value >= sign * must:
        reached = "must"
    if sign * value >= sign * aim:
        reached = "aim"
    return {
        "title": title,
        "sign": "≥" if sign > 0.0 else "≤",
        "must": must,
        "aim": aim,
        "value": value,
        "reached": reached,
    }
