"""`ellipseg demo`: from a source over DDS to the node and back, and the verification."""

import json
import os
import signal
import subprocess
import sys
from argparse import Namespace
from pathlib import Path

import numpy as np
import pytest
from point_accounting import Account
from visualization_msgs.msg import Marker

from ellipseg_ros.cli import node_process
from ellipseg_ros.cli.main import main
from ellipseg_ros.cli.report import print_summary
from ellipseg_ros.cli.verification import recorded_updates
from ellipseg_ros.config import Config
from ellipseg_ros.io import update_messages
from ellipseg_ros.io.bag import read_messages
from ellipseg_ros.io.sources import open_source
from ellipseg_ros.node.grouping import updates
from ellipseg_ros.segmenter import Segmenter

TIMEOUT_S = 240.0  # includes the first compilation


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
        except OSError:  # ended since the listing
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
    out, err = process.communicate(timeout=TIMEOUT_S)
    assert not err
    assert process.returncode == 0
    return json.loads(out), folder


def test_every_update_equals_the_offline_run(demo):
    summary, folder = demo
    assert summary["passed"] and not summary["problems"]
    assert summary["updates"] == 4  # the last one of the half second that is left
    assert summary["checks"]["equal to offline"] == "4 of 4 updates, bit for bit"
    assert json.loads((folder / "summary.json").read_text()) == summary


def test_summary_is_printed_as_a_table(demo, capsys):
    summary, _ = demo
    print_summary(summary, Namespace(json=False, quiet=False))
    shown = capsys.readouterr().out
    assert "equal to offline       4 of 4 updates" in shown and "latency" in shown


def test_bag_holds_full_and_incremental_messages(demo):
    _, folder = demo
    said = [msg.full for _, msg in read_messages(folder / "bag", "/segments")]
    assert set(said) == {True, False}


def test_counts_add_up_to_the_points_sent(demo):
    summary, folder = demo
    sent = sum(msg.width for _, msg in read_messages(folder / "bag", "/points"))
    assert summary["points"] == summary["window"]["points"] == sent
    (_, last) = list(read_messages(folder / "bag", "/segments"))[-1]
    assert last.segmented + last.isolated + last.rejected + last.thinned == sent
    assert last.thinned == summary["window"]["thinned"] > 0


def test_points_of_segments_and_objects_are_conserved(demo):
    _, folder = demo
    config = Config(max_points_per_second=5000)
    segmenter, account = Segmenter(config), Account()
    groups = updates(open_source("sim:industrial", duration=3.5), config)
    for group, node in zip(groups, recorded_updates(folder / "bag"), strict=True):
        account.update(segmenter.process(group), node.labels, node.objects, node.message)
    assert not account.problems


def test_bag_holds_all_topics(demo):
    _, folder = demo
    assert len(list(read_messages(folder / "bag", "/segmented_points"))) == 4
    arrays = [msg.markers for _, msg in read_messages(folder / "bag", "/ellipsoids")]
    assert any(marker.action == Marker.ADD for marker in arrays[-1])  # not all deleted
    markers = [marker for array in arrays for marker in array]
    assert len(markers) > 10
    assert np.isfinite([m.pose.position.x for m in markers]).all()


def test_summary_holds_the_diagnostics_of_the_node(demo):
    summary, folder = demo
    assert summary["node"]["clouds lost by DDS"] == "0"
    assert summary["update_ms"]["median"] > 0.0
    assert summary["peak_memory_mb"] > 50.0
    assert "ready" in (folder / "node.log").read_text()


def test_results_are_written(demo):
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


def test_single_cloud_is_one_update(ros_domain, words, capsys):
    assert main([*words, "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert (summary["updates"], summary["points"], summary["times_real_time"]) == (1, 3000, None)
    assert summary["window"]["thinned"] == 0


def test_difference_is_code_1(ros_domain, words, monkeypatch, capsys):
    monkeypatch.setattr(update_messages, "write_labelled", lambda found: b"something else")
    assert main([*words, "-q"]) == 1
    assert capsys.readouterr().err == (
        "ellipseg: the verification failed\n"
        "update 1 differs from the offline result: segmented_points\n"
    )


def test_death_of_the_node_is_one_line(ros_domain, monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(node_process, "PROGRAM", "raise SystemExit(3)")
    folder = tmp_path / "out"
    assert main(["demo", "--duration", "1", "-o", str(folder), "-q"]) == 2
    assert capsys.readouterr().err == (
        f"ellipseg: the node ended too early, with 3; see {folder / 'node.log'}\n"
    )


def test_ctrl_c_ends_the_node(tmp_path):
    process = start_demo("-o", tmp_path / "out", env={**os.environ, "PYTHONUNBUFFERED": "1"})
    line = process.stderr.readline()
    assert line.startswith("starting the node")
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=TIMEOUT_S)
    assert process.returncode == 130
    assert err == "ellipseg: interrupted\n"
    assert not processes_with(f"demo_{process.pid}")
    assert not list(tmp_path.glob("out/.bag*"))
