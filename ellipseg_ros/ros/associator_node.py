"""The node `ellipseg_associator`: keeps a map of landmarks, and recognizes them."""

import time
from collections.abc import Callable
from pathlib import Path
from threading import Thread

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from std_srvs.srv import Trigger
from visualization_msgs.msg import MarkerArray

from ellipseg_ros.association.associate import associate, warm_up
from ellipseg_ros.association.landmark_map import LandmarkMap
from ellipseg_ros.config import AssociationConfig, AssociatorConfig, MapConfig
from ellipseg_ros.errors import InputError
from ellipseg_ros.io.landmark_messages import read_landmarks
from ellipseg_ros.io.limits import check_name, read_stamp
from ellipseg_ros.io.map_file import read_map, write_map
from ellipseg_ros.msg import Association as AssociationMessage
from ellipseg_ros.msg import LandmarkArray
from ellipseg_ros.node.associator_health import AssociatorHealth
from ellipseg_ros.ros.associations import association_markers, association_message
from ellipseg_ros.ros.diagnostics import diagnostic_message
from ellipseg_ros.ros.limits import Pauses, Share, throttled
from ellipseg_ros.ros.outputs import DEPTH, FAREWELL, delete_all_markers, send
from ellipseg_ros.ros.parameters import Parameters
from ellipseg_ros.ros.process import End, run
from ellipseg_ros.settings import flatten

FILES = (0.1, 2.0)  # share of its time that maps may take to write and read, and s at once
CALLS = (0.2, 1.0)  # share of a core that all but landmarks may take, and s at once
PATIENCE = 1.0  # s that the compiler gets when the node ends


class AssociatorNode:
    """Hands landmarks to the map, and what the map knows to `associate`.

    All in the callbacks: an update takes milliseconds, and comes once a second.
    """

    def __init__(self, end: End) -> None:
        node = self.node = Node(
            "ellipseg_associator", automatically_declare_parameters_from_overrides=True
        )
        self.pauses = Pauses(*CALLS)
        self._log = node.get_logger()
        self._parameters = Parameters(node, AssociationConfig(), MapConfig(), AssociatorConfig())
        self._config, map_config, associator = self._parameters.records()
        self._parameters.on_change(self._take_parameters)
        self._file = Path(associator.map_file) if associator.map_file else None
        self._map = LandmarkMap(map_config)
        if self._file and _is_there(self._file):
            self._map.load(read_map(self._file))
        self._health = AssociatorHealth()
        self._associations = node.create_publisher(AssociationMessage, "associations", DEPTH)
        self._markers = node.create_publisher(MarkerArray, "association_markers", DEPTH)
        self._diagnostics = node.create_publisher(DiagnosticArray, "/diagnostics", 10)
        node.create_timer(1.0, self._report, clock=Clock(clock_type=ClockType.STEADY_TIME))
        for name, call in (("save", self._save), ("load", self._load), ("clear", self._clear)):
            node.create_service(Trigger, f"~/{name}", call)
        self._share = Share(*FILES)
        self._end = end
        self._starter = Thread(target=self._start, name="starter", daemon=True)
        self._starter.start()

    def close(self) -> bool:
        """Take the lines away; False if the kernels are still being compiled."""
        self._starter.join(PATIENCE)
        self._markers.publish(delete_all_markers())
        self._markers.wait_for_all_acked(FAREWELL)
        return not self._starter.is_alive()

    def _start(self) -> None:
        """Compile, then subscribe: in a thread, so that services answer and the node can end."""
        try:
            warm_up()
        except Exception as error:
            self._end(error)
            return
        self._subscription = self.node.create_subscription(
            LandmarkArray, "landmarks", self._on_landmarks, DEPTH
        )
        records = self._parameters.records()
        values = [item for record in records for item in flatten(record).items()]
        told = ", ".join(f"{name} {value}" for name, value in values)
        self._log.info(f"ready; map of {len(self._map.stored)} landmarks; {told}")

    def _on_landmarks(self, msg: LandmarkArray) -> None:
        started = time.monotonic()
        self.pauses.exempt()
        try:
            live = read_landmarks(msg)
            check_name("frame_id", msg.header.frame_id)
            stamp_ns = read_stamp(msg.header.stamp)
            self._map.update(live, stamp_ns, msg.header.frame_id, msg.sequence)
            known = self._map.recognizable()
            found = associate(known.landmarks, live, self._config)
        except InputError as error:
            self._health.rejected(str(error))
            self._log.warning(f"landmarks rejected: {error}", **throttled())
            return
        if found.verdict.has_transform:
            self._map.mark_recognized(live.ids[found.pairs[:, 1]])
        send(self._associations, lambda: association_message(found, known, live, msg.header))
        send(self._markers, lambda: association_markers(found, known, live, msg.header))
        self._health.updated(found, time.monotonic() - started)

    def _save(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        return self._with_file(response, self._write_to)

    def _load(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        return self._with_file(response, self._read_from)

    def _clear(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success = True
        response.message = f"{len(self._map.stored)} landmarks forgotten"
        self._map.clear()
        return response

    def _with_file(
        self, response: Trigger.Response, do: Callable[[Path], str]
    ) -> Trigger.Response:
        """Do something with the file; the answer tells how that went."""
        try:
            if self._file is None:
                raise InputError("there is no file; start the node with the parameter map_file")
            wait = self._share.wait()
            if wait:
                raise InputError(f"maps were written and read all the time; call in {wait:.1f} s")
            with self._share.work():
                response.success, response.message = True, do(self._file)
        except InputError as error:
            response.success, response.message = False, str(error)
        return response

    def _write_to(self, path: Path) -> str:
        write_map(path, self._map.stored)
        return f"{len(self._map.stored)} landmarks written to {path}"

    def _read_from(self, path: Path) -> str:
        self._map.load(read_map(path))
        return f"{len(self._map.stored)} landmarks read from {path}"

    def _take_parameters(self) -> None:
        self._config, self._map.config, _ = self._parameters.records()

    def _report(self) -> None:
        report = self._health.report(len(self._map.stored))
        self._diagnostics.publish(diagnostic_message(self.node, "association", report))


def _is_there(path: Path) -> bool:
    try:
        return path.exists()
    except OSError:
        return True  # reading it will tell what is wrong


def main(args: list[str] | None = None) -> int:
    """`ros2 run ellipseg_ros associator`."""
    return run(AssociatorNode, args)
