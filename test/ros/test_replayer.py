"""The replayer as a process, over DDS."""

import signal

import numpy as np
import pytest
from node_kit import nanoseconds, parameters, peer, running, wall
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import SetBool

from ellipseg_ros.io.pointcloud2 import read_sweep, write_sweep
from ellipseg_ros.simulation.simulator import simulate

STOP_WITHIN = 10.0  # s


@pytest.fixture(scope="module")
def domain(session_ros_domain):
    return session_ros_domain


def test_replayer_plays_pauses_and_ends(domain, tmp_path):
    arguments = parameters(source="sim:industrial", start_paused="true", rate=0)
    names = ["-r", "points:=lidar/points", "-r", "__ns:=/rig"]
    with (
        running("replayer", [*arguments, *names], tmp_path / "log") as process,
        peer(domain) as me,
    ):
        clouds = me.subscribe(PointCloud2, "/rig/lidar/points")
        clock = me.subscribe(Clock, "/clock")
        answer = me.call(SetBool, "/rig/ellipseg_replayer/pause", SetBool.Request(data=False))
        assert answer.success and answer.message == "playing"
        assert process.wait() == 0
        sweeps = list(simulate("industrial"))
        clouds.wait_for(len(sweeps))
        clock.wait_for(len(sweeps))
        assert f"sent {len(sweeps)} clouds" in process.output
        assert "Traceback" not in process.output
    for message, time, sweep in zip(clouds.messages, clock.messages, sweeps, strict=True):
        came = read_sweep(message)
        assert nanoseconds(time.clock) == came.stamp_ns == sweep.stamp_ns
        assert came.frame_id == sweep.frame_id
        assert came.fields.dtype == sweep.fields.dtype
        assert np.array_equal(came.fields, sweep.fields)
        assert np.array_equal(came.times_ns, sweep.times_ns)


def test_sigint_ends_the_replayer_cleanly(domain, tmp_path):
    arguments = parameters(source="sim:industrial", rate=0.001, loop="true")
    with running("replayer", arguments, tmp_path / "log") as process, peer(domain) as me:
        me.subscribe(PointCloud2, "/points").wait_for(1)
        process.signal(signal.SIGINT)
        assert process.wait(STOP_WITHIN) == 0
        assert "Traceback" not in process.output


@pytest.mark.parametrize(
    ("values", "complaint"),
    [
        ({}, "the parameter source is empty; give one"),
        ({"source": "no/such.mcap"}, "there is no no/such.mcap; it must be a bag"),
        ({"source": "sim:industrial", "rate": -1}, "rate is -1; it must be from 0"),
    ],
)
def test_unplayable_source_is_one_line_and_exit_code_2(domain, tmp_path, values, complaint):
    with running("replayer", parameters(**values), tmp_path / "log") as process:
        assert process.wait() == 2
        (line,) = process.output.splitlines()
    assert complaint in line


def test_bag_damaged_at_the_end_is_one_line_and_exit_code_2(domain, tmp_path):
    bag = tmp_path / "damaged"
    store = get_typestore(Stores.ROS2_JAZZY)
    with Writer(bag, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        points = writer.add_connection("/points", "sensor_msgs/msg/PointCloud2", typestore=store)
        good = bytes(write_sweep(wall(1.0)))
        for stamp, data in enumerate((good, good, good[:100])):
            writer.write(points, stamp, data)
    arguments = parameters(source=bag, wait_for_subscriber="false", rate=0)
    with running("replayer", arguments, tmp_path / "log") as process:
        assert process.wait() == 2
        assert "Traceback" not in process.output
        (line,) = [line for line in process.output.splitlines() if "[FATAL]" in line]
    assert str(bag) in line


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["--params-file", "no/such.yaml"], "Couldn't parse params file: '--params-file no/such"),
        (["-r", "__ns:=my-car"], "Couldn't parse remap rule: '-r __ns:=my-car'"),
        (["--speed"], "ROS knows no arguments ['--speed']"),
    ],
)
def test_invalid_ros_arguments_are_one_line_and_exit_code_2(
    domain, tmp_path, arguments, complaint
):
    with running("replayer", arguments, tmp_path / "log") as process:
        assert process.wait() == 2
        assert "Traceback" not in process.output
        (line,) = [line for line in process.output.splitlines() if "[FATAL]" in line]
    assert complaint in line and "/project/src" not in line
