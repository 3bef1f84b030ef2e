"""`~/tune`, `tuning_curve` and tuning by itself: the ROS side of the tuner."""

from typing import Any

from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_srvs.srv import Trigger

from ellipseg_ros.msg import TuningCurve
from ellipseg_ros.node.health import Health
from ellipseg_ros.records import SECOND
from ellipseg_ros.ros.limits import throttled
from ellipseg_ros.ros.process import End
from ellipseg_ros.ros.tuner import Tuned, Tuner
from ellipseg_ros.tuning.curve import Curve
from ellipseg_ros.tuning.live import Decision, Hysteresis, decide_by_one, report

ASKED, BY_ITSELF = "tuned", "auto_tuned"  # reasons of a change, as in SegmentArray.msg
SET = "set"


class LiveTuning:
    """Has the tuner work, sets the threshold, and tells of it.

    Everything but the tuner runs among the node's callbacks, in their thread.
    end: as for the tuner.
    """

    def __init__(self, node: Node, health: Health, end: End) -> None:
        self._node = node
        self._health = health
        self._hysteresis = Hysteresis()
        self.reason = SET  # why the next change of the parameters comes about
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._curves = node.create_publisher(TuningCurve, "tuning_curve", latched)
        self.tuner = Tuner(lambda tuned: self._among_callbacks(self._by_itself, tuned), end)
        service = node.create_service(Trigger, "~/tune", lambda _, response: response)
        # The answer comes seconds later. rclpy would wait for it: with no other callback running,
        # or, for a coroutine, asking all the time whether it is there (rclpy 7.1).
        self._send = service.send_response
        service.send_response = self._asked

    def _among_callbacks(self, call: Any, *args: Any) -> None:
        executor = self._node.executor
        if executor is not None:  # else the node is ending
            executor.create_task(call, *args)

    def _asked(self, response: Trigger.Response, header: Any) -> None:
        def done(tuned: Tuned) -> None:
            self._among_callbacks(self._answer, tuned, response, header)

        problem = self.tuner.ask(done)
        if problem:
            self._refuse(problem, response, header)

    def _refuse(self, problem: str, response: Trigger.Response, header: Any) -> None:
        response.success, response.message = False, problem
        self._send(response, header)

    def _answer(self, tuned: Tuned, response: Trigger.Response, header: Any) -> None:
        problem = self._problem(tuned)
        if tuned.curve is None or problem:
            self._refuse(problem, response, header)
            return
        decision = decide_by_one(tuned.curve, tuned.config.tau)
        self._carry_out(tuned, tuned.curve, decision, ASKED)
        response.success, response.message = True, report(tuned.curve, decision)
        self._send(response, header)

    def _by_itself(self, tuned: Tuned) -> None:
        problem = self._problem(tuned)
        if tuned.curve is None or problem:
            self._node.get_logger().warning(f"no tuning: {problem}", **throttled())
            return
        decision = self._hysteresis.decide(tuned.curve, tuned.config.tau)
        self._carry_out(tuned, tuned.curve, decision, BY_ITSELF)

    def _problem(self, tuned: Tuned) -> str:
        """Why a curve is of no use; empty if it is."""
        names = ("criterion", "threshold")
        now = tuple(self._node.get_parameter(name).value for name in names)
        then = tuple(getattr(tuned.config, name) for name in names)
        if not tuned.problem and now != then:
            return "criterion or threshold was changed meanwhile; call again after an update"
        return tuned.problem

    def _carry_out(self, tuned: Tuned, curve: Curve, decision: Decision, reason: str) -> None:
        self._curves.publish(message(tuned, curve, decision))
        self._health.tuned(curve, tuned.seconds)
        if not decision.changed:
            return
        self.reason = reason
        try:
            self._node.set_parameters([Parameter("threshold", value=decision.threshold)])
        finally:
            self.reason = SET
        self._node.get_logger().info(
            f"{reason}: threshold {decision.present:g} -> {decision.threshold:.4g}, "
            f"{decision.reason}"
        )


def message(tuned: Tuned, curve: Curve, decision: Decision) -> TuningCurve:
    """A curve, and what came of it."""
    made = TuningCurve(
        criterion=curve.criterion,
        points=curve.points,
        present=decision.present,
        chosen=decision.threshold,
        reason=decision.reason,
        singletons=curve.singletons,
        threshold=curve.threshold.tolist(),
        aicc=curve.aicc.tolist(),
        variance=curve.variance.tolist(),
        bias=curve.bias.tolist(),
        count=curve.count.tolist(),
        loss=curve.loss.tolist(),
    )
    made.header.frame_id = tuned.found.frame_id
    made.header.stamp.sec, made.header.stamp.nanosec = divmod(tuned.found.end_ns, SECOND)
    return made
