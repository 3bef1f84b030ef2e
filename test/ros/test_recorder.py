"""What the recorder records, with test publishers instead of a segmenter."""

from threading import Condition

import pytest
from node_kit import SECOND, peer
from rclpy.serialization import serialize_message
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Header
from visualization_msgs.msg import MarkerArray

from ellipseg_ros.errors import EllipsegError
from ellipseg_ros.msg import LandmarkArray, SegmentArray
from ellipseg_ros.ros.recorder import Recorder

LIMIT = 60.0
SHORT = 0.3  # s, for what must not come


class Notes:
    """Keeps the topics and times that it is told to write."""

    def __init__(self):
        self.written = []
        self._changed = Condition()

    def write(self, topic, time_ns, message):
        with self._changed:
            self.written.append((topic, time_ns // SECOND))
            self._changed.notify_all()

    def wait_for(self, *written):
        with self._changed:
            assert self._changed.wait_for(lambda: set(written) <= set(self.written), LIMIT)


def stamped(kind, seconds, **values):
    header = Header()
    header.stamp.sec = seconds
    return serialize_message(kind(header=header, **values))


@pytest.fixture
def scene(ros_domain):
    """A recorder, its notes, and the publishers of all topics."""
    notes = Notes()
    with Recorder(notes) as recorder, peer(ros_domain) as me:
        kinds = {
            "segments": SegmentArray,
            "segmented_points": PointCloud2,
            "landmarks": LandmarkArray,
            "ellipsoids": MarkerArray,
        }
        topics = {name: me.publish(kind, f"/{name}") for name, kind in kinds.items()}
        with pytest.raises(EllipsegError, match="the node publishes nothing"):
            recorder.wait_for_topics(SHORT)  # it may not know of us yet
        topics["ellipsoids"].send(MarkerArray())
        recorder.wait_for_topics(LIMIT)
        yield recorder, notes, topics


def test_update_is_complete_on_all_stamped_topics(scene):
    recorder, notes, topics = scene
    topics["segments"].send(stamped(SegmentArray, 1))
    notes.wait_for(("/segments", 1))
    with pytest.raises(EllipsegError, match="the last update is incomplete"):
        recorder.wait_for_updates(1, SHORT)
    topics["segmented_points"].send(stamped(PointCloud2, 1))
    recorder.wait_for_updates(1, LIMIT)

    topics["landmarks"].send(stamped(LandmarkArray, 1))  # from now on they count
    topics["segmented_points"].send(stamped(PointCloud2, 2))
    topics["segments"].send(stamped(SegmentArray, 2, sequence=1))
    notes.wait_for(("/landmarks", 1), ("/segmented_points", 2), ("/segments", 2))
    with pytest.raises(EllipsegError, match="the last update is incomplete"):
        recorder.wait_for_updates(2, SHORT)
    topics["landmarks"].send(stamped(LandmarkArray, 2))
    recorder.wait_for_updates(2, LIMIT)
    assert sorted(notes.written) == [
        (f"/{topic}", time)
        for topic in ("landmarks", "segmented_points", "segments")
        for time in (1, 2)
    ]


def test_too_few_updates_are_an_error(scene):
    recorder, _, topics = scene
    topics["segmented_points"].send(stamped(PointCloud2, 1))
    topics["segments"].send(stamped(SegmentArray, 1))
    recorder.wait_for_updates(1, LIMIT)
    with pytest.raises(EllipsegError, match="3 updates were expected, 1 received within"):
        recorder.wait_for_updates(3, SHORT)
