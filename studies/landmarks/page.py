"""The results as text: repeatability of landmarks, and of what else could be one."""

from typing import Any

import numpy as np

from studies.landmarks.recognition_page import recognition_blocks
from studies.landmarks.study import Results, chosen, mean_error, share
from studies.report.markdown import machine_line, table

KINDS = ("plane", "line", "blob")

INTRODUCTION = """# Landmarks found again

<!-- written by `ellipseg evaluate association` -->

Two drives along the same 75 m of a simulated scene: the second one is faster, 0.7 m beside the
track of the first, has another noise and another drift, and goes the same way or the opposite one.
Each drive is one window. What is found in one is looked for in the other, under the true motion:
that which brings the drifted points of either drive nearest to where they truly are. What drift
bends within a drive stays in. A landmark is *repeated* if the other pass has one of its kind that
agrees in what its shape determines:

- planes: offsets within 5 cm where their boxes overlap, normals within 1.5 degrees;
- lines: 10 cm and 3 degrees;
- blobs: centres within 0.3 m.

It is *seen* if the other pass has seen what is there: half of its points have a point of the other
pass within 0.3 m, and there are at least 40 of those, or as many as it has. The scanner sees
what is ahead, so that at the ends of the road the way back sees other things. Both passes are
asked. Repeatability is the share of the repeated ones, of those seen and of all.
"""


def blocks(results: Results) -> list[str]:
    """The tables, each with a line before it."""
    repeated = [*_ours(results), *_others(results), *_errors(results)]
    return [*repeated, *recognition_blocks(results)]


def page(results: Results) -> str:
    """The whole page."""
    return "\n".join([INTRODUCTION, *blocks(results), machine_line(results["machine"])])


def spread(values: list[float], digits: int = 2) -> str:
    """Mean, and least to greatest."""
    if not values:
        return "-"
    low, middle, high = min(values), float(np.mean(values)), max(values)
    return f"{middle:.{digits}f} ({low:.{digits}f} to {high:.{digits}f})"


def _ours(results: Results) -> list[str]:
    head = ["scene", "way", "landmarks a window", "repeated, of seen", "of all", *KINDS]
    rows = []
    for scene in results["scenes"]:
        for way in ("same", "opposite"):
            runs = chosen(results, scene=scene, direction=way, method="landmarks")
            counts = [float(n) for run in runs for n in run["landmarks"]]
            kinds = [_kind(runs, kind) for kind in KINDS]
            shares = [spread(share(runs, "all", of)) for of in ("seen", "landmarks")]
            rows.append([scene, way, spread(counts, 0), *shares, *kinds])
    text = (
        f"## Landmarks of this package\n\nMean over {len(results['seeds'])} seeds (least to "
        "greatest); of the kinds, the share repeated of those seen, and how many these were a "
        "window.\n"
    )
    return [text, table(head, rows)]


def _kind(runs: list[Results], kind: str) -> str:
    seen, again = (sum(run["asked"][kind][k] for run in runs) for k in ("seen", "seen_again"))
    return f"{again / seen:.2f} of {seen / (2 * len(runs)):.1f}" if seen else "-"


def _others(results: Results) -> list[str]:
    few = {run["seed"] for run in results["runs"] if run["method"] != "landmarks"}
    if not few:
        return []
    runs = [run for run in results["runs"] if run["seed"] in few]
    names = list(dict.fromkeys(run["method"] for run in runs))
    rows = []
    for name in names:
        ours = [run for run in runs if run["method"] == name]
        cells = []
        for scene in results["scenes"]:
            part = [run for run in ours if run["scene"] == scene]
            cells += [f"{np.mean([n for run in part for n in run['landmarks']]):,.0f}"]
            cells += [f"{np.mean(share(part, 'all')):.2f}"]
        kinds = [_kind(ours, kind).split(" of ")[0] for kind in KINDS]
        rows.append([name, *cells, *kinds])
    head = ["landmarks are"]
    for scene in results["scenes"]:
        head += [f"{scene}: a window", "repeated, of seen"]
    text = (
        f"## What else could be a landmark\n\nOn {len(few)} of the seeds, both ways. Ellipsoids, "
        "and Gaussians of a grid, of 12 points or more are planes, lines or blobs by their shape "
        "(the greatest of planarity, cylindricality, sphericity), and their boxes reach two "
        "standard deviations. That something agrees in offset and normal is easy where thousands "
        "overlap: read the share beside the number.\n"
    )
    return [text, table([*head, *KINDS], rows)]


def _errors(results: Results) -> list[str]:
    rows: list[list[Any]] = []
    for scene in results["scenes"]:
        runs = chosen(results, scene=scene, method="landmarks")
        for kind in KINDS:
            mean, median, count = mean_error(runs, kind)
            if count:
                rows.append([scene, kind, f"{count:,}", f"{mean:.2f}", f"{median:.2f}"])
    text = (
        "## Are the covariances honest?\n\nNormalised error squared of the pairs that agree: the "
        "squared Mahalanobis distance by the number of what is determined. Its mean is 1 if the "
        "covariances are right, less if they are too large.\n"
    )
    return [text, table(["scene", "kind", "pairs", "mean", "median"], rows)]
