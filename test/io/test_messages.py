from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import random_records
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from ellipseg_ros.config import NodeConfig
from ellipseg_ros.io import topics
from ellipseg_ros.io.bag import node_types
from ellipseg_ros.io.colours import id_colours
from ellipseg_ros.io.messages import MarkerStream, quaternions, write_landmarks, write_segments
from ellipseg_ros.records import Kind, Ragged, State

SECOND = 10**9
STORE = node_types()
ALL = NodeConfig(marker_min_count=1)


def message(name, **fields):
    """An object of a message type: what is not named is empty or zero."""
    kind = STORE.types[name]
    return kind(**fields)


def time(ns, kind="Time"):
    return message(f"builtin_interfaces/msg/{kind}", sec=ns // SECOND, nanosec=ns % SECOND)


def header(ns, frame_id):
    return message("std_msgs/msg/Header", stamp=time(ns), frame_id=frame_id)


def vector(kind, values):
    return message(
        f"geometry_msgs/msg/{kind}", **dict(zip("xyzw", map(float, values), strict=False))
    )


def rotation(axes):
    return vector("Quaternion", quaternions(axes[None])[0])


# --- the plain twins: one object after the other -------------------------------------------------


def plain_segment(found, row):
    shape = found.ellipsoids
    return message(
        "ellipseg_ros/msg/Segment",
        id=int(found.ids[row]),
        object_id=int(found.objects.ids[found.objects.segment_labels[row]])
        if found.objects is not None
        else 0,
        state=int(found.state[row]),
        count=int(shape.count[row]),
        mean=vector("Point", shape.mean[row]),
        covariance=shape.covariance[row].ravel(),
        orientation=rotation(shape.axes[row]),
        sigma=np.sqrt(shape.eigenvalues[row]),
        planarity=float(shape.planarity[row]),
        cylindricality=float(shape.cylindricality[row]),
        sphericity=float(shape.sphericity[row]),
        aicc=float(shape.aicc[row]),
        first_seen=time(int(found.first_seen_ns[row])),
        last_seen=time(int(found.last_seen_ns[row])),
        parents=found.parents[row],
    )


def plain_object(found, row):
    objects = found.objects
    return message(
        "ellipseg_ros/msg/Object",
        id=int(objects.ids[row]),
        state=int(objects.state[row]),
        count=int(objects.count[row]),
        mean=vector("Point", objects.mean[row]),
        covariance=objects.covariance[row].ravel(),
        box_min=vector("Point", objects.box_min[row]),
        box_max=vector("Point", objects.box_max[row]),
        planarity=float(objects.planarity[row]),
        cylindricality=float(objects.cylindricality[row]),
        sphericity=float(objects.sphericity[row]),
        segments=np.sort(found.ids[objects.segment_labels == row]),
        parents=objects.parents[row],
    )


def plain_segments(found):
    return message(
        "ellipseg_ros/msg/SegmentArray",
        header=header(found.end_ns, found.frame_id),
        window_start=time(found.start_ns),
        window_end=time(found.end_ns),
        criterion=found.criterion,
        threshold=found.threshold,
        threshold_change=found.threshold_change,
        aicc=found.aicc,
        segmented=int((found.labels >= 0).sum()),
        isolated=int((found.labels == -1).sum()),
        rejected=int((found.labels == -2).sum()),
        thinned=int((found.labels == -4).sum()),
        late=found.late,
        evicted=found.evicted,
        filtered=found.filtered,
        unplaced=found.unplaced,
        full=True,
        sequence=found.sequence,
        segments=[plain_segment(found, row) for row in np.argsort(found.ids)],
        removed=found.removed,
        objects=[plain_object(found, row) for row in np.argsort(found.objects.ids)]
        if found.objects is not None
        else [],
        removed_objects=found.removed_objects,
    )


def plain_landmark(found, row):
    marks = found.landmarks
    return message(
        "ellipseg_ros/msg/Landmark",
        id=int(marks.ids[row]),
        kind=int(marks.kind[row]),
        count=int(marks.count[row]),
        position=vector("Point", marks.position[row]),
        orientation=rotation(marks.axes[row]),
        sigma=marks.sigma[row].copy(),
        box_min=vector("Vector3", marks.box_min[row]),
        box_max=vector("Vector3", marks.box_max[row]),
        covariance=marks.covariance[row].ravel(),
        instability=float(marks.instability[row]),
        first_seen=time(int(marks.first_seen_ns[row])),
        segments=np.sort(found.ids[marks.segments[row]]),
    )


def plain_landmarks(found):
    return message(
        "ellipseg_ros/msg/LandmarkArray",
        header=header(found.end_ns, found.frame_id),
        sequence=found.sequence,
        landmarks=[plain_landmark(found, row) for row in range(len(found.landmarks))],
        removed=found.landmarks.removed,
    )


def plain_marker(found, number, action, shape):
    nothing = np.zeros(0, np.uint8)
    image = message(
        "sensor_msgs/msg/CompressedImage", header=header(0, ""), format="", data=nothing
    )
    position, orientation, scale, rgba = shape
    return message(
        "visualization_msgs/msg/Marker",
        header=header(found.end_ns, found.frame_id),
        ns="ellipsoids",
        id=number,
        type=2,
        action=action,
        pose=message(
            "geometry_msgs/msg/Pose", position=vector("Point", position), orientation=orientation
        ),
        scale=vector("Vector3", scale),
        color=message(
            "std_msgs/msg/ColorRGBA", **dict(zip("rgba", map(float, rgba), strict=True))
        ),
        lifetime=time(10 * SECOND, "Duration"),
        frame_locked=False,
        points=[],
        colors=[],
        texture_resource="",
        texture=image,
        uv_coordinates=[],
        text="",
        mesh_resource="",
        mesh_file=message("visualization_msgs/msg/MeshFile", filename="", data=nothing),
        mesh_use_embedded_materials=False,
    )


def plain_markers(found, rows, dead=(), clear=False):
    gone = ((0, 0, 0), vector("Quaternion", (0, 0, 0, 1)), (0, 0, 0), (0, 0, 0, 0))
    markers = [plain_marker(found, 0, 3, gone)] if clear else []
    markers += [plain_marker(found, int(number), 2, gone) for number in dead]
    e = found.ellipsoids
    for row in rows:
        rgb = np.sqrt([e.cylindricality[row], e.sphericity[row], e.planarity[row]])
        scale = [max(0.001, 4.0 * np.sqrt(value)) for value in e.eigenvalues[row]]
        shape = (e.mean[row], rotation(e.axes[row]), scale, [*rgb, 0.7])
        markers.append(plain_marker(found, int(found.ids[row]), 0, shape))
    return message("visualization_msgs/msg/MarkerArray", markers=markers)


# --- segments ------------------------------------------------------------------------------------


@given(
    segments=st.integers(0, 9),
    seed=st.integers(0, 2**32 - 1),
    frame_id=st.sampled_from(["", "map", "odom", "a frame \N{DEGREE SIGN}", "base/odom"]),
    criterion=st.sampled_from(["shape", "density", "parsimony"]),
)
@settings(max_examples=100, deadline=None)
def test_segment_bytes_equal_those_of_message_objects(segments, seed, frame_id, criterion):
    found = random_records.segmentation(30, segments, seed, frame_id=frame_id, criterion=criterion)
    expected = STORE.serialize_cdr(plain_segments(found), topics.SEGMENTS.type)
    assert write_segments(found) == bytes(expected)


@given(
    segments=st.integers(1, 9),
    seed=st.integers(0, 2**32 - 1),
    frame_id=st.sampled_from(["", "map", "odom", "a frame \N{DEGREE SIGN}", "base/odom"]),
)
@settings(max_examples=50, deadline=None)
def test_landmark_bytes_equal_those_of_message_objects(segments, seed, frame_id):
    found = random_records.segmentation(90, segments, seed, frame_id=frame_id)
    expected = STORE.serialize_cdr(plain_landmarks(found), topics.LANDMARKS.type)
    assert write_landmarks(found, found.landmarks) == bytes(expected)


def test_rclpy_deserializes_landmarks():
    serialization = pytest.importorskip("rclpy.serialization")
    from ellipseg_ros.msg import Landmark, LandmarkArray

    found = random_records.segmentation(90, 7)
    data = write_landmarks(found, found.landmarks)
    read = serialization.deserialize_message(data, LandmarkArray)
    assert [mark.id for mark in read.landmarks] == list(found.landmarks.ids)
    assert np.array_equal(
        read.landmarks[2].covariance.reshape(6, 6), found.landmarks.covariance[2]
    )
    assert read.landmarks[-1].box_max.z == found.landmarks.box_max[-1, 2]
    assert list(read.removed) == list(found.landmarks.removed)
    assert (Landmark.PLANE, Landmark.LINE, Landmark.BLOB) == tuple(Kind)


def test_disabled_objects_are_not_in_the_message():
    found = random_records.segmentation(30, 5, objects=None)
    expected = STORE.serialize_cdr(plain_segments(found), topics.SEGMENTS.type)
    assert write_segments(found) == bytes(expected)


def test_any_number_of_parents_is_serialized():
    lengths = np.array([0, 5, 0, 0, 1, 2, 3, 0])
    values = np.arange(lengths.sum(), dtype=np.uint32)
    parents = Ragged(np.append(0, np.cumsum(lengths)), values)
    found = random_records.segmentation(
        30, 8, parents=parents, ids=np.arange(8, 0, -1).astype(np.uint32)
    )
    read = STORE.deserialize_cdr(write_segments(found), topics.SEGMENTS.type)
    assert [s.id for s in read.segments] == list(range(1, 9))
    assert [s.parents.tolist() for s in read.segments[::-1]] == [
        parents[k].tolist() for k in range(8)
    ]


def test_rclpy_deserializes_segments():
    serialization = pytest.importorskip("rclpy.serialization")
    from ellipseg_ros.msg import SegmentArray

    found = random_records.segmentation(30, 7)
    read = serialization.deserialize_message(write_segments(found), SegmentArray)
    assert [s.id for s in read.segments] == sorted(found.ids)
    assert list(read.removed) == found.removed.tolist()
    assert [o.id for o in read.objects] == sorted(found.objects.ids)
    assert list(read.objects[0].segments) == sorted(
        segment.id for segment in read.segments if segment.object_id == 1
    )
    assert list(read.removed_objects) == found.removed_objects.tolist()
    first = int(np.argmin(found.objects.ids))
    assert list(read.objects[0].parents) == found.objects.parents[first].tolist()
    row = int(np.argmax(found.ids))
    assert list(read.segments[-1].parents) == found.parents[row].tolist()
    assert read.segments[-1].sphericity == found.ellipsoids.sphericity[row]


def test_quaternions_equal_those_of_scipy():
    turns = Rotation.random(1000, rng=np.random.default_rng(0)).as_matrix()
    half = [np.diag(d) for d in ([1.0, -1, -1], [-1.0, 1, -1], [-1.0, -1, 1], [1.0, 1, 1])]
    turns = np.concatenate([turns, half])
    expected = Rotation.from_matrix(turns).as_quat(canonical=True)
    np.testing.assert_allclose(quaternions(turns), expected, atol=1e-14)


# --- markers -------------------------------------------------------------------------------------


def sent(markers, found, **how):
    """What a viewer is told: the ids that it must draw, those to delete, whether to clear."""
    read = STORE.deserialize_cdr(markers.update(found, **how), topics.ELLIPSOIDS.type).markers
    actions = [marker.action for marker in read]
    assert 3 not in actions[1:], "DELETEALL must come first"
    ids = [marker.id for marker in read if marker.action != 3]
    assert len(ids) == len(set(ids))
    drawn = {marker.id for marker in read if marker.action == 0}
    return drawn, {marker.id for marker in read if marker.action == 2}, 3 in actions


@given(
    st.integers(0, 9), st.integers(0, 2**32 - 1), st.sampled_from(["", "map", "world", "odoms"])
)
@settings(max_examples=100, deadline=None)
def test_marker_bytes_equal_those_of_message_objects(segments, seed, frame_id):
    markers = MarkerStream(ALL)
    first = random_records.segmentation(60, segments, seed, frame_id=frame_id)
    visible = np.flatnonzero(first.ellipsoids.count >= 1)
    kind = topics.ELLIPSOIDS.type
    visible = visible[np.argsort(first.ids[visible])]
    expected = STORE.serialize_cdr(plain_markers(first, visible, clear=True), kind)
    assert markers.update(first) == bytes(expected)

    kept = random_records.segmentation(
        60, 3, seed, frame_id=frame_id, sequence=1, ids=np.array([2, 4, 99], np.uint32)
    )
    rows = np.flatnonzero(kept.ellipsoids.count >= 1)
    dead = sorted(set(first.ids[visible]) - set(kept.ids[rows]))
    expected = STORE.serialize_cdr(plain_markers(kept, rows, dead), kind)
    assert markers.update(kept, send_all=True) == bytes(expected)

    anew = replace(kept, restart="a reset", sequence=2)
    expected = STORE.serialize_cdr(plain_markers(anew, rows, clear=True), kind)
    assert markers.update(anew) == bytes(expected)


def test_rclpy_deserializes_markers():
    serialization = pytest.importorskip("rclpy.serialization")
    from visualization_msgs.msg import MarkerArray

    found = random_records.segmentation(100, 7, restart="a reset")
    read = serialization.deserialize_message(MarkerStream(ALL).update(found), MarkerArray).markers
    assert [m.id for m in read] == [0, *range(1, 8)]
    assert [m.action for m in read] == [3] + [0] * 7
    assert [m.pose.position.z for m in read[1:]] == found.ellipsoids.mean[
        np.argsort(found.ids), 2
    ].tolist()


def steady(seconds, step=1.0, **changes):
    """Updates of 200 segments to which nothing happens but the first."""
    count = 200
    first = random_records.segmentation(
        6000, count, ids=np.arange(1, count + 1).astype(np.uint32), state=np.zeros(count, np.uint8)
    )
    for k in range(round(seconds / step)):
        state = State.UNCHANGED if k else State.NEW
        yield replace(
            first,
            sequence=k,
            end_ns=first.end_ns + round(k * step * SECOND),
            state=np.full(count, state, np.uint8),
            **changes,
        )


@pytest.mark.parametrize("step", [0.1, 0.7, 1.0, 2.0, 4.9])
def test_markers_are_repeated_every_4_s_and_spread_over_updates(step):
    markers = MarkerStream(ALL)
    times = {number: [] for number in range(1, 201)}
    for found in steady(40.0, step):
        drawn, dead, cleared = sent(markers, found)
        assert not dead and cleared == (found.sequence == 0)
        assert found.sequence == 0 or step > 2.0 or len(drawn) < 160
        for number in drawn:
            times[number].append(found.end_ns)
    for stamps in times.values():
        assert all(b - a <= (4.0 + step) * SECOND for a, b in pairwise([*stamps, found.end_ns]))
    often = np.mean([len(stamps) for stamps in times.values()])
    assert often <= 1 + 40 / 4 + 1 or step > 4.0


def test_only_changed_markers_are_sent_immediately():
    updates = list(steady(3.0, 0.01))
    markers = MarkerStream(ALL)
    assert len(sent(markers, updates[0])[0]) == 200
    state = updates[1].state.copy()
    state[[3, 5]] = [State.UPDATED, State.NEW]
    drawn, _, _ = sent(markers, replace(updates[1], state=state))
    assert {4, 6} <= drawn and len(drawn) < 20


def test_removed_and_small_markers_are_deleted_once():
    first, second, third = list(steady(3.0))
    markers = MarkerStream(NodeConfig(marker_min_count=2))
    sent(markers, first)
    count = second.ellipsoids.count.copy()
    count[0] = 1  # id 1 is too small now
    gone = second.ids.copy()
    gone[1] = 777  # id 2 is no more
    shrunk = replace(second.ellipsoids, count=count)
    drawn, dead, _ = sent(markers, replace(second, ellipsoids=shrunk, ids=gone))
    assert dead == {1, 2} and 777 in drawn and 1 not in drawn
    drawn, dead, _ = sent(markers, replace(third, ids=gone))  # id 1 has grown again
    assert dead == set() and 1 in drawn


def test_all_markers_are_sent_on_request_after_gaps_settings_and_resets():
    updates = list(steady(1.0, 0.01))
    everything = set(range(1, 201))
    markers = MarkerStream(ALL)
    assert sent(markers, updates[0]) == (everything, set(), True)  # who knows what was before
    assert sent(markers, updates[1])[0] != everything
    assert sent(markers, updates[2], send_all=True) == (everything, set(), False)
    assert sent(markers, updates[2], send_all=True, delete_all=True) == (everything, set(), True)
    assert sent(markers, updates[4])[0] == everything  # updates[3] was left out
    markers.configure(ALL)
    assert sent(markers, updates[5])[0] != everything
    markers.configure(replace(ALL, marker_sigmas=3.0))
    assert sent(markers, updates[6])[0] == everything
    drawn, dead, cleared = sent(
        markers, replace(updates[7], restart="a reset", ids=updates[7].ids + 500)
    )
    assert cleared and not dead and drawn == {number + 500 for number in everything}


def test_marker_in_object_colour_is_sent_when_the_object_changes():
    markers = MarkerStream(replace(ALL, marker_colour="object"))
    first, second, third = list(steady(0.03, 0.01))
    sent(markers, first)
    assert len(sent(markers, second)[0]) < 20
    ids = third.objects.ids.copy()
    ids[0] = 1234
    moved = replace(third, objects=replace(third.objects, ids=ids))
    members = set(third.ids[third.objects.segment_labels == 0].tolist())
    read = STORE.deserialize_cdr(markers.update(moved), topics.ELLIPSOIDS.type).markers
    assert members <= {marker.id for marker in read}
    for marker in read:
        expected = id_colours(moved.object_ids[moved.ids == marker.id])[0] / 255.0
        colour = [marker.color.r, marker.color.g, marker.color.b]
        np.testing.assert_allclose(colour, expected, atol=1e-6)


def test_markers_have_a_minimum_axis_and_scale_with_sigmas():
    found = random_records.segmentation(100, 5)
    read = STORE.deserialize_cdr(
        MarkerStream(NodeConfig(marker_min_count=1, marker_sigmas=3.0)).update(found),
        topics.ELLIPSOIDS.type,
    )
    drawn = [marker for marker in read.markers if marker.action == 0]
    scales = np.array([[m.scale.x, m.scale.y, m.scale.z] for m in drawn])
    sigma = np.sqrt(found.ellipsoids.eigenvalues[np.argsort(found.ids)])
    expected = np.maximum(0.001, 6.0 * sigma)
    np.testing.assert_allclose(scales, expected, rtol=1e-15)
    assert scales.min() == 0.001
