"""Subscribers of `segments` over DDS have exact copies: late ones, after a loss, after a reset."""

from dataclasses import replace
from types import SimpleNamespace

import pytest
from node_kit import LIMIT, parameters, peer, running
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import Trigger

from ellipseg_ros.config import Config, NodeConfig
from ellipseg_ros.io.bag import BagSink, read_messages
from ellipseg_ros.io.messages import write_segments
from ellipseg_ros.io.segment_mirror import SegmentMirror
from ellipseg_ros.io.segment_stream import SegmentStream
from ellipseg_ros.msg import SegmentArray
from ellipseg_ros.node.grouping import updates
from ellipseg_ros.ros.recorder import Recorder
from ellipseg_ros.ros.subscriptions import sequence_number
from ellipseg_ros.segmenter import Segmenter
from ellipseg_ros.simulation.simulator import simulate

CONFIG = Config(update_period=0.5, window_duration=2.0)
SHOWN = NodeConfig(full_segments_period=1.5)
JOINED = 4  # updates made before the second subscriber comes; the last of them went as changes
SWEEPS = 5  # in an update


def decoded(data):
    return deserialize_message(data, SegmentArray)


@pytest.fixture(scope="module")
def offline():
    """A drive, and after a reset again; the last update of it isn't closed by a stamp."""
    drive = list(simulate("industrial", duration=4.0))
    segmenter = Segmenter(CONFIG)
    found = [segmenter.process(group) for group in updates(drive, CONFIG)]
    segmenter.reset()
    found += [segmenter.process(group) for group in updates(drive, CONFIG)][:-1]
    stream = SegmentStream(SHOWN)
    return SimpleNamespace(drive=drive, found=found, sent=[stream.update(one) for one in found])


@pytest.fixture(scope="module")
def heard(offline, session_ros_domain, tmp_path_factory):
    """What two subscribers hear, one from the beginning and one who comes late."""
    settings = {
        "max_backlog": 0,
        "input_reliability": "reliable",
        "input_depth": 1000,
        "update_period": CONFIG.update_period,
        "window_duration": CONFIG.window_duration,
        "full_segments_period": SHOWN.full_segments_period,
    }
    folder = tmp_path_factory.mktemp("mirror")
    domain, drive = session_ros_domain, offline.drive
    with (
        running("segmenter_node", parameters(**settings), folder / "log"),
        peer(domain) as me,
        peer(domain) as other,
        BagSink(folder / "bag") as bag,
        Recorder(bag) as recorder,
    ):
        recorder.wait_for_topics(LIMIT)
        faithful = me.subscribe(SegmentArray, "/segments", raw=True)
        points = me.publish(PointCloud2, "/points")
        for sweep in drive[: JOINED * SWEEPS + 1]:
            points.send(sweep)
        everybody_has(JOINED, faithful, recorder)
        late = other.subscribe(SegmentArray, "/segments", raw=True)
        late.wait_for(1)
        for sweep in drive[JOINED * SWEEPS + 1 :]:
            points.send(sweep)
        # All clouds have come when all is told but the update that the reset will close.
        late.wait(lambda data: decoded(data).sequence == restart(offline) - 2)
        everybody_has(restart(offline) - 1, faithful, recorder)
        assert me.call(Trigger, "/ellipseg_segmenter/reset").success
        for sweep in drive:
            points.send(sweep)
        late.wait(lambda data: decoded(data).sequence == len(offline.found) - 1)
        everybody_has(len(offline.found), faithful, recorder)
    recorded = [data for data, _ in read_messages(folder / "bag", "/segments")]
    return SimpleNamespace(faithful=faithful.messages, late=late.messages, recorded=recorded)


def everybody_has(count, faithful, recorder):
    """Wait for so many updates: the node keeps only a few for whoever is slow to read."""
    faithful.wait(lambda data: decoded(data).sequence == count - 1)
    recorder.wait_for_updates(count, LIMIT)


def restart(offline):
    """The number of the first update after the reset."""
    (number,) = [one.sequence for one in offline.found if one.restart]
    return number


def copied(mirror, found):
    """Whether the mirror holds just what a full message of the update lists."""
    full = decoded(write_segments(found))
    return mirror.segments == {one.id: one for one in full.segments} and mirror.objects == {
        one.id: one for one in full.objects
    }


def follow(messages, found):
    """Feed a mirror; yields (message, in step) and checks the copy whenever it is."""
    mirror = SegmentMirror()
    for data in messages:
        message = decoded(data)
        in_step = mirror.update(message)
        assert not in_step or copied(mirror, found[message.sequence])
        yield message, in_step


def test_messages_equal_the_offline_ones_plus_one_for_the_late_subscriber(heard, offline):
    again = write_segments(offline.found[JOINED - 1])
    expected = [*offline.sent[:JOINED], again, *offline.sent[JOINED:]]
    assert heard.faithful == expected
    assert heard.late == expected[JOINED:]
    assert {decoded(data).full for data in offline.sent} == {True, False}


def test_resent_message_is_not_recorded(heard, offline):
    assert sorted(heard.recorded) == sorted(offline.sent)  # a bag is read in order of time


@pytest.mark.parametrize("frame_id", ["", "map", "odom", "a/frame"])
def test_sequence_number_is_read_from_the_bytes(offline, frame_id):
    found = replace(offline.found[3], frame_id=frame_id)
    assert sequence_number(write_segments(found)) == 3


def test_early_subscriber_stays_in_step(heard, offline):
    assert all(in_step for _, in_step in follow(heard.faithful, offline.found))


def test_late_subscriber_syncs_immediately_and_stays_in_step(heard, offline):
    steps = list(follow(heard.late, offline.found))
    assert all(in_step for _, in_step in steps)
    assert steps[0][0].full and not decoded(offline.sent[JOINED - 1]).full


@pytest.mark.parametrize("lost", range(1, 9))
def test_full_message_resynchronizes_after_a_loss(heard, offline, lost):
    missing = decoded(heard.late[lost]).sequence
    waiting = False
    for message, in_step in follow(heard.late[:lost] + heard.late[lost + 1 :], offline.found):
        waiting = not message.full and (waiting or message.sequence == missing + 1)
        assert in_step != waiting
    assert in_step


def test_a_reset_replaces_the_copy(heard, offline):
    messages = [message for message, _ in follow(heard.faithful, offline.found)]
    k = restart(offline)
    before, after = (next(m for m in messages if m.sequence == number) for number in (k - 1, k))
    assert after.full and not before.full
    assert min(one.id for one in after.segments) > max(one.id for one in before.segments)
