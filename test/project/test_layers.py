"""Dependencies point one way: from studies and edges through the pipeline to core and records."""

import ast
import sys
from pathlib import Path

import pytest
from sources import GENERATED, PACKAGE, ROOT, imported_modules, is_ros, parse, python_files

SOURCES = python_files("ellipseg_ros")

# A module imports from its own layer and from the layers before it.
LAYERS = [
    {"errors"},
    {"settings"},
    {"config"},
    {"records"},
    {"core"},
    {"landmarks", "objects", "poses"},
    {"association", "result", "segmenter"},
    {"io", "node", "simulation", "tuning"},
    {"doctor", "plots"},
    {"ros"},
    {"cli"},
]
# Imports against the layers, as (file, module).
EXCEPTIONS = {
    ("config.py", "ellipseg_ros.core.criteria"),  # names and defaults of the criteria, on use
}

# Where a package may be imported; one that is not listed may be imported anywhere.
ONLY_IN = {
    "PIL": "plots/",
    "distributed": "tuning/parallel.py",
    "laspy": "io/formats/",
    "matplotlib": "plots/",
    "numba": ("core/", "doctor/"),
    "pypcd4": "io/formats/",
    "rosbags": "io/",
    "tqdm": "cli/",
    "trimesh": "io/formats/",
    "yaml": "cli/",
}
NOT_IN_CORE = {"datetime", "io", "logging", "pathlib", "time", "warnings"}
THIRD_PARTY_OF_CORE = {"numba", "numpy", "scipy"}
WITH_FILES = {"jit.py", "kernel_cache.py"}  # numba's cache of compiled kernels


def layer_of(module: str) -> int:
    """Index of the layer of a module named below the package, such as core.merge."""
    top = module.partition(".")[0]
    return next(index for index, names in enumerate(LAYERS) if top in names)


def local_imports(path: Path) -> set[str]:
    """Modules of this package that a file imports, without the generated messages."""
    return {
        name
        for name in imported_modules(path)
        if name.startswith("ellipseg_ros.") and not name.startswith("ellipseg_ros.msg")
    }


def test_every_module_belongs_to_a_layer() -> None:
    tops = {path.relative_to(PACKAGE).with_suffix("").parts[0] for path in SOURCES}
    assert tops - {"__init__"} == set().union(*LAYERS)


def test_modules_import_only_from_their_own_and_lower_layers() -> None:
    violations = set()
    for path in SOURCES:
        place = path.relative_to(PACKAGE)
        if path.parent == PACKAGE and place.stem == "__init__":
            continue  # the table of public names
        own = layer_of(place.with_suffix("").parts[0])
        for name in local_imports(path):
            if layer_of(name.removeprefix("ellipseg_ros.")) > own:
                violations.add((place.as_posix(), name))
    assert violations == EXCEPTIONS


def test_the_package_never_imports_studies() -> None:
    assert not [
        path for path in SOURCES for name in imported_modules(path) if name.startswith("studies")
    ]


def test_ros_is_imported_only_in_ros_folders() -> None:
    for path in SOURCES + python_files("studies"):
        for name in imported_modules(path):
            if is_ros(name.partition(".")[0]) or name.startswith("ellipseg_ros.msg"):
                assert "ros" in path.relative_to(ROOT).parts[1:-1], f"{path} imports {name}"


def test_third_party_packages_are_imported_only_in_their_places() -> None:
    for path in SOURCES:
        place = path.relative_to(PACKAGE).as_posix()
        for name in imported_modules(path):
            allowed = ONLY_IN.get(name.partition(".")[0], "")
            assert place.startswith(allowed), f"{place} imports {name}"


def test_core_imports_only_what_computes() -> None:
    for path in python_files("ellipseg_ros/core"):
        tops = {name.partition(".")[0] for name in imported_modules(path)} - {"ellipseg_ros"}
        assert tops - set(sys.stdlib_module_names) <= THIRD_PARTY_OF_CORE, path
        assert path.name in WITH_FILES or not tops & NOT_IN_CORE, path


def test_only_the_command_line_prints() -> None:
    for path in SOURCES:
        if path.relative_to(PACKAGE).parts[0] != "cli":
            calls = [node.func for node in ast.walk(parse(path)) if isinstance(node, ast.Call)]
            names = {func.id for func in calls if isinstance(func, ast.Name)}
            assert "print" not in names, path


@pytest.mark.parametrize(
    ("module", "lower"), [("cli.main", "ros.start"), ("core.merge", "records"), ("io.bag", "core")]
)
def test_order_of_the_layers(module: str, lower: str) -> None:
    assert layer_of(module) > layer_of(lower)


def test_generated_messages_are_not_among_the_sources() -> None:
    assert SOURCES and not [path for path in SOURCES if GENERATED in path.parents]
