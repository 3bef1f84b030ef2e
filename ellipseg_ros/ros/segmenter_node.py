"""The node `ellipseg_segmenter`: receives clouds, queues updates, and reports its health."""

import time
from dataclasses import asdict

from sensor_msgs.msg import PointCloud2
from std_srvs.srv import Trigger

from ellipseg_ros.config import Config, NodeConfig, PlacementConfig
from ellipseg_ros.errors import InputError
from ellipseg_ros.io.frames import looks_like_a_sensor, warning
from ellipseg_ros.io.pointcloud2 import read_sweep
from ellipseg_ros.io.topics import ODOMETRY, POINTS, RESET, SEGMENTER
from ellipseg_ros.node.backlog import Backlog, Resend, Reset, Update
from ellipseg_ros.node.grouping import Grouping
from ellipseg_ros.node.health import Health, Report
from ellipseg_ros.node.memory import release_large_blocks
from ellipseg_ros.node.placing import Decision, Placed, Placing
from ellipseg_ros.poses import placer
from ellipseg_ros.poses.placement import Unplaced
from ellipseg_ros.poses.placer import Event
from ellipseg_ros.records import Sweep
from ellipseg_ros.ros.diagnostics import publish_diagnostics
from ellipseg_ros.ros.input import Input, Qos
from ellipseg_ros.ros.limits import CALLBACK_SHARE, Pauses, Quota, throttled
from ellipseg_ros.ros.live_tuning import LiveTuning
from ellipseg_ros.ros.outputs import Outputs
from ellipseg_ros.ros.pose_input import PoseInput, decided, odometry_topics
from ellipseg_ros.ros.process import End, Runnable, run, start_thread
from ellipseg_ros.ros.topics import create_service
from ellipseg_ros.ros.worker import Worker
from ellipseg_ros.segmenter import warm_up

WORKER_TIMEOUT_S = 1.0  # for a last update at shutdown
TUNER_TIMEOUT_S = 0.1  # it either ends immediately, or is in a tuning that takes long
RESET_QUOTA = (30, 60.0)  # calls within s, so that a flood of calls leaves most of the windows


class SegmenterNode(Runnable):
    """Passes clouds to the worker in groups."""

    def __init__(self, end: End) -> None:
        super().__init__(SEGMENTER, Config(), NodeConfig(), PlacementConfig())
        node = self.node
        self.pauses: Pauses = Pauses(*CALLBACK_SHARE)
        self._config, self._node_config, placement = self.parameters.records()
        self._placement = decided(placement, node)
        self.parameters.changed = self._apply_parameters
        self._grouping = Grouping(self._config)
        self._backlog = Backlog()
        self._health = Health()
        poses = node.resolve_topic_name(ODOMETRY.name)
        self._poses = "tf" if self._placement.pose_source == "tf" else poses
        self._placing = Placing(self._placement, self._health, self._poses)
        self._outputs = Outputs(node, lambda topic: self._backlog.put(Resend(topic)))
        publish_diagnostics(node, "segmentation", self._report)
        create_service(node, RESET, self._on_reset)
        self._reset_quota = Quota(*RESET_QUOTA)
        self._tuning = LiveTuning(node, self._health, end)
        self._tuner = self._tuning.tuner
        self._threshold_change = self._tuning.reason  # reason of the last change
        self._worker = Worker(
            self._config, self._backlog, self._outputs, self._health, self._tuner, self.log
        )
        self._thread = start_thread("segmenter", self._work, end)

    def close(self) -> bool:
        """Delete the markers and end the threads; False if one is still working.

        An update that is finished later is not published.
        """
        self._backlog.close()
        self._thread.join(WORKER_TIMEOUT_S)
        self._outputs.close()
        return self._tuner.close(TUNER_TIMEOUT_S) and not self._thread.is_alive()

    def _work(self) -> None:
        """Compile the kernels, subscribe to clouds, and segment; in a thread of its own."""
        self.log.info(
            "loading the kernels; the first start compiles them, which takes half a minute"
        )
        warm_up()
        if self._placing.needs_poses:
            placer.warm_up()
        source = self._placement.pose_source
        self._pose_input = PoseInput(self.node, source, self._on_pose, self._on_lost_poses)
        qos = Qos(self._node_config.input_depth, self._node_config.input_reliability)
        self._input = Input(self.node, POINTS, self._on_cloud, self._on_lost, qos)
        self._health.ready = True
        origin = f"placed by poses from {self._poses}" if self._placing.needs_poses else source
        self.log.info(f"ready; clouds are {origin}; {self.parameters}")
        self._worker.run()

    def _on_cloud(self, msg: PointCloud2) -> None:
        self.pauses.exempt()
        self._health.cloud()
        try:
            cloud = read_sweep(msg)
        except InputError as error:
            self._reject(error)
            return
        self._check_stamp(cloud)
        self._handle(self._placing.take(cloud))

    def _on_pose(self, event: Event) -> None:
        self.pauses.exempt()
        self._handle(self._placing.take(event))

    def _handle(self, decisions: list[Decision]) -> None:
        """Group the clouds that are placed; warn of others and of refused poses."""
        for decision in decisions:
            if isinstance(decision, Placed):
                self._group(decision)
            elif isinstance(decision, Unplaced):
                self.log.warning(f"cloud not placed: {decision.text}", **throttled())
            else:
                self.log.warning(f"pose refused: {decision.text}", **throttled())

    def _group(self, cloud: Placed) -> None:
        self._check_frame(cloud.sweep.frame_id)
        if text := self._placing.new_description():
            self.log.info(f"input: {text}", **throttled())
        try:
            self._queue(self._grouping.push(cloud.sweep), cloud.arrival)
        except InputError as error:
            self._reject(error)

    def _reject(self, error: InputError) -> None:
        self._health.rejected(error.reason)
        self.log.warning(f"cloud rejected: {error}", **throttled())

    def _queue(self, groups: list[Sweep], arrival: float) -> None:
        for group in groups:
            update = Update(
                group, self._config, self._node_config, arrival, self._threshold_change
            )
            overload = self._backlog.put(update, self._node_config.max_backlog)
            if overload is not None:
                self._health.count(**asdict(overload))
                self.log.warning(
                    "too slow for these clouds: updates are coalesced; segments stay exact, ids "
                    "may differ from a slower replay (max_points_per_second thins the clouds)",
                    **throttled(),
                )

    def _check_frame(self, frame_id: str) -> None:
        is_raw = looks_like_a_sensor(frame_id) and not self._placing.needs_poses
        sensor_frame = frame_id if is_raw else ""
        if sensor_frame and sensor_frame != self._health.sensor_frame:
            self.log.warning(warning(frame_id, odometry_topics(self.node)), **throttled())
        self._health.sensor_frame = sensor_frame

    def _check_stamp(self, sweep: Sweep) -> None:
        config = self._config
        if text := self._health.stamps.check(sweep, config.window_duration, config.max_lateness):
            self.log.warning(text, **throttled())

    def _on_lost(self, clouds: int) -> None:
        self._health.count(lost=clouds)
        self.log.warning(
            f"{clouds} clouds were lost in transport; a reliable publisher, or a larger "
            "input_depth, may help",
            **throttled(),
        )

    def _on_lost_poses(self, topic: str, messages: int) -> None:
        self._health.count(poses_lost=messages)
        self.log.warning(f"{messages} messages of {topic} were lost in transport", **throttled())

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Queue a reset between the clouds before the call and those after it."""
        if not self._reset_quota.take():
            calls, seconds = RESET_QUOTA
            response.success = False
            response.message = f"at most {calls} resets in {seconds:g} s; call again later"
            return response
        self._handle(self._placing.reset())
        try:
            self._queue(self._grouping.flush(), time.monotonic())
        except InputError as error:
            self._health.rejected(error.reason, group=True)
        self._grouping = Grouping(self._config)
        self._backlog.put(Reset("~/reset was called"))
        response.success = True
        response.message = "the window restarts with the next cloud; ids are not reused"
        return response

    def _apply_parameters(self) -> None:
        before = self._config
        self._config, self._node_config, _ = self.parameters.records()
        if (self._config.criterion, self._config.tau) != (before.criterion, before.tau):
            self._threshold_change = self._tuning.reason
        self._grouping.configure(self._config)

    def _report(self) -> Report:
        before, count = self._health.other_publishers, self._outputs.other_publishers()
        self._health.other_publishers = count
        if count > before:
            self.log.warning(
                f"{count} other nodes publish segments in this namespace: subscribers get "
                "messages of both; give each node a namespace (a killed one counts for 20 s)",
                **throttled(),
            )
        self._health.placement = self._placing.values()
        self._health.waiting_for = self._placing.problem()
        now_ns = self.node.get_clock().now().nanoseconds
        return self._health.report(self._backlog.waiting(), now_ns)


def main(args: list[str] | None = None) -> int:
    """`ros2 run ellipseg_ros segmenter`."""
    release_large_blocks()
    return run(SegmenterNode, args)
