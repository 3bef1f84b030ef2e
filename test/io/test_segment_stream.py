"""Messages of `segments`: changes, full messages, and the copies maintained from them."""

from collections import Counter
from dataclasses import fields, is_dataclass, replace

import numpy as np
import pytest
from point_accounting import NO_GROUPS, Groups, contradictions

from ellipseg_ros.config import Config, NodeConfig
from ellipseg_ros.io import topics
from ellipseg_ros.io.bag import BagSink, node_types, read_messages
from ellipseg_ros.io.messages import write_segments
from ellipseg_ros.io.segment_mirror import SegmentMirror
from ellipseg_ros.io.segment_stream import SegmentStream
from ellipseg_ros.records import SECOND, State, Sweep
from ellipseg_ros.segmenter import Segmenter


def decoded(data):
    return node_types().deserialize_cdr(data, topics.SEGMENTS.type)


def same(one, other):
    """Whether two decoded messages are equal, arrays in them too."""
    if is_dataclass(one):
        return all(same(getattr(one, f.name), getattr(other, f.name)) for f in fields(one))
    return np.array_equal(one, other)


def copied(mirror, found):
    """Whether the mirror holds just what a full message of the update lists."""
    full = decoded(write_segments(found))
    return all(
        copy.keys() == {one.id for one in listed}
        and all(same(copy[one.id], one) for one in listed)
        for copy, listed in ((mirror.segments, full.segments), (mirror.objects, full.objects))
    )


def stream(seed, count=30):
    """Updates of a window that moves over clumps, while thresholds change and resets come."""
    rng = np.random.default_rng(seed)
    segmenter = Segmenter(Config(window_duration=4.0))
    for second in range(count):
        clumps = rng.uniform(0.0, 1.5, (rng.integers(1, 5), 3)) + [0.4 * second, 0.0, 0.0]
        size = rng.choice([0.02, 0.3], (len(clumps), 1, 3))
        shape = size * rng.normal(size=(len(clumps), 40, 3))
        points = (clumps[:, None] + shape).reshape(-1, 3)
        if rng.random() < 0.3:
            threshold = rng.choice([1.0, 4.0, 30.0])
            objects = replace(segmenter.config.objects, enabled=bool(rng.random() < 0.8))
            segmenter.configure(replace(segmenter.config, threshold=threshold, objects=objects))
        if rng.random() < 0.1:
            segmenter.reset()
        if rng.random() < 0.2:
            points = points[:0]  # nothing new
        offsets = -rng.integers(0, SECOND, len(points))
        yield segmenter.process(Sweep((100 + second) * SECOND, points, offsets, frame_id="odom"))


def groups_of(found):
    """Of segments and of objects, from an offline result."""
    full = decoded(write_segments(found))
    return (
        Groups(found.arrival, found.point_ids, {s.id: s for s in full.segments}, full.removed),
        Groups(
            found.arrival,
            found.point_object_ids,
            {o.id: o for o in full.objects},
            full.removed_objects,
        ),
    )


@pytest.mark.parametrize("seed", range(6))
def test_points_come_only_from_parents_the_predecessor_or_new_data(seed):
    happened = [Counter(), Counter()]
    before = NO_GROUPS, NO_GROUPS
    for found in stream(seed):
        if found.restart:
            before = tuple(groups.without_points() for groups in before)
        now = groups_of(found)
        for old, new, count in zip(before, now, happened, strict=True):
            assert list(contradictions(old, new)) == []
            heirs = {parent for one in new.reported.values() for parent in one.parents}
            count["births"] += sum(
                one.state == State.NEW and not len(one.parents) for one in new.reported.values()
            )
            count["splits"] += sum(
                one.state == State.NEW and len(one.parents) > 0 for one in new.reported.values()
            )
            count["merges"] += len(heirs.intersection(new.removed.tolist()))
            count["expiries"] += len(set(new.removed.tolist()) - heirs)
        before = now
    for count in happened:
        assert min(count[kind] for kind in ("births", "splits", "merges", "expiries")) > 0


@pytest.mark.parametrize("period", [0.0, 3.0, 1000.0])
@pytest.mark.parametrize("seed", range(4))
def test_mirror_is_exact_while_in_step(seed, period):
    rng = np.random.default_rng(seed)
    sender = SegmentStream(NodeConfig(full_segments_period=period))
    mirror = SegmentMirror()
    knows = False  # the last update
    equal = changes = 0
    for found in stream(seed):
        message = decoded(sender.update(found))
        changes += not message.full
        if rng.random() < 0.15:  # lost on the way
            knows = False
        else:
            knows = message.full or knows
            assert mirror.update(message) == mirror.in_step == knows
        if rng.random() < 0.1:  # again, for a subscriber who came late, and both out of order
            knows = mirror.update(decoded(write_segments(found)))
            assert knows and mirror.update(message)
        if knows:
            equal += 1
            assert copied(mirror, found)
    assert equal > 3
    assert (changes > 5) == (period > 0.0)


def test_change_message_lists_only_changes():
    sender = SegmentStream(NodeConfig(full_segments_period=1000.0))
    before, listed, there = {}, 0, 0
    for found in stream(1):
        message, full = (decoded(data) for data in (sender.update(found), write_segments(found)))
        owners = {one.id: one.object_id for one in full.segments}
        if not message.full:
            expected = [
                one.id
                for one in full.segments
                if one.state != State.UNCHANGED or before.get(one.id) != one.object_id
            ]
            assert [one.id for one in message.segments] == expected
            listed, there = listed + len(expected), there + len(full.segments)
        before = owners
    assert 0 < listed < 0.9 * there


def test_offline_bag_has_the_same_messages(tmp_path):
    config = NodeConfig(full_segments_period=3.0)
    sender, found = SegmentStream(config), list(stream(4, 12))
    with BagSink(tmp_path / "bag", config) as bag:
        for one in found:
            bag.write_update(one)
    written = [data for data, _ in read_messages(tmp_path / "bag", "/segments")]
    assert written == [sender.update(one) for one in found]


def test_full_messages_depend_on_stamps_only():
    found = list(stream(3))
    everybody, latecomer = (SegmentStream(NodeConfig(full_segments_period=5.0)) for _ in "12")
    first = [decoded(everybody.update(one)).full for one in found]
    second = [decoded(latecomer.update(one)).full for one in found[7:]]
    assert second[0] and second[1:] == first[8:]
    told = found[0].end_ns
    for full, one in zip(first, found, strict=True):
        told = one.end_ns if full else told
        assert one.end_ns - told < 5 * SECOND
    assert 5 < sum(first) < 15
    assert all(full for full, one in zip(first, found, strict=True) if one.restart)


def test_first_message_is_full():
    segmenter, points = Segmenter(Config()), np.random.default_rng(0).normal(size=(50, 3))
    found = [segmenter.process(Sweep(k * SECOND, points + k)) for k in range(4)]
    sender = SegmentStream(NodeConfig(full_segments_period=10.0))
    assert [decoded(sender.update(one)).full for one in found] == [True, False, False, False]


def test_new_period_starts_with_a_full_message():
    segmenter, points = Segmenter(Config()), np.random.default_rng(0).normal(size=(50, 3))
    found = [segmenter.process(Sweep((100 + k) * SECOND, points + k)) for k in range(6)]
    sender, told = SegmentStream(NodeConfig()), []
    for one, period in zip(found, (0.0, 10.0, 10.0, 0.0, 20.0, 20.0), strict=True):
        sender.configure(NodeConfig(full_segments_period=period))
        told.append(decoded(sender.update(one)).full)
    assert told == [True, True, False, True, True, False]


def test_changes_of_another_run_are_not_applied():
    ours, others = list(stream(1)), list(stream(2))
    mirror = SegmentMirror()
    mirror.update(decoded(write_segments(ours[4])))
    sender = SegmentStream(NodeConfig(full_segments_period=1000.0))
    later = [decoded(sender.update(found)) for found in others[:6]][-1]
    assert not later.full and later.sequence == ours[4].sequence + 1
    assert not mirror.update(later)


def test_unchanged_items_have_no_parents():
    mirror = SegmentMirror()
    sender = SegmentStream(NodeConfig(full_segments_period=1000.0))
    for found in stream(5):
        mirror.update(decoded(sender.update(found)))
        for one in (*mirror.segments.values(), *mirror.objects.values()):
            assert one.state != State.UNCHANGED or not len(one.parents)
