"""What the scale of objects does, as Markdown."""

from typing import Any

from studies.partition.scale import DOUBLING
from studies.report.markdown import Cells, number, table

Results = dict[str, Any]

INTRODUCTION = """# The scale of objects

Written by `ellipseg evaluate scale`; every number was measured by it. To measure again:

```bash
ellipseg evaluate scale sim:woodland sim:industrial sim:roadway sim:mixed SCENE... -o docs
```

Objects are cut from one hierarchy of merges: all those before the first one that costs more than
`objects.scale` ([objects](../explanation/objects.md)). Here it is cut at many scales, to see what
depends on the choice, and how much. The numbers of more scales are in [scale.json](scale.json).
"""
PICTURE = "![The same as curves over the scale](scale.png)\n"
DEFINITIONS = """## What the columns say

All is of the last window of a scene, and of the points in it that have a segment.

| column | what |
| --- | --- |
| scale | `objects.scale` |
| objects | number of objects |
| paid | costs of the merges that are made, as a share of those of all merges there are |
| moved, wider | share of the points that change their object when the scale doubles: that are not in the heir of it, by the rule of ids |
| ARI, wider | adjusted Rand index (Hubert and Arabie 1985) of the objects at this scale and at twice the scale, over points: 1 if they are the same |
| moved, next; ARI, next | the same for the objects of two updates in a row, over the points in both windows, at the same scale; mean of the last pairs of updates |
| purity, mean IoU | against classes, where they are known, as in [quality.md](quality.md) |
| ARI, PQ | against things, where they are known; the ARI is over points that are no ground |
"""  # noqa: E501, a cell of a Markdown table is one line
COLUMNS = {
    "paid": "paid",
    "moved_wider": "moved, wider",
    "ari_wider": "ARI, wider",
    "moved_next": "moved, next",
    "ari_next": "ARI, next",
}
TRUTH = {"purity": "purity", "mean_iou": "mean IoU", "ari": "ARI", "quality": "PQ"}


def page(results: Results) -> str:
    """All of docs/scale.md."""
    return "\n".join([INTRODUCTION, PICTURE, *blocks(results), DEFINITIONS])


def blocks(results: Results) -> list[str]:
    """The scale in force on all scenes, against truth, every scene."""
    return [
        _at_own(results),
        _truth(results),
        *(_scene(one, results) for one in results["scenes"]),
    ]


def own_row(scene: Results) -> Results:
    """The row of the scale in force: the middle one."""
    return dict(scene["rows"][len(scene["rows"]) // 2])


def _at_own(results: Results) -> str:
    rows = []
    for scene in results["scenes"]:
        row = own_row(scene)
        half, double = (
            scene["rows"][len(scene["rows"]) // 2 + k]["objects"] for k in (-DOUBLING, DOUBLING)
        )
        rows.append(
            [scene["name"], f"{scene['segments']:,}", f"{half:,}", f"{row['objects']:,}"]
            + [f"{double:,}", *(_share(row[name]) for name in COLUMNS)]
        )
    head = ["scene", "segments", "objects at half", "objects", "at double", *COLUMNS.values()]
    settings = ", ".join(f"{name} {value}" for name, value in results["settings"].items())
    text = f"## At a scale of {number(results['scale'])}, on every scene\n\n"
    text += f"Settings: {settings or 'the defaults'}.\n\n"
    return text + table(head, rows)


def _truth(results: Results) -> str:
    """What grouping costs of the classes, and gains of the things."""
    text = (
        "## Against truth\n\nClasses: merging can hardly but lose mean IoU; here is how much of "
        "that of the segments is lost.\n\n"
    )
    text += table(
        ["scene", "mean IoU, segments", "objects", "lost"],
        [_lost(scene, own_row(scene)["mean_iou"]) for scene in _with("mean_iou", results)],
    )
    scenes = _with("quality", results)
    curves = {scene["name"]: _curve(scene, "quality") for scene in scenes}
    if curves:
        every = list(curves.values())
        curves["mean of all"] = {
            scale: sum(curve[scale] for curve in every) / len(every) for scale in every[0]
        }
    text += (
        "\nThings: the best scale of each scene by itself, and what it gains; last, the one that "
        "is best on average.\n\n"
    )
    head = ["scene", "PQ, scale in force", "best", "at a scale of", "gain"]
    return text + table(head, [_gain(*one, results["scale"]) for one in curves.items()])


def _with(name: str, results: Results) -> list[Results]:
    return [scene for scene in results["scenes"] if name in own_row(scene)]


def _lost(scene: Results, own: float) -> Cells:
    alone = scene["ungrouped"]["mean_iou"]
    return [scene["name"], _share(alone), _share(own), f"{alone - own:.3f}"]


def _curve(scene: Results, name: str) -> dict[float, float]:
    return {row["scale"]: row.get(name, 0.0) for row in scene["rows"]}


def _gain(name: str, curve: dict[float, float], in_force: float) -> Cells:
    best = max(curve, key=lambda scale: curve[scale])
    gain = curve[best] - curve[in_force]
    return [name, _share(curve[in_force]), _share(curve[best]), number(best), f"{gain:.3f}"]


def _scene(scene: Results, results: Results) -> str:
    truth = {k: v for k, v in TRUTH.items() if any(k in row for row in scene["rows"])}
    rows = [
        [
            f"**{number(row['scale'])}**"
            if row["scale"] == results["scale"]
            else number(row["scale"])
        ]
        + [f"{row['objects']:,}", *(_share(row.get(name)) for name in (*COLUMNS, *truth))]
        for row in scene["rows"][::DOUBLING]
    ]
    text = (
        f"## {scene['name']}\n\n{scene['points']:,} points in {scene['segments']:,} segments, "
        f"window of {scene['window_s']:.0f} s, {scene['pairs']} pairs of updates.\n\n"
    )
    return text + table(["scale", "objects", *COLUMNS.values(), *truth.values()], rows)


def _share(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"
