"""Scores of the association as sections of the page."""

from collections import Counter
from typing import Any

import numpy as np

from studies.landmarks.association import DRIFTS, MAX_LANDMARKS
from studies.landmarks.candidates import OURS
from studies.landmarks.passes import DIRECTIONS
from studies.landmarks.study import compared_runs, methods_of, runs_with
from studies.report.page import Section, Table

Runs = list[dict[str, Any]]
MOTIONS = 6  # directions of a transform
HEAD = (
    *("precision", "recall", "error [m]", "max [m]", "error [deg]", "max [deg]"),
    *("NEES", "CPU [ms]", "with transform"),
)

INTRODUCTION = (
    "`associate` gets the landmarks of both drives, those of the later one moved by a drift of "
    "the given size in a random direction, which it does not know. At most "
    f"{MAX_LANDMARKS} landmarks of a drive are used, those with the most points: as many as are "
    "associated in 0.1 s.",
    """- precision: share of correct pairs over all runs; at least half of the points of a correct
  pair belong to the same instances (a wall may be of several), and under the true transform it
  differs by at most three times the limits below;
- recall: agreeing pairs, as a share of the landmarks that have an agreeing counterpart;
- error: of the transform in its determined directions, at the landmarks' centroid; median and
  maximum over the runs with a transform;
- NEES: normalised squared error of the transform, divided by its six directions; the mean is 1 if
  the covariance is right;
- CPU: median CPU time;
- with transform: runs with a transform (KNOWN, or PARTIAL with a determined direction), of all;
  the others report that they cannot determine it.""",
)


def association_section(results: dict[str, Any]) -> list[Section]:
    """The sections, each with a table per drift."""
    ours = runs_with(results["runs"], method=OURS.name)
    sections = [Section("Association", INTRODUCTION)]
    for drift in DRIFTS:
        rows = [
            [scene, way, *cells(runs_with(ours, scene=scene, direction=way), drift)]
            for scene in results["scenes"]
            for way in DIRECTIONS
        ]
        table = Table(["scene", "direction", *HEAD], rows)
        sections.append(Section(f"Landmarks of this package, drift of {drift}", [table], 3))
    return [*sections, *_candidates(results), *recording_sections(results.get("recording", []))]


def _candidates(results: dict[str, Any]) -> list[Section]:
    """The other candidates for landmarks; no section if they were not tried."""
    runs = compared_runs(results)
    text = (
        f"On {len({run['seed'] for run in runs})} of the seeds, both scenes. The other candidates "
        "have no covariance: the limits of agreement replace it, with which few directions of a "
        "transform, or none, are determined."
    )
    sections = []
    for drift in DRIFTS if runs else ():
        rows = [[name, *cells(runs_with(runs, method=name), drift)] for name in methods_of(runs)]
        table = Table(["candidate", *HEAD], rows)
        sections.append(Section(f"Other candidates, drift of {drift}", [text, table], 3))
    return sections


def recording_sections(runs: Runs) -> list[Section]:
    """Scores of the windows of a recording."""
    text = (
        "Windows of 3 s that begin with the given delay and have no sweep in common. possible: "
        "landmarks with an agreeing counterpart."
    )
    head = ["delay", "candidate", "possible", "verdict", *HEAD[:-1]]
    sections = []
    for drift in DRIFTS if runs else ():
        rows = []
        for run in runs:
            scores = run["association"][drift]
            first = [f"{run['delay_s']:g} s", run["method"], str(scores["possible"])]
            rows.append([*first, scores["verdict"], *cells([run], drift)[:-1]])
        sections.append(Section(f"A recording, drift of {drift}", [text, Table(head, rows)], 3))
    return sections


def cells(runs: Runs, drift: str) -> list[str]:
    """The columns of HEAD."""
    scores = [run["association"][drift] for run in runs]
    total: Counter[str] = Counter()
    for score in scores:
        names = ("pairs", "correct", "agreeing", "possible")
        total.update({name: score[name] for name in names})
    with_transform = [score for score in scores if _has_transform(score)]
    return [
        _ratio(total["correct"], total["pairs"]),
        _ratio(total["agreeing"], total["possible"]),
        *_median_and_maximum([score["error_m"] for score in with_transform]),
        *_median_and_maximum([score["error_deg"] for score in with_transform]),
        f"{np.mean([s['nees'] for s in with_transform]):.1f}" if with_transform else "-",
        f"{1e3 * np.median([score['cpu_s'] for score in scores]):.0f}" if scores else "-",
        f"{len(with_transform)}/{len(scores)}",
    ]


def _has_transform(score: dict[str, Any]) -> bool:
    return score["verdict"] in ("KNOWN", "PARTIAL") and score["undetermined"] < MOTIONS


def _ratio(part: int, whole: int) -> str:
    return f"{part / whole:.3f}" if whole else "-"


def _median_and_maximum(values: list[float]) -> list[str]:
    return [f"{np.median(values):.3f}", f"{max(values):.3f}"] if values else ["-", "-"]
