"""How well passes are associated, as text."""

from collections import Counter
from typing import Any

import numpy as np

from studies.landmarks.recognition import BUDGET, DRIFTS
from studies.report.markdown import table

Runs = list[dict[str, Any]]
MOTIONS = 6  # directions of a transform
HEAD = ["precision", "recall", "error [m]", "worst", "[deg]", "worst", "NEES", "ms", "told"]

INTRODUCTION = f"""## Associated

`associate` gets the landmarks of both passes, those of the later one moved by a drift of this
size in a random direction, and knows nothing of it. Of more than {BUDGET} landmarks a pass, those
of the most points are taken: as many as are associated in 0.1 s.

- precision: share of the pairs that are right: at least half of their points are of the same
  things (a wall may be of several), and they lie within three times the limits above under the
  true transform; over all runs;
- recall: pairs that agree, of the landmarks that have a counterpart that agrees;
- error: of the transform along the directions that are said to be known, at the landmarks'
  centroid; median and worst of the runs that tell one;
- NEES: normalised error squared of the transform, by its six directions; the mean is 1 if the
  covariance is right;
- ms: CPU time, median;
- told: runs that tell a transform (KNOWN, or PARTIAL with a direction that is known), of all; the
  others say that they cannot.
"""


def recognition_blocks(results: dict[str, Any]) -> list[str]:
    """The tables, each with a line before it."""
    blocks = [INTRODUCTION]
    ours = [run for run in results["runs"] if run["method"] == "landmarks"]
    for drift in DRIFTS:
        rows = []
        for scene in results["scenes"]:
            for way in ("same", "opposite"):
                part = [run for run in ours if (run["scene"], run["direction"]) == (scene, way)]
                rows.append([scene, way, *cells(part, drift)])
        blocks += [f"### Our landmarks, drift of {drift}\n", table(["scene", "way", *HEAD], rows)]
    few = {run["seed"] for run in results["runs"] if run["method"] != "landmarks"}
    runs = [run for run in results["runs"] if run["seed"] in few]
    for drift in DRIFTS if few else ():
        rows = []
        for name in dict.fromkeys(run["method"] for run in runs):
            part = [run for run in runs if run["method"] == name]
            rows.append([name, *cells(part, drift)])
        about = (
            f"### Whatever else, drift of {drift}\n\nOn {len(few)} of the seeds, both scenes. "
            "Those other than landmarks have no covariance: the limits of agreement stand for it, "
            "with which few directions of a transform, or none, can be said to be known.\n"
        )
        blocks += [about, table(["landmarks are", *HEAD], rows)]
    return blocks + recording_blocks(results.get("recording", []))


def recording_blocks(runs: Runs) -> list[str]:
    """The same of the windows of a recording."""
    blocks = []
    for drift in DRIFTS if runs else ():
        rows = []
        for run in runs:
            found = run["association"][drift]
            first = [f"{run['apart']:g} s", run["method"], str(found["there"]), found["verdict"]]
            rows.append([*first, *cells([run], drift)[:-1]])
        head = ["apart", "landmarks are", "there", "verdict", *HEAD[:-1]]
        blocks += [
            f"### A recording, drift of {drift}\n\nWindows of 3 s, so far apart, without a "
            "sweep in common. there: landmarks with a counterpart that agrees.\n",
            table(head, rows),
        ]
    return blocks


def cells(runs: Runs, drift: str) -> list[str]:
    """What HEAD names."""
    found = [run["association"][drift] for run in runs]
    total: Counter[str] = Counter()
    for one in found:
        total.update({name: one[name] for name in ("pairs", "right", "agree", "there")})
    told = [
        one for one in found if one["verdict"] in ("KNOWN", "PARTIAL") and one["unknown"] < MOTIONS
    ]
    return [
        ratio(total["right"], total["pairs"]),
        ratio(total["agree"], total["there"]),
        *both([one["offset"] for one in told]),
        *both([one["angle"] for one in told]),
        f"{np.mean([one['nees'] for one in told]):.1f}" if told else "-",
        f"{1e3 * np.median([one['seconds'] for one in found]):.0f}" if found else "-",
        f"{len(told)}/{len(found)}",
    ]


def ratio(part: int, whole: int) -> str:
    """As a decimal; a dash of nothing."""
    return f"{part / whole:.3f}" if whole else "-"


def both(values: list[float]) -> list[str]:
    """Median and greatest."""
    return [f"{np.median(values):.3f}", f"{max(values):.3f}"] if values else ["-", "-"]
