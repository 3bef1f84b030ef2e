"""Earlier names of what studies.report.page offers, until every study uses that."""

from studies.report.machine import machine_line as _machine_line
from studies.report.page import Table, not_measured, number, quartiles

Cells = list[str]
between = quartiles
__all__ = ["Cells", "between", "machine_line", "not_measured", "number", "table"]


def table(head: Cells, rows: list[Cells]) -> str:
    """A Markdown table."""
    return Table(head, rows).markdown() + "\n"


def machine_line(machine: dict[str, object]) -> str:
    """The machine as a sentence."""
    return _machine_line(machine) + "\n"
