"""The page of the partition study."""

from typing import Any

from studies.partition.evaluation import DEFAULT
from studies.partition.means import evaluation_at, groups, means, pairs, targets
from studies.partition.methods import OBJECTS
from studies.partition.peers import CUT_PURSUIT
from studies.partition.targets import COUNTS
from studies.report.page import (
    Page,
    Section,
    Table,
    not_measured,
    numbers,
    quartiles,
    share,
    shares,
    table_of,
    text,
)
from studies.report.requirements import requirement_table

Results = dict[str, Any]

COMMAND = """
pip install -e '.[peers]'  # the other methods
python -m studies.partition SCAN... sim:woodland sim:industrial sim:roadway sim:mixed \\
    -o docs/results
"""
INTRODUCTION = (
    "Quality of segments and objects on clouds with a known class per point, beside other "
    "partition methods at the same number of segments. One parameter of each method is searched "
    "until the target number of segments is met within 4 %, or at least within 10 %; *default* is "
    "the number that its default settings give. For other libraries a small grid of further "
    "settings is tried, and the result with the highest mean IoU is shown, separately for every "
    "cloud and target. The number of segments in a table is the one that was reached."
)
DEFINITIONS = Table(
    ["column", "definition"],
    [
        ["purity", "share of points with the most frequent class of their segment"],
        [
            "mean IoU",
            "every segment is assigned its most frequent class; intersection over union, mean "
            "over the true classes",
        ],
        [
            "BR, BP",
            "boundary recall and precision on the graph of the 10 nearest neighbours: edges "
            "between classes that are edges between segments, and vice versa, with a tolerance of "
            "one edge (Landrieu and Boussaha 2019)",
        ],
        [
            "UE",
            "corrected under-segmentation error (Neubert and Protzel 2012): points by which "
            "segments leak over class boundaries; less is better",
        ],
        [
            "ARI",
            "adjusted Rand index of segments and instances, over points that are not ground "
            "(Hubert and Arabie 1985)",
        ],
        [
            "precision, recall, PQ",
            "panoptic quality (Kirillov et al. 2019) of segments against instances of 12 points "
            "or more, matched where the intersection over union is above 0.5; segments of ground "
            "are ignored",
        ],
        ["covered", "share of points that the method itself assigned to a segment"],
        [
            "s, CPU s",
            "from points to labels, wall-clock and over all cores; median of 3 runs, or one run "
            "if it takes more than 2 s",
        ],
        ["MB", "peak memory beyond that of program and points"],
    ],
)
METHOD: list[str | Table] = [
    "Points of unknown class are ignored. A point that a method leaves without a segment is "
    "assigned that of the nearest point with one.",
    DEFINITIONS,
]
CUT_PURSUIT_NOTE = (
    "The binding of cut-pursuit ignores its regularisation strength if edges have weights (seen "
    "in 1.0.12), so the strength is a factor of the weights here. Its default strength is that of "
    "its authors for outdoor scans. PCL's region growing is not compared: PCL is not on PyPI."
)
SCORES = {
    "purity": "purity",
    "mean_iou": "mean IoU",
    "boundary_recall": "BR",
    "boundary_precision": "BP",
    "under_segmentation": "UE",
}
COST = {
    "covered": text("covered", ".2f"),
    "s": numbers("seconds"),
    "CPU s": numbers("cpu_s"),
    "MB": numbers("memory_mb"),
}
INSTANCES = {"ari": "ARI", "precision": "precision", "recall": "recall", "quality": "PQ"}


def page(results: Results) -> Page:
    """Requirements, means, every cloud, pictures and methods."""
    sections = _requirements(results) if results["rows"] else []
    for heading, scans in groups(results):
        sections += _means(heading, scans, results)
    sections += [*_clouds(results), _methods(results)]
    drawn = [scan for scan in results["scans"] if scan["picture"]]
    pictures = [f"![{scan['name']}]({scan['picture']})" for scan in drawn]
    about = (
        "The simulated scenes from above: every point in the colour of its segment, of its "
        "object, and of its true instance or class."
    )
    return Page(
        name="partition",
        title="Partition quality",
        introduction=[INTRODUCTION],
        chart="Means over the number of segments as curves",
        sections=[*sections, *([Section("Pictures", [about, *pictures])] if drawn else [])],
        method=METHOD,
        machine=results["machine"],
        command=COMMAND,
    )


def _requirements(results: Results) -> list[Section]:
    """Requirements, and objects beside cut-pursuit on every cloud."""
    rows = []
    for scan in results["scans"]:
        for target in COUNTS:
            for ours, theirs in pairs([scan], OBJECTS.name, CUT_PURSUIT.name, target).values():
                gain = ours["mean_iou"] - theirs["mean_iou"]
                times = scan["timing"][0] if target == DEFAULT and scan["timing"] else {}
                names = ("objects_ms", "cut_pursuit_ms", "ratio")
                rows.append(
                    [scan["name"], str(target), f"{theirs['count']:,}"]
                    + [share(ours["mean_iou"]), share(theirs["mean_iou"]), f"{gain:+.3f}"]
                    + [quartiles(times.get(name)) for name in names]
                )
    head = ["cloud", "target", "segments", "objects", "cut-pursuit", "difference"]
    head += ["objects, ms", "cut-pursuit, ms", "ratio"]
    about = (
        "Mean IoU, with the objects cut at the number of segments that cut-pursuit reached; "
        "wall-clock time of alternating runs at its default number, median (quartiles) of 3."
    )
    return [
        Section(
            "Requirements on objects beside cut-pursuit", [requirement_table(results["rows"])]
        ),
        Section("Objects and cut-pursuit by cloud", [about, Table(head, rows)], level=3),
    ]


def _means(heading: str, scans: list[Results], results: Results) -> list[Section]:
    """A table of means for every target."""
    names = [method["name"] for method in results["methods"]]
    columns = SCORES | (INSTANCES if any(scan["instances"] for scan in scans) else {})
    table = {"method": text("method"), "clouds": text("scans"), "segments": text("count", ",.0f")}
    table |= {name: shares(key) for key, name in columns.items()} | COST
    about = (
        f"Over {', '.join(scan['name'] for scan in scans)}. In each table all rows are over the "
        "same clouds: those on which all methods shown reached the target. A method that reached "
        "it on less than three quarters of the clouds is not shown."
    )
    sections = [Section(f"{heading}: means", [about])]
    for target in targets(results):
        rows = means(scans, names, target)
        if rows:
            title = "default settings" if target == DEFAULT else f"{target:,} segments"
            sections.append(Section(f"{heading}, {title}", [table_of(rows, table)], level=3))
    return sections


def _clouds(results: Results) -> list[Section]:
    """The mean IoU of every method on every cloud."""
    about = (
        "Mean IoU and, in brackets, the number of segments reached; a dash: the method could not "
        "reach the target."
    )
    sections = [Section("All clouds", [about])]
    head = ["method", DEFAULT, *(f"{count:,}" for count in results["counts"])]
    for scan in results["scans"]:
        rows = [
            [method["name"], *(_score(scan, method["name"], at) for at in targets(results))]
            for method in results["methods"]
            if method["name"] not in results["missing"]
        ]
        classes = ", ".join(f"{name} {count:,}" for name, count in scan["classes"].items())
        instances = f"; {scan['instances']:,} instances" if scan["instances"] else ""
        properties = f"{scan['points']:,} points: {classes}{instances}."
        problems = [f"{method}: {problem}." for method, problem in scan["problems"].items()]
        parts: list[str | Table] = [properties, Table(head, rows), *problems]
        sections.append(Section(scan["name"], parts, level=3))
    return sections


def _score(scan: Results, method: str, target: int | str) -> str:
    evaluation = evaluation_at(scan, method, target)
    if evaluation is None:
        return "-"
    return f"{evaluation['mean_iou']:.3f} ({evaluation['count']:,})"


def _methods(results: Results) -> Section:
    names = [method["name"] for method in results["methods"]]
    columns = {"method": text("name"), "version": text("version")}
    columns["searched parameter"] = lambda method: method["parameter"] or "number of segments"
    columns["grid of other settings"] = text("grid")
    missing = [not_measured(results["missing"])] if results["missing"] else []
    note = [CUT_PURSUIT_NOTE] if CUT_PURSUIT.name in names else []
    return Section("Methods", [table_of(results["methods"], columns), *missing, *note])
