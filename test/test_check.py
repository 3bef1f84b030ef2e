"""The demo's check lets nothing wrong pass."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from ellipseg_ros.cli.check import Check, Received
from ellipseg_ros.config import Config
from ellipseg_ros.data import SECOND, Sweep
from ellipseg_ros.io.messages import write_segments
from ellipseg_ros.io.pointcloud2 import write_labelled
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
    counts = vars(found.counts)
    return Received(
        write_labelled(found), found.point_ids, write_segments(found), SimpleNamespace(**counts)
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
        numbers = vars(node.counts)
        return replace(node, counts=SimpleNamespace(**numbers | {count: numbers[count] + 1}))

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
