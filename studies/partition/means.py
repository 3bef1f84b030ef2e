"""Means over clouds, of methods that can be compared."""

from typing import Any

from studies.partition.cells import OWN, Cell

Results = dict[str, Any]

OFTEN = 0.75  # share of the clouds on which a method must come to a count to have a mean

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


def cell_at(scan: Results, method: str, wanted: int | str) -> Cell | None:
    """What a method reached on a cloud at a wanted count, if it did."""
    for cell in scan["cells"]:
        if cell["method"] == method and cell["wanted"] == wanted and cell["reached"]:
            return dict(cell)
    return None


def pairs(
    scans: list[Results], ours: str, theirs: str, wanted: int | str
) -> dict[str, tuple[Cell, Cell]]:
    """By cloud: two methods, at the number to which the second one came."""
    found = {}
    for scan in scans:
        mark = cell_at(scan, theirs, wanted)
        beside = cell_at(scan, ours, mark["count"]) if mark else None
        if mark and beside:
            found[scan["name"]] = (beside, mark)
    return found


def means(scans: list[Results], methods: list[str], wanted: int | str) -> list[Cell]:
    """The mean of every measure, a row a method, all over the same clouds; `scans`: how many.

    A method that came to the wanted count on less than three quarters of the clouds has no row;
    the clouds are those on which all the others came to it.
    """
    found = {
        name: {scan["name"]: cell_at(scan, name, wanted) for scan in scans} for name in methods
    }
    often = [
        name
        for name, cells in found.items()
        if sum(cell is not None for cell in cells.values()) >= OFTEN * len(scans)
    ]
    common = [scan["name"] for scan in scans if all(found[name][scan["name"]] for name in often)]
    rows = [mean_of([found[name][scan] for scan in common]) for name in often]
    return [
        {"method": name, "wanted": wanted, "scans": len(common)} | row
        for name, row in zip(often, rows, strict=True)
        if common
    ]


def mean_of(cells: list[Cell | None]) -> Cell:
    """The mean of every measure over the cells that have it; None where none has."""
    row: Cell = {}
    for name in MEASURES:
        values = [cell[name] for cell in cells if cell and cell.get(name) is not None]
        row[name] = sum(values) / len(values) if values else None
    return row


def columns(results: Results) -> list[int | str]:
    """All that is shown: every method's own count, then the wanted ones."""
    return [OWN, *results["counts"]]


def kinds(results: Results) -> list[tuple[str, list[Results]]]:
    """Labelled scans and simulated scenes, each with its heading, if there are any."""
    pairs = (("Labelled scans", False), ("Simulated scenes", True))
    split = [(name, [s for s in results["scans"] if s["simulated"] is sim]) for name, sim in pairs]
    return [(name, scans) for name, scans in split if scans]
