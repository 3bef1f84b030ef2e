"""The paper's findings, one by one, and whether scenes show them."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

Facts = dict[str, Any]
Value = Callable[[Facts], float]  # of the facts of one criterion

CLEAR = 0.02  # loss at both ends of a curve whose minimum is one
SLIGHT = 0.05  # loss that does no harm
LATE = 0.8  # merge completion
PAPERS = ("shape", "density")  # its criteria
TESSELLA = 0.05  # share of all points: the ground is in many parts
ONE_SEGMENT = 0.2  # share of all points: there is more ground than that in every scene


@dataclass(frozen=True)
class Claim:
    """One finding: what the paper says, and how a scene is judged."""

    text: str
    paper: str  # its numbers
    rule: str  # when a scene shows it
    shows: Callable[[Facts], bool]  # of the facts of a scene, by criterion
    measured: Callable[[list[Facts]], str]  # of those of several scenes


@dataclass(frozen=True)
class Verdict:
    """What scenes of one kind make of a claim."""

    measured: str
    shown: int
    scenes: int

    @property
    def holds(self) -> str:
        """In a word, or in how many scenes."""
        if not self.scenes:
            return "-"
        if self.shown in (0, self.scenes):
            return "yes" if self.shown else "no"
        return f"in {self.shown} of {self.scenes}"


def judge(claim: Claim, scenes: list[Facts]) -> Verdict:
    """Judge a claim by scenes (facts, see facts.py) of one kind."""
    criteria = [scene["criteria"] for scene in scenes]
    shown = sum(claim.shows(one) for one in criteria)
    return Verdict(claim.measured(criteria) if criteria else "-", shown, len(criteria))


def span(scenes: list[Facts], criterion: str, value: Value, form: str) -> str:
    """Least and greatest of a value over the scenes."""
    values = sorted(value(scene[criterion]) for scene in scenes)
    low, high = (f"{value:{form}}" for value in (values[0], values[-1]))
    return low if low == high else f"{low} to {high}"


def spans(name: str, form: str, *criteria: str) -> Callable[[list[Facts]], str]:
    """The span of one number for each of the criteria."""
    return lambda scenes: ", ".join(
        f"{criterion} {span(scenes, criterion, lambda one: one[name], form)}"
        for criterion in criteria
    )


def _least_end(scene: Facts) -> float:
    """The lesser loss at the ends of the thresholds, of the paper's criteria."""
    ends = ("loss_at_lowest", "loss_at_highest")
    return min(float(scene[name][end]) for name in PAPERS for end in ends)


CLAIMS = (
    Claim(
        "The AICc over the threshold has a minimum",
        "figure 4",
        f"loss at both ends of the thresholds at least {CLEAR:g}, shape and density",
        lambda scene: _least_end(scene) >= CLEAR,
        lambda scenes: f"loss at the ends {min(map(_least_end, scenes)):.2f} or more",
    ),
    Claim(
        "Minima lie at 80 % merge completion or later",
        "figure 5",
        "shape and density",
        lambda scene: all(scene[name]["completion"] >= LATE for name in PAPERS),
        spans("completion", ".0%", *PAPERS),
    ),
    Claim(
        "The minimum of density comes later in the merging than that of shape",
        "figure 5",
        "completion at the minimum",
        lambda scene: scene["density"]["completion"] > scene["shape"]["completion"],
        spans("completion", ".1%", *PAPERS),
    ),
    Claim(
        "The minimum of density is lower than that of shape",
        "1.358e5 against 8.949e5",
        "AICc per point",
        lambda scene: scene["density"]["aicc"] < scene["shape"]["aicc"],
        spans("aicc", ".2f", *PAPERS),
    ),
    Claim(
        "Shape leaves thousands of ellipsoids",
        "7,173 and 12,391",
        "1,000 or more",
        lambda scene: scene["shape"]["count"] >= 1000,
        spans("count", ",", "shape"),
    ),
    Claim(
        "Density leaves fewer ellipsoids than shape",
        "5,061 and 4,057",
        "number at the minimum",
        lambda scene: scene["density"]["count"] < scene["shape"]["count"],
        spans("count", ",", *PAPERS),
    ),
    Claim(
        "Many of the ellipsoids that shape leaves are small",
        "in words",
        "half of them or more have fewer than 12 points",
        lambda scene: 2 * scene["shape"]["small"] >= scene["shape"]["count"],
        lambda scenes: (
            span(scenes, "shape", lambda one: one["small"] / max(1, one["count"]), ".0%")
            + " of them"
        ),
    ),
    Claim(
        "Shape finds larger structure than density",
        "walls, road, ground",
        "half of the points lie in fewer segments",
        lambda scene: scene["shape"]["half"] < scene["density"]["half"],
        spans("half", ",", *PAPERS),
    ),
    Claim(
        "Density fits more tightly than shape",
        "in words",
        "median over the points of their ellipsoid's mean half axis, m",
        lambda scene: scene["density"]["size_m"] < scene["shape"]["size_m"],
        spans("size_m", ".2f", *PAPERS),
    ),
    Claim(
        "Density tessellates the ground",
        "figure 6",
        "no segment has more than a twentieth of all points",
        lambda scene: scene["density"]["largest"] <= TESSELLA,
        spans("largest", ".1%", "density"),
    ),
    Claim(
        "Shape makes the ground of a wood one segment",
        "figure 6",
        "the largest segment has a fifth of all points or more",
        lambda scene: scene["shape"]["largest"] >= ONE_SEGMENT,
        spans("largest", ".1%", "shape"),
    ),
)

BEYOND = (
    Claim(
        "Parsimony has a lower AICc than shape and density",
        "",
        "AICc per point",
        lambda scene: (
            scene["parsimony"]["aicc"] < min(scene["shape"]["aicc"], scene["density"]["aicc"])
        ),
        spans("aicc", ".2f", "shape", "density", "parsimony"),
    ),
    Claim(
        "with fewer ellipsoids",
        "",
        "number at the minimum",
        lambda scene: (
            scene["parsimony"]["count"] < min(scene["shape"]["count"], scene["density"]["count"])
        ),
        spans("count", ",", "shape", "density", "parsimony"),
    ),
    Claim(
        "The default thresholds need no tuning",
        "",
        f"loss at most {SLIGHT:g}, every criterion",
        lambda scene: all(one["loss_at_default"] <= SLIGHT for one in scene.values()),
        lambda scenes: (
            ", ".join(
                f"{name} {max(scene[name]['loss_at_default'] for scene in scenes):.3f}"
                for name in ("shape", "density", "parsimony")
            )
            + " at most"
        ),
    ),
)
