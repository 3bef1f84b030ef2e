"""The public interface of the package: the names that `ellipseg_ros` offers."""

import ast
import subprocess
import sys

import ellipseg_ros
from ellipseg_ros import Config, Segmenter, segment

# Packages of the extras in setup.py that the package can import.
EXTRAS = {
    *("PIL", "distributed", "kiss_icp", "laspy", "matplotlib", "pypcd4"),
    *("small_gicp", "trimesh"),
}


def test_every_public_name_resolves() -> None:
    for name in ellipseg_ros.__all__:
        assert getattr(ellipseg_ros, name).__name__ == name
    assert set(ellipseg_ros.__all__) <= set(dir(ellipseg_ros))


def test_unknown_name_is_an_attribute_error() -> None:
    assert not hasattr(ellipseg_ros, "segmentt")


def test_public_names_are_those_of_their_modules() -> None:
    assert Segmenter is sys.modules["ellipseg_ros.segmenter"].Segmenter
    assert segment is sys.modules["ellipseg_ros.segmenter"].segment
    assert Config is sys.modules["ellipseg_ros.config"].Config


def test_type_checkers_see_the_same_names() -> None:
    with open(ellipseg_ros.__file__, encoding="utf-8") as file:
        tree = ast.parse(file.read())
    imports = next(node for node in tree.body if isinstance(node, ast.If)).body
    names = {
        f"{node.module}.{alias.name}"
        for node in imports
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert names == {
        f"ellipseg_ros.{module}.{name}" for name, module in ellipseg_ros._MODULES.items()
    }


def test_import_of_the_package_loads_nothing_heavy() -> None:
    program = "import sys, ellipseg_ros; print(*sorted(sys.modules))"
    result = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    loaded = set(result.stdout.split())
    assert "ellipseg_ros" in loaded
    assert not loaded & {"matplotlib", "numba", "numpy", "rclpy", "rosbags", "scipy", "yaml"}


def run_without(packages: set[str], program: str) -> str:
    """The output of a program in which importing any of the packages fails."""
    blocked = f"import sys; sys.modules.update(dict.fromkeys({sorted(packages)!r}))"
    result = subprocess.run(
        [sys.executable, "-c", f"{blocked}\n{program}"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 0, result.stderr
    return result.stdout


def test_library_needs_neither_ros_nor_extras() -> None:
    program = (
        "import numpy as np, ellipseg_ros\n"
        "[getattr(ellipseg_ros, name) for name in ellipseg_ros.__all__]\n"
        "points = np.random.default_rng(1).uniform(0.0, 1.0, (40, 3))\n"
        "print(ellipseg_ros.segment(points).counts.segmented)\n"
    )
    assert run_without(EXTRAS | {"rclpy", "tqdm", "yaml"}, program) == "40\n"


def test_nodes_need_no_extras() -> None:
    program = (
        "import ellipseg_ros.ros.segmenter_node, ellipseg_ros.ros.associator_node\n"
        "import ellipseg_ros.ros.replayer\n"
    )
    assert run_without(EXTRAS, program) == ""
