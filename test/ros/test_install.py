"""Installation by colcon and by pip, from a source distribution."""

import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]
SCRIPTS = {"associator", "ellipseg", "replayer", "segmenter"}
READY_WITHIN = 180.0  # s, with an empty cache of kernels
ANSWER_WITHIN = 60.0  # s
STOP_WITHIN = 20.0  # s

# Imports every module of the package and prints its path; plots need an extra to be imported.
IMPORT_ALL = """
import importlib.util, pkgutil, ellipseg_ros
has_extra = importlib.util.find_spec("matplotlib") is not None
for module in pkgutil.walk_packages(ellipseg_ros.__path__, "ellipseg_ros."):
    if module.name.startswith("ellipseg_ros.plots.") and not has_extra:
        print(importlib.util.find_spec(module.name).origin)
    elif not module.name.startswith("ellipseg_ros.ellipseg_ros_s__"):  # loaded by the messages
        print(importlib.import_module(module.name).__file__)
from ellipseg_ros.msg import Segment, SegmentArray
from rclpy.serialization import deserialize_message, serialize_message
array = SegmentArray(segments=[Segment(id=7, parents=[3])])
assert deserialize_message(serialize_message(array), SegmentArray) == array
"""


def run(*command, **options):
    """Run a command and return its output; show the output on failure."""
    done = subprocess.run(
        [str(word) for word in command],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
        **options,
    )
    assert done.returncode == 0, f"{command}:\n{done.stdout}"
    return done.stdout


def environment(prefix):
    """An environment in which the virtual environment `prefix` is activated and no ROS sourced."""
    sourced = ("AMENT_", "CMAKE_", "COLCON_", "LD_LIBRARY_PATH", "PYTHON", "VIRTUAL_ENV")
    own = ("_ROS_WHEELS_BOOTSTRAP_COMPLETE",)  # else the child keeps our LD_LIBRARY_PATH
    env = {key: value for key, value in os.environ.items() if not key.startswith(sourced + own)}
    return env | {"VIRTUAL_ENV": str(prefix), "PATH": f"{prefix}/bin:{env['PATH']}"}


def check_modules(python, prefix, env, cwd):
    """Every module of the package can be imported, and none comes from elsewhere."""
    paths = run(python, "-c", IMPORT_ALL, cwd=cwd, env=env).split()
    assert len(paths) > len(list((ROOT / "ellipseg_ros").rglob("*.py"))) - 5
    assert [path for path in paths if not Path(path).is_relative_to(prefix)] == []


def check_files(prefix):
    """Files are where `ros2 launch` and users search them."""
    share = prefix / "share" / "ellipseg_ros"
    for folder in ("config", "launch", "msg"):
        wanted = {path.name for path in (ROOT / folder).iterdir() if path.is_file()}
        assert wanted <= {path.name for path in (share / folder).iterdir()}
    index = prefix / "share" / "ament_index" / "resource_index"
    assert (index / "packages" / "ellipseg_ros").is_file()
    messages = (index / "rosidl_interfaces" / "ellipseg_ros").read_text().split()
    assert {"msg/Segment.msg", "msg/SegmentArray.msg"} <= set(messages)


def executables(folder):
    return {path.name for path in folder.iterdir() if os.access(path, os.X_OK)}


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    """The source distribution, unpacked; it lacks files that MANIFEST.in does not name."""
    folder = tmp_path_factory.mktemp("source")
    sdist = ("egg_info", "--egg-base", folder, "sdist", "--dist-dir", folder)
    run(sys.executable, "setup.py", "-q", *sdist, cwd=ROOT)
    (archive,) = folder.glob("*.tar.gz")
    shutil.unpack_archive(archive, folder)
    return folder / archive.name.removesuffix(".tar.gz")


@pytest.fixture(scope="module")
def workspace(source, tmp_path_factory):
    """A workspace that colcon has built."""
    folder = tmp_path_factory.mktemp("workspace")
    shutil.copytree(source, folder / "src" / "ellipseg_ros")
    run("colcon", "build", cwd=folder, env=environment(sys.prefix))
    return folder


@pytest.fixture(scope="module")
def sourced(workspace):
    """The environment after sourcing the workspace."""
    command = ("bash", "-c", ". install/local_setup.bash && env -0")
    lines = run(*command, cwd=workspace, env=environment(sys.prefix)).split("\0")
    return dict(line.split("=", 1) for line in lines if line)


def test_colcon_installs_everything(workspace, sourced, tmp_path):
    prefix = workspace / "install" / "ellipseg_ros"
    check_modules(sys.executable, prefix, sourced, tmp_path)
    check_files(prefix)
    assert executables(prefix / "lib" / "ellipseg_ros") == SCRIPTS


def test_a_shell_that_sourced_the_workspace_finds_the_command(workspace, sourced, tmp_path):
    command = shutil.which("ellipseg", path=sourced["PATH"])
    assert Path(command).is_relative_to(workspace)
    assert "segment" in run(command, "--help", cwd=tmp_path, env=sourced)


def test_the_installed_node_segments(workspace, sourced, tmp_path, ros_domain):
    command = workspace / "install" / "ellipseg_ros" / "lib" / "ellipseg_ros" / "segmenter"
    env = sourced | {
        "ROS_DOMAIN_ID": str(ros_domain),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "ROS_LOG_DIR": str(tmp_path),
    }
    said = tmp_path / "said"
    with (
        said.open("w") as file,
        subprocess.Popen([command], cwd=tmp_path, env=env, stdout=file, stderr=file) as process,
    ):
        try:
            answer = segments_of_a_wall(process)
            process.send_signal(signal.SIGINT)
            process.wait(STOP_WITHIN)
        finally:
            process.kill()
            print(said.read_text())
    assert process.returncode == 0
    assert "Traceback" not in said.read_text()
    assert answer.full
    assert sum(segment.count for segment in answer.segments) == answer.segmented
    assert (answer.segmented + answer.isolated) % len(wall()) == 0
    assert answer.segmented > 0


def wall():
    """(1600, 3) float32, m: a wall of 8 x 4 m, a little rough."""
    across, up = np.meshgrid(np.linspace(0.0, 8.0, 40), np.linspace(0.0, 4.0, 40))
    depth = np.random.default_rng(1).normal(10.0, 0.02, across.size)
    return np.column_stack([depth, across.ravel(), up.ravel()]).astype(np.float32)


def segments_of_a_wall(process):
    """Send the wall to the node of `process` twice a second of sensor time until it answers."""
    import rclpy
    from rclpy.executors import SingleThreadedExecutor
    from sensor_msgs.msg import PointCloud2, PointField

    from ellipseg_ros.msg import SegmentArray

    def wait(seconds, done, what):
        end = time.monotonic() + seconds
        while not done():
            assert process.poll() is None, f"the node has ended while we waited for {what}"
            assert time.monotonic() < end, f"{seconds:g} s without {what}"
            executor.spin_once(timeout_sec=0.2)

    answers = []
    context = rclpy.Context()
    rclpy.init(context=context)
    executor = SingleThreadedExecutor(context=context)
    try:
        node = rclpy.create_node("tester", context=context)
        executor.add_node(node)
        publisher = node.create_publisher(PointCloud2, "points", 10)
        node.create_subscription(SegmentArray, "segments", answers.append, 10)
        wait(READY_WITHIN, publisher.get_subscription_count, "a subscription to points")

        points = wall()
        cloud = PointCloud2(height=1, width=len(points), point_step=12, row_step=12 * len(points))
        cloud.header.frame_id = "odom"
        cloud.fields = [
            PointField(name=name, offset=4 * i, datatype=PointField.FLOAT32, count=1)
            for i, name in enumerate("xyz")
        ]
        cloud.data = points.tobytes()

        def answered():
            cloud.header.stamp.nanosec = (cloud.header.stamp.nanosec + 500_000_000) % 10**9
            cloud.header.stamp.sec += cloud.header.stamp.nanosec == 0
            publisher.publish(cloud)
            return answers

        wait(ANSWER_WITHIN, answered, "segments")
    finally:
        executor.shutdown()
        context.try_shutdown()
    return answers[0]


def test_colcon_installs_links_that_follow_the_source(workspace, tmp_path):
    bases = ("--build-base", tmp_path / "build", "--install-base", tmp_path / "install")
    env = environment(sys.prefix)
    run("colcon", "build", "--symlink-install", *bases, cwd=workspace, env=env)
    source = workspace / "src" / "ellipseg_ros"
    linked = tmp_path / "install" / "ellipseg_ros" / "share" / "ellipseg_ros" / "package.xml"
    assert linked.resolve() == source / "package.xml"
    code = "import ellipseg_ros.config as config, ellipseg_ros.msg; print(config.__file__)"
    command = f". {tmp_path}/install/local_setup.bash && python -c '{code}'"
    path = run("bash", "-c", command, cwd=tmp_path, env=env).strip()
    assert Path(path).resolve() == source / "ellipseg_ros" / "config.py"


def test_pip_installs_everything_that_is_needed(source, tmp_path):
    prefix, elsewhere = tmp_path / "venv", tmp_path / "elsewhere"
    elsewhere.mkdir()
    env = environment(prefix)
    python = prefix / "bin" / "python"
    if uv := shutil.which("uv", path=environment(sys.prefix)["PATH"]):
        run(uv, "venv", "--python", sys.executable, prefix)
        run(uv, "pip", "install", "--python", python, source, env=env)
    else:
        run(sys.executable, "-m", "venv", prefix)
        run(python, "-m", "pip", "install", source, env=env)

    check_modules(python, prefix, env, elsewhere)
    check_files(prefix)
    assert executables(prefix / "lib" / "ellipseg_ros") == SCRIPTS - {"ellipseg"}
    assert executables(prefix / "bin") >= SCRIPTS
    assert "segment" in run(prefix / "bin" / "ellipseg", "--help", cwd=elsewhere, env=env)
    (marker,) = prefix.glob("lib/python*/site-packages/ellipseg_ros/py.typed")
    assert marker.is_file()
