"""The tables of io/topics.py determine topics and services everywhere."""

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag2 import Reader

from ellipseg_ros.config import Config, NodeConfig
from ellipseg_ros.io.bag import BagSink, node_types
from ellipseg_ros.io.topics import (
    BAG_TOPICS,
    DIAGNOSTICS,
    NODES,
    ODOMETRY,
    SEGMENTER,
    SEGMENTS,
    SERVICES,
    TF,
    TF_STATIC,
    TOPICS,
    TUNING_CURVE,
    UPDATE_TOPICS,
)
from ellipseg_ros.io.update_messages import UpdateMessages
from ellipseg_ros.records import SECOND, Sweep
from ellipseg_ros.ros import graph_probe, import_check
from ellipseg_ros.ros.recorder import STAMPED
from ellipseg_ros.ros.topics import interface_class
from ellipseg_ros.segmenter import Segmenter

ROOT = Path(__file__).resolve().parents[2]


def segmentation():
    points = np.random.default_rng(0).uniform(0.0, 1.0, (100, 3))
    return Segmenter(Config()).process(Sweep(SECOND, points, frame_id="odom"))


@pytest.fixture(scope="module")
def generator():
    """The script that writes the generated files of config/."""
    path = ROOT / "config" / "_tools" / "generate.py"
    spec = importlib.util.spec_from_file_location("generate", path)
    module = sys.modules["generate"] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    yield module
    del sys.modules["generate"]


def test_names_are_unique_and_nodes_exist():
    assert len({topic.name for topic in TOPICS}) == len(TOPICS)
    assert len({(service.node, service.name) for service in SERVICES}) == len(SERVICES)
    for topic in TOPICS:
        assert topic.publishers and {*topic.publishers, *topic.subscribers} <= {*NODES}
    assert {service.node for service in SERVICES} <= {*NODES}


def test_types_load_with_rclpy_and_with_rosbags():
    assert import_check.problem() == ""
    for interface in (*TOPICS, *SERVICES):
        assert interface_class(interface.type).__name__ == interface.type.rpartition("/")[2]
    assert {topic.type for topic in BAG_TOPICS.values()} <= node_types().types.keys()


def test_an_update_has_a_message_for_each_topic_and_segments_are_last():
    writers = UpdateMessages(NodeConfig()).writers(segmentation())
    assert writers.keys() == {*UPDATE_TOPICS}
    assert list(writers)[-1] == SEGMENTS


def test_a_bag_of_registered_clouds_holds_the_bag_topics_without_poses(tmp_path):
    with BagSink(tmp_path / "bag") as bag:
        bag.write_event(Sweep(SECOND, np.zeros((1, 3))))
        bag.write_update(segmentation())
    with Reader(tmp_path / "bag") as reader:
        types = {connection.topic: connection.msgtype for connection in reader.connections}
    poses = {ODOMETRY, TF, TF_STATIC}
    assert types == {n: topic.type for n, topic in BAG_TOPICS.items() if topic not in poses}


def test_the_recorder_knows_which_messages_begin_with_a_header():
    for topic in UPDATE_TOPICS:
        fields = interface_class(topic.type).get_fields_and_field_types()
        assert (next(iter(fields)) == "header") == (topic.name in STAMPED)


def test_the_doctor_lists_all_outputs_of_the_segmenter():
    published = {topic for topic in TOPICS if SEGMENTER in topic.publishers}
    assert published == {*UPDATE_TOPICS, TUNING_CURVE, DIAGNOSTICS}
    assert graph_probe.OUTPUT_TYPES == {topic.type for topic in published - {DIAGNOSTICS}}


def test_generated_files_are_up_to_date(generator):
    for path, text in generator.files().items():
        assert path.read_text(encoding="utf-8") == text, f"{path.name}: run `make config`"
