"""The command line: files, JSON, one-line errors, exit codes."""

import json
import subprocess
import sys

import numpy as np
import pytest

from ellipseg_ros.cli.main import main
from ellipseg_ros.config import Config
from ellipseg_ros.io.bag import read_messages
from ellipseg_ros.io.messages import write_segments
from ellipseg_ros.io.pointcloud2 import write_labelled
from ellipseg_ros.io.sources import open_source
from ellipseg_ros.node.grouping import updates
from ellipseg_ros.segmenter import Segmenter
from ellipseg_ros.simulation.simulator import FIELDS

ROOT_MODULE = "ellipseg_ros.cli.main"


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    """2.2 s of a simulated drive: two updates and a last one of the rest."""
    path = tmp_path_factory.mktemp("cli") / "yard"
    assert main(["simulate", "industrial", "-o", str(path), "--duration", "2.2", "-q"]) == 0
    return path


@pytest.fixture(scope="module")
def segmented(bag):
    """The folder that `ellipseg segment` makes of the bag."""
    folder = bag.parent / "yard_segmented"
    assert main(["segment", str(bag), "-o", str(folder), "-q"]) == 0
    return folder


@pytest.fixture
def run(capsys, monkeypatch, tmp_path):
    """Run a command in an empty folder; gives exit code, stdout, stderr."""
    monkeypatch.chdir(tmp_path)

    def run_it(*words):
        code = main([str(word) for word in words])
        return (code, *capsys.readouterr())

    return run_it


def as_process(*words, **options):
    return subprocess.run(
        [sys.executable, "-m", ROOT_MODULE, *map(str, words)],
        stderr=subprocess.PIPE,
        text=True,
        timeout=120,
        **options,
    )


# --- results ---------------------------------------------------------------------------------


def test_simulate_writes_the_scene_with_ground_truth(bag):
    written, scene = list(open_source(bag)), list(open_source("sim:industrial", duration=2.2))
    assert len(written) == len(scene) == 22
    for sweep, same in zip(written, scene, strict=True):
        assert sweep.stamp_ns == same.stamp_ns and sweep.frame_id == "odom"
        assert sweep.fields.dtype.names == FIELDS.names
        for name in FIELDS.names:
            np.testing.assert_array_equal(sweep.fields[name], same.fields[name])


def test_raw_drive_is_placed_by_its_odometry(run):
    drive = ("town", "-o", "raw", "--raw", "--lidar", "wide32", "--duration", "0.4")
    words = ("simulate", *drive, "--stamp", "end", "--vendor", "hesai", "--json")
    summary = json.loads(run(*words)[1])
    assert summary["frame_id"] == "lidar" and summary["points"] == 4 * 1024 * 32
    placed = [sweep for sweep in open_source("raw", odometry="/odometry") if len(sweep)]
    assert placed and all(sweep.frame_id == "odom" for sweep in placed)
    for sweep in placed:
        assert sweep.fields.dtype["timestamp"] == np.float64
        assert np.nanmax(np.linalg.norm(sweep.points - sweep.fields["truth"], axis=1)) < 0.2


def test_seeds_differ(run, bag):
    run("simulate", "industrial", "-o", "other", "--duration", "2.2", "--seed", "5")
    first = [next(iter(open_source(path))) for path in (bag, "other")]
    assert not np.array_equal(first[0].points, first[1].points)


def test_segment_writes_the_topics_of_the_node(bag, segmented):
    segmenter = Segmenter(Config())
    found = [segmenter.process(group) for group in updates(open_source(bag), Config())]
    assert len(found) == 3
    clouds = [raw for raw, _ in read_messages(segmented / "bag", "/segmented_points")]
    arrays = [raw for raw, _ in read_messages(segmented / "bag", "/segments")]
    assert clouds == [write_labelled(update) for update in found]
    assert arrays == [write_segments(update) for update in found]
    markers = [msg.markers for _, msg in read_messages(segmented / "bag", "/ellipsoids")]
    assert len(markers) == 3 and len(markers[-1]) > 0
    points = [raw for raw, _ in read_messages(segmented / "bag", "/points")]
    assert points == [raw for raw, _ in read_messages(bag, "/points")]


def test_segment_writes_the_last_window(segmented):
    with np.load(segmented / "window.npz") as window:
        labels, ids = window["label"], window["segment_id"]
        count = dict(zip(*np.unique(labels[labels > 0], return_counts=True), strict=True))
        assert count == dict(zip(ids, window["segment_count"], strict=True))
    ply = next(iter(open_source(segmented / "window.ply")))
    np.testing.assert_array_equal(ply.fields["label"], labels)


def test_segment_writes_pictures(segmented):
    pictures = sorted(path.name for path in segmented.glob("*.png"))
    assert len(pictures) == 5
    assert all((segmented / name).stat().st_size > 10_000 for name in pictures)


def test_counts_of_the_summary_add_up(run, bag):
    code, out, err = run("segment", bag, "--json", "--no-pictures", "--no-bag")
    summary = json.loads(out)
    assert (code, err) == (0, "")
    points = sum(map(len, open_source(bag)))
    window = summary["window"]
    fates = [window[fate] for fate in ("segmented", "isolated", "rejected", "thinned")]
    assert summary["points"] == window["points"] == sum(fates) == points
    assert summary["updates"] == 3
    assert summary["sensor_s"] == pytest.approx(2.2, abs=0.05)
    assert summary["settings"]["graph.neighbours"] == 10
    assert 0 < summary["update_ms"]["median"] <= summary["update_ms"]["max"]
    assert sorted(summary["files"]) == [
        f"yard_segmented/{name}" for name in ("summary.json", "window.npz", "window.ply")
    ]
    assert json.loads(open("yard_segmented/summary.json").read()) == summary


def test_table_equals_the_summary(run, bag):
    _, table, _ = run("segment", bag, "--no-pictures", "--no-bag")
    summary = json.loads(open("yard_segmented/summary.json").read())
    assert f"{summary['window']['segmented']:,}" in table
    assert f"{summary['window']['segments']:,} (" in table
    assert "yard_segmented/: summary.json, window.npz, window.ply" in table


def test_quiet_prints_nothing(run, bag):
    assert run("segment", bag, "-q", "--no-pictures", "--no-bag") == (0, "", "")


def test_second_run_replaces_the_first(run, bag):
    run("segment", bag, "-o", "out", "--no-pictures")
    code, out, _ = run("segment", bag, "-o", "out", "--no-pictures", "--no-bag", "--json")
    assert code == 0
    assert "out/bag" not in json.loads(out)["files"]


# --- settings --------------------------------------------------------------------------------


def settings_of(run, bag, *words):
    code, out, err = run("segment", bag, "--json", "--no-pictures", "--no-bag", *words)
    assert code == 0, err
    return json.loads(out)["settings"]


def test_options_override_the_file(run, bag, tmp_path):
    file = tmp_path / "params.yaml"
    file.write_text(
        "/**:\n  ros__parameters:\n    use_sim_time: true\n    threshold: 7\n"
        "    criterion: parsimony\n    marker_min_count: 20\n    model:\n"
        "      noise_variance: 1e-3\n"
    )
    found = settings_of(run, bag, "--params", file, "--set", "threshold=8", "--criterion", "shape")
    assert found["threshold"] == 8.0 and found["criterion"] == "shape"
    assert found["marker_min_count"] == 20 and found["model.noise_variance"] == 1e-3


def test_installed_parameter_file_equals_the_defaults(run, bag):
    file = __file__.replace("test/cli/test_cli.py", "config/segmenter.yaml")
    assert settings_of(run, bag, "--params", file) == settings_of(run, bag)


# --- errors ----------------------------------------------------------------------------------

ERRORS = {
    "missing file": (["segment", "nowhere.mcap"], "there is no nowhere.mcap"),
    "unknown suffix": (["segment", "words.txt"], "has no readable format"),
    "truncated bag": (["segment", "short.mcap"], "can't be read as a bag"),
    "empty bag": (["segment", "empty.mcap"], "can't be read as a bag"),
    "wrong topic": (["segment", "yard", "--topic", "/no"], "it has /points"),
    "unknown scene": (["segment", "sim:moon"], "industrial"),
    "unknown scene to simulate": (["simulate", "moon", "-o", "x"], "industrial"),
    "duration out of range": (["simulate", "mixed", "-o", "x", "--duration", "-1"], "duration"),
    "raw sweeps of a plane": (["simulate", "mixed", "-o", "x", "--raw"], "--lidar hdl64e"),
    "raw option alone": (["simulate", "town", "-o", "x", "--stamp", "end"], "--stamp needs --raw"),
    "unknown lidar": (["simulate", "town", "-o", "x", "--lidar", "radar"], "one of hdl64e"),
    "unknown vendor": (["simulate", "town", "-o", "x", "--raw", "--vendor", "y"], "one of"),
    "bag exists": (["simulate", "mixed", "-o", "yard"], "exists already"),
    "scene option for a bag": (["segment", "yard", "--seed", "1"], "simulated scenes"),
    "out of range": (["segment", "yard", "--set", "graph.neighbours=2"], "from 3 to 64"),
    "not a number": (["segment", "yard", "--threshold", "much"], "must be a number"),
    "not a truth": (["segment", "yard", "--set", "objects.enabled=no"], "must be true or false"),
    "not whole": (["segment", "yard", "--set", "input_depth=1.5"], "must be a whole number"),
    "unknown criterion": (["segment", "yard", "--criterion", "y"], "one of shape, density"),
    "unknown setting": (["segment", "yard", "--set", "neighbors=5"], "graph.neighbours"),
    "group, not setting": (["segment", "yard", "--set", "graph=5"], "there is no setting graph;"),
    "no value": (["segment", "yard", "--set", "threshold"], "--set name=value"),
    "no parameter file": (["segment", "yard", "--params", "no.yaml"], "no.yaml: No such file"),
    "broken parameter file": (["segment", "yard", "--params", "words.txt"], "is no YAML"),
    "empty parameter file": (["segment", "yard", "--params", "empty.mcap"], "holds no settings"),
    "unwritable": (["segment", "yard", "-o", "words.txt/out"], "words.txt/out: Not a directory"),
    "unwritable bag": (["simulate", "mixed", "-o", "words.txt/out"], "can't be written"),
    "foreign folder": (["segment", "yard", "-o", "."], "give a new folder"),
    "replay of nothing": (["replay", "nowhere.mcap"], "there is no nowhere.mcap"),
    "rate out of range": (["replay", "yard", "--rate", "-1"], "rate is -1"),
    "demo of nothing": (["demo", "--data", "nowhere.npz"], "there is no nowhere.npz"),
    "demo, bad setting": (["demo", "--set", "update_period=0"], "update_period is 0"),
}


@pytest.mark.parametrize("case", ERRORS)
def test_error_is_one_line_and_code_2(run, bag, tmp_path, case):
    (tmp_path / "yard").symlink_to(bag)
    (tmp_path / "words.txt").write_text("a: [b\n")
    (tmp_path / "empty.mcap").write_bytes(b"")
    content = (bag / "yard.mcap").read_bytes()
    (tmp_path / "short.mcap").write_bytes(content[: len(content) // 2])
    words, says = ERRORS[case]
    code, out, err = run(*words)
    assert (code, out) == (2, "")
    assert err.startswith("ellipseg: ") and err.count("\n") == 1
    assert says in err


def test_source_is_never_overwritten(run, segmented):
    before = sorted(path.name for path in segmented.iterdir())
    code, _, err = run("segment", segmented / "bag", "--topic", "points", "-o", segmented)
    assert code == 2 and "is overwritten" in err
    assert sorted(path.name for path in segmented.iterdir()) == before


@pytest.mark.parametrize("words", [["fly"], [], ["segment"], ["segment", "x", "--jobs", "2"]])
def test_wrong_usage_is_code_2(words, capsys):
    with pytest.raises(SystemExit) as ended:
        main(words)
    assert ended.value.code == 2
    assert "usage: ellipseg" in capsys.readouterr().err


def test_ctrl_c_is_code_130_without_a_traceback(run, bag, monkeypatch):
    def interrupted(self, sweep):
        raise KeyboardInterrupt

    monkeypatch.setattr(Segmenter, "process", interrupted)
    code, out, err = run("segment", bag, "-o", "out", "-q")
    assert (code, out, err) == (130, "", "ellipseg: interrupted\n")


def test_missing_package_is_named(run, monkeypatch):
    monkeypatch.setitem(sys.modules, "ellipseg_ros.cli.simulate", None)
    monkeypatch.delitem(sys.modules, "ellipseg_ros.io.bag", raising=False)
    monkeypatch.delitem(sys.modules, "ellipseg_ros.cli.segment", raising=False)
    monkeypatch.setitem(sys.modules, "tqdm", None)
    monkeypatch.delitem(sys.modules, "ellipseg_ros.cli.report", raising=False)
    code, _, err = run("segment", "sim:mixed")
    assert code == 2
    assert err == "ellipseg: this needs the package tqdm: pip install tqdm\n"


def test_full_disk_is_one_line(bag, tmp_path):
    words = ["segment", bag, "--json", "--no-pictures", "--no-bag", "-o", tmp_path / "out"]
    with open("/dev/full", "w") as full:
        ended = as_process(*words, stdout=full)
    assert ended.returncode == 2
    assert ended.stderr == "ellipseg: No space left on device\n"


def test_help_imports_nothing_heavy_and_shows_examples():
    code = (
        "import sys\nfrom ellipseg_ros.cli.main import main\n"
        "try:\n    main(['segment', '--help'])\nexcept SystemExit:\n    pass\n"
        "print(sorted({'numba', 'numpy', 'rclpy', 'rosbags'} & sys.modules.keys()))"
    )
    ended = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60
    )
    assert "ellipseg segment drive.mcap" in ended.stdout
    assert ended.stdout.endswith("[]\n")
