"""Publishers, subscriptions and services from the tables in io/topics.py."""

from collections.abc import Callable
from importlib import import_module
from typing import Any

from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.service import Service as RosService
from rclpy.subscription import Subscription

from ellipseg_ros.io.topics import Service, Topic


def interface_class(name: str) -> Any:
    """Import the class of a message or service type, such as "std_srvs/srv/Trigger"."""
    package, kind, base = name.split("/")
    return getattr(import_module(f"{package}.{kind}"), base)


def create_publisher(node: Node, topic: Topic, **options: Any) -> "Publisher[Any]":
    """Create a publisher; options: of rclpy's create_publisher."""
    qos = QoSProfile(depth=topic.depth)
    if topic.latched:
        qos.durability = DurabilityPolicy.TRANSIENT_LOCAL
    return node.create_publisher(interface_class(topic.type), topic.name, qos, **options)


def create_subscription(
    node: Node,
    topic: Topic,
    callback: Callable[..., object],
    qos: QoSProfile | int | None = None,
    **options: Any,
) -> "Subscription[Any]":
    """Create a subscription; qos: a profile, or a depth other than the topic's own.

    options: of rclpy's create_subscription.
    """
    kind = interface_class(topic.type)
    return node.create_subscription(kind, topic.name, callback, qos or topic.depth, **options)


def create_service(
    node: Node, service: Service, callback: Callable[[Any, Any], Any]
) -> "RosService[Any, Any]":
    """Create a service of a node."""
    return node.create_service(interface_class(service.type), service.name, callback)
