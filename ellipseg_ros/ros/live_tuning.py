"""`~/tune`, `tuning_curve` and automatic tuning: the ROS side of the tuner."""

from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger

from ellipseg_ros.errors import EllipsegError
from ellipseg_ros.io.topics import TUNE, TUNING_CURVE
from ellipseg_ros.msg import TuningCurve
from ellipseg_ros.node.health import Health
from ellipseg_ros.records import SECOND, Segmentation
from ellipseg_ros.ros.limits import throttled
from ellipseg_ros.ros.process import OnError
from ellipseg_ros.ros.topics import create_publisher, create_service
from ellipseg_ros.ros.tuner import Tuned, Tuner
from ellipseg_ros.tuning.curve import Curve
from ellipseg_ros.tuning.live import Decision, Hysteresis, decide_by_one, report

SET, TUNED, AUTO_TUNED = "set", "tuned", "auto_tuned"  # `threshold_change` of SegmentArray.msg


class LiveTuning:
    """Runs the tuner on demand and periodically, sets the threshold, and publishes the curve.

    Everything but the tuner runs in the thread of the node's callbacks. end: as for the tuner.
    """

    def __init__(self, node: Node, health: Health, end: OnError) -> None:
        self._node = node
        self._health = health
        self._hysteresis = Hysteresis()
        self.reason = SET  # of a change of the parameters that happens now
        self._curves = create_publisher(node, TUNING_CURVE)
        self.tuner = Tuner(lambda tuned: self._in_callbacks(self._auto_tuned, tuned), end)
        service = create_service(node, TUNE, lambda _, response: response)
        # The response comes seconds later. rclpy would wait for it: blocking all other callbacks,
        # or, with a coroutine, polling (rclpy 7.1). So its sending is replaced.
        self._send_response = service.send_response
        service.send_response = self._on_tune

    def _in_callbacks(self, call: Any, *args: Any) -> None:
        executor = self._node.executor
        if executor is not None:  # None: the node is ending
            executor.create_task(call, *args)

    def _on_tune(self, response: Trigger.Response, header: Any) -> None:
        def done(tuned: Tuned) -> None:
            self._in_callbacks(self._respond, tuned, response, header)

        if problem := self.tuner.request(done):
            response.success, response.message = False, problem
            self._send_response(response, header)

    def _respond(self, tuned: Tuned, response: Trigger.Response, header: Any) -> None:
        try:
            response.message = self._apply(tuned, decide_by_one, TUNED)
            response.success = True
        except EllipsegError as error:
            response.success, response.message = False, str(error)
        self._send_response(response, header)

    def _auto_tuned(self, tuned: Tuned) -> None:
        try:
            self._apply(tuned, self._hysteresis.decide, AUTO_TUNED)
        except EllipsegError as error:
            self._node.get_logger().warning(f"no tuning: {error}", **throttled())

    def _apply(self, tuned: Tuned, decide: Callable[[Curve, float], Decision], reason: str) -> str:
        """Publish the curve, set the threshold decided on, and return a report.

        Raises EllipsegError if the tuning has failed or is outdated.
        """
        curve, config = tuned.curve, tuned.config
        if curve is None:
            raise EllipsegError(tuned.problem)
        present = [self._node.get_parameter(name).value for name in ("criterion", "threshold")]
        if present != [config.criterion, config.threshold]:
            raise EllipsegError(
                "criterion or threshold has changed meanwhile; call again after an update"
            )
        decision = decide(curve, config.tau)
        self._curves.publish(_message(tuned.window, curve, decision))
        self._health.tuned(curve, tuned.seconds)
        if decision.changed:
            self.reason = reason
            try:
                self._node.set_parameters([Parameter("threshold", value=decision.threshold)])
            finally:
                self.reason = SET
            self._node.get_logger().info(
                f"{reason}: threshold {decision.present:g} -> {decision.threshold:.4g}, "
                f"{decision.reason}"
            )
        return report(curve, decision)


def _message(window: Segmentation, curve: Curve, decision: Decision) -> TuningCurve:
    """Convert the curve of a window and the decision on the threshold."""
    arrays = ("threshold", "aicc", "variance", "bias", "count", "loss")
    message = TuningCurve(
        criterion=curve.criterion,
        points=curve.points,
        current_threshold=decision.present,
        new_threshold=decision.threshold,
        reason=decision.reason,
        singleton_aicc=curve.singletons,
        **{name: getattr(curve, name).tolist() for name in arrays},
    )
    header = message.header
    header.frame_id = window.frame_id
    header.stamp.sec, header.stamp.nanosec = divmod(window.end_ns, SECOND)
    return message
