"""The Python sources of the repository, and the modules that they import."""

import ast
import sys
from collections.abc import Iterator
from pathlib import Path

import ellipseg_ros

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "ellipseg_ros"
GENERATED = PACKAGE / "msg"


def python_files(folder: str) -> list[Path]:
    """The Python files below a folder of the repository, without generated ones."""
    return sorted(p for p in (ROOT / folder).rglob("*.py") if GENERATED not in p.parents)


def parse(path: Path) -> ast.Module:
    """The syntax tree of a Python file."""
    return ast.parse(path.read_text(encoding="utf-8"), str(path))


def imported_modules(path: Path) -> Iterator[str]:
    """Dotted names of all modules that a file imports, also inside functions.

    A public name imported from `ellipseg_ros` counts as an import of the module that defines it.
    """
    for node in ast.walk(parse(path)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module == "ellipseg_ros":
            for alias in node.names:
                yield f"ellipseg_ros.{ellipseg_ros._MODULES.get(alias.name, alias.name)}"
        elif isinstance(node, ast.ImportFrom):
            assert node.module is not None and node.level == 0, f"{path}: relative import"
            yield node.module


def third_party(paths: list[Path]) -> set[str]:
    """Top-level names of imported packages, without the standard library and this repository."""
    tops = {name.partition(".")[0] for path in paths for name in imported_modules(path)}
    return tops - set(sys.stdlib_module_names) - {"ellipseg_ros", "studies"}


def is_ros(name: str) -> bool:
    """Whether a top-level name is rclpy or a package of ROS messages."""
    return name == "rclpy" or name.endswith(("_msgs", "_srvs", "_interfaces"))
