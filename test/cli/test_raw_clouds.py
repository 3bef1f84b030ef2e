"""Commands on bags of raw clouds, with every choice of --odometry."""

import json
from contextlib import nullcontext
from types import SimpleNamespace

import numpy as np
import pytest
from raw_bags import NS, START_NS, RawBag, scans, sensor, truth, write_drive

from ellipseg_ros.cli import replay
from ellipseg_ros.cli.main import main
from ellipseg_ros.io.sources import open_source
from ellipseg_ros.poses.placer import Placer, outcomes
from ellipseg_ros.records import Sweep

SCENE = {"count": 4, "points": 300}
CASES = ("/odometry", "odometry", "/tf", "poses.tum", "poses.txt", "registered")
COMMANDS = {
    "segment": ["--no-pictures", "--no-bag"],
    "tune": ["--count", "3", "--no-pictures"],
    "replay": [],
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Bags with an odometry, with tf and without poses; the same poses as files."""
    folder = tmp_path_factory.mktemp("raw")
    for name, poses in (("odometry", "odometry"), ("tf", "tf"), ("bare", "")):
        write_drive(folder / name, poses, "mcap", **SCENE)
    tum, kitti = [], []
    for seconds, _ in scans(**SCENE):
        at = sensor(seconds)
        numbers = (*at.position, *at.rotation)
        second, ns = divmod(START_NS + round(seconds * NS), NS)
        tum.append(" ".join([f"{second}.{ns:09}", *(f"{x:.17g}" for x in numbers)]))
        kitti.append(" ".join(f"{x:.17g}" for x in at.matrix[:3].ravel()))
    (folder / "poses.tum").write_text("# time x y z qx qy qz qw\n" + "\n".join(tum))
    (folder / "poses.txt").write_text("\n".join(kitti) + "\n")
    (folder / "short.txt").write_text("\n".join(kitti[1:]))
    (folder / "words.tum").write_text("time x y z qx qy qz qw")
    return folder


@pytest.fixture
def run(capsys, monkeypatch, tmp_path, folder):
    """Run a command in an empty folder; gives exit code, stdout, stderr.

    Sources and files of poses are those of `folder`.
    """
    monkeypatch.chdir(tmp_path)

    def run_it(command, bag, odometry, *words):
        file = folder / odometry
        chosen = ["--odometry", str(file) if file.is_file() else odometry] if odometry else []
        code = main([command, str(folder / bag), *chosen, *map(str, words)])
        return (code, *capsys.readouterr())

    return run_it


def bag_of(case):
    """The bag that has these poses, or none where a file has them."""
    return {"/odometry": "odometry", "odometry": "odometry", "/tf": "tf"}.get(case, "bare")


def expected(case):
    if case == "registered":
        return [points.astype(np.float64) for _, points in scans(**SCENE)]
    return list(truth(**SCENE))


def check(sweeps, case, atol=1e-9):
    frame = "lidar" if case == "registered" else "odom"
    assert len(sweeps) == SCENE["count"]
    for sweep, points in zip(sweeps, expected(case), strict=True):
        assert sweep.frame_id == frame
        np.testing.assert_allclose(sweep.points, points, rtol=0, atol=atol)


@pytest.mark.parametrize("case", CASES)
def test_segment_places_the_clouds(run, case):
    code, out, err = run("segment", bag_of(case), case, "-o", "found", "--no-pictures", "--json")
    assert code == 0 and "Traceback" not in err
    summary = json.loads(out)
    assert summary["points"] == SCENE["count"] * SCENE["points"]
    assert summary["window"]["rejected"] == 0
    check(list(open_source("found/bag", "/points", "registered")), case, atol=1e-5)  # float32


def test_tune_gives_the_same_curves_with_every_choice(run):
    tables = {}
    for number, odometry in enumerate(
        ("/odometry", "/tf", "poses.tum", "poses.txt", "registered")
    ):
        words = ("-o", number, *COMMANDS["tune"])
        code, _, err = run("tune", bag_of(odometry), odometry, *words)
        assert code == 0, err
        with open(f"{number}/tuning.json", encoding="utf-8") as file:
            tables[odometry] = np.array(numbers(json.load(file)["curves"]))
    raw, expected = tables.pop("registered"), tables["/odometry"]
    assert len(expected) >= 6 and not np.allclose(raw, expected, rtol=1e-3)
    for table in tables.values():
        np.testing.assert_allclose(table, expected, rtol=1e-6)


def numbers(value):
    """All numbers of a nested structure, in its order."""
    if isinstance(value, dict):
        value = list(value.values())
    if isinstance(value, list):
        return [number for part in value for number in numbers(part)]
    return [float(value)] if isinstance(value, int | float) else []


class RecordedReplay:
    """In place of a Replayer: keeps what it is to publish."""

    last: "RecordedReplay"

    def __init__(self, events, options, placement):
        self.events, self.placement = list(events), placement
        RecordedReplay.last = self

    def __enter__(self):
        return self

    def __exit__(self, *error):
        pass

    def run(self, progress):
        return SimpleNamespace(points=0, clouds=0, wall_seconds=0.0, missed=0, updates=0)


@pytest.mark.parametrize("case", CASES)
def test_replay_publishes_clouds_with_an_odometry_that_places_them(run, monkeypatch, case):
    monkeypatch.setattr(replay, "Replayer", RecordedReplay)
    monkeypatch.setattr(replay, "progress_bar", lambda *words: nullcontext())
    assert run("replay", bag_of(case), case)[0] == 0
    played = RecordedReplay.last
    placed = list(outcomes(played.events, Placer(played.placement)))
    check([sweep for sweep in placed if isinstance(sweep, Sweep)], case)


@pytest.fixture(scope="module")
def unusual(folder):
    """A bag with two topics of poses, and one whose tf does not reach the clouds."""
    with RawBag(folder / "several") as bag:
        for topic in ("/wheels", "/gnss"):
            bag.odometry(START_NS, sensor(0.0), topic)
        bag.cloud(START_NS, np.ones((3, 3), np.float32))
    with RawBag(folder / "apart") as bag:
        bag.transforms(START_NS, [("odom", "base", sensor(0.0))])
        bag.cloud(START_NS, np.ones((3, 3), np.float32))
    np.savez(folder / "cloud.npz", xyz=np.zeros((9, 3)))
    return folder


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize(
    ("bag", "odometry", "text"),
    [
        ("bare", "", "topics with poses: none"),
        ("bare", "/odometry", "no poses on /odometry"),
        ("bare", "/tf", "no poses on /tf"),
        ("bare", "missing.tum", "missing.tum"),
        ("bare", "short.txt", "3 poses for 4 clouds"),
        ("bare", "words.tum", "can't be read as poses"),
        ("several", "", "/gnss, /wheels"),
        ("apart", "/tf", "to no other frame"),
        ("cloud.npz", "/odometry", "a cloud file has no topics"),
    ],
)
def test_unusable_poses_are_refused_in_one_line(
    run, unusual, monkeypatch, command, bag, odometry, text
):
    monkeypatch.setattr(replay, "Replayer", RecordedReplay)
    code, out, err = run(command, bag, odometry, *COMMANDS[command])
    assert (code, out) == (2, "")
    assert text in err and len(err.strip().splitlines()) == 1 and err.startswith("ellipseg: ")
