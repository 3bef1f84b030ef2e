"""Objects beside cut-pursuit at its own counts: what must be reached, what is aimed at."""

from statistics import mean, median
from typing import Any

from studies.partition.cells import OWN
from studies.partition.means import kinds, pairs
from studies.partition.methods import OBJECTS
from studies.partition.peers import CUT_PURSUIT

AT = (OWN, 250, 1000)  # of cut-pursuit
BETTER = (0.03, 0.05)  # mean IoU above cut-pursuit's: must, aim
TIME = (0.2, 0.1)  # share of cut-pursuit's
Results = dict[str, Any]
Row = dict[str, Any]


def rows(results: Results) -> list[Row]:
    """Every promise with what was measured; none where objects and cut-pursuit did not run."""
    scans = kinds(results)[0][1]  # labelled scans, if there are any
    table: list[Row] = []
    for wanted in AT:
        found = pairs(scans, OBJECTS.name, CUT_PURSUIT.name, wanted)
        if not found:
            continue
        where = "its own count" if wanted == OWN else f"{wanted:,} segments"
        gains = [ours["mean_iou"] - theirs["mean_iou"] for ours, theirs in found.values()]
        above, count = sum(gain > 0.0 for gain in gains), len(gains)
        table += [
            row(f"scans of {count} with a higher mean IoU, at {where}", above, count - 1, count),
            row(f"mean IoU higher by, mean, at {where}", mean(gains), *BETTER),
        ]
    times = [race["ratio"]["median"] for scan in scans for race in scan["races"]]
    if times:
        title = "time / cut-pursuit's, in turn, median, at its own count"
        table.append(row(title, median(times), *TIME))
    return table


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
