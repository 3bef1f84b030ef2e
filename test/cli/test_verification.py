"""The verification of the demo, and the accounting of points, accept no wrong update."""

import re
from dataclasses import replace

import numpy as np
import pytest
from point_accounting import Account

from ellipseg_ros.cli.verification import COMPARED, RecordedUpdate, Verification
from ellipseg_ros.config import Config
from ellipseg_ros.io.bag import node_types
from ellipseg_ros.io.messages import write_landmarks, write_segments
from ellipseg_ros.io.pointcloud2 import write_labelled
from ellipseg_ros.io.topics import LANDMARKS, SEGMENTED_POINTS, SEGMENTS
from ellipseg_ros.records import SECOND, State, Sweep
from ellipseg_ros.segmenter import Segmenter

CONFIG = Config(window_duration=2.5, max_points_per_second=150)


@pytest.fixture(scope="module")
def stream():
    """Five updates of 200 points, some NaN, some far away; the window holds about half."""
    rng = np.random.default_rng(2)
    groups, results = [], []
    segmenter = Segmenter(CONFIG)
    for second in range(5):
        points = rng.uniform(0.0, 4.0, (200, 3))
        points[:3] = np.nan
        points[3] = 500.0
        groups.append(
            Sweep(second * SECOND, points, rng.integers(0, SECOND, 200), frame_id="odom")
        )
        results.append(segmenter.process(groups[-1]))
    return groups, results


def recorded(result):
    """The messages of a correct node."""
    messages = {
        SEGMENTED_POINTS: write_labelled(result),
        SEGMENTS: write_segments(result),
        LANDMARKS: write_landmarks(result, result.landmarks),
    }
    message = node_types().deserialize_cdr(messages[SEGMENTS], SEGMENTS.type)
    return RecordedUpdate(messages, result.point_ids, result.point_object_ids, message)


def replaced(node, topic, convert):
    """An update with another message on a topic, from that of the node."""
    return replace(node, messages=node.messages | {topic: convert(node.messages[topic])})


def verify(stream, change=lambda k, node: node):
    """Verify the stream, with the k-th update as changed."""
    verification = Verification(expected=5)
    for k, (group, result) in enumerate(zip(*stream, strict=True)):
        verification.update(group, result, change(k, recorded(result)))
    return verification


def account(stream, change=lambda k, node: node):
    """Account for the points of the stream; returns problems, and the number of good updates."""
    points = Account()
    good = 0
    for k, result in enumerate(stream[1]):
        node = change(k, recorded(result))
        good += points.update(result, node.labels, node.objects, node.message)
    return points.problems, good


def test_correct_node_passes(stream):
    verification = verify(stream)
    assert verification.passed and not verification.problems
    last = stream[1][-1]
    assert 0 < verification.expired == 1000 - len(last.labels)
    assert last.counts.rejected and last.counts.thinned and last.counts.segmented
    text = verification.summary()["points accounted for"]
    assert f"{len(last.labels):,} in the last window" in text
    assert account(stream) == ([], 5)


def test_padding_of_dds_is_no_difference(stream):
    padded = verify(
        stream, lambda k, node: replaced(node, SEGMENTED_POINTS, lambda data: data + bytes(k % 4))
    )
    assert padded.passed
    longer = verify(stream, lambda k, node: replaced(node, SEGMENTS, lambda data: data + bytes(4)))
    assert longer.identical == 0


def test_landmarks_that_were_not_published_are_a_difference(stream):
    def change(k, node):
        published = {topic: node.messages[topic] for topic in (SEGMENTED_POINTS, SEGMENTS)}
        return replace(node, messages=published) if k == 3 else node

    verification = verify(stream, change)
    assert verification.identical == 4
    assert verification.problems == ["update 4 differs from the offline result: landmarks"]


def test_missing_update_fails(stream):
    groups, results = stream
    assert not verify((groups[:4], results[:4])).passed


@pytest.mark.parametrize("count", ["segmented", "isolated", "rejected", "thinned"])
def test_lost_point_fails(stream, count):
    def change(k, node):
        if k != 3:
            return node
        wrong = {count: getattr(node.message, count) + 1}
        return replace(node, message=replace(node.message, **wrong))

    verification = verify(stream, change)
    assert not verification.passed and verification.complete == 4
    assert verification.problems[0].startswith("update 4: ")


def test_point_without_its_label_fails(stream):
    def change(k, node):
        labels = node.labels.copy()
        labels[np.flatnonzero(labels)[0]] = 0
        return replace(node, labels=labels)

    assert verify(stream, change).complete == 0


@pytest.mark.parametrize("topic", COMPARED)
def test_one_different_bit_fails(stream, topic):
    def flip(message):
        data = bytearray(message)
        data[len(data) // 2] ^= 1
        return bytes(data)

    verification = verify(stream, lambda k, node: replaced(node, topic, flip))
    assert verification.complete == 5 and verification.identical == 0 and not verification.passed


def test_restart_expires_all_points(stream):
    groups, _ = stream
    segmenter, verification = Segmenter(CONFIG), Verification(expected=2)
    for group in (groups[4], replace(groups[0], restart="jump")):
        result = segmenter.process(group)
        verification.update(group, result, recorded(result))
    assert verification.passed and verification.expired == 200


# --- accounting of points -----------------------------------------------------------------------


def in_fourth_update(level, **changes):
    """A change of the first updated segment, or object (`level`), of the fourth update."""

    def change(k, node):
        if k != 3:
            return node
        rows = list(getattr(node.message, level))
        first = next(k for k, row in enumerate(rows) if row.state == State.UPDATED)
        values = {name: new(getattr(rows[first], name)) for name, new in changes.items()}
        rows[first] = replace(rows[first], **values)
        return replace(node, message=replace(node.message, **{level: rows}))

    return change


@pytest.mark.parametrize(
    ("level", "changes", "problem"),
    [
        ("segments", {"parents": lambda ids: [*ids, 999_999]}, "segments: .* parents"),
        ("objects", {"parents": lambda ids: [*ids, 999_999]}, "objects: .* parents"),
        ("segments", {"state": lambda _: State.NEW}, "state 0, and existed before: True"),
        ("objects", {"state": lambda _: State.UNCHANGED}, "its points have changed"),
        ("objects", {"count": lambda count: count - 1}, "objects: the counts"),
        ("segments", {"object_id": lambda _: 999_999}, "object is not that of its segment"),
        ("objects", {"segments": lambda ids: ids[:-1]}, "lists segments"),
    ],
)
def test_contradiction_in_a_segment_or_object_is_reported(stream, level, changes, problem):
    problems, good = account(stream, in_fourth_update(level, **changes))
    assert good == 4
    assert re.search(problem, "\n".join(problems))


@pytest.mark.parametrize(("less", "problem"), [(1, "segments: the counts"), (0, "not follow")])
def test_wrong_counts_of_segments_are_reported(stream, less, problem):
    def change(k, node):
        first, second, *others = node.message.segments
        first = replace(first, count=first.count + 1)
        second = replace(second, count=second.count - less)
        wrong = replace(node.message, segments=[first, second, *others])
        return replace(node, message=wrong) if k == 3 else node

    problems, good = account(stream, change)
    assert good < 5
    assert re.search(problem, "\n".join(problems))


@pytest.mark.parametrize("name", ["removed", "removed_objects"])
def test_removed_ids_that_never_existed_are_reported(stream, name):
    def change(k, node):
        ids = getattr(node.message, name)
        ids = np.append(ids, 999_999) if k == 3 else ids
        return replace(node, message=replace(node.message, **{name: ids}))

    problems, good = account(stream, change)
    assert good == 4 and "removed ids" in problems[0]


def test_point_in_another_object_than_its_segment_is_reported(stream):
    def change(k, node):
        objects = node.objects.copy()
        objects[np.flatnonzero(objects)[0]] += 1
        return replace(node, objects=objects)

    assert account(stream, change)[1] == 0


def test_changes_without_a_full_message_before_are_reported(stream):
    problems, good = account(
        stream, lambda k, node: replace(node, message=replace(node.message, full=k != 0))
    )
    assert good == 3
    assert problems[0] == "an update does not follow the one before"
