"""`ellipseg demo`: the whole way over DDS, with the node in a process of its own."""

import json
import os
import signal
import subprocess
import sys
from argparse import Namespace
from pathlib import Path

import numpy as np
import pytest
from visualization_msgs.msg import Marker

from ellipseg_ros.cli import check, node_process
from ellipseg_ros.cli.main import main
from ellipseg_ros.cli.report import show
from ellipseg_ros.io.bag import read_messages

LIMIT = 240.0  # s: the node may have to compile first


def start_demo(*words, **options):
    return subprocess.Popen(
        [sys.executable, "-m", "ellipseg_ros.cli.main", "demo", *map(str, words)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        **options,
    )


def processes_with(word):
    """Command lines of running processes that hold `word`."""
    found = []
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            line = path.read_bytes().replace(b"\0", b" ").decode()
        except OSError:  # it has just ended
            continue
        if word in line:
            found.append(line)
    return found


@pytest.fixture(scope="module")
def demo(tmp_path_factory):
    """The demo on 3.5 s of a simulated drive, thinned; its summary and its folder."""
    folder = tmp_path_factory.mktemp("demo") / "demo"
    settings = ["--set", "max_points_per_second=5000", "--set", "full_segments_period=2"]
    process = start_demo("--duration", 3.5, *settings, "-o", folder, "--json")
    out, err = process.communicate(timeout=LIMIT)
    assert not err
    assert process.returncode == 0
    return json.loads(out), folder


def test_every_update_is_that_of_the_offline_run(demo):
    summary, folder = demo
    assert summary["passed"] and not summary["problems"]
    assert summary["updates"] == 4  # the last one of the half second that is left
    assert summary["checks"]["equal to offline"] == "4 of 4 updates, bit for bit"
    assert json.loads((folder / "summary.json").read_text()) == summary


def test_the_summary_can_be_read_by_people(demo, capsys):
    summary, _ = demo
    show(summary, Namespace(json=False, quiet=False))
    shown = capsys.readouterr().out
    assert "equal to offline       4 of 4 updates" in shown and "latency" in shown


def test_the_bag_holds_changes_too(demo):
    _, folder = demo
    said = [msg.full for _, msg in read_messages(folder / "bag", "/segments")]
    assert set(said) == {True, False}


def test_every_point_is_accounted_for(demo):
    summary, folder = demo
    sent = sum(msg.width for _, msg in read_messages(folder / "bag", "/points"))
    assert summary["points"] == summary["window"]["points"] == sent
    (_, last) = list(read_messages(folder / "bag", "/segments"))[-1]
    assert last.segmented + last.isolated + last.rejected + last.thinned == sent
    assert last.thinned == summary["window"]["thinned"] > 0


def test_the_bag_holds_all_topics(demo):
    _, folder = demo
    assert len(list(read_messages(folder / "bag", "/segmented_points"))) == 4
    arrays = [msg.markers for _, msg in read_messages(folder / "bag", "/ellipsoids")]
    assert any(marker.action == Marker.ADD for marker in arrays[-1])  # not all taken away
    markers = [marker for array in arrays for marker in array]
    assert len(markers) > 10
    assert np.isfinite([m.pose.position.x for m in markers]).all()


def test_the_node_says_how_it_was(demo):
    summary, folder = demo
    assert summary["node"]["clouds lost by DDS"] == "0"
    assert summary["update_ms"]["median"] > 0.0
    assert summary["peak_memory_mb"] > 50.0
    assert "ready" in (folder / "node.log").read_text()


def test_the_results_are_there(demo):
    _, folder = demo
    names = {path.name for path in folder.iterdir()}
    assert names >= {"bag", "window.npz", "window.ply", "segments.png", "ellipsoids.png"}


@pytest.fixture
def words(tmp_path):
    """A command line: the demo on one small cloud."""
    points = np.random.default_rng(4).uniform(0.0, 5.0, (3000, 3))
    np.savez(tmp_path / "cloud.npz", xyz=points)
    cloud, folder = str(tmp_path / "cloud.npz"), str(tmp_path / "out")
    return ["demo", "--data", cloud, "-o", folder, "--no-pictures"]


def test_a_single_cloud_is_one_update(ros_domain, words, capsys):
    assert main([*words, "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert (summary["updates"], summary["points"], summary["times_real_time"]) == (1, 3000, None)
    assert summary["window"]["thinned"] == 0


def test_a_difference_is_code_1(ros_domain, words, monkeypatch, capsys):
    monkeypatch.setattr(check, "write_labelled", lambda found: b"something else")
    assert main([*words, "-q"]) == 1
    assert capsys.readouterr().err == (
        "ellipseg: the check failed\nupdate 1 differs from the offline result: segmented_points\n"
    )


def test_a_node_that_dies_is_one_line(ros_domain, monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(node_process, "START", "raise SystemExit(3)")
    folder = tmp_path / "out"
    assert main(["demo", "--duration", "1", "-o", str(folder), "-q"]) == 2
    assert capsys.readouterr().err == (
        f"ellipseg: the node ended too early, with 3; see {folder / 'node.log'}\n"
    )


def test_ctrl_c_leaves_no_node_behind(tmp_path):
    process = start_demo("-o", tmp_path / "out", env={**os.environ, "PYTHONUNBUFFERED": "1"})
    line = process.stderr.readline()
    assert line.startswith("starting the node")
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=LIMIT)
    assert process.returncode == 130
    assert err == "ellipseg: interrupted\n"
    assert not processes_with(f"demo_{process.pid}")
    assert not list(tmp_path.glob("out/.bag*"))
