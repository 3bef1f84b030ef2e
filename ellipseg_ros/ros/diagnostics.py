"""A node's health as /diagnostics."""

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

from ellipseg_ros.node.health import Report


def diagnostic_message(node: Node, subject: str, report: Report) -> DiagnosticArray:
    """One status, named after the node and its subject."""
    status = DiagnosticStatus(
        level=bytes([report.level]),
        name=f"{node.get_fully_qualified_name().lstrip('/')}: {subject}",
        message=report.message,
        values=[KeyValue(key=key, value=value) for key, value in report.values.items()],
    )
    message = DiagnosticArray(status=[status])
    message.header.stamp = node.get_clock().now().to_msg()
    return message
