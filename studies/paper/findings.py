"""The paper's findings, and the rules by which a scene shows them."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

Facts = dict[str, Any]
Value = Callable[[Facts], float]  # of the facts of one criterion

MIN_END_LOSS = 0.02  # at both ends of a curve that has a minimum
SMALL_LOSS = 0.05  # that makes no visible difference
LATE_COMPLETION = 0.8  # of the merging
PAPER_CRITERIA = ("shape", "density")
TILE_SHARE = 0.05  # of all points, at most in one segment if the ground is tessellated
GROUND_SHARE = 0.2  # of all points; the ground of every scene has more


@dataclass(frozen=True)
class Finding:
    """A finding of the paper, and the rule by which a scene shows it."""

    text: str
    paper: str  # its numbers
    rule: str
    shows: Callable[[Facts], bool]  # given the facts of a scene, by criterion
    measured: Callable[[list[Facts]], str]  # given those of several scenes


@dataclass(frozen=True)
class Verdict:
    """In how many scenes of one kind a finding holds, with the measured range."""

    measured: str
    shown: int
    scenes: int

    @property
    def holds(self) -> str:
        """yes, no, or the number of scenes."""
        if not self.scenes:
            return "-"
        if self.shown in (0, self.scenes):
            return "yes" if self.shown else "no"
        return f"in {self.shown} of {self.scenes}"


def judge(finding: Finding, scenes: list[Facts]) -> Verdict:
    """Judge a finding by scenes (see facts.py) of one kind."""
    criteria = [scene["criteria"] for scene in scenes]
    shown = sum(finding.shows(one) for one in criteria)
    return Verdict(finding.measured(criteria) if criteria else "-", shown, len(criteria))


def span(scenes: list[Facts], criterion: str, value: Value, form: str) -> str:
    """Smallest to largest value of a criterion over the scenes."""
    values = sorted(value(scene[criterion]) for scene in scenes)
    low, high = (f"{value:{form}}" for value in (values[0], values[-1]))
    return low if low == high else f"{low} to {high}"


def spans(name: str, form: str, *criteria: str) -> Callable[[list[Facts]], str]:
    """The span of one number for each of the criteria."""
    return lambda scenes: ", ".join(
        f"{criterion} {span(scenes, criterion, lambda one: one[name], form)}"
        for criterion in criteria
    )


def _lower_end_loss(scene: Facts) -> float:
    """The lower loss of the two ends of the thresholds, over the paper's criteria."""
    ends = ("loss_at_lowest", "loss_at_highest")
    return min(float(scene[name][end]) for name in PAPER_CRITERIA for end in ends)


FINDINGS = (
    Finding(
        "The AICc over the threshold has a minimum",
        "figure 4",
        f"loss at both ends of the thresholds at least {MIN_END_LOSS:g}, shape and density",
        lambda scene: _lower_end_loss(scene) >= MIN_END_LOSS,
        lambda scenes: f"loss at the ends {min(map(_lower_end_loss, scenes)):.2f} or more",
    ),
    Finding(
        "The minima are at 80 % merge completion or later",
        "figure 5",
        "shape and density",
        lambda scene: all(scene[name]["completion"] >= LATE_COMPLETION for name in PAPER_CRITERIA),
        spans("completion", ".0%", *PAPER_CRITERIA),
    ),
    Finding(
        "The minimum of density is at a later merge completion than that of shape",
        "figure 5",
        "completion at the minimum",
        lambda scene: scene["density"]["completion"] > scene["shape"]["completion"],
        spans("completion", ".1%", *PAPER_CRITERIA),
    ),
    Finding(
        "The minimum of density is lower than that of shape",
        "1.358e5 against 8.949e5",
        "AICc per point",
        lambda scene: scene["density"]["aicc"] < scene["shape"]["aicc"],
        spans("aicc", ".2f", *PAPER_CRITERIA),
    ),
    Finding(
        "Shape leaves thousands of ellipsoids",
        "7,173 and 12,391",
        "1,000 or more",
        lambda scene: scene["shape"]["count"] >= 1000,
        spans("count", ",", "shape"),
    ),
    Finding(
        "Density leaves fewer ellipsoids than shape",
        "5,061 and 4,057",
        "number at the minimum",
        lambda scene: scene["density"]["count"] < scene["shape"]["count"],
        spans("count", ",", *PAPER_CRITERIA),
    ),
    Finding(
        "Many of the ellipsoids that shape leaves are small",
        "in the text",
        "half of them or more have fewer than 12 points",
        lambda scene: 2 * scene["shape"]["small"] >= scene["shape"]["count"],
        lambda scenes: (
            span(scenes, "shape", lambda one: one["small"] / max(1, one["count"]), ".0%")
            + " of them"
        ),
    ),
    Finding(
        "Shape finds larger structures than density",
        "walls, road, ground",
        "half of the points lie in fewer segments",
        lambda scene: scene["shape"]["half"] < scene["density"]["half"],
        spans("half", ",", *PAPER_CRITERIA),
    ),
    Finding(
        "Density fits more tightly than shape",
        "in the text",
        "median over the points of the mean semi-axis of their ellipsoid, m",
        lambda scene: scene["density"]["size_m"] < scene["shape"]["size_m"],
        spans("size_m", ".2f", *PAPER_CRITERIA),
    ),
    Finding(
        "Density tessellates the ground",
        "figure 6",
        "no segment has more than a twentieth of all points",
        lambda scene: scene["density"]["largest"] <= TILE_SHARE,
        spans("largest", ".1%", "density"),
    ),
    Finding(
        "Shape makes the ground of a forest one segment",
        "figure 6",
        "the largest segment has a fifth of all points or more",
        lambda scene: scene["shape"]["largest"] >= GROUND_SHARE,
        spans("largest", ".1%", "shape"),
    ),
)

ADDITIONAL = (
    Finding(
        "Parsimony has a lower AICc than shape and density",
        "",
        "AICc per point",
        lambda scene: (
            scene["parsimony"]["aicc"] < min(scene["shape"]["aicc"], scene["density"]["aicc"])
        ),
        spans("aicc", ".2f", "shape", "density", "parsimony"),
    ),
    Finding(
        "Parsimony leaves fewer ellipsoids than shape and density",
        "",
        "number at the minimum",
        lambda scene: (
            scene["parsimony"]["count"] < min(scene["shape"]["count"], scene["density"]["count"])
        ),
        spans("count", ",", "shape", "density", "parsimony"),
    ),
    Finding(
        "The default thresholds are near the minima",
        "",
        f"loss at most {SMALL_LOSS:g}, every criterion",
        lambda scene: all(one["loss_at_default"] <= SMALL_LOSS for one in scene.values()),
        lambda scenes: (
            ", ".join(
                f"{name} {max(scene[name]['loss_at_default'] for scene in scenes):.3f}"
                for name in ("shape", "density", "parsimony")
            )
            + " at most"
        ),
    ),
)
