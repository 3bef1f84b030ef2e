"""Messages of `segments` for late subscribers, without DDS."""

from types import SimpleNamespace

import numpy as np
import pytest
from rclpy.serialization import deserialize_message

from ellipseg_ros.config import Config, NodeConfig
from ellipseg_ros.io.messages import write_segments
from ellipseg_ros.io.segment_mirror import SegmentMirror
from ellipseg_ros.io.topics import SEGMENTS
from ellipseg_ros.msg import SegmentArray
from ellipseg_ros.records import SECOND, Sweep
from ellipseg_ros.ros.outputs import Outputs
from ellipseg_ros.segmenter import Segmenter

CHANGES = NodeConfig(full_segments_period=10.0)
EVERYTHING = NodeConfig(full_segments_period=0.0)


class Publisher:
    """Keeps what is published, which only `segments` has a subscriber for."""

    def __init__(self, kind, topic, qos, event_callbacks=None):
        self.topic = topic
        self.sent = []

    def get_subscription_count(self):
        return int(self.topic == "segments")

    def publish(self, message):
        self.sent.append(message)


@pytest.fixture
def outputs():
    return Outputs(SimpleNamespace(create_publisher=Publisher), lambda topic: None)


@pytest.fixture(scope="module")
def updates():
    """Updates at 8 ... 13 s."""
    segmenter, rng = Segmenter(Config()), np.random.default_rng(0)
    return [
        segmenter.process(Sweep(k * SECOND, rng.uniform(0.0, 1.0, (200, 3)) + [k, 0.0, 0.0]))
        for k in range(8, 14)
    ]


def sent(outputs):
    return outputs._publishers[SEGMENTS].sent


@pytest.mark.parametrize("joined", range(1, 6))
def test_late_subscriber_syncs_immediately(outputs, updates, joined):
    for found in updates[:joined]:
        outputs.publish(found, CHANGES)
    before = len(sent(outputs))
    outputs.resend(SEGMENTS)
    for found in updates[joined:]:
        outputs.publish(found, CHANGES)
    assert sent(outputs)[before] == write_segments(updates[joined - 1])
    for first in (0, before):  # an early and a late subscriber
        mirror = SegmentMirror()
        for data in sent(outputs)[first:]:
            assert mirror.update(deserialize_message(data, SegmentArray))


def test_first_update_after_setting_the_period_is_full(outputs, updates):
    outputs.publish(updates[0], EVERYTHING)
    outputs.resend(SEGMENTS)
    assert len(sent(outputs)) == 1
    outputs.publish(updates[1], CHANGES)
    assert sent(outputs)[1] == write_segments(updates[1])
    outputs.resend(SEGMENTS)
    assert sent(outputs)[2] == sent(outputs)[1]


def test_full_messages_are_not_resent(outputs, updates):
    for found in updates:
        outputs.publish(found, EVERYTHING)
        outputs.resend(SEGMENTS)
    assert sent(outputs) == [write_segments(found) for found in updates]


def test_without_a_window_nothing_is_resent(outputs, updates):
    outputs.resend(SEGMENTS)
    outputs.publish(updates[0], CHANGES)
    outputs.clear()
    outputs.resend(SEGMENTS)
    assert len(sent(outputs)) == 1
