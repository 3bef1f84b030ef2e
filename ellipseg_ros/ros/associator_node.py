"""The node `ellipseg_associator`: maintains a landmark map and matches landmarks with it."""

import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

from std_srvs.srv import Trigger

from ellipseg_ros.association.associate import associate, warm_up
from ellipseg_ros.association.landmark_map import LandmarkMap
from ellipseg_ros.config import AssociationConfig, AssociatorConfig, MapConfig
from ellipseg_ros.errors import InputError
from ellipseg_ros.io import topics
from ellipseg_ros.io.landmark_messages import read_landmarks
from ellipseg_ros.io.limits import check_name, read_stamp
from ellipseg_ros.io.map_file import read_map, write_map
from ellipseg_ros.msg import LandmarkArray
from ellipseg_ros.node.associator_health import AssociatorHealth
from ellipseg_ros.ros.associations import association_markers, association_message
from ellipseg_ros.ros.diagnostics import publish_diagnostics
from ellipseg_ros.ros.limits import CALLBACK_SHARE, Pauses, Share, throttled
from ellipseg_ros.ros.outputs import ACKNOWLEDGE_TIMEOUT, delete_all_markers, send
from ellipseg_ros.ros.process import End, Runnable, run, start_thread
from ellipseg_ros.ros.topics import create_publisher, create_service, create_subscription

FILE_SHARE = (0.1, 2.0)  # of the time, for writing and reading maps, and burst in s
COMPILER_TIMEOUT_S = 1.0  # at shutdown


class AssociatorNode(Runnable):
    """Passes landmarks to the map, and both to `associate`.

    All of it in the callbacks: an update takes milliseconds, and comes once a second.
    """

    def __init__(self, end: End) -> None:
        super().__init__(topics.ASSOCIATOR, AssociationConfig(), MapConfig(), AssociatorConfig())
        self.pauses: Pauses = Pauses(*CALLBACK_SHARE)
        self._config, map_config, associator = self.parameters.records()
        self.parameters.changed = self._apply_parameters
        self._file = Path(associator.map_file) if associator.map_file else None
        self._map = LandmarkMap(map_config)
        if self._file and _may_exist(self._file):
            self._map.load(read_map(self._file))
        self._health = AssociatorHealth()
        self._associations = create_publisher(self.node, topics.ASSOCIATIONS)
        self._markers = create_publisher(self.node, topics.ASSOCIATION_MARKERS)
        publish_diagnostics(
            self.node, "association", lambda: self._health.report(len(self._map.stored))
        )
        for service, action in ((topics.SAVE, self._save), (topics.LOAD, self._load)):
            create_service(self.node, service, partial(self._use_file, action))
        create_service(self.node, topics.CLEAR, self._clear)
        self._file_share = Share(*FILE_SHARE)
        self._starter = start_thread("starter", self._start, end)

    def close(self) -> bool:
        """Delete the markers; False if the kernels are still being compiled."""
        self._starter.join(COMPILER_TIMEOUT_S)
        self._markers.publish(delete_all_markers())
        self._markers.wait_for_all_acked(ACKNOWLEDGE_TIMEOUT)
        return not self._starter.is_alive()

    def _start(self) -> None:
        """Compile, then subscribe; in a thread, so that services answer and the node can end."""
        warm_up()
        self._subscription = create_subscription(self.node, topics.LANDMARKS, self._on_landmarks)
        self.log.info(f"ready; map of {len(self._map.stored)} landmarks; {self.parameters}")

    def _on_landmarks(self, msg: LandmarkArray) -> None:
        started = time.monotonic()
        self.pauses.exempt()
        try:
            landmarks = read_landmarks(msg)
            check_name("frame_id", msg.header.frame_id)
            stamp_ns = read_stamp(msg.header.stamp)
            self._map.update(landmarks, stamp_ns, msg.header.frame_id, msg.sequence)
            stored = self._map.recognizable()
            association = associate(stored.landmarks, landmarks, self._config)
        except InputError as error:
            self._health.rejected(str(error))
            self.log.warning(f"landmarks rejected: {error}", **throttled())
            return
        if association.verdict.has_transform:
            self._map.mark_recognized(landmarks.ids[association.pairs[:, 1]])
        results = association, stored, landmarks, msg.header
        send(self._associations, lambda: association_message(*results))
        send(self._markers, lambda: association_markers(*results))
        self._health.updated(association, time.monotonic() - started)

    def _clear(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success = True
        response.message = f"{len(self._map.stored)} landmarks deleted"
        self._map.clear()
        return response

    def _use_file(
        self, action: Callable[[Path], str], _: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        """Answer a call with what an action on the map file returns or raises."""
        try:
            if self._file is None:
                raise InputError("there is no file; start the node with the parameter map_file")
            wait = self._file_share.wait()
            if wait:
                raise InputError(f"too many maps were written or read; call in {wait:.1f} s")
            with self._file_share.work():
                response.success, response.message = True, action(self._file)
        except InputError as error:
            response.success, response.message = False, str(error)
        return response

    def _save(self, path: Path) -> str:
        write_map(path, self._map.stored)
        return f"{len(self._map.stored)} landmarks written to {path}"

    def _load(self, path: Path) -> str:
        self._map.load(read_map(path))
        return f"{len(self._map.stored)} landmarks read from {path}"

    def _apply_parameters(self) -> None:
        self._config, self._map.config, _ = self.parameters.records()


def _may_exist(path: Path) -> bool:
    try:
        return path.exists()
    except OSError:
        return True  # reading it will raise a proper error


def main(args: list[str] | None = None) -> int:
    """`ros2 run ellipseg_ros associator`."""
    return run(AssociatorNode, args)
