"""Results as Markdown, which a terminal shows as well."""

import re
from typing import Any

Cells = list[str]
NUMBER = re.compile(r"([≤≥] )?-?\d[\d.,%]*( m?s| MB| \(.*| clouds)?$|-?$")  # or nothing

BUSY = (
    " **The machine was busy**: times by the clock are too long, and those of the cores somewhat; "
    "ratios of times taken in turn suffer least."
)


def table(head: Cells, rows: list[Cells]) -> str:
    """A Markdown table, its columns aligned: numbers to the right."""
    columns = list(zip(*rows, strict=True)) if rows else [()] * len(head)
    numeric = [all(NUMBER.match(cell) for cell in column) for column in columns]
    widths = [
        max(3, len(name), *map(len, cells)) for name, cells in zip(head, columns, strict=True)
    ]
    rule = [
        "-" * (width - 1) + (":" if right else "-")
        for width, right in zip(widths, numeric, strict=True)
    ]
    lines = []
    for row in [head, rule, *rows]:
        cells = [
            cell.rjust(width) if right else cell.ljust(width)
            for cell, width, right in zip(row, widths, numeric, strict=True)
        ]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def number(value: float) -> str:
    """Three digits that matter; whole from 100 on."""
    return f"{value:,.0f}" if abs(value) >= 100.0 else f"{value:.3g}"


def between(value: dict[str, Any] | None) -> str:
    """Median and quartiles."""
    if value is None:
        return "-"
    if value["runs"] == 1:
        return number(value["median"])
    return f"{number(value['median'])} ({number(value['low'])} to {number(value['high'])})"


def machine_line(machine: dict[str, Any]) -> str:
    """What `describe` found, as a sentence."""
    versions = ", ".join(f"{name} {version}" for name, version in machine["versions"].items())
    busy = BUSY if machine["load_before"] > machine["cores"] else ""
    return (
        f"Machine: {machine['cpu']}, {machine['cores']} cores, {machine['memory_gb']:g} GB; "
        f"{machine['system']}, Python {machine['python']}, {versions}. "
        f"Load average before: {machine['load_before']:g}.{busy}\n"
    )


def not_measured(missing: dict[str, str]) -> str:
    """What is not there, and why, as a sentence."""
    return "Not measured: " + "; ".join(f"{name} ({why})" for name, why in missing.items()) + "."
