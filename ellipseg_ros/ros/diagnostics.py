"""Publishing a node's health on /diagnostics."""

from collections.abc import Callable

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

from ellipseg_ros.io.topics import DIAGNOSTICS
from ellipseg_ros.node.health import Report
from ellipseg_ros.ros.limits import STEADY
from ellipseg_ros.ros.topics import create_publisher


def publish_diagnostics(node: Node, subject: str, report: Callable[[], Report]) -> None:
    """Publish a report every second, as one status named after the node and the subject."""
    publisher = create_publisher(node, DIAGNOSTICS)
    name = f"{node.get_fully_qualified_name().lstrip('/')}: {subject}"

    def publish() -> None:
        health = report()
        status = DiagnosticStatus(
            level=bytes([health.level]),
            name=name,
            message=health.message,
            values=[KeyValue(key=key, value=value) for key, value in health.values.items()],
        )
        message = DiagnosticArray(status=[status])
        message.header.stamp = node.get_clock().now().to_msg()
        publisher.publish(message)

    node.create_timer(1.0, publish, clock=STEADY)
