"""The page of the study of the object scale."""

from typing import Any

from studies.partition.scale.cuts import DOUBLING
from studies.report.page import Cell, Page, Section, Table, number, share, shares, table_of, text

Results = dict[str, Any]

COMMAND = """
python -m studies.partition.scale sim:woodland sim:industrial sim:roadway sim:mixed SCENE... \\
    -o docs/results
"""
INTRODUCTION = (
    "Objects are cut from a hierarchy of merges: all merges before the first one that costs more "
    "than `objects.scale` are made ([objects](../explanation/objects.md)). Here the hierarchy is "
    "cut at many scales, to see what depends on the choice and how much. More scales than in the "
    "tables are in [scale.json](scale.json)."
)
DEFINITIONS = Table(
    ["column", "definition"],
    [
        ["scale", "`objects.scale`"],
        ["objects", "number of objects"],
        ["cost", "cost of the merges that are made, as a share of that of all merges"],
        [
            "moved, doubled",
            "share of the points that change their object when the scale doubles, i.e. that are "
            "not in its successor by the rule of persistent ids",
        ],
        [
            "ARI, doubled",
            "adjusted Rand index (Hubert and Arabie 1985) of the objects at this scale and at "
            "twice the scale, over points; 1: identical",
        ],
        [
            "moved, next; ARI, next",
            "the same for the objects of two consecutive updates at one scale, over the points in "
            "both windows; mean of the last pairs of updates",
        ],
        [
            "purity, mean IoU",
            "against classes, where they are known, as in [partition](partition.md)",
        ],
        ["ARI, PQ", "against instances, where known; the ARI is over points that are not ground"],
    ],
)
METHOD: list[str | Table] = [
    "All values are of the last window of a scene, over its points that have a segment.",
    DEFINITIONS,
]
COLUMNS = {
    "cost_share": "cost",
    "moved_doubled": "moved, doubled",
    "ari_doubled": "ARI, doubled",
    "moved_next": "moved, next",
    "ari_next": "ARI, next",
}
TRUTH = {"purity": "purity", "mean_iou": "mean IoU", "ari": "ARI", "quality": "PQ"}


def page(results: Results) -> Page:
    """The current scale on all scenes, against truth, then every scene."""
    return Page(
        name="scale",
        title="Object scale",
        introduction=[INTRODUCTION],
        chart="Measures over the scale as curves",
        sections=[
            _current(results),
            _truth(results),
            *(_scene(scene, results["scale"]) for scene in results["scenes"]),
        ],
        method=METHOD,
        command=COMMAND,
    )


def _current_row(scene: Results) -> Results:
    """The row of the current scale: the middle one."""
    return dict(scene["rows"][len(scene["rows"]) // 2])


def _current(results: Results) -> Section:
    rows = []
    for scene in results["scenes"]:
        middle = len(scene["rows"]) // 2
        row = _current_row(scene)
        counts = [scene["rows"][middle + k]["objects"] for k in (-DOUBLING, 0, DOUBLING)]
        rows.append(
            [scene["name"], f"{scene['segments']:,}", *(f"{count:,}" for count in counts)]
            + [share(row[name]) for name in COLUMNS]
        )
    settings = ", ".join(f"{name} {value}" for name, value in results["settings"].items())
    head = ["scene", "segments", "objects at half", "objects", "at double", *COLUMNS.values()]
    return Section(
        f"At a scale of {number(results['scale'])}, all scenes",
        [f"Settings: {settings or 'the defaults'}.", Table(head, rows)],
    )


def _truth(results: Results) -> Section:
    """Loss of class scores by grouping, and gain of instance scores at other scales."""
    classes = []
    for scene in _with("mean_iou", results):
        segments, objects = scene["ungrouped"]["mean_iou"], _current_row(scene)["mean_iou"]
        loss = share(segments - objects)
        classes.append([scene["name"], share(segments), share(objects), loss])
    curves = {
        scene["name"]: {row["scale"]: row.get("quality", 0.0) for row in scene["rows"]}
        for scene in _with("quality", results)
    }
    if curves:
        every = list(curves.values())
        scales = every[0]
        curves["mean of all"] = {k: sum(curve[k] for curve in every) / len(every) for k in scales}
    instances = [_gain(name, curve, results["scale"]) for name, curve in curves.items()]
    return Section(
        "Against truth",
        [
            "Classes: grouping rarely raises the mean IoU; the table shows how much of that of "
            "the segments is lost.",
            Table(["scene", "mean IoU, segments", "objects", "loss"], classes),
            "Instances: the best scale of each scene separately, and its gain; in the last row, "
            "the scale that is best on average.",
            Table(["scene", "PQ, current scale", "best", "at a scale of", "gain"], instances),
        ],
    )


def _with(name: str, results: Results) -> list[Results]:
    return [scene for scene in results["scenes"] if name in _current_row(scene)]


def _gain(name: str, curve: dict[float, float], current: float) -> list[str]:
    best = max(curve, key=lambda scale: curve[scale])
    gain = curve[best] - curve[current]
    return [name, share(curve[current]), share(curve[best]), number(best), share(gain)]


def _scene(scene: Results, current: float) -> Section:
    truth = {key: text for key, text in TRUTH.items() if any(key in row for row in scene["rows"])}

    def scale(row: Results) -> str:
        return f"**{number(current)}**" if row["scale"] == current else number(row["scale"])

    columns: dict[str, Cell] = {"scale": scale, "objects": text("objects", ",")}
    columns |= {name: shares(key) for key, name in (COLUMNS | truth).items()}
    size = (
        f"{scene['points']:,} points in {scene['segments']:,} segments, window of "
        f"{scene['window_s']:.0f} s, {scene['pairs']} pairs of updates."
    )
    return Section(scene["name"], [size, table_of(scene["rows"][::DOUBLING], columns)])
