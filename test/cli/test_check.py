"""The demo's check lets nothing wrong pass."""

import re
from dataclasses import replace

import numpy as np
import pytest

from ellipseg_ros.cli.check import Check, Received
from ellipseg_ros.config import Config
from ellipseg_ros.io.bag import TYPES, node_types
from ellipseg_ros.io.messages import write_landmarks, write_segments
from ellipseg_ros.io.pointcloud2 import write_labelled
from ellipseg_ros.records import SECOND, State, Sweep
from ellipseg_ros.segmenter import Segmenter

CONFIG = Config(window_duration=2.5, max_points_per_second=150)


@pytest.fixture(scope="module")
def stream():
    """Five updates of 200 points, some NaN, some far off; the window holds about half."""
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


def said(found):
    """What a faultless node publishes."""
    segments = write_segments(found)
    return Received(
        write_labelled(found),
        found.point_ids,
        found.point_object_ids,
        segments,
        write_landmarks(found, found.landmarks),
        node_types().deserialize_cdr(segments, TYPES["/segments"]),
    )


def checked(stream, spoil=lambda k, node: node):
    check = Check(expected=5)
    for k, (group, found) in enumerate(zip(*stream, strict=True)):
        check.update(group, found, spoil(k, said(found)))
    return check


def test_a_faultless_node_passes(stream):
    check = checked(stream)
    assert check.passed and not check.problems
    last = stream[1][-1]
    assert 0 < check.expired == 1000 - len(last.labels)
    assert last.counts.rejected and last.counts.thinned and last.counts.segmented
    assert f"{len(last.labels):,} in the last window" in check.summary()["points accounted for"]


def test_the_padding_of_dds_is_no_difference(stream):
    check = checked(stream, lambda k, node: replace(node, cloud=node.cloud + bytes(k % 4)))
    assert check.passed
    check = checked(stream, lambda k, node: replace(node, segments=node.segments + bytes(4)))
    assert check.identical == 0


def test_a_missing_update_fails(stream):
    groups, results = stream
    assert not checked((groups[:4], results[:4])).passed


@pytest.mark.parametrize("count", ["segmented", "isolated", "rejected", "thinned"])
def test_a_lost_point_fails(stream, count):
    def spoil(k, node):
        if k != 3:
            return node
        return replace(node, said=replace(node.said, **{count: getattr(node.said, count) + 1}))

    check = checked(stream, spoil)
    assert not check.passed and check.accounted == 4
    assert check.problems[0].startswith("update 4: ")


def test_a_point_without_its_label_fails(stream):
    def spoil(k, node):
        labels = node.labels.copy()
        labels[np.flatnonzero(labels)[0]] = 0
        return replace(node, labels=labels)

    assert checked(stream, spoil).accounted == 0


@pytest.mark.parametrize("part", ["cloud", "segments"])
def test_one_other_bit_fails(stream, part):
    def spoil(k, node):
        data = bytearray(getattr(node, part))
        data[len(data) // 2] ^= 1
        return replace(node, **{part: bytes(data)})

    check = checked(stream, spoil)
    assert check.accounted == 5 and check.identical == 0 and not check.passed


def test_a_restart_expires_everything(stream):
    groups, _ = stream
    segmenter, check = Segmenter(CONFIG), Check(expected=2)
    for group in (groups[4], replace(groups[0], restart="jump")):
        found = segmenter.process(group)
        check.update(group, found, said(found))
    assert check.passed and check.expired == 200


def spoilt(level, **changes):
    """The fourth update with another first updated segment, or object (`level`) of many points."""

    def spoil(k, node):
        if k != 3:
            return node
        things = list(getattr(node.said, level))
        k = next(k for k, one in enumerate(things) if one.state == State.UPDATED)
        things[k] = replace(
            things[k],
            **{name: change(getattr(things[k], name)) for name, change in changes.items()},
        )
        return replace(node, said=replace(node.said, **{level: things}))

    return spoil


@pytest.mark.parametrize(
    ("level", "changes", "problem"),
    [
        ("segments", {"parents": lambda ids: [*ids, 999_999]}, "segments: .* parents"),
        ("objects", {"parents": lambda ids: [*ids, 999_999]}, "objects: .* parents"),
        ("segments", {"state": lambda _: State.NEW}, "state 0, and was there before"),
        ("objects", {"state": lambda _: State.UNCHANGED}, "its points are others"),
        ("objects", {"count": lambda count: count - 1}, "objects: the counts"),
        ("segments", {"object_id": lambda _: 999_999}, "object is not that of its segment"),
        ("objects", {"segments": lambda ids: ids[:-1]}, "lists other segments"),
    ],
)
def test_what_cannot_be_of_a_segment_or_an_object_fails(stream, level, changes, problem):
    check = checked(stream, spoilt(level, **changes))
    assert check.accounted == check.identical == 5 and check.conserved == 4 and not check.passed
    assert re.search(problem, "\n".join(check.problems))


@pytest.mark.parametrize(("less", "problem"), [(1, "segments: the counts"), (0, "not follow")])
def test_counts_of_segments_that_are_others_fail(stream, less, problem):
    def spoil(k, node):
        first, second, *rest = node.said.segments
        first = replace(first, count=first.count + 1)
        second = replace(second, count=second.count - less)
        wrong = replace(node.said, segments=[first, second, *rest])
        return replace(node, said=wrong) if k == 3 else node

    check = checked(stream, spoil)
    assert check.conserved < 5 and not check.passed
    assert re.search(problem, "\n".join(check.problems))


@pytest.mark.parametrize("name", ["removed", "removed_objects"])
def test_other_removed_ids_than_there_are_fail(stream, name):
    def spoil(k, node):
        ids = np.append(getattr(node.said, name), 999_999) if k == 3 else getattr(node.said, name)
        return replace(node, said=replace(node.said, **{name: ids}))

    check = checked(stream, spoil)
    assert check.conserved == 4 and "removed ids" in check.problems[0]


def test_a_point_in_another_object_than_its_segment_fails(stream):
    def spoil(k, node):
        objects = node.objects.copy()
        objects[np.flatnonzero(objects)[0]] += 1
        return replace(node, objects=objects)

    assert checked(stream, spoil).conserved == 0


def test_changes_that_do_not_follow_fail(stream):
    check = checked(stream, lambda k, node: replace(node, said=replace(node.said, full=k != 0)))
    assert check.conserved == 3 and not check.passed
    assert check.problems[0] == "update 1 does not follow the one before"
