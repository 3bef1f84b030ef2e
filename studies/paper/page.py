"""The page of the paper's findings and figures."""

from typing import Any

from ellipseg_ros.core.criteria import CRITERIA
from studies.paper.facts import KINDS
from studies.paper.findings import ADDITIONAL, FINDINGS, SMALL_LOSS, Finding, judge
from studies.report.page import Page, Section, Table, table_of, text

Facts = dict[str, Any]

COMMAND = """
python -m studies.paper RECORDING... -o paper
cp paper/paper.md paper/paper.json paper/paper_*.png docs/results
"""
INTRODUCTION = (
    "The paper's figures on other scenes, and which of its findings hold there. The simulated "
    "scenes imitate its scanner, not its places; of recorded scenes only numbers are shown, since "
    "the recordings may not be published here. Each scene is one window of points. Equations and "
    "choices: [method](../explanation/method.md). The AICc is given per point, and is comparable "
    "on the same points only."
)
ABOUT_FINDINGS = (
    "A scene shows a finding by the rule in the third column. Ranges are over the scenes, each at "
    "the threshold of lowest AICc."
)
ABOUT_ADDITIONAL = (
    "Parsimony merges by the AICc itself; shape and density merge by other measures, which the "
    "AICc then assesses."
)
ABOUT_SHARED = "The threshold with the lowest maximum loss over the scenes, and that loss."
ABOUT_MINIMA = (
    "The threshold of lowest AICc, its result, and the loss at the default threshold of the node: "
    "loss(τ) = (AICc(τ) − min) / (AICc of all singletons − min)."
)
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
        "Dots mark the minima. Curves end at the highest threshold.",
    ),
    "figure6_industrial": (
        "Figure 6: segmentations at the minimum, industrial",
        "Left: points, a colour per segment; right: ellipsoids of 12 points or more, coloured as "
        "in figure 3. From top to bottom: shape, density, parsimony.",
    ),
    "figure6_woodland": ("Figure 6: segmentations at the minimum, woodland", ""),
    "figure7": (
        "Figure 7: AICc over the threshold, all scenes",
        "Simulated scenes are solid, recorded ones dashed. The paper shows shape.",
    ),
}


def page(facts: Facts) -> Page:
    """Findings, thresholds and figures."""
    changed = facts["settings"]
    settings = ", ".join(f"`{name}` {value}" for name, value in changed.items())
    figures = [
        Section(heading, [f"![{heading}](paper_{name}.png)", *([note] if note else [])], level=3)
        for name, (heading, note) in FIGURES.items()
        if name in facts["figures"]
    ]
    return Page(
        name="paper",
        title="Findings of the paper",
        introduction=[INTRODUCTION],
        sections=[
            Section("Findings", [ABOUT_FINDINGS, _findings(facts, FINDINGS)]),
            Section("Beyond the paper", [ABOUT_ADDITIONAL, _findings(facts, ADDITIONAL)]),
            Section("One threshold for all scenes", [ABOUT_SHARED, _shared(facts)]),
            Section("Minima", [ABOUT_MINIMA, _minima(facts)]),
            *([Section("Figures", []), *figures] if figures else []),
        ],
        method=[f"Settings that differ from the defaults: {settings}."] if changed else [],
        command=COMMAND,
    )


def _findings(facts: Facts, findings: tuple[Finding, ...]) -> Table:
    groups = {kind: [s for s in facts["scenes"] if s["kind"] == kind] for kind in KINDS}
    groups = {kind: scenes for kind, scenes in groups.items() if scenes}
    in_paper = any(finding.paper for finding in findings)
    head = ["finding", *(["paper"] if in_paper else []), "rule"]
    for kind, scenes in groups.items():
        head += [f"{kind} ({len(scenes)})", "holds"]
    rows = []
    for finding in findings:
        row = [finding.text, *([finding.paper] if in_paper else []), finding.rule]
        for scenes in groups.values():
            verdict = judge(finding, scenes)
            row += [verdict.measured, verdict.holds]
        rows.append(row)
    return Table(head, rows)


def _shared(facts: Facts) -> Table:
    kinds = [kind for kind in (*KINDS, "all") if kind in facts["shared"]["shape"]]
    head = ["criterion", *(f"{kind}: τ, loss" for kind in kinds), f"loss ≤ {SMALL_LOSS:g}"]
    rows = []
    for name in CRITERIA:
        shared = [facts["shared"][name][kind] for kind in kinds]
        cells = [f"{one['threshold']:.3g}, {one['worst_loss']:.3f}" for one in shared]
        rows.append([name, *cells, "yes" if shared[-1]["worst_loss"] <= SMALL_LOSS else "no"])
    return Table(head, rows)


def _minima(facts: Facts) -> Table:
    rows = [
        {"scene": scene["name"], "points": scene["points"], "criterion": name} | one
        for scene in facts["scenes"]
        for name, one in scene["criteria"].items()
    ]
    columns = {
        "scene": text("scene"),
        "points": text("points", ","),
        "criterion": text("criterion"),
        "τ": text("threshold", ".3g"),
        "AICc": text("aicc", ".2f"),
        "variance": text("variance", ".2f"),
        "bias": text("bias", ".2f"),
        "ellipsoids": text("count", ","),
        "completion": text("completion", ".1%"),
        "default τ": text("default", "g"),
        "loss there": text("loss_at_default", ".4f"),
    }
    return table_of(rows, columns)
