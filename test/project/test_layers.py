"""Dependencies point one way: cli -> ros -> io -> the rest -> core -> data -> config -> errors."""

import ast
import sys
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[2] / "ellipseg_ros"
SOURCES = sorted(path for path in PACKAGE.rglob("*.py") if path.parent.name != "msg")

# From the bottom to the top; a module of the package itself that isn't named is in "".
LAYERS = ["errors", "config", "data", "core", "", "io", "ros", "cli"]

COMMANDS = ("benchmark", "comparison", "paper", "reliability", "twopasses")  # in all but name

# Who may import what; what isn't named here is for everybody.
ONLY_IN = {
    "ellipseg_ros.msg": ["ros/"],
    "distributed": ["tuning/parallel.py"],
    "matplotlib": [
        "plots.py",
        "charts.py",
        "benchmark/picture.py",
        "comparison/picture.py",
        "comparison/scale_picture.py",
        "measuring/charts.py",
        "paper/figures.py",
        "twopasses/picture.py",
    ],
    "rclpy": ["ros/"],
    "rosbags": ["io/bag.py", "io/bag_writer.py", "io/samples.py"],
    "small_gicp": ["core/neighbours.py", "cli/"],
    "tqdm": ["cli/"],
    "yaml": ["cli/", "reliability/fault_files.py"],
    "laspy": ["io/cloud.py", "io/samples.py"],
    "pypcd4": ["io/cloud.py", "io/samples.py"],
    "trimesh": ["io/cloud.py"],
}
# The core computes: no clock, no files, no log.
NOT_IN_CORE = {"datetime", "io", "logging", "pathlib", "time", "warnings"}
ALSO_IN_CORE = {"numba", "numpy", "scipy", "small_gicp"}


def is_message_package(name):
    return name.endswith(("_msgs", "_srvs", "_interfaces"))


def imported(path):
    """All modules that a file names in its imports, those within functions too."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield node.module
            if node.module == "ellipseg_ros":
                yield from (f"ellipseg_ros.{alias.name}" for alias in node.names)


def layer(parts):
    """The number of the layer of a module, given the parts of its name below the package."""
    name = "cli" if parts[0] in COMMANDS else parts[0]
    return LAYERS.index(name if name in LAYERS else "")


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_a_module_imports_only_what_its_layer_may(path):
    place = path.relative_to(PACKAGE)
    own = layer(place.with_suffix("").parts)
    for name in imported(path):
        top, _, below = name.partition(".")
        if top == "ellipseg_ros" and below and not below.startswith("msg"):
            assert layer(below.split(".")) <= own, f"{place} imports {name}"
        for restricted, places in ONLY_IN.items():
            if name == restricted or name.startswith(restricted + "."):
                assert str(place).startswith(tuple(places)), f"{place} imports {name}"
        if is_message_package(top):
            assert place.parts[0] == "ros", f"{place} imports {name}"


@pytest.mark.parametrize(
    "path", [path for path in SOURCES if path.parent.name == "core"], ids=lambda path: path.name
)
def test_the_core_only_computes(path):
    tops = {name.split(".")[0] for name in imported(path)} - {"ellipseg_ros"}
    assert tops - set(sys.stdlib_module_names) <= ALSO_IN_CORE
    assert not tops & NOT_IN_CORE
