"""The node `ellipseg_segmenter`: subscribes, converts, hands over, reports."""

import time
from dataclasses import asdict

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import Trigger

from ellipseg_ros.config import Config, NodeConfig
from ellipseg_ros.errors import InputError
from ellipseg_ros.io.frames import looks_like_a_sensor, warning
from ellipseg_ros.io.pointcloud2 import read_sweep
from ellipseg_ros.node.backlog import Backlog, ListAll, Reset, ShowAll, Update
from ellipseg_ros.node.grouping import Grouping
from ellipseg_ros.node.health import Health
from ellipseg_ros.node.memory import release_large_blocks
from ellipseg_ros.node.stamps import StampMonitor
from ellipseg_ros.records import Sweep
from ellipseg_ros.ros.cloud_input import CloudInput
from ellipseg_ros.ros.diagnostics import diagnostic_message
from ellipseg_ros.ros.limits import Pauses, Quota, throttled
from ellipseg_ros.ros.live_tuning import LiveTuning
from ellipseg_ros.ros.outputs import Outputs
from ellipseg_ros.ros.parameters import Parameters
from ellipseg_ros.ros.process import End, run
from ellipseg_ros.ros.worker import Around, Worker
from ellipseg_ros.settings import flatten

PATIENCE = 1.0  # s that the worker gets for a last update when the node ends
BRIEF = 0.1  # s that the tuner gets: it ends at once, or is at a tuning that takes long
RESETS = (30, 60.0)  # calls within s: of whoever calls all the time, a window or two are lost
CALLS = (0.2, 1.0)  # share of a core that all but the clouds may take, and s at once
FRAMES = 10  # that are warned of, once each: a stranger can think of any number


class SegmenterNode:
    """Carries clouds to the worker, and tells how it is going.

    It has a rclpy node and is none, as names of rclpy's own would clash with those here.
    """

    def __init__(self, end: End) -> None:
        node = self.node = Node(
            "ellipseg_segmenter", automatically_declare_parameters_from_overrides=True
        )
        self.pauses = Pauses(*CALLS)
        self._log = node.get_logger()
        self._parameters = Parameters(node, Config(), NodeConfig())
        self._config, self._shown = self._parameters.records()
        self._parameters.on_change(self._take_parameters)
        self._grouping = Grouping(self._config)
        self._backlog = Backlog()
        self._health = Health()
        self._stamps = StampMonitor()
        self._warned: set[str] = set()  # frames that were warned of
        self._outputs = Outputs(
            node, lambda: self._backlog.put(ShowAll()), lambda: self._backlog.put(ListAll())
        )
        self._diagnostics = node.create_publisher(DiagnosticArray, "/diagnostics", 10)
        node.create_timer(1.0, self._report, clock=Clock(clock_type=ClockType.STEADY_TIME))
        node.create_service(Trigger, "~/reset", self._reset)
        self._resets = Quota(*RESETS)
        self._tuning = LiveTuning(node, self._health, end)
        self._reason = self._tuning.reason  # of the last change of the parameters
        around = Around(
            self._backlog,
            self._outputs,
            self._health,
            self._tuning.tuner,
            self._log,
            self._subscribe,
            end,
        )
        self._worker = Worker(self._config, around)
        self._worker.start()
        self._tuning.tuner.start()

    def close(self) -> bool:
        """Take the markers away and end the threads; False if one is still at work.

        An update that comes too late is not published.
        """
        self._backlog.close()
        self._tuning.tuner.close()
        self._worker.join(PATIENCE)
        self._outputs.farewell()
        self._tuning.tuner.join(BRIEF)
        return not (self._worker.is_alive() or self._tuning.tuner.is_alive())

    def _subscribe(self) -> None:
        """Called by the worker when all is compiled."""
        self._input = CloudInput(self.node, self._shown, self._on_cloud, self._lost)
        self._health.ready()
        values = {**flatten(self._config), **flatten(self._shown)}
        self._log.info("ready; " + ", ".join(f"{name} {value}" for name, value in values.items()))

    def _on_cloud(self, msg: PointCloud2) -> None:
        arrived = time.monotonic()
        self.pauses.exempt()
        self._health.cloud()
        try:
            sweep = read_sweep(msg)
            self._look_at_frame(sweep.frame_id)
            self._look_at_stamp(sweep)
            self._hand_over(self._grouping.push(sweep), arrived)
        except InputError as error:
            self._health.rejected(error.reason)
            self._log.warning(f"cloud rejected: {error}", **throttled())

    def _hand_over(self, groups: list[Sweep], arrived: float) -> None:
        for group in groups:
            update = Update(group, self._config, self._shown, arrived, reason=self._reason)
            overload = self._backlog.put(update, self._shown.max_backlog)
            if overload is not None:
                self._health.overloaded(**asdict(overload))
                self._log.warning(
                    "too slow for these clouds: updates are taken together; segments stay exact, "
                    "ids may differ from a slower replay (max_points_per_second thins the clouds)",
                    **throttled(),
                )

    def _look_at_frame(self, frame_id: str) -> None:
        sensor = looks_like_a_sensor(frame_id)
        self._health.sensor_frame = frame_id if sensor else ""
        if sensor and frame_id not in self._warned and len(self._warned) < FRAMES:
            self._warned.add(frame_id)
            self._log.warning(warning(frame_id))

    def _look_at_stamp(self, sweep: Sweep) -> None:
        config = self._config
        if text := self._stamps.check(sweep, config.window_duration, config.max_lateness):
            self._log.warning(text, **throttled())
        self._health.stamps(self._stamps.stalled, self._stamps.gaps)

    def _lost(self, clouds: int) -> None:
        self._health.lost(clouds)
        self._log.warning(
            f"{clouds} clouds were lost on the way; a reliable publisher, or a larger "
            "input_depth, may help",
            **throttled(),
        )

    def _reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Between the clouds that came before the call and those that come after it."""
        if not self._resets.take():
            calls, seconds = RESETS
            response.success = False
            response.message = f"at most {calls} resets in {seconds:g} s; call again later"
            return response
        try:
            self._hand_over(self._grouping.flush(), time.monotonic())
        except InputError as error:
            self._health.group_rejected(error.reason)
        self._grouping = Grouping(self._config)
        self._backlog.put(Reset("~/reset was called"))
        response.success = True
        response.message = "the window begins anew with the next cloud; ids go on"
        return response

    def _take_parameters(self) -> None:
        before = self._config
        self._config, self._shown = self._parameters.records()
        if (self._config.criterion, self._config.tau) != (before.criterion, before.tau):
            self._reason = self._tuning.reason
        self._grouping.configure(self._config)

    def _look_for_rivals(self) -> None:
        before, self._health.rivals = self._health.rivals, self._outputs.rivals()
        if self._health.rivals > before:
            self._log.warning(
                f"{self._health.rivals} other nodes publish `segments` in this namespace: what is "
                "told gets mixed up; give each a namespace (one that was killed counts for 20 s)",
                **throttled(),
            )

    def _report(self) -> None:
        self._look_for_rivals()
        now_ns = self.node.get_clock().now().nanoseconds
        report = self._health.report(self._backlog.waiting(), now_ns)
        self._diagnostics.publish(diagnostic_message(self.node, "segmentation", report))


def main(args: list[str] | None = None) -> int:
    """`ros2 run ellipseg_ros segmenter`."""
    release_large_blocks()
    return run(SegmenterNode, args)
