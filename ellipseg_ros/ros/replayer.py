"""Publishes a source on ROS topics: `ros2 run ellipseg_ros replayer`, or as a library call."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from threading import Thread

import rclpy
from builtin_interfaces.msg import Time
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.event_handler import PublisherEventCallbacks, QoSPublisherMatchedInfo
from rclpy.node import Node
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import SetBool

from ellipseg_ros.errors import InputError
from ellipseg_ros.io.pointcloud2 import write_sweep
from ellipseg_ros.io.sources import open_source
from ellipseg_ros.msg import SegmentArray
from ellipseg_ros.node.playback import Playback, ReplayOptions, ReplaySummary
from ellipseg_ros.records import SECOND, Sweep
from ellipseg_ros.ros.parameters import Parameters
from ellipseg_ros.ros.process import End, Spinner, run
from ellipseg_ros.ros.subscriptions import header_stamp_ns
from ellipseg_ros.settings import Checked, setting

DEPTH = 1000  # clouds kept for a slow subscriber
FAREWELL = Duration(seconds=1.0)  # that subscribers get to acknowledge the last clouds
PATIENCE = 1.0  # s that the playback gets to end


@dataclass(frozen=True)
class Place(Checked):
    """What `ros2 run` plays."""

    source: str = setting("", "bag, cloud file, or sim:SCENE", live=False)
    topic: str = setting("", "topic of the bag; empty: the only one with clouds", live=False)


class ReplayerNode:
    """The node `ellipseg_replayer`: `points`, /clock, and the service ~/pause (std_srvs/SetBool).

    options: the defaults of its parameters.
    """

    def __init__(self, options: ReplayOptions, context: Context | None = None) -> None:
        node = self.node = Node(
            "ellipseg_replayer",
            context=context,
            automatically_declare_parameters_from_overrides=True,
        )
        options, self.place = Parameters(node, options, Place()).records()
        self.playback = Playback(options, self._send, node.get_logger().info)
        matched = PublisherEventCallbacks(matched=self._on_match)
        self._points = node.create_publisher(PointCloud2, "points", DEPTH, event_callbacks=matched)
        self._clock_topic = node.create_publisher(Clock, "/clock", 10) if options.clock else None
        if options.ahead:
            node.create_subscription(SegmentArray, "segments", self._on_segments, DEPTH, raw=True)
        node.create_service(SetBool, "~/pause", self._on_pause)

    def close(self) -> bool:
        """Send nothing more, and wait a moment for what was sent to arrive."""
        self.playback.stop()
        self._points.wait_for_all_acked(FAREWELL)
        return True

    def _send(self, sweep: Sweep) -> None:
        if self._clock_topic is not None:
            seconds, nanoseconds = divmod(sweep.stamp_ns, SECOND)
            self._clock_topic.publish(Clock(clock=Time(sec=seconds, nanosec=nanoseconds)))
        self._points.publish(write_sweep(sweep))

    def _on_match(self, event: QoSPublisherMatchedInfo) -> None:
        if event.current_count:
            self.playback.listening()

    def _on_segments(self, serialized: bytes) -> None:
        """Only the stamp is read: as objects, thousands of segments would take too long."""
        self.playback.come_back(header_stamp_ns(serialized))

    def _on_pause(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        self.playback.pause(request.data)
        response.success = True
        response.message = "paused" if request.data else "playing"
        return response


class Replayer:
    """Plays a source on ROS topics from any program; a context manager.

        with Replayer(open_source("drive.mcap"), ReplayOptions(ahead=3.0)) as replayer:
            summary = replayer.run()

    It has a ROS context of its own. args: `--ros-args ...` for it. domain: its ROS_DOMAIN_ID, if
    it shall not be that of the environment. Raises ConfigError.
    """

    def __init__(
        self,
        source: Iterable[Sweep],
        options: ReplayOptions | None = None,
        args: list[str] | None = None,
        domain: int | None = None,
    ) -> None:
        self._source = source
        self._context = Context()
        rclpy.init(args=args or [], context=self._context, domain_id=domain)
        self._failed: list[BaseException] = []
        self._node = ReplayerNode(options or ReplayOptions(), self._context)
        self._spinner = Spinner(self._node.node, self._fail)

    def __enter__(self) -> "Replayer":
        return self

    def __exit__(self, *_: object) -> None:
        self._node.close()
        self._spinner.stop()
        self._node.node.destroy_node()
        rclpy.shutdown(context=self._context)

    def run(self, progress: Callable[[Sweep], None] = lambda _: None) -> ReplaySummary:
        """Play in the calling thread until the end, or `stop`; `progress` gets each cloud."""
        summary = self._node.playback.play(self._source, progress)
        if self._failed:
            raise self._failed[0]
        return summary

    def stop(self) -> None:
        """End `run` soon; for any thread, and for signal handlers."""
        self._node.playback.stop()

    def _fail(self, error: BaseException | None) -> None:
        if error is not None:
            self._failed.append(error)
        self.stop()


class ReplayerProcess(ReplayerNode):
    """The node that plays what its parameters name, and then ends."""

    pauses = None

    def __init__(self, end: End) -> None:
        super().__init__(ReplayOptions())
        if not self.place.source:
            raise InputError("the parameter source is empty; give one: -p source:=drive.mcap, say")
        self._source = open_source(self.place.source, self.place.topic)
        self._end = end
        self._player = Thread(target=self._play, name="player", daemon=True)
        self._player.start()

    def close(self) -> bool:
        """Send nothing more; False if the source is slow to let go."""
        super().close()
        self._player.join(PATIENCE)
        return not self._player.is_alive()

    def _play(self) -> None:
        try:
            summary = self.playback.play(self._source)
            self.node.get_logger().info(f"sent {summary.clouds} clouds, {summary.points} points")
        except Exception as error:
            self._end(error)
        else:
            self._end(None)


def main(args: list[str] | None = None) -> int:
    """`ros2 run ellipseg_ros replayer --ros-args -p source:=...`."""
    return run(ReplayerProcess, args)
