"""The results as Markdown."""

from typing import Any

from studies.partition.cells import OWN, Cell
from studies.partition.means import cell_at, columns, kinds, means, pairs
from studies.partition.methods import OBJECTS
from studies.partition.peers import CUT_PURSUIT
from studies.partition.promises import AT
from studies.report.markdown import (
    Cells,
    between,
    machine_line,
    not_measured,
    number,
    table,
)

Results = dict[str, Any]

INTRODUCTION = """# Partition quality

Written by `ellipseg evaluate partition`; every number was measured by it. To measure again:

```bash
pip install -e '.[evaluate]'  # the methods of others
ellipseg evaluate partition SCAN... sim:woodland sim:industrial sim:roadway sim:mixed -o docs
```

A scan is any source with a class per point (field `class` or `coarse`). What is compared is the
quality at the same number of segments. Every method comes to a wanted number by one setting of
its own, tried until the number is met within 4 %, or at least 10 %; `own` is what its own settings
give. Of the methods of others, a small grid of further settings is tried, and the one with the
highest mean IoU is shown, for every cloud and every number by itself. Given is the number that
was come to.
"""
PICTURE = "![The means as curves over the number of segments](quality.png)\n"
DEFINITIONS = """## What the columns say

Points of no known class take no part. A point that a method leaves without a segment joins that
of the nearest point that has one; `covered` is the share that it did not leave.

| column | what |
| --- | --- |
| purity | share of points that have the commonest class of their segment |
| mean IoU | every segment votes for its commonest class; intersection over union, mean over the classes of the truth |
| BR, BP | boundary recall and precision on the graph of the 10 nearest neighbours: edges between classes that are edges between segments, and the other way round, with a tolerance of one edge (Landrieu and Boussaha 2019) |
| UE | under-segmentation error, corrected (Neubert and Protzel 2012): what leaks over classes; less is better |
| ARI | adjusted Rand index of segments and things, over points that are no ground (Hubert and Arabie 1985) |
| precision, recall, PQ | panoptic (Kirillov et al. 2019), of things and segments of 12 points or more, matched where the intersection over union is above 0.5; segments of ground do not count |
| s, CPU s | from the points to the labels, by the clock and over all cores; median of 3 runs, or one if it takes more than 2 s |
| MB | most memory, beyond that of program and points |
"""  # noqa: E501, a cell of a Markdown table is one line
SCORES = {
    "purity": "purity",
    "mean_iou": "mean IoU",
    "boundary_recall": "BR",
    "boundary_precision": "BP",
    "under_segmentation": "UE",
}
INSTANCES = {"ari": "ARI", "precision": "precision", "recall": "recall", "quality": "PQ"}


def page(results: Results) -> str:
    """All of docs/quality.md."""
    return "\n".join([INTRODUCTION, PICTURE, *blocks(results), _pictures(results), DEFINITIONS])


def blocks(results: Results) -> list[str]:
    """The machine, the promises, means, every cloud, the methods."""
    text = [machine_line(results["machine"])]
    text += [_promises(results["rows"])] if results["rows"] else []
    text += [_beside(results)] if results["rows"] else []
    for heading, scans in kinds(results):
        text.append(_means(heading, scans, results))
    text.append(_clouds(results))
    return [*text, _methods(results)]


def _pictures(results: Results) -> str:
    """Scenes as ellipsoids, as objects, and as they are; none where none was drawn."""
    drawn = [scan for scan in results["scans"] if scan["picture"]]
    pictures = [f"![{scan['name']}]({scan['picture']})\n" for scan in drawn]
    head = (
        "## Pictures\n\nThe simulated scenes from above: every point in the colour of its "
        "segment, of its object, and of the thing or class that it truly belongs to.\n"
    )
    return "\n".join([head, *pictures]) if pictures else ""


def _promises(rows: list[Results]) -> str:
    cells = [
        [row["title"], f"{row['sign']} {row['must']:g}", f"{row['sign']} {row['aim']:g}"]
        + [number(row["value"]), row["reached"]]
        for row in rows
    ]
    head = ["objects beside cut-pursuit", "must", "aim", "measured", "reached"]
    return "## What was promised\n\n" + table(head, cells)


def _beside(results: Results) -> str:
    """Objects and cut-pursuit on every cloud, at cut-pursuit's counts."""
    rows = []
    for scan in results["scans"]:
        for wanted in AT:
            for ours, theirs in pairs([scan], OBJECTS.name, CUT_PURSUIT.name, wanted).values():
                rows.append(
                    [scan["name"], str(wanted), f"{theirs['count']:,}"]
                    + [f"{cell['mean_iou']:.3f}" for cell in (ours, theirs)]
                    + [f"{ours['mean_iou'] - theirs['mean_iou']:+.3f}"]
                    + _times(scan["races"] if wanted == OWN else [])
                )
    head = ["cloud", "wanted", "segments", "objects", "cut-pursuit", "difference"]
    head += ["objects, ms", "cut-pursuit, ms", "ratio"]
    return (
        "### Cloud by cloud\n\nMean IoU, objects cut at the very count that cut-pursuit came to; "
        "time by the clock, both run in turn, at its own count, median (quartiles) of 3.\n\n"
        + table(head, rows)
    )


def _times(found: list[Results]) -> Cells:
    if not found:
        return ["-", "-", "-"]
    return [between(found[0][name]) for name in ("ours_ms", "theirs_ms", "ratio")]


def _means(heading: str, scans: list[Results], results: Results) -> str:
    """A table of means for every count."""
    names = [method["name"] for method in results["methods"]]
    told = SCORES | (INSTANCES if any(scan["instances"] for scan in scans) else {})
    text = (
        f"## {heading}: means\n\nOver {', '.join(scan['name'] for scan in scans)}. At a wanted "
        "number, every row is over the same clouds: those on which all the methods shown came to "
        "it. A method that did so on less than three quarters of the clouds is not shown.\n"
    )
    for wanted in columns(results):
        rows = [_mean(row, told) for row in means(scans, names, wanted)]
        if not rows:
            continue
        title = "each method's own number" if wanted == OWN else f"{wanted:,} segments"
        head = ["method", "clouds", "segments", *told.values(), "covered", "s", "CPU s", "MB"]
        text += f"\n### {heading}, {title}\n\n{table(head, rows)}"
    return text


def _mean(row: Cell, told: dict[str, str]) -> Cells:
    return [
        row["method"],
        str(row["scans"]),
        f"{row['count']:,.0f}",
        *(share(row[name]) for name in told),
        f"{row['covered']:.2f}",
        *(number(row[name]) for name in ("seconds", "cpu_s", "memory_mb")),
    ]


def share(value: float | None) -> str:
    """A score; a dash where there is none."""
    return "-" if value is None else f"{value:.3f}"


def _clouds(results: Results) -> str:
    """The mean IoU of every method on every cloud."""
    text = (
        "## Every cloud\n\nMean IoU, and in brackets the number of segments come to; a dash: it "
        "could not come to the number.\n"
    )
    for scan in results["scans"]:
        rows = [
            [method["name"], *(_one(scan, method["name"], at) for at in columns(results))]
            for method in results["methods"]
            if method["name"] not in results["missing"]
        ]
        classes = ", ".join(f"{name} {count:,}" for name, count in scan["classes"].items())
        things = f"; {scan['instances']:,} things" if scan["instances"] else ""
        head = ["method", OWN, *(f"{count:,}" for count in results["counts"])]
        text += f"\n### {scan['name']}\n\n{scan['points']:,} points: {classes}{things}.\n\n"
        text += table(head, rows)
        for method, problem in scan["problems"].items():
            text += f"\n{method}: {problem}.\n"
    return text


def _one(scan: Results, method: str, wanted: int | str) -> str:
    cell = cell_at(scan, method, wanted)
    return f"{cell['mean_iou']:.3f} ({cell['count']:,})" if cell else "-"


def _methods(results: Results) -> str:
    rows = [[m["name"], m["version"], m["turned"], m["grid"]] for m in results["methods"]]
    text = "## Methods\n\n" + table(["method", "version", "number met by", "own settings"], rows)
    if results["missing"]:
        text += f"\n{not_measured(results['missing'])}\n"
    if CUT_PURSUIT.name in [method["name"] for method in results["methods"]]:
        text += (
            "\nThe binding of cut-pursuit ignores its regularisation strength where edges have "
            "weights (seen in 1.0.12), so the strength is a factor of the weights here. Its own "
            "strength is that of its authors for outdoor scans. PCL's region growing is not among "
            "the methods: PCL is not on PyPI.\n"
        )
    return text
