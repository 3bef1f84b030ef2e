"""Poses from ROS: which source the node uses, and its subscriptions to `odometry` and tf."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

from nav_msgs.msg import Odometry
from rclpy.node import Node

from ellipseg_ros.config import PlacementConfig
from ellipseg_ros.errors import ConfigError, InputError
from ellipseg_ros.io.pose_messages import read_odometry, read_transforms
from ellipseg_ros.io.topics import ODOMETRY, TF, TF_MESSAGE, TF_STATIC, Topic
from ellipseg_ros.poses.placer import Event, RefusedPose
from ellipseg_ros.ros.input import Input
from ellipseg_ros.ros.topics import interface_class


def tf_is_available() -> bool:
    """Whether tf2_msgs is installed, which is not on PyPI."""
    try:
        interface_class(TF_MESSAGE)
    except ImportError:
        return False
    return True


def decided(config: PlacementConfig, node: Node) -> PlacementConfig:
    """The settings with a pose source in place of `auto`; ConfigError if it can't be used."""
    source = config.pose_source
    if source == "auto":
        source = "odometry" if _is_remapped(node) else "registered"
        source = "tf" if config.fixed_frame else source
    if source == "tf" and not tf_is_available():
        problem = "the poses are to come from tf (fixed_frame), but tf2_msgs is not installed"
        raise ConfigError(f"{problem}; install it with ROS, or remap odometry:= to an odometry")
    return replace(config, pose_source=source)


def _is_remapped(node: Node) -> bool:
    here = node.resolve_topic_name(ODOMETRY.name, only_expand=True)
    return bool(node.resolve_topic_name(ODOMETRY.name) != here)


def odometry_topics(node: Node) -> list[str]:
    """Topics of the graph with an odometry that somebody publishes."""
    return [
        name
        for name, types in node.get_topic_names_and_types()
        if ODOMETRY.type in types and node.count_publishers(name)
    ]


class PoseInput:
    """Subscriptions to the poses of a source, passed on in the thread of the callbacks.

    source: odometry, with the static transforms of tf where they are available, or tf.
    on_event: gets each pose and transform, and those that are refused.
    on_lost: gets the name of a topic and a number of lost messages.
    """

    def __init__(
        self,
        node: Node,
        source: str,
        on_event: Callable[[Event], None],
        on_lost: Callable[[str, int], None],
    ) -> None:
        self._on_event = on_event
        topics = {"odometry": [ODOMETRY], "tf": [TF]}.get(source, [])
        if topics and tf_is_available():
            topics.insert(0, TF_STATIC)
        readers: dict[Topic, Callable[[Any], None]] = {
            ODOMETRY: self.on_odometry,
            TF: partial(self.on_transforms, False),
            TF_STATIC: partial(self.on_transforms, True),
        }
        self._inputs = [
            Input(node, topic, readers[topic], partial(on_lost, topic.name)) for topic in topics
        ]

    def on_odometry(self, msg: Odometry) -> None:
        """Pass on the pose of a message, or why it is refused."""
        try:
            self._on_event(read_odometry(msg))
        except InputError as error:
            self._on_event(RefusedPose(error.reason, str(error)))

    def on_transforms(self, static: bool, msg: Any) -> None:
        """Pass on the transforms of a message; static: of /tf_static."""
        for event in read_transforms(msg, static):
            self._on_event(event)
