"""The required and the desired values of the benchmark. Less is better."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from studies.report.requirements import Target

Section = dict[str, Any]  # results of a section
Value = dict[str, Any]  # a spread, see report/timing.py


@dataclass(frozen=True)
class Row:
    """A target, the section that measures it, and where its value is in the results of that."""

    section: str
    target: Target
    value: Callable[[Section], Value | None]


def _batch(section: Section) -> Value | None:
    return next(
        (case.get("ratio") for case in section["cases"] if case["criterion"] == "shape"), None
    )


def _update(period: float) -> Callable[[Section], Value | None]:
    key = {"criterion": "shape", "kind": "lowest AICc", "period": period}
    return lambda section: next(
        (case["ratio"] for case in section["cases"] if key.items() <= case.items()), None
    )


def _length(period: float) -> Callable[[Section], Value | None]:
    """Ratio of the longest window to the window a quarter as long."""

    def value(section: Section) -> Value | None:
        case = max(section["cases"], key=lambda case: (case["period"] == period, case["window_s"]))
        return case["ratio_to"].get(f"{case['window_s'] / 4.0:g}")

    return value


def _largest(section: Section) -> Value | None:
    """The largest ratio of all criteria."""
    return max((case["ratio"] for case in section["cases"]), key=lambda value: value["median"])


ROWS = {
    "batch": Row("batch", Target("batch / small_gicp's 10-NN", 3.0, 2.0), _batch),
    "update_tenth": Row(
        "updates", Target("update at 0.1 s steps / batch", 0.3, 0.12), _update(0.1)
    ),
    "update_second": Row("updates", Target("update at 1 s steps / batch", 0.7, 0.4), _update(1.0)),
    "length_second": Row(
        "length",
        Target("update at 1 s steps, four times the window / window", 2.0, 1.3),
        _length(1.0),
    ),
    "length_tenth": Row(
        "length",
        Target("update at 0.1 s steps, four times the window / window", 2.0, 1.3),
        _length(0.1),
    ),
    "tuning": Row("tuning", Target("AICc at 40 thresholds / batch", 12.0, 8.0), _largest),
    "publishing": Row(
        "publishing",
        Target("building and publishing all messages", 60.0, 20.0, "ms"),
        lambda section: section["publish_ms"],
    ),
    "memory": Row(
        "memory",
        Target("peak memory of the node", 600.0, 350.0, "MB"),
        lambda section: dict.fromkeys(("median", "low", "high"), section["peak_mb"]) | {"runs": 1},
    ),
    "start": Row(
        "start",
        Target("start to ready, compiled cache warm", 5.0, 2.0, "s"),
        lambda section: section["warm_s"],
    ),
}


def judged(sections: dict[str, Section]) -> list[dict[str, Any]]:
    """Every target with its value, None where its section was not measured; JSON-ready."""
    return [
        {"key": key}
        | row.target.judge(row.value(sections[row.section]) if row.section in sections else None)
        for key, row in ROWS.items()
    ]
