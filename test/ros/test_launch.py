"""The launch files. `launch` is not on PyPI: stubs of its classes record their arguments."""

import runpy
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest
import yaml

from ellipseg_ros.config import Config, NodeConfig, PlacementConfig
from ellipseg_ros.node.playback import ReplayOptions
from ellipseg_ros.ros.replayer import ReplaySource
from ellipseg_ros.settings import flatten

ROOT = Path(__file__).resolve().parents[2]
SEGMENTER = flatten(Config()) | flatten(NodeConfig()) | flatten(PlacementConfig())
SEGMENTER["use_sim_time"] = False
REPLAYER = flatten(ReplayOptions()) | flatten(ReplaySource())
MODULES = {
    "launch": ["LaunchDescription"],
    "launch.actions": ["DeclareLaunchArgument"],
    "launch.conditions": ["IfCondition"],
    "launch.substitutions": ["LaunchConfiguration", "PathJoinSubstitution"],
    "launch_ros": [],
    "launch_ros.actions": ["Node"],
    "launch_ros.parameter_descriptions": ["ParameterValue"],
    "launch_ros.substitutions": ["FindPackageShare"],
}


@pytest.fixture
def launch(monkeypatch):
    """Runs a launch file; the actions of its description."""

    def stand_in(kind):
        return lambda *args, **options: SimpleNamespace(kind=kind, args=args, options=options)

    for name, classes in MODULES.items():
        module = ModuleType(name)
        for kind in classes:
            setattr(module, kind, stand_in(kind))
        monkeypatch.setitem(sys.modules, name, module)

    def run(name):
        return runpy.run_path(str(ROOT / "launch" / name))["generate_launch_description"]().args[0]

    return run


def leaves(value):
    """Everything that a stand-in was given, all the way down."""
    if isinstance(value, SimpleNamespace):
        yield value
        yield from leaves([*value.args, *value.options.values()])
    elif isinstance(value, (list, tuple)):
        for part in value:
            yield from leaves(part)
    elif isinstance(value, dict):
        yield from leaves(list(value.values()))
    else:
        yield value


@pytest.mark.parametrize("name", ["segmenter.launch.py", "replay.launch.py"])
def test_every_argument_is_declared_and_used(launch, name):
    actions = launch(name)
    declared = [a.args[0] for a in actions if a.kind == "DeclareLaunchArgument"]
    used = [
        leaf.args[0]
        for leaf in leaves(actions)
        if isinstance(leaf, SimpleNamespace) and leaf.kind == "LaunchConfiguration"
    ]
    assert sorted(set(used)) == sorted(declared)
    assert all(a.options["description"] for a in actions if a.kind == "DeclareLaunchArgument")


@pytest.mark.parametrize("name", ["segmenter.launch.py", "replay.launch.py"])
def test_launched_nodes_and_their_parameters_exist(launch, name):
    known = {"segmenter": SEGMENTER, "replayer": REPLAYER}
    nodes = [action for action in launch(name) if action.kind == "Node"]
    for node in nodes:
        if node.options["package"] == "ellipseg_ros":
            for parameters in node.options["parameters"]:
                if isinstance(parameters, dict):
                    assert set(parameters) <= set(known[node.options["executable"]])
    assert "segmenter" in [node.options["executable"] for node in nodes]


@pytest.mark.parametrize("name", ["segmenter.launch.py", "replay.launch.py"])
def test_named_files_exist(launch, name):
    texts = [leaf for leaf in leaves(launch(name)) if isinstance(leaf, str)]
    files = [text for text in texts if text.endswith((".yaml", ".rviz"))]
    assert files
    for file in files:
        assert (ROOT / "config" / file).is_file()


def test_rviz_shows_the_topics_of_the_node():
    view = yaml.safe_load((ROOT / "config" / "ellipseg.rviz").read_text(encoding="utf-8"))
    manager = view["Visualization Manager"]
    assert manager["Global Options"]["Fixed Frame"] == "odom"
    shown = {d["Topic"]["Value"]: d for d in manager["Displays"] if "Topic" in d}
    assert {"/segmented_points", "/ellipsoids"} <= set(shown)
    assert shown["/segmented_points"]["Color Transformer"] == "RGB8"
    assert shown["/ellipsoids"]["Namespaces"] == {"ellipsoids": True}
