"""Publishing a source on ROS topics: `ros2 run ellipseg_ros replayer`, or as a library call."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from builtin_interfaces.msg import Time
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.event_handler import PublisherEventCallbacks, QoSPublisherMatchedInfo
from rclpy.node import Node
from rosgraph_msgs.msg import Clock
from std_srvs.srv import SetBool

from ellipseg_ros.config import PlacementConfig
from ellipseg_ros.errors import InputError
from ellipseg_ros.io.bag import node_types
from ellipseg_ros.io.pointcloud2 import write_sweep
from ellipseg_ros.io.pose_messages import write_odometry
from ellipseg_ros.io.sources import as_odometry, open_source
from ellipseg_ros.io.topics import CLOCK, ODOMETRY, PAUSE, POINTS, REPLAYER, SEGMENTS
from ellipseg_ros.node.flow_control import REGISTERED
from ellipseg_ros.node.playback import Playback, ReplayOptions, ReplaySummary
from ellipseg_ros.poses.placer import Event
from ellipseg_ros.poses.series import PoseSample
from ellipseg_ros.records import SECOND, Sweep
from ellipseg_ros.ros.auxiliary_node import AuxiliaryNode
from ellipseg_ros.ros.process import End, Runnable, run, start_thread
from ellipseg_ros.ros.subscriptions import header_stamp_ns
from ellipseg_ros.ros.topics import create_publisher, create_service, create_subscription
from ellipseg_ros.settings import Checked, fixed

SEGMENTS_DEPTH = 1000  # an update that is lost would stop the flow until its timeout
ACKNOWLEDGE_TIMEOUT = Duration(seconds=1.0)  # for the last clouds
PLAYBACK_TIMEOUT_S = 1.0  # for the thread to end


@dataclass(frozen=True)
class ReplaySource(Checked):
    """What `ros2 run` plays."""

    source: str = fixed("", "bag, cloud file, or sim:SCENE")
    topic: str = fixed("", "topic of the bag; empty: the only one with clouds")
    odometry: str = fixed("", "poses of raw clouds, as the option --odometry of `ellipseg replay`")


class ReplayerNode(Runnable):
    """The node `ellipseg_replayer`: publishes `points`, `odometry` and /clock; offers ~/pause.

    options: the defaults of its parameters.
    """

    def __init__(self, options: ReplayOptions, context: Context | None = None) -> None:
        super().__init__(REPLAYER, options, ReplaySource(), context=context)
        node = self.node
        options, self.source = self.parameters.records()
        self.playback = Playback(options, self._send, self.log.info)
        matched = PublisherEventCallbacks(matched=self._on_match)
        self._points = create_publisher(node, POINTS, event_callbacks=matched)
        self._odometry = create_publisher(node, ODOMETRY)
        self._clock = create_publisher(node, CLOCK) if options.clock else None
        if options.ahead:
            create_subscription(node, SEGMENTS, self._on_segments, SEGMENTS_DEPTH, raw=True)
        create_service(node, PAUSE, self._on_pause)

    def close(self) -> bool:
        """Stop the playback, and wait briefly until what was sent is acknowledged."""
        self.playback.stop()
        self._points.wait_for_all_acked(ACKNOWLEDGE_TIMEOUT)
        return True

    def _send(self, event: Event) -> None:
        if isinstance(event, PoseSample):
            self._odometry.publish(write_odometry(event, node_types()))
        if not isinstance(event, Sweep):
            return
        if self._clock is not None:
            seconds, nanoseconds = divmod(event.stamp_ns, SECOND)
            self._clock.publish(Clock(clock=Time(sec=seconds, nanosec=nanoseconds)))
        self._points.publish(write_sweep(event))

    def _on_match(self, event: QoSPublisherMatchedInfo) -> None:
        if event.current_count:
            self.playback.subscribed()

    def _on_segments(self, serialized: bytes) -> None:
        """Read only the stamp: deserializing thousands of segments would take too long."""
        self.playback.acknowledge(header_stamp_ns(serialized))

    def _on_pause(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        self.playback.pause(request.data)
        response.success = True
        response.message = "paused" if request.data else "playing"
        return response


class Replayer(AuxiliaryNode):
    """Plays a source on ROS topics from any program; a context manager.

        with Replayer(open_source("drive.mcap"), ReplayOptions(ahead=3.0)) as replayer:
            summary = replayer.run()

    source: clouds, and poses of clouds that are not placed yet, which the segmenter places by
    `placement`. It has a ROS context of its own. args: `--ros-args ...` for it. domain: its
    ROS_DOMAIN_ID; None: that of the environment. Raises ConfigError.
    """

    def __init__(
        self,
        source: Iterable[Event],
        options: ReplayOptions | None = None,
        args: list[str] | None = None,
        placement: PlacementConfig = REGISTERED,
        domain: int | None = None,
    ) -> None:
        self._events, self._placement = source, placement
        self._options = options or ReplayOptions()
        super().__init__(REPLAYER, args or [], domain)

    def _create_node(self, name: str, context: Context) -> Node:
        self._replayer = ReplayerNode(self._options, context)
        return self._replayer.node

    def close(self) -> None:
        """Stop the playback, and destroy the node."""
        self._replayer.close()
        super().close()

    def run(self, progress: Callable[[Sweep], None] = lambda _: None) -> ReplaySummary:
        """Play in the calling thread until the end, or `stop`; `progress` gets each cloud."""
        playback = self._replayer.playback
        summary = playback.play(self._events, progress, self._placement)
        if self.failed:
            raise self.failed[0]
        return summary

    def stop(self) -> None:
        """End `run` soon; for any thread, and for signal handlers."""
        self._replayer.playback.stop()

    def fail(self, error: BaseException) -> None:
        """End `run` with an error of a callback."""
        super().fail(error)
        self.stop()


class ReplayerProcess(ReplayerNode):
    """The node that plays the source named by its parameters, and then ends."""

    def __init__(self, end: End) -> None:
        super().__init__(ReplayOptions())
        source = self.source
        if not source.source:
            raise InputError("the parameter source is empty; give one: -p source:=drive.mcap, say")
        opened = open_source(source.source, source.topic, source.odometry)
        self._played = as_odometry(opened)
        self._end = end
        self._player = start_thread("player", self._play, end)

    def close(self) -> bool:
        """Stop the playback; False if reading the source blocks it."""
        super().close()
        self._player.join(PLAYBACK_TIMEOUT_S)
        return not self._player.is_alive()

    def _play(self) -> None:
        summary = self.playback.play(self._played.events, placement=self._played.placement)
        self.log.info(f"sent {summary.clouds} clouds, {summary.points} points")
        self._end(None)


def main(args: list[str] | None = None) -> int:
    """`ros2 run ellipseg_ros replayer --ros-args -p source:=...`."""
    return run(ReplayerProcess, args)
