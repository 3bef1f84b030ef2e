"""Pages of results: title, sections of paragraphs and tables, and how they were measured."""

import json
import re
import textwrap
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from studies.report.machine import machine_line

WIDTH = 99  # characters of a line of text
NUMBER = re.compile(r"([≤≥] )?[-+]?\d[\d.,%]*( m?s| MB| \(.*| clouds)?$|-?$")  # or an empty cell


@dataclass(frozen=True)
class Table:
    """A table of texts; a column of numbers only is aligned to the right."""

    head: Sequence[str]
    rows: Sequence[Sequence[str]]

    def markdown(self) -> str:
        """The table in Markdown with aligned columns, which a terminal shows as well."""
        columns = list(zip(*self.rows, strict=True)) if self.rows else [()] * len(self.head)
        numeric = [all(NUMBER.match(cell) for cell in column) for column in columns]
        widths = [
            max(3, len(name), *map(len, cells))
            for name, cells in zip(self.head, columns, strict=True)
        ]
        rule = [
            "-" * (width - 1) + (":" if right else "-")
            for width, right in zip(widths, numeric, strict=True)
        ]
        lines = []
        for row in [self.head, rule, *self.rows]:
            cells = [
                cell.rjust(width) if right else cell.ljust(width)
                for cell, width, right in zip(row, widths, numeric, strict=True)
            ]
            lines.append(f"| {' | '.join(cells)} |")
        return "\n".join(lines)


Record = dict[str, Any]  # of results
Cell = Callable[[Record], str]
Part = str | Table  # a paragraph or Markdown of several lines; a table


@dataclass(frozen=True)
class Section:
    """A heading with what stands below it; level 2 is that of the page's main sections."""

    title: str
    parts: Sequence[Part]
    level: int = 2

    def blocks(self) -> Iterator[str]:
        """Heading, paragraphs and tables in Markdown."""
        yield f"{'#' * self.level} {self.title}"
        yield from map(block, self.parts)


@dataclass(frozen=True)
class Page:
    """A page of results; its files are NAME.md, NAME.json and perhaps NAME.png."""

    name: str
    title: str
    introduction: Sequence[Part]
    sections: Sequence[Section]
    command: str  # that measures everything again; lines of a shell
    method: Sequence[Part] = ()  # how it was measured, definitions of columns
    machine: dict[str, Any] | None = None  # of machine.describe
    chart: str = ""  # alternative text of NAME.png, if there is one

    def markdown(self) -> str:
        """The whole page."""
        chart = [f"![{self.chart}]({self.name}.png)"] if self.chart else []
        head = [f"# {self.title}", *map(block, self.introduction), *chart]
        sections = [text for section in self.sections for text in section.blocks()]
        return "\n\n".join([*head, *sections, *self._measured().blocks()]) + "\n"

    def tables(self) -> str:
        """The sections and the machine, for a terminal."""
        parts = [text for section in self.sections for text in section.blocks()]
        machine = [block(machine_line(self.machine))] if self.machine else []
        return "\n\n".join([*parts, *machine])

    def _measured(self) -> Section:
        machine = [machine_line(self.machine)] if self.machine else []
        again = "This page is written by a study. To measure everything again:"
        code = f"```bash\n{self.command.strip()}\n```"
        return Section("How it was measured", [*self.method, *machine, again, code])


def block(part: Part) -> str:
    """A part in Markdown; a paragraph given as one line is wrapped."""
    if isinstance(part, Table):
        return part.markdown()
    text = part.strip("\n")
    if "\n" in text or text.startswith(("![", "|")):
        return text
    return textwrap.fill(text, WIDTH, break_long_words=False, break_on_hyphens=False)


def number(value: float) -> str:
    """Three significant digits; no decimals from 100 on."""
    return f"{value:,.0f}" if abs(value) >= 100.0 else f"{value:.3g}"


def share(value: float | None) -> str:
    """A score with three decimals; a dash if there is none."""
    return "-" if value is None else f"{value:.3f}"


def quartiles(value: dict[str, Any] | None) -> str:
    """A spread (see timing.py) as "median (lower to upper quartile)"; a dash if there is none."""
    if value is None:
        return "-"
    if value["runs"] == 1:
        return number(value["median"])
    return f"{number(value['median'])} ({number(value['low'])} to {number(value['high'])})"


def not_measured(missing: dict[str, str]) -> str:
    """A sentence that names what was not measured and why."""
    return "Not measured: " + "; ".join(f"{name} ({why})" for name, why in missing.items()) + "."


def table_of(records: Iterable[Record], columns: dict[str, Cell]) -> Table:
    """A row per record and a column per name, whose function formats the cell of a record."""
    return Table(list(columns), [[cell(one) for cell in columns.values()] for one in records])


def text(key: str, form: str = "") -> Cell:
    """Cells with `record[key]` in a format; a dash if it is missing."""
    return lambda record: "-" if record.get(key) is None else f"{record[key]:{form}}"


def numbers(key: str) -> Cell:
    """Cells with three significant digits of `record[key]`."""
    return lambda record: number(record[key])


def shares(key: str) -> Cell:
    """Cells with the score `record[key]`."""
    return lambda record: share(record.get(key))


def spreads(key: str) -> Cell:
    """Cells with median and quartiles of `record[key]`."""
    return lambda record: quartiles(record.get(key))


def json_text(results: Any, levels: int = 2) -> str:
    """JSON with a line for everything of at most `levels` nested levels."""
    return f"{_json(results, levels, '')}\n"


def _json(value: Any, levels: int, indent: str) -> str:
    if not value or _height(value) <= levels:
        return json.dumps(value)
    inner = indent + " "
    if isinstance(value, dict):
        pairs = [f"{json.dumps(key)}: {_json(v, levels, inner)}" for key, v in value.items()]
        return "{\n" + ",\n".join(inner + pair for pair in pairs) + f"\n{indent}}}"
    items = [inner + _json(item, levels, inner) for item in value]
    return "[\n" + ",\n".join(items) + f"\n{indent}]"


def _height(value: Any) -> int:
    """Number of nested levels of dictionaries and lists."""
    if not isinstance(value, dict | list):
        return 0
    inner = value.values() if isinstance(value, dict) else value
    return 1 + max(map(_height, inner), default=0)
