"""Means of scores over the clouds on which methods are comparable."""

from typing import Any

from studies.partition.evaluation import DEFAULT, Evaluation

Results = dict[str, Any]

MIN_SHARE = 0.75  # of the clouds on which a method must reach a count to have a mean
MEASURES = (
    "purity",
    "mean_iou",
    "boundary_recall",
    "boundary_precision",
    "under_segmentation",
    "ari",
    "precision",
    "recall",
    "quality",
    "covered",
    "seconds",
    "cpu_s",
    "memory_mb",
    "count",
)


def evaluation_at(scan: Results, method: str, target: int | str) -> Evaluation | None:
    """The evaluation of a method on a cloud at a target count; None if it was not reached."""
    for evaluation in scan["evaluations"]:
        if (
            evaluation["method"] == method
            and evaluation["target"] == target
            and evaluation["reached"]
        ):
            return dict(evaluation)
    return None


def pairs(
    scans: list[Results], ours: str, theirs: str, target: int | str
) -> dict[str, tuple[Evaluation, Evaluation]]:
    """By cloud: evaluations of two methods at the count that the second method reached."""
    paired = {}
    for scan in scans:
        reference = evaluation_at(scan, theirs, target)
        other = evaluation_at(scan, ours, reference["count"]) if reference else None
        if reference and other:
            paired[scan["name"]] = (other, reference)
    return paired


def means(scans: list[Results], methods: list[str], target: int | str) -> list[Evaluation]:
    """The means of all measures, a row per method; `scans`: number of clouds.

    A method that reached the target on less than three quarters of the clouds has no row. All
    rows are over the same clouds: those on which every method with a row reached it.
    """
    by_cloud = {
        name: {scan["name"]: evaluation_at(scan, name, target) for scan in scans}
        for name in methods
    }
    shown = [
        name
        for name, evaluations in by_cloud.items()
        if sum(map(bool, evaluations.values())) >= MIN_SHARE * len(scans)
    ]
    common = [s["name"] for s in scans if all(by_cloud[name][s["name"]] for name in shown)]
    return [
        {"method": name, "target": target, "scans": len(common)}
        | _mean([by_cloud[name][scan] for scan in common])
        for name in shown
        if common
    ]


def _mean(evaluations: list[Evaluation | None]) -> Evaluation:
    """The mean of every measure over the evaluations that have it; None if none has."""
    row: Evaluation = {}
    for name in MEASURES:
        values = [e[name] for e in evaluations if e and e.get(name) is not None]
        row[name] = sum(values) / len(values) if values else None
    return row


def targets(results: Results) -> list[int | str]:
    """All targets of a study: each method's default count, then the given counts."""
    return [DEFAULT, *results["counts"]]


def groups(results: Results) -> list[tuple[str, list[Results]]]:
    """Labelled scans and simulated scenes with their headings, if there are any."""
    kinds = (("Labelled scans", False), ("Simulated scenes", True))
    split = [(name, [s for s in results["scans"] if s["simulated"] is sim]) for name, sim in kinds]
    return [(name, scans) for name, scans in split if scans]
