"""Irregular stamps in a running node: updates equal those of the offline run, and are reported."""

import signal
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from node_kit import SECOND, parameters, peer, running
from sensor_msgs.msg import PointCloud2

from ellipseg_ros.cli.verification import equal
from ellipseg_ros.io.messages import write_segments
from ellipseg_ros.io.pointcloud2 import write_labelled
from ellipseg_ros.msg import SegmentArray
from ellipseg_ros.ros.replayer import Replayer, ReplayOptions
from ellipseg_ros.simulation.simulator import simulate
from studies.endurance import stamps
from studies.endurance.stamps import CONFIG, YEAR


def restamped(sweeps, first, every=0.1):
    """The same clouds with stamps from `first` on, in s."""
    return [
        replace(sweep, stamp_ns=round((first + k * every) * SECOND))
        for k, sweep in enumerate(sweeps)
    ]


@pytest.fixture(scope="module")
def drive():
    """A drive from 0 on, in which all happens that stamps do; it ends with ten clouds of 33 s."""
    sweeps = [sweep.keep(slice(None, None, 4)) for sweep in simulate("industrial", duration=1.5)]
    swapped = restamped(sweeps, 1.5)
    swapped[3::4], swapped[4::4] = swapped[4::4], swapped[3:-1:4]
    parts = [sweep.keep(rows) for sweep in restamped(sweeps, 3.0) for rows in thirds(len(sweep))]
    return [
        *restamped(sweeps, 0.0),
        *swapped,
        *parts,  # of equal stamps
        *restamped(sweeps, 14.5),  # a gap
        *restamped(sweeps, 0.0),  # a loop
        *restamped(sweeps[:3], 1.5),
        *restamped(sweeps[:1], YEAR),  # one is wrong
        *restamped(sweeps, 1.8),
        *(replace(sweep, frame_id="map") for sweep in restamped(sweeps, 3.3)),
        *restamped(sweeps[:10] * 11, 33.0, every=0.0),  # a clock that stands still
    ]


def thirds(count):
    return np.array_split(np.arange(count), 3)


@pytest.fixture(scope="module")
def offline(drive):
    """What it gives without ROS."""
    return stamps.offline(drive)


@pytest.fixture(scope="module", params=["false", "true"], ids=["wall time", "sim time"])
def live(request, drive, offline, session_ros_domain, tmp_path_factory):
    """What the node says of it; with use_sim_time, but nobody publishes /clock."""
    settings = {
        "max_backlog": 0,
        "update_period": CONFIG.update_period,
        "window_duration": CONFIG.window_duration,
        "use_sim_time": request.param,
    }
    log = tmp_path_factory.mktemp("time") / "log"
    with (
        running("segmenter_node", parameters(**settings), log) as node,
        peer(session_ros_domain) as me,
    ):
        segments = me.subscribe(SegmentArray, "/segments", raw=True)
        clouds = me.subscribe(PointCloud2, "/segmented_points", raw=True)
        diagnostics = me.subscribe(DiagnosticArray, "/diagnostics")
        me.wait_until_known()
        options = ReplayOptions(
            rate=0.0, ahead=1.0, update_period=0.5, clock=False, update_timeout=60.0
        )
        with Replayer(drive, options, domain=session_ros_domain) as replayer:
            replayer.run()
        for inbox in (segments, clouds):
            inbox.wait_for(len(offline))
        last = diagnostics.wait(lambda m: values(m)["clouds received"] == str(len(drive)))
        node.signal(signal.SIGINT)
        assert node.wait() == 0
        return SimpleNamespace(
            segments=segments.messages,
            clouds=clouds.messages,
            status=last.status[0],
            values=values(last),
            output=node.output,
        )


def values(message):
    return {pair.key: pair.value for pair in message.status[0].values}


def test_updates_equal_the_offline_ones_bit_for_bit(live, offline):
    assert len(live.segments) == len(live.clouds) == len(offline)
    for segments, cloud, found in zip(live.segments, live.clouds, offline, strict=True):
        assert equal(segments, write_segments(found))
        assert equal(cloud, write_labelled(found))


def test_restarts_are_logged_once_each_and_gaps_are_throttled(live):
    assert live.output.count("the window restarts") == int(live.values["restarts"]) == 3
    for reason in (
        "restarts: the stamps jumped back by 15.900 s",
        f"restarts: the stamps jumped back by {YEAR - 1.8:.3f} s",
        "restarts: the frame changed from 'odom' to 'map'",
        "the stamps jumped forward by 10.100 s",
    ):
        assert live.output.count(reason) == 1, reason
    assert live.values["stamp gaps"] == "3"


def test_diagnostics_warn_of_stalled_stamps(live):
    assert live.status.level == b"\x01"
    assert "stamps do not advance: 109 clouds are no newer" in live.status.message
    assert live.values["clouds with stalled stamps"] == "109"
