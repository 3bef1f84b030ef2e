"""The rows of the speed table: what must be reached, what is aimed at, what was measured."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

Results = dict[str, Any]  # by section, as in benchmarks.json
Value = dict[str, Any]  # a Spread as JSON


@dataclass(frozen=True)
class Row:
    """One promise. Less is better."""

    key: str
    title: str
    section: str  # that measures it
    unit: str
    must: float
    aim: float
    find: Callable[[Results], Value | None]  # in the results of its section


def _batch(section: Results) -> Value | None:
    return next(
        (case.get("ratio") for case in section["cases"] if case["criterion"] == "shape"), None
    )


def _update(period: float) -> Callable[[Results], Value | None]:
    def find(section: Results) -> Value | None:
        wanted = {"criterion": "shape", "kind": "AICc-best", "period": period}
        return next(
            (case["ratio"] for case in section["cases"] if wanted.items() <= case.items()), None
        )

    return find


def _length(period: float) -> Callable[[Results], Value | None]:
    """The longest window over the one a quarter as long."""

    def find(section: Results) -> Value | None:
        case = max(section["cases"], key=lambda case: (case["period"] == period, case["window_s"]))
        return case["ratio_to"].get(f"{case['window_s'] / 4.0:g}")

    return find


def _dearest(section: Results) -> Value | None:
    """The criterion with the largest ratio."""
    return max((case["ratio"] for case in section["cases"]), key=lambda value: value["median"])


def _single(key: str) -> Callable[[Results], Value | None]:
    def find(section: Results) -> Value | None:
        value = section.get(key)
        if value is None or isinstance(value, dict):
            return value
        return {"median": value, "low": value, "high": value, "runs": 1}

    return find


ROWS = (
    Row("batch", "batch / small_gicp's 10-NN", "batch", "", 3.0, 2.0, _batch),
    Row("update_tenth", "update at 0.1 s steps / batch", "updates", "", 0.3, 0.12, _update(0.1)),
    Row("update_second", "update at 1 s steps / batch", "updates", "", 0.7, 0.4, _update(1.0)),
    Row(
        "length_second",
        "update at 1 s steps, four times the window / window",
        "length",
        "",
        2.0,
        1.3,
        _length(1.0),
    ),
    Row(
        "length_tenth",
        "update at 0.1 s steps, four times the window / window",
        "length",
        "",
        2.0,
        1.3,
        _length(0.1),
    ),
    Row("tuning", "AICc at 40 thresholds / batch", "tuning", "", 12.0, 8.0, _dearest),
    Row(
        "publishing",
        "message building and publishing",
        "publishing",
        "ms",
        60.0,
        20.0,
        _single("publish_ms"),
    ),
    Row("memory", "peak memory of the node", "memory", "MB", 600.0, 350.0, _single("peak_mb")),
    Row("start", "start to ready, cache warm", "start", "s", 5.0, 2.0, _single("warm_s")),
)


def table(results: Results) -> list[dict[str, Any]]:
    """Every row, JSON-ready; `value` None where its section was not measured."""
    rows = []
    for row in ROWS:
        value = row.find(results[row.section]) if row.section in results else None
        facts = {name: getattr(row, name) for name in ("key", "title", "unit", "must", "aim")}
        rows.append(facts | {"value": value, "reached": reached(row, value)})
    return rows


def reached(row: Row, value: Value | None) -> str:
    """What the median has reached."""
    if value is None:
        return "not measured"
    if value["median"] <= row.aim:
        return "aim"
    return "must" if value["median"] <= row.must else "neither"
