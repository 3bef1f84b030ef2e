"""The claims as Markdown, which a terminal shows as well."""

from typing import Any

from ellipseg_ros.config import CRITERIA
from studies.paper.facts import KINDS
from studies.paper.findings import BEYOND, CLAIMS, SLIGHT, Claim, judge
from studies.report.markdown import table

Facts = dict[str, Any]
PICTURES = "images/paper_"

INTRODUCTION = """# What holds of the paper

Written by `ellipseg paper`; every number was measured by it, in one run. To measure again, with
recordings of yours beside the four simulated scenes:

```bash
ellipseg paper drive.mcap -o paper
cp paper/claims.* docs && cp paper/images/* docs/images
```

The scenes of the paper are not ours. The simulated ones imitate its scanner, not its places; of
the real ones only numbers are shown, as the recordings are not ours to publish. Each is one window
of points. Equations and choices: [method](../explanation/method.md). AICc is given per point, and
compares on the same points only.
"""
CLAIMED = """## Claims

A scene shows a claim by the rule in the third column. Ranges are over the scenes, each at the
threshold of least AICc.
"""
BETTER = """## Beyond the paper

Parsimony grows the AICc itself, the other two something that the AICc then judges.
"""
MINIMA = """## The minima

The threshold of least AICc, what it leaves, and the loss at the node's default threshold:
loss(τ) = (AICc(τ) − min) / (AICc of all singletons − min).
"""
ONE_THRESHOLD = """## One threshold for all

The threshold whose worst loss over the scenes is least, and that loss.
"""
FIGURES = {
    "figure3": (
        "Figure 3: the shape spectrum",
        "RGB is the square root of cylindricality, sphericity and planarity.",
    ),
    "figure4": (
        "Figure 4: AICc and its terms over the threshold",
        "Simulated industrial scene. The paper shows shape and density.",
    ),
    "figure5": (
        "Figure 5: AICc over merge completion",
        "Dots are the minima. Curves end where the thresholds do.",
    ),
    "figure6_industrial": (
        "Figure 6: segmentations at the minimum, industrial",
        "Left points, a colour a segment; right ellipsoids of 12 points or more, coloured as "
        "figure 3. Shape, density, parsimony.",
    ),
    "figure6_woodland": ("The same, woodland", ""),
    "figure7": (
        "Figure 7: AICc over the threshold, all scenes",
        "Simulated scenes drawn through, real ones dashed. The paper shows shape.",
    ),
}


def page(facts: Facts) -> str:
    """All of docs/claims.md."""
    return "\n".join([INTRODUCTION, *blocks(facts), *_figures(facts)])


def blocks(facts: Facts) -> list[str]:
    """The tables."""
    changed = facts["settings"]
    settings = ", ".join(f"`{name}` {value}" for name, value in changed.items())
    return [
        *([f"Settings that are not the defaults: {settings}.\n"] if changed else []),
        CLAIMED,
        _claims(facts, CLAIMS),
        BETTER,
        _claims(facts, BEYOND),
        ONE_THRESHOLD,
        _shared(facts),
        MINIMA,
        _minima(facts),
    ]


def _claims(facts: Facts, claims: tuple[Claim, ...]) -> str:
    groups = {kind: [s for s in facts["scenes"] if s["kind"] == kind] for kind in KINDS}
    groups = {kind: scenes for kind, scenes in groups.items() if scenes}
    in_print = any(claim.paper for claim in claims)
    head = ["claim", *(["paper"] if in_print else []), "rule"]
    for kind, scenes in groups.items():
        head += [f"{kind} ({len(scenes)})", "holds"]
    rows = []
    for claim in claims:
        row = [claim.text, *([claim.paper] if in_print else []), claim.rule]
        for scenes in groups.values():
            verdict = judge(claim, scenes)
            row += [verdict.measured, verdict.holds]
        rows.append(row)
    return table(head, rows)


def _shared(facts: Facts) -> str:
    kinds = [kind for kind in (*KINDS, "all") if kind in facts["shared"][CRITERIA[0]]]
    head = ["criterion", *(f"{kind}: τ, loss" for kind in kinds), f"holds (loss ≤ {SLIGHT:g})"]
    rows = []
    for name in CRITERIA:
        found = [facts["shared"][name][kind] for kind in kinds]
        cells = [f"{one['threshold']:.3g}, {one['worst_loss']:.3f}" for one in found]
        rows.append([name, *cells, "yes" if found[-1]["worst_loss"] <= SLIGHT else "no"])
    return table(head, rows)


def _minima(facts: Facts) -> str:
    head = ["scene", "points", "criterion", "τ", "AICc", "variance", "bias", "ellipsoids"]
    head += ["completion", "default τ", "loss there"]
    rows = []
    for scene in facts["scenes"]:
        for name, one in scene["criteria"].items():
            row = [scene["name"], f"{scene['points']:,}", name, f"{one['threshold']:.3g}"]
            row += [f"{one[key]:.2f}" for key in ("aicc", "variance", "bias")]
            row += [f"{one['count']:,}", f"{one['completion']:.1%}", f"{one['default']:g}"]
            rows.append([*row, f"{one['loss_at_default']:.4f}"])
    return table(head, rows)


def _figures(facts: Facts) -> list[str]:
    parts = ["## Figures\n"]
    for name in facts["figures"]:
        heading, text = FIGURES[name]
        parts.append(f"### {heading}\n\n![{heading}]({PICTURES}{name}.png)\n")
        if text:
            parts.append(f"{text}\n")
    return parts
