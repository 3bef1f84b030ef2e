"""Requirements on objects beside cut-pursuit, at the numbers of segments of the latter."""

from statistics import mean, median
from typing import Any

from studies.partition.evaluation import DEFAULT
from studies.partition.means import groups, pairs
from studies.partition.methods import OBJECTS
from studies.partition.peers import CUT_PURSUIT
from studies.report.requirements import Row, Target

COUNTS = (DEFAULT, 250, 1000)  # of cut-pursuit
GAIN = (0.03, 0.05)  # of the mean IoU over that of cut-pursuit: must, aim
TIME = (0.2, 0.1)  # relative to that of cut-pursuit: must, aim


def judged(results: dict[str, Any]) -> list[Row]:
    """All requirements that were measured, JSON-ready; on labelled scans, if there are any."""
    scans = groups(results)[0][1]
    rows: list[Row] = []
    for target in COUNTS:
        evaluations = pairs(scans, OBJECTS.name, CUT_PURSUIT.name, target).values()
        if not evaluations:
            continue
        where = "its default count" if target == DEFAULT else f"{target:,} segments"
        gains = [ours["mean_iou"] - theirs["mean_iou"] for ours, theirs in evaluations]
        better, count = sum(gain > 0.0 for gain in gains), len(gains)
        clouds = Target(f"clouds of {count} with a higher mean IoU, at {where}", count - 1, count)
        gain = Target(f"gain of the mean IoU, mean over clouds, at {where}", *GAIN)
        rows += [clouds.judge(better), gain.judge(mean(gains))]
    ratios = [timing["ratio"]["median"] for scan in scans for timing in scan["timing"]]
    if ratios:
        time = Target("time / cut-pursuit's, alternating, median, at its default count", *TIME)
        rows.append(time.judge(median(ratios)))
    return rows
