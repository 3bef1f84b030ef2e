"""Settings as ROS parameters; over DDS they are tested in test_node.py."""

from pathlib import Path
from queue import SimpleQueue

import pytest
import rclpy
import yaml
from builtin_interfaces.msg import Time
from node_kit import peer, running
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterValue
from rcl_interfaces.srv import SetParameters
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock

from ellipseg_ros.config import (
    AssociationConfig,
    AssociatorConfig,
    Config,
    MapConfig,
    NodeConfig,
    PlacementConfig,
)
from ellipseg_ros.errors import ConfigError
from ellipseg_ros.ros.limits import Quota
from ellipseg_ros.ros.parameters import Parameters
from ellipseg_ros.ros.process import Spinner
from ellipseg_ros.settings import flatten

NODE = "/ellipseg_segmenter"
ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def make_node(ros_domain):
    """Makes a node from arguments for ROS."""
    opened = []

    def make(*words):
        context = Context()
        rclpy.init(args=["--ros-args", *words] if words else [], context=context)
        node = Node("some", context=context, automatically_declare_parameters_from_overrides=True)
        opened.append((node, context))
        return node

    yield make
    for node, context in opened:
        node.destroy_node()
        rclpy.shutdown(context=context)


def test_without_arguments_the_parameters_are_the_defaults(make_node):
    node = make_node()
    assert Parameters(node, Config(), NodeConfig()).records() == (Config(), NodeConfig())
    for name, value in (flatten(Config()) | flatten(NodeConfig())).items():
        found = node.get_parameter(name).value
        assert found == value and type(found) is type(value), name


def test_given_values_are_taken_and_integers_become_doubles(make_node):
    node = make_node("-p", "threshold:=6", "-p", "graph.neighbours:=8", "-p", "marker_sigmas:=1")
    config, shown = Parameters(node, Config(), NodeConfig()).records()
    assert (config.threshold, config.graph.neighbours, shown.marker_sigmas) == (6.0, 8, 1.0)
    assert type(node.get_parameter("threshold").value) is float


@pytest.mark.parametrize(
    ("word", "complaint"),
    [
        ("graph.neighbours:=2", "neighbours is 2; it must be from 3 to 64"),
        ("graph.neighbours:=8.0", "neighbours is 8.0, of type float; it must be int"),
        ("window_duration:=long", "window_duration is 'long', of type str; it must be float"),
        ("window_duration:=[1.0, 2.0]", "window_duration is .* it must be float"),
        ("criterion:=shapes", "criterion is 'shapes'; it must be one of shape, density, parsi"),
        ("max_backlog:=true", "max_backlog is True, of type bool; it must be int"),
    ],
)
def test_a_bad_given_value_is_refused_in_one_line(make_node, word, complaint):
    with pytest.raises(ConfigError, match=complaint) as refusal:
        Parameters(make_node("-p", word), Config(), NodeConfig())
    assert "\n" not in str(refusal.value)


def test_changes_are_reported_once_and_refused_ones_are_not(make_node):
    node = make_node()
    parameters = Parameters(node, Config(), NodeConfig())
    told = []
    parameters.changed = lambda: told.append(parameters.records())
    together = [Parameter("criterion", value="density"), Parameter("threshold", value=0.02)]
    assert node.set_parameters_atomically(together).successful
    assert told == [(Config(criterion="density", threshold=0.02), NodeConfig())]
    together = [Parameter("marker_sigmas", value=1.0), Parameter("threshold", value=-0.5)]
    assert not node.set_parameters_atomically(together).successful
    assert len(told) == 1 and parameters.records() == told[0]


def test_other_parameters_do_not_change_the_settings(make_node):
    node = make_node()
    parameters = Parameters(node, Config())
    (answer,) = node.set_parameters([Parameter("use_sim_time", value=True)])
    assert answer.successful
    assert parameters.records() == (Config(),)


@pytest.fixture
def spun(ros_domain, tmp_path):
    """A segmenter that runs, and a peer to call it."""
    log = tmp_path / "log"
    words = ["-p", "use_sim_time:=true"]
    with running("segmenter_node", words, log) as node, peer(ros_domain) as me:
        yield node, me


def test_message_rejected_by_rclpy_does_not_end_the_node(spun):
    node, me = spun
    clock = me.publish(Clock, "/clock")
    assert me.get(NODE, "max_points")
    odd = ParameterMessage(name="threshold", value=ParameterValue(type=200))
    client = me.node.create_client(SetParameters, f"{NODE}/set_parameters")
    assert client.wait_for_service(60.0)
    client.call_async(SetParameters.Request(parameters=[odd]))  # which nobody answers
    clock.send(Clock(clock=Time(sec=-1)))
    (taken,) = me.set(NODE, marker_sigmas=3.0)
    assert taken.successful and node.alive()
    assert node.output.count("invalid message, rejected by rclpy") >= 1


def test_error_of_our_callback_ends_the_node(make_node):
    node = make_node()
    ended = SimpleQueue()
    spinner = Spinner(node, ended.put)
    node.create_timer(0.01, lambda: Quota("many", 1.0))
    with pytest.raises(TypeError, match="an integer is required"):
        raise ended.get(timeout=60.0)
    spinner.stop()


def test_parameter_file_holds_the_defaults():
    """Its comments are tested in test_topics.py, with the other generated files."""
    text = (ROOT / "config" / "segmenter.yaml").read_text(encoding="utf-8")
    assert flat(yaml.safe_load(text)["/**"]["ros__parameters"]) == (
        flatten(Config()) | flatten(NodeConfig()) | flatten(PlacementConfig())
    )


def test_parameter_file_of_the_associator_holds_the_defaults():
    text = (ROOT / "config" / "associator.yaml").read_text(encoding="utf-8")
    records = (AssociationConfig(), MapConfig(), AssociatorConfig())
    values = yaml.safe_load(text)["/**"]["ros__parameters"]
    assert values == {name: value for record in records for name, value in flatten(record).items()}


def test_ros_reads_the_parameter_file_as_the_defaults(make_node):
    node = make_node("--params-file", str(ROOT / "config" / "segmenter.yaml"))
    records = (Config(), NodeConfig(), PlacementConfig())
    assert Parameters(node, *records).records() == records


def flat(tree, prefix=""):
    found = {}
    for name, value in tree.items():
        found |= (
            flat(value, f"{prefix}{name}.") if isinstance(value, dict) else {prefix + name: value}
        )
    return found
