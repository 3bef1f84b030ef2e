"""The associator over DDS: recognition, the map, its file, and invalid landmarks."""

import signal
from dataclasses import replace

import numpy as np
import pytest
import worlds
from diagnostic_msgs.msg import DiagnosticArray
from node_kit import SECOND, nanoseconds, peer, running
from scipy.spatial.transform import Rotation
from std_srvs.srv import Trigger
from visualization_msgs.msg import Marker, MarkerArray

from ellipseg_ros.association.associate import associate
from ellipseg_ros.association.landmark_map import StoredMap, no_landmarks, select_landmarks
from ellipseg_ros.io.landmark_messages import read_landmarks
from ellipseg_ros.io.map_file import read_map, write_map
from ellipseg_ros.msg import Association, Landmark, LandmarkArray
from ellipseg_ros.records import Verdict

NODE = "/ellipseg_associator"


@pytest.fixture(scope="module")
def domain(session_ros_domain):
    return session_ros_domain


def message(found, stamp, frame_id="odom"):
    """A LandmarkArray; stamp in s, and its number."""
    made = LandmarkArray(sequence=stamp)
    made.header.frame_id = frame_id
    made.header.stamp.sec = stamp
    for row in range(len(found)):
        landmark = Landmark(
            id=int(found.ids[row]),
            kind=int(found.kind[row]),
            count=int(found.count[row]),
            sigma=found.sigma[row],
            covariance=found.covariance[row].ravel(),
            instability=float(found.instability[row]),
        )
        for name in ("position", "box_min", "box_max"):
            point = getattr(landmark, name)
            point.x, point.y, point.z = getattr(found, name)[row].tolist()
        q = landmark.orientation
        q.x, q.y, q.z, q.w = Rotation.from_matrix(found.axes[row]).as_quat().tolist()
        made.landmarks.append(landmark)
    return made


def scene(seed=0, drift=(1.0, 4.0)):
    rng = np.random.default_rng(seed)
    return worlds.observe_twice(worlds.world(rng), rng, *drift)


class AssociatorPeer:
    """A peer with the topics and services of the associator."""

    def __init__(self, me):
        self.me = me
        self.associations = me.subscribe(Association, "associations")
        self.markers = me.subscribe(MarkerArray, "association_markers")
        self.diagnostics = me.subscribe(DiagnosticArray, "/diagnostics")
        self.landmarks = me.publish(LandmarkArray, "landmarks")

    def update(self, found, stamp, **options):
        """Send landmarks, and wait for the association and its markers."""
        self.landmarks.send(message(found, stamp, **options))

        def matches(array):
            return nanoseconds(array.markers[0].header.stamp) == stamp * SECOND

        self.marker = self.markers.wait(matches).markers[0]
        return self.associations.wait_for_stamp(stamp)

    def call(self, service):
        return self.me.call(Trigger, f"{NODE}/{service}")


@pytest.fixture(scope="module")
def node(domain, tmp_path_factory):
    folder = tmp_path_factory.mktemp("associator")
    path = folder / "map.npz"
    arguments = ["-p", f"map_file:={path}", "-p", "delay:=10.0", "-p", "min_age:=0.0"]
    with running("associator_node", arguments, folder / "log") as process, peer(domain) as me:
        found = AssociatorPeer(me)
        found.process, found.path = process, path
        yield found


def test_revisited_world_is_recognized(node):
    looks = scene()
    first = node.update(looks.earlier, 1)
    assert first.verdict == Association.TOO_FEW and first.map_landmark_count == 0
    assert node.marker.action == Marker.DELETE
    node.update(no_landmarks(), 2)
    early = node.update(looks.later, 3)
    assert early.map_landmark_count == 0  # the delay is not over
    again = node.update(looks.later, 20)
    assert again.map_landmark_count == len(looks.earlier)

    # The map's ids are rows + 1, since nothing was in it before.
    expected = associate(looks.earlier, looks.later)
    pairs = [(pair.map_id - 1, pair.landmark_id - 1) for pair in again.pairs]
    assert pairs == [tuple(pair) for pair in expected.pairs]
    assert again.verdict == expected.verdict < Verdict.AMBIGUOUS
    assert {nanoseconds(pair.map_last_seen) for pair in again.pairs} == {SECOND}
    np.testing.assert_allclose(
        [pair.mahalanobis_distance for pair in again.pairs], expected.distance, atol=1e-6
    )
    t, q = again.transform.translation, again.transform.rotation
    np.testing.assert_allclose([t.x, t.y, t.z], expected.T_earlier_later[:3, 3], atol=1e-6)
    turn = Rotation.from_quat([q.x, q.y, q.z, q.w]).as_matrix()
    np.testing.assert_allclose(turn, expected.T_earlier_later[:3, :3], atol=1e-6)
    np.testing.assert_allclose(again.covariance, expected.covariance.ravel(), rtol=1e-6)
    assert len(again.undetermined) == expected.undetermined.size
    assert list(again.undetermined_names) == expected.undetermined_names

    assert node.marker.action == Marker.ADD
    ends = np.array([(p.x, p.y, p.z) for p in node.marker.points]).reshape(-1, 2, 3)
    np.testing.assert_allclose(ends[:, 0], looks.earlier.position[expected.pairs[:, 0]])
    np.testing.assert_allclose(ends[:, 1], looks.later.position[expected.pairs[:, 1]])


def test_recognized_landmarks_are_not_stored_twice(node):
    node.update(no_landmarks(), 90)
    assert node.call("clear").success
    looks = scene(1)
    node.update(looks.earlier, 100)
    node.update(no_landmarks(), 101)
    pairs = len(node.update(looks.later, 120).pairs)
    assert pairs > 10
    node.update(no_landmarks(), 121)
    total = node.update(no_landmarks(), 140).map_landmark_count
    assert total == len(looks.earlier) + len(looks.later) - pairs


def test_restarted_segmenter_has_new_landmarks(domain, tmp_path):
    arguments = ["-p", "delay:=0.0", "-p", "min_age:=0.0", "-r", "__ns:=/restarted"]
    with (
        running("associator_node", arguments, tmp_path / "log"),
        peer(domain, "/restarted") as me,
    ):
        found = AssociatorPeer(me)
        first = scene(4).earlier
        found.update(no_landmarks(), 5, frame_id="elsewhere")  # pins nothing
        found.update(first, 10)
        restarted = message(scene(5).earlier, 20)  # the ids are the same
        restarted.sequence = 0
        found.landmarks.send(restarted)
        heard = found.associations.wait_for_stamp(20)
        assert heard.map_landmark_count == len(first)


def test_saved_map_is_loaded_unchanged(node):
    before = node.update(no_landmarks(), 200).map_landmark_count
    assert before > 0
    answer = node.call("save")
    assert answer.success and answer.message == f"{before} landmarks written to {node.path}"
    assert len(read_map(node.path)) == before
    assert node.call("clear").message == f"{before} landmarks deleted"
    assert node.update(no_landmarks(), 201).map_landmark_count == 0
    answer = node.call("load")
    assert answer.success and answer.message == f"{before} landmarks read from {node.path}"
    assert node.update(no_landmarks(), 202).map_landmark_count == before


def test_map_file_cannot_be_changed_over_the_network(node, tmp_path):
    other = tmp_path / "other.npz"
    (answer,) = node.me.set(NODE, map_file=str(other))
    assert not answer.successful and "read-only" in answer.reason
    (value,) = node.me.get(NODE, "map_file")
    assert value.string_value == str(node.path)
    assert str(node.path) in node.call("save").message
    assert not other.exists()


def test_invalid_map_file_is_refused_and_the_map_is_kept(node):
    before = node.update(no_landmarks(), 300).map_landmark_count
    node.path.write_bytes(b"no map")
    answer = node.call("load")
    assert not answer.success and "is no map of landmarks" in answer.message
    assert "\n" not in answer.message
    assert node.update(no_landmarks(), 301).map_landmark_count == before


def test_invalid_landmarks_are_rejected_and_reported(node):
    bad = message(scene().earlier, 400)
    bad.landmarks[0].position.x = float("nan")
    heard = len(node.diagnostics.messages)
    node.landmarks.send(bad)

    def told(report):
        return "position has a value that is not finite" in report.status[0].message

    status = node.diagnostics.wait(told, heard).status[0]
    assert status.name == "ellipseg_associator: association" and status.level > b"\x00"
    heard = len(node.diagnostics.messages)
    node.landmarks.send(message(scene().earlier, 401, frame_id="elsewhere"))
    node.diagnostics.wait(lambda r: "in frame elsewhere; the map is in odom" in str(r), heard)
    assert node.update(no_landmarks(), 402).header.frame_id == "odom"


def test_parameters_are_live_except_for_the_file(node):
    assert node.me.set(NODE, max_translation=2)[0].successful
    refused = node.me.set(NODE, max_translation=-1.0)[0]
    assert not refused.successful and "out of range" in refused.reason
    assert not node.me.set(NODE, map_file="/elsewhere")[0].successful
    assert node.me.set(NODE, max_translation=3.0)[0].successful


def test_flood_of_file_calls_is_limited(domain, tmp_path):
    earlier = scene(3).earlier
    many = select_landmarks(earlier, np.arange(20_000) % len(earlier))
    ids = np.arange(1, len(many) + 1, dtype=np.uint32)
    seen = np.full(len(ids), 5 * SECOND)
    path = tmp_path / "map.npz"
    write_map(path, StoredMap(replace(many, ids=ids), seen, "odom", len(ids) + 1))
    arguments = ["-p", f"map_file:={path}", "-r", "__ns:=/flooded"]
    with running("associator_node", arguments, tmp_path / "log"), peer(domain) as me:
        refused = []
        for number in range(300):
            answer = me.call(Trigger, f"/flooded{NODE}/save")
            refused += [] if answer.success else [answer.message]
            assert answer.success or number
            if len(refused) == 5:
                break
        assert len(refused) == 5
        assert all("too many maps were written or read; call in" in one for one in refused)
        assert me.call(Trigger, f"/flooded{NODE}/clear").success  # it costs nothing
        assert len(read_map(path)) == len(many)


def test_associator_starts_with_its_map_and_ends_cleanly(domain, tmp_path):
    looks = scene(2)
    path = tmp_path / "map.npz"
    ids = np.arange(1, len(looks.earlier) + 1, dtype=np.uint32)
    seen = np.full(len(ids), 5 * SECOND)
    landmarks = select_landmarks(looks.earlier, slice(None))
    write_map(path, StoredMap(landmarks, seen, "odom", int(ids[-1]) + 1))
    with (
        running(
            "associator_node", ["-p", f"map_file:={path}", "-r", "__ns:=/two"], tmp_path / "log"
        ) as process,
        peer(domain, "/two") as me,
    ):
        found = AssociatorPeer(me)
        heard = found.update(looks.later, 1000)
        assert len(heard.pairs) > 10
        assert heard.map_landmark_count == len(ids)
        process.signal(signal.SIGINT)
        assert process.wait() == 0
        assert found.markers.wait(lambda m: m.markers[0].action == Marker.DELETEALL)


@pytest.mark.parametrize(
    ("name", "why"), [("map.npz", "is no map of landmarks"), ("x" * 300, "cannot be read")]
)
def test_unreadable_map_ends_the_start_in_one_line(domain, tmp_path, name, why):
    (tmp_path / "map.npz").write_bytes(b"no map")
    arguments = ["-p", f"map_file:={tmp_path / name}"]
    with running("associator_node", arguments, tmp_path / "log") as process:
        assert process.wait() == 2
        assert why in process.output and "Traceback" not in process.output


@pytest.mark.parametrize(
    ("spoil", "why"),
    [
        (lambda landmark: setattr(landmark, "kind", 7), "kind is 7"),
        (lambda landmark: setattr(landmark, "id", 2), "occurs twice"),
        (lambda landmark: setattr(landmark.orientation, "w", 3.0), "not of length 1"),
        (lambda landmark: setattr(landmark.position, "x", np.inf), "not finite"),
    ],
)
def test_invalid_landmarks_are_refused(spoil, why):
    made = message(scene().earlier, 1)
    spoil(made.landmarks[0])
    with pytest.raises(Exception, match=why):
        read_landmarks(made)


def test_landmarks_survive_the_round_trip_through_a_message():
    found = scene().earlier
    back = read_landmarks(message(found, 1))
    for name in ("ids", "kind", "count", "position", "sigma", "box_min", "box_max", "covariance"):
        np.testing.assert_array_equal(getattr(back, name), getattr(found, name))
    np.testing.assert_allclose(back.axes, found.axes, atol=1e-12)
    assert len(read_landmarks(message(no_landmarks(), 1))) == 0
