"""Requirements, what was measured of them, and whether they are met."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from studies.report.page import Table, number, quartiles

Row = dict[str, Any]  # JSON-ready; see Target.judge and check

AIM, MET, MISSED, NOT_MEASURED = "aim met", "met", "not met", "not measured"


@dataclass(frozen=True)
class Target:
    """A measured quantity with the limit it must keep and the one aimed at.

    It is a lower limit if the aim is above what must be, else an upper one.
    """

    requirement: str
    must: float
    aim: float
    unit: str = ""

    def judge(self, value: dict[str, Any] | float | None) -> Row:
        """Requirement, limits, measured value and result, JSON-ready.

        value: a spread (see timing.py), of which the median counts, a number, or None.
        """
        middle = value["median"] if isinstance(value, dict) else value
        limits = {"unit": self.unit, "must": self.must, "aim": self.aim}
        result = NOT_MEASURED if middle is None else self._result(float(middle))
        return {"requirement": self.requirement, **limits, "measured": value, "result": result}

    def _result(self, value: float) -> str:
        sign = 1.0 if self.aim > self.must else -1.0
        if sign * value >= sign * self.aim:
            return AIM
        return MET if sign * value >= sign * self.must else MISSED


def check(requirement: str, test: str, measured: str, met: bool) -> Row:
    """A requirement without numeric limits: how it was tested, what was seen, and the result."""
    result = MET if met else MISSED
    return {"requirement": requirement, "test": test, "measured": measured, "result": result}


def requirement_table(rows: Sequence[Row]) -> Table:
    """Requirements with test, limits, measured value and result; columns that apply only."""
    columns = [_cells(row) for row in rows]
    names = [name for name in _HEAD if any(cells[name] for cells in columns)]
    return Table(names, [[cells[name] for name in names] for cells in columns])


_HEAD = ("requirement", "test", "must", "aim", "measured", "runs", "result")


def _cells(row: Row) -> dict[str, str]:
    value = row["measured"]
    cells = dict.fromkeys(_HEAD, "") | {"requirement": row["requirement"]}
    cells["test"] = row.get("test", "")
    if "must" in row:
        sign = "≥" if row["aim"] > row["must"] else "≤"
        for name in ("must", "aim"):
            cells[name] = f"{sign} {row[name]:g} {row['unit']}".rstrip()
    if isinstance(value, dict):
        cells["measured"] = f"{quartiles(value)} {row['unit']}".rstrip()
        cells["runs"] = str(value["runs"])
    elif isinstance(value, str):
        cells["measured"] = value
    else:
        cells["measured"] = "-" if value is None else f"{number(value)} {row['unit']}".rstrip()
    cells["result"] = f"**{MISSED}**" if row["result"] == MISSED else row["result"]
    return cells
