"""Write the pages of docs/reference that repeat the sources.

    python docs/_tools/reference.py

Parameters come from config.py, messages from msg/*.msg, options from the parser of `ellipseg`, and
the library from the public names of the package. test/project/test_documents.py fails if a page
differs from its source.
"""

import argparse
import ast
import inspect
import textwrap
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import ellipseg_ros
from ellipseg_ros.cli.parser import build_parser
from ellipseg_ros.config import (
    AssociationConfig,
    AssociatorConfig,
    Config,
    MapConfig,
    NodeConfig,
    PlacementConfig,
)
from ellipseg_ros.node.playback import ReplayOptions
from ellipseg_ros.ros.replayer import ReplaySource
from ellipseg_ros.settings import Checked, iterate_settings

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / "docs" / "reference"
NOTE = "<!-- Written by docs/_tools/reference.py. Edit the sources, then run `make docs`. -->"

PARAMETERS = """
All parameters of the nodes, with the defaults that are also in
[config/segmenter.yaml](../../config/segmenter.yaml) and
[config/associator.yaml](../../config/associator.yaml). Parameters marked * are fixed while the
node runs. The others can change at any time and take effect with the next update. A value out of
range is refused with a reason. [Tuning](../guide/tuning.md) explains how to choose the threshold.
"""
MESSAGES = """
The messages of this package, with the comments that `ros2 interface show` prints. Units are in
square brackets; [-] means no unit.
"""
COMMANDS = """
The options of every command of `ellipseg`. Defaults are in parentheses. Exit codes: 0 success,
1 the command ran and reports a failure (such as an error found by `doctor`), 2 wrong options or
unreadable input, 130 interrupted.
"""
LIBRARY = """
The public interface of the package. Import these names from `ellipseg_ros`; each is loaded on
first use. Everything else in the package is internal and may change between versions.

Lengths are in metres, times in seconds or integer nanoseconds (names that end in `_ns`). Row i of
every array in a record describes the same point, segment, object or landmark.
"""


def table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """A table in Markdown."""
    head = list(head)
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(
        "| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines
    )


# --- parameters ----------------------------------------------------------------------------------


def parameters() -> str:
    """Tables of the parameters of the three nodes."""
    sections = [
        ("Segmenter", (Config(), NodeConfig(), PlacementConfig())),
        ("Associator", (AssociationConfig(), MapConfig(), AssociatorConfig())),
        ("Replayer", (ReplayOptions(), ReplaySource())),
    ]
    parts = [f"## {title}\n\n{parameter_table(records)}" for title, records in sections]
    return "\n\n".join(["# Parameters", PARAMETERS.strip(), *parts])


def parameter_table(records: Iterable[Checked]) -> str:
    """A row for every setting of some records: name, type, default, unit, range, meaning."""
    kinds = {float: "double", int: "int", str: "string", bool: "bool"}
    rows = []
    for record in records:
        for name, value, about in iterate_settings(record):
            limits = ", ".join(about.choices)
            if about.low is not None:
                limits = f"{about.low:g} ... {about.high:g}" if about.high else f">= {about.low:g}"
            shown = str(value).lower() if isinstance(value, bool) else str(value)
            mark = "" if about.live else " *"
            kind = kinds[type(value)]
            rows.append([f"`{name}`{mark}", kind, shown, about.unit, limits, about.about])
    return table(["parameter", "type", "default", "unit", "range", "meaning"], rows)


# --- messages ------------------------------------------------------------------------------------


def messages() -> str:
    """A section for every message: what it is, its constants and its fields."""
    parts = [message(path) for path in sorted((ROOT / "msg").glob("*.msg"))]
    return "\n\n".join(["# Messages", MESSAGES.strip(), *parts])


def message(path: Path) -> str:
    """The section of one message."""
    text, constants, fields = "", [], []
    comment: list[str] = []
    for line in [*path.read_text(encoding="utf-8").splitlines(), ""]:
        if line.startswith("#"):
            comment.append(line.lstrip("# ") or "\n\n")
            continue
        if line:
            kind, name, *value = line.replace("=", " ").split()
            row = [f"`{name}`", *value, " ".join(comment)]
            (constants if value else fields).append(row if value else [row[0], kind, row[1]])
        elif comment:
            text += f"\n\n{' '.join(comment)}"
        comment = []
    parts = [f"## {path.stem}{text}"]
    if constants:
        parts.append(table(["constant", "value", "meaning"], constants))
    parts.append(table(["field", "type", "meaning"], fields))
    return "\n\n".join(parts)


# --- command line --------------------------------------------------------------------------------


def command_line() -> str:
    """A section for every command: what it does, its options, examples."""
    (commands,) = (action for action in build_parser()._actions if isinstance(action, SubParsers))
    helps = {choice.dest: choice.help or "" for choice in commands._choices_actions}
    parts = [command(name, helps[name], parser) for name, parser in commands.choices.items()]
    return "\n\n".join(["# Command line", COMMANDS.strip(), *parts])


SubParsers = argparse._SubParsersAction


def command(name: str, help_text: str, parser: argparse.ArgumentParser) -> str:
    """The section of one command."""
    rows = []
    for action in parser._actions:
        if "--help" not in action.option_strings:
            metavar = action.metavar or (action.dest.upper() if action.nargs != 0 else "")
            names = ", ".join(f"`{option}`" for option in action.option_strings) or f"`{metavar}`"
            value = f" `{metavar}`" if action.option_strings and metavar else ""
            choices = f": {', '.join(map(str, action.choices))}" if action.choices else ""
            about = (action.help or "").replace("%%", "%")
            rows.append([names + value, about + choices])
    parts = [f"## ellipseg {name}", help_text[:1].upper() + help_text[1:] + "."]
    parts.append(table(["option", "meaning"], rows))
    if parser.epilog:
        parts.append(f"```text\n{parser.epilog.strip()}\n```")
    return "\n\n".join(parts)


# --- library -------------------------------------------------------------------------------------


def library() -> str:
    """Signatures, docstrings and fields of all public names."""
    functions, classes = [], []
    for name in sorted(ellipseg_ros.__all__, key=str.lower):
        value = getattr(ellipseg_ros, name)
        section = f"### {name}\n\n```python\n{outline(value)}\n```"
        (classes if inspect.isclass(value) else functions).append(section)
    parts = ["# Library", LIBRARY.strip(), "## Functions", *functions, "## Classes", *classes]
    return "\n\n".join(parts)


def outline(value: Callable[..., object]) -> str:
    """The source of a function or class without the bodies of functions."""
    source = textwrap.dedent(inspect.getsource(value))
    node = ast.parse(source).body[0]
    lines = source.splitlines()
    if isinstance(node, ast.ClassDef):
        return "\n".join(class_outline(node, lines)).rstrip()
    return "\n".join(head(node, lines))


def class_outline(node: ast.ClassDef, lines: list[str]) -> Iterator[str]:
    """Yield the lines of a class: docstring, fields, public methods without their bodies."""
    yield from head(node, lines)
    body = node.body[1:] if ast.get_docstring(node) else node.body
    fields = [item for item in body if not isinstance(item, ast.FunctionDef)]
    if any(isinstance(base, ast.Name) and base.id == "Checked" for base in node.bases):
        yield "    # fields: see Parameters"
    elif fields:
        yield ""
        end = next((first(item) for item in body if isinstance(item, ast.FunctionDef)), None)
        block = lines[fields[0].lineno - 1 : end - 1 if end else len(lines)]
        yield from "\n".join(block).rstrip().splitlines()
    for item in body:
        if isinstance(item, ast.FunctionDef) and ast.get_docstring(item):
            if not item.name.startswith("_"):
                yield ""
                yield from head(item, lines)


def first(node: ast.AST) -> int:
    """Number of the first line of a definition, decorators included."""
    return min([node.lineno, *(item.lineno for item in node.decorator_list)])


def head(node: ast.AST, lines: list[str]) -> list[str]:
    """Decorators, signature and docstring of a definition."""
    has_docstring = ast.get_docstring(node) is not None
    last = node.body[0].end_lineno if has_docstring else node.body[0].lineno - 1
    return lines[first(node) - 1 : last]


PAGES: dict[str, Callable[[], str]] = {
    "parameters.md": parameters,
    "messages.md": messages,
    "command_line.md": command_line,
    "library.md": library,
}


def page(name: str) -> str:
    """The text of a page of docs/reference."""
    return f"{NOTE}\n\n{PAGES[name]()}\n"


def main() -> None:
    """Write all pages."""
    for name in PAGES:
        (FOLDER / name).write_text(page(name), encoding="utf-8")


if __name__ == "__main__":
    main()
