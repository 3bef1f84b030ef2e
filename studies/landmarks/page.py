"""Results as a page: repeatability, honesty of covariances, association."""

import numpy as np

from studies.landmarks.association_page import association_section
from studies.landmarks.candidates import OURS
from studies.landmarks.passes import DIRECTIONS
from studies.landmarks.study import (
    Results,
    compared_runs,
    error_summary,
    methods_of,
    repeated_shares,
    runs_with,
)
from studies.report.page import Page, Section, Table

KINDS = ("plane", "line", "blob")

INTRODUCTION = (
    "How many of the landmarks of one drive another drive finds again, and how well `associate` "
    "matches them. Two drives go along the same 75 m of a simulated scene: the second one is "
    "faster, 0.7 m beside the track of the first, has other noise and another drift, and goes in "
    "the same or the opposite direction. Each drive is one window.",
)
DEFINITIONS = (
    "A landmark is *repeated* if the other drive has one of its kind that agrees in what its "
    "shape determines, under the true transform between the drives:",
    """- planes: offsets within 5 cm where their boxes overlap, normals within 1.5 degrees;
- lines: offsets within 10 cm, directions within 3 degrees;
- blobs: centres within 0.3 m.""",
    "The true transform is the rigid motion that brings the drifted points of each drive nearest "
    "to their true places; what drift bends within a drive stays in. A landmark is *visible* if "
    "half of its points have a point of the other drive within 0.3 m, and if at least 40 of these "
    "are there, or as many as the landmark has. The scanner looks ahead, so that a drive in the "
    "opposite direction sees other surfaces at the ends of the road. *Repeatability* is the share "
    "of the repeated landmarks among the visible ones and among all, over both drives.",
)


def page(results: Results) -> Page:
    """The page landmarks.md."""
    sections = [_repeatability(results), *_candidates(results), _covariances(results)]
    return Page(
        name="landmarks",
        title="Repeatability and association of landmarks",
        introduction=INTRODUCTION,
        sections=[*sections, *association_section(results)],
        command="python -m studies.landmarks -o docs/results    # 1 h",
        method=DEFINITIONS,
        machine=results["machine"],
        chart="Repeatability of landmarks and of other candidates",
    )


def mean_and_range(values: list[float], digits: int = 2) -> str:
    """Mean, minimum and maximum; a dash if there are no values."""
    if not values:
        return "-"
    low, mean, high = min(values), float(np.mean(values)), max(values)
    return f"{mean:.{digits}f} ({low:.{digits}f} to {high:.{digits}f})"


def _repeatability(results: Results) -> Section:
    head = ["scene", "direction", "landmarks", "repeated of visible", "repeated of all", *KINDS]
    rows = []
    for scene in results["scenes"]:
        for direction in DIRECTIONS:
            runs = runs_with(results["runs"], scene=scene, direction=direction, method=OURS.name)
            counts = [float(n) for run in runs for n in run["landmarks"]]
            shares = [
                mean_and_range(repeated_shares(runs, "all", among))
                for among in ("visible", "landmarks")
            ]
            kinds = [
                f"{share} of {visible}" if share else "-"
                for share, visible in (_of_kind(runs, kind) for kind in KINDS)
            ]
            rows.append([scene, direction, mean_and_range(counts, 0), *shares, *kinds])
    text = (
        f"Mean over {len(results['seeds'])} seeds (minimum to maximum) of landmarks per window "
        "and repeatability; by kind, the share repeated of the visible landmarks, and their "
        "number per window."
    )
    return Section("Landmarks of this package", [text, Table(head, rows)])


def _of_kind(runs: list[Results], kind: str) -> tuple[str, str]:
    """Share repeated of the visible landmarks, and their number per window; or empty texts."""
    counts = [run["counts"][kind] for run in runs]
    visible, repeated = (sum(c[k] for c in counts) for k in ("visible", "visible_repeated"))
    return (
        (f"{repeated / visible:.2f}", f"{visible / (2 * len(runs)):.1f}") if visible else ("", "")
    )


def _candidates(results: Results) -> list[Section]:
    """The other candidates for landmarks; no section if they were not tried."""
    runs = compared_runs(results)
    if not runs:
        return []
    rows = []
    for method in methods_of(runs):
        of_method = runs_with(runs, method=method)
        cells = []
        for scene in results["scenes"]:
            part = runs_with(of_method, scene=scene)
            cells += [f"{np.mean([n for run in part for n in run['landmarks']]):,.0f}"]
            cells += [f"{np.mean(repeated_shares(part, 'all')):.2f}"]
        rows.append([method, *cells, *(_of_kind(of_method, kind)[0] or "-" for kind in KINDS)])
    head = ["candidate"]
    for scene in results["scenes"]:
        head += [f"{scene}: number", "repeated of visible"]
    text = (
        f"On {len({run['seed'] for run in runs})} of the seeds, both directions. Ellipsoids and "
        "Gaussians of a voxel grid with 12 points or more count as planes, lines or blobs by "
        "their shape (the greatest of planarity, cylindricality and sphericity), with boxes of "
        "two standard deviations. Among thousands of overlapping candidates some agree by chance: "
        "compare the share with the number."
    )
    return [Section("Other candidates for landmarks", [text, Table([*head, *KINDS], rows)])]


def _covariances(results: Results) -> Section:
    rows = []
    for scene in results["scenes"]:
        runs = runs_with(results["runs"], scene=scene, method=OURS.name)
        for kind in KINDS:
            errors = error_summary(runs, kind)
            if errors is not None:
                numbers = [f"{errors.pairs:,}", f"{errors.mean:.2f}", f"{errors.median:.2f}"]
                rows.append([scene, kind, *numbers])
    text = (
        "Normalised squared errors of the agreeing pairs: the squared Mahalanobis distance "
        "divided by the number of determined motions. The mean is 1 if the covariances are right, "
        "and less if they are too large."
    )
    head = ["scene", "kind", "pairs", "mean", "median"]
    return Section("Consistency of the covariances", [text, Table(head, rows)])
