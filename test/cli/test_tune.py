"""`ellipseg tune`: results, parallel execution, and failures."""

import csv
import json
import os
import subprocess
import sys
import time
from itertools import islice
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from clouds import street
from matplotlib.image import imread

from ellipseg_ros.cli import tune as command
from ellipseg_ros.cli.main import main
from ellipseg_ros.config import Config
from ellipseg_ros.errors import InputError
from ellipseg_ros.io.sources import Source, open_source
from ellipseg_ros.segmenter import segment
from ellipseg_ros.tuning import parallel
from ellipseg_ros.tuning.search import Search
from ellipseg_ros.tuning.tasks import Task, run
from ellipseg_ros.tuning.windows import windows

QUICK = ["--set", "window_duration=1", "--count", "5", "--no-pictures", "--jobs", "1"]


def write_drive(path, seconds=3.0, seed=0):
    """A drive of 500 points a second along the street, as .npz."""
    rng = np.random.default_rng(seed)
    t = np.sort(rng.uniform(0.0, seconds, round(500 * seconds)))
    t[0], t[-1] = 0.0, seconds
    xyz = street(len(t), rng) * 0.5
    np.savez(path, xyz=xyz, t=t)
    return path


@pytest.fixture(scope="module")
def drive(tmp_path_factory):
    """A drive of three windows."""
    return write_drive(tmp_path_factory.mktemp("tune") / "street.npz")


@pytest.fixture
def tune(capsys, monkeypatch, tmp_path):
    """Run the command in an empty folder; gives exit code, what it printed, and its JSON."""
    monkeypatch.chdir(tmp_path)

    def run_it(*words):
        code = main(["tune", *map(str, words)])
        out, err = capsys.readouterr()
        return SimpleNamespace(code=code, out=out, err=err)

    return run_it


def numbers(folder):
    """The results, but for what differs from run to run."""
    summary = json.loads((Path(folder) / "tuning.json").read_text())
    return {name: summary[name] for name in ("choices", "curves", "windows", "problems")}


def brute_force(drive, threshold, **config):
    """AICc of every window at one threshold, by `segment`."""
    at = Config(threshold=threshold, window_duration=1.0, **config)
    cuts = windows("", open_source(drive), at)
    return [segment(cut.points, at, cut.origin).aicc for cut in cuts]


# --- results ---------------------------------------------------------------------------------


def test_files_equal_a_brute_force_search(tune, drive):
    assert tune(drive, *QUICK, "-q", "-o", "out").code == 0
    found = numbers("out")
    assert found["windows"] == 3 and found["problems"] == []
    first = found["curves"][0]["curves"]["shape"]
    for column in (0, len(first["threshold"]) // 2, -1):
        assert first["aicc"][column] == brute_force(drive, first["threshold"][column])[0]
    with open("out/curves.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == sum(len(c["curves"]["shape"]["threshold"]) for c in found["curves"])
    last = found["curves"][-1]
    assert float(rows[-1]["aicc"]) == last["curves"]["shape"]["aicc"][-1]
    assert (rows[-1]["window"], rows[-1]["criterion"]) == ("2", "shape")


def test_parameter_file_holds_the_tuned_threshold_and_settings(tune, drive):
    words = ["--set", "graph.neighbours=8", "--set", "marker_min_count=30"]
    assert tune(drive, *QUICK, *words, "-q", "-o", "out").code == 0
    given = yaml.safe_load(Path("out/segmenter_shape.yaml").read_text())["/**"]["ros__parameters"]
    threshold = numbers("out")["choices"]["shape"]["threshold"]
    assert given == {
        "criterion": "shape",
        "threshold": threshold,
        "window_duration": 1.0,
        "graph": {"neighbours": 8},
        "marker_min_count": 30,
    }
    assert main(["segment", str(drive), "--params", "out/segmenter_shape.yaml", "--json"]) == 0


def test_all_criteria_share_the_windows(tune, drive):
    assert tune(drive, *QUICK, "--criterion", "all", "-q", "-o", "out").code == 0
    found = numbers("out")
    assert list(found["choices"]) == ["shape", "density", "parsimony"]
    assert {p.name for p in Path("out").glob("*.yaml")} == {
        f"segmenter_{name}.yaml" for name in found["choices"]
    }
    for name, choice in found["choices"].items():
        curve = found["curves"][1]["curves"][name]
        row = curve["threshold"].index(choice["present"])
        assert curve["aicc"][row] == brute_force(drive, choice["present"], criterion=name)[1]


def test_table_equals_the_json(tune, drive):
    table = tune(drive, *QUICK, "-o", "table")
    printed = tune(drive, *QUICK, "-o", "json", "--json")
    assert json.loads(printed.out)["choices"] == numbers("table")["choices"]
    choice = numbers("table")["choices"]["shape"]
    assert f"shape: threshold {choice['threshold']:.4g}, mean loss" in table.out
    assert len([line for line in table.out.splitlines() if "street.npz" in line]) == 3
    assert printed.err == ""


def test_windows_of_several_sources_are_distinguished(tune, drive, tmp_path):
    other = write_drive(tmp_path / "other.npz", seconds=2.0, seed=1)
    assert tune(other, drive, *QUICK, "-q", "-o", "out").code == 0
    places = [(curve["source"], curve["window"]) for curve in numbers("out")["curves"]]
    assert places == [(str(other), 0), (str(other), 1), *((str(drive), k) for k in range(3))]


def test_picture_has_three_panels_with_curves(tune, drive):
    words = [word for word in QUICK if word != "--no-pictures"]
    assert tune(drive, *words, "-q", "-o", "out").code == 0
    image = imread("out/shape.png")[..., :3]
    ink = np.ptp(image, axis=2) > 0.3
    thirds = np.array_split(ink, 3, axis=1)
    assert all(third.sum() > 300 for third in thirds)
    svg = Path("out/shape.svg").read_text()
    for text in ("AICc per point", "merge completion", "threshold τ of shape", "τ = "):
        assert text in svg


# --- where it is done ------------------------------------------------------------------------


@pytest.fixture(scope="module")
def expected(drive, tmp_path_factory):
    """What one process finds."""
    folder = tmp_path_factory.mktemp("expected") / "out"
    words = ["tune", str(drive), *QUICK, "-q", "--criterion", "all", "-o", str(folder)]
    assert main(words) == 0
    return numbers(folder)


def test_two_processes_give_the_same_result(tune, drive, expected):
    words = [drive, *QUICK, "-q", "--criterion", "all", "-o", "out", "--jobs", "2"]
    assert tune(*words).code == 0
    assert numbers("out") == expected


def test_threads_of_this_process_give_the_same_result(tune, drive, expected):
    cuts = list(windows(str(drive), open_source(drive), Config(window_duration=1.0)))
    tasks = [
        Task(cut, Config(window_duration=1.0), ("shape", "density", "parsimony"), Search(count=5))
        for cut in cuts
    ]
    with parallel.this_process() as workers:
        found = list(parallel.outcomes(tasks, workers))
    for (_, curves, _), result in zip(found, expected["curves"], strict=True):
        assert {name: curve.as_dict() for name, curve in curves.items()} == result["curves"]


def test_dask_cluster_gives_the_same_result(tune, drive, expected):
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
    ) as cluster:
        words = [drive, *QUICK, "-q", "--criterion", "all", "-o", "out"]
        assert tune(*words, "--scheduler", cluster.scheduler_address).code == 0
    assert numbers("out") == expected


# --- what goes wrong -------------------------------------------------------------------------


def test_finished_windows_are_reused(tune, drive, monkeypatch):
    assert tune(drive, *QUICK, "-q", "-o", "out").code == 0
    before = numbers("out")
    kept = sorted(Path("out/windows").iterdir())
    assert len(kept) == 3
    kept[0].unlink()
    kept[1].write_text("{")  # half written
    ran = []
    monkeypatch.setattr(parallel, "processes", lambda count: here(ran))
    again = tune(drive, *QUICK, "-o", "out")
    assert again.code == 0 and len(ran) == 2
    assert "1 windows were reused from an earlier run" in again.out
    assert numbers("out") == before
    assert tune(drive, *QUICK, "-q", "-o", "out", "--threshold", "5").code == 0
    assert len(ran) == 5  # another question


def here(ran, problem=lambda task: None):
    """A stand-in for processes, which notes what it runs, and fails where it is told to."""

    def submit(task):
        ran.append(task.cut.number)
        future = parallel.Future()
        error = problem(task)
        if error:
            future.set_exception(error)
        else:
            future.set_result(run(task))
        return future

    return parallel.contextmanager(lambda: (yield parallel.Workers(1, submit)))()


def test_failed_window_is_reported_and_others_are_tuned(tune, drive, monkeypatch):
    def second(task):
        return MemoryError("no\nroom") if task.cut.number == 1 else None

    monkeypatch.setattr(parallel, "processes", lambda count: here([], second))
    found = tune(drive, *QUICK, "-o", "out")
    assert found.code == 1
    problem = f"window 1 of {drive}: MemoryError: no room"
    assert problem in found.err and f"failed: {problem}" in found.out
    assert [curve["window"] for curve in numbers("out")["curves"]] == [0, 2]


def test_failure_of_every_window_is_one_line(tune, drive, monkeypatch):
    monkeypatch.setattr(parallel, "processes", lambda count: here([], lambda _: ValueError("odd")))
    found = tune(drive, *QUICK, "-q", "-o", "out")
    assert found.code == 2
    assert found.err.splitlines()[-1].startswith("ellipseg: no window could be tuned: window 0")


class Deadly:
    """A list of criteria that ends the process that reads it."""

    def __iter__(self):
        os._exit(1)


def test_dead_worker_process_is_reported_and_replaced(drive):
    config = Config(window_duration=1.0)
    cuts = list(windows("a", open_source(drive), config))
    tasks = [
        Task(cut, config, Deadly() if cut.number == 0 else ("shape",), Search(count=3))
        for cut in cuts
    ]
    with parallel.processes(1) as workers:
        (dead, *_) = parallel.outcomes(tasks[:1], workers)
        alive = list(parallel.outcomes(tasks[1:], workers))
    assert dead.curves is None and "a worker process died" in dead.problem
    assert [outcome.problem for outcome in alive] == ["", ""]


def test_truncated_source_is_reported_and_the_next_is_read(tune, drive, monkeypatch):
    def broken():
        yield from islice(open_source(drive), 15)  # 1.5 s
        raise InputError("the 16th cloud can't be read")

    opened = {"odd": Source("odd", "odom", None, None, broken()), str(drive): open_source(drive)}
    monkeypatch.setattr(command, "open_input", lambda spec, *_: opened[spec])
    found = tune("odd", drive, *QUICK, "-q", "-o", "out")
    assert found.code == 1
    assert numbers("out")["problems"] == ["odd: the 16th cloud can't be read"]
    assert numbers("out")["windows"] == 4


ERRORS = {
    "missing": (["nowhere.mcap"], "there is no nowhere.mcap"),
    "one missing of two": (["sim:mixed", "nowhere.mcap"], "there is no nowhere.mcap"),
    "descending": (["sim:mixed", "--from", "9", "--to", "2"], "they must ascend from above 0"),
    "few": (["sim:mixed", "--count", "2"], "count is 2; it must be from 3"),
    "every": (["sim:mixed", "--every", "0"], "--every is 0; it must be more than 0 s"),
    "jobs": (["sim:mixed", "--jobs", "0"], "--jobs is 0; it must be at least 1"),
    "foreign folder": (["sim:mixed", "-o", "."], "give a new folder"),
    "no scheduler": (
        ["sim:mixed", "--duration", "1", "--scheduler", "tcp://127.0.0.1:9"],
        "no Dask scheduler answers at tcp://127.0.0.1:9",
    ),
}


@pytest.mark.parametrize("name", ERRORS)
def test_invalid_input_is_one_line(tune, name, monkeypatch):
    monkeypatch.setattr(parallel, "SCHEDULER_TIMEOUT_S", 1)
    Path("foreign.txt").write_text("mine")
    words, reason = ERRORS[name]
    found = tune(*words, "-q")
    assert found.code == 2 and found.out == ""
    (line,) = found.err.splitlines()
    assert reason in line


def test_interrupted_run_ends_its_processes_and_can_be_resumed(drive, tmp_path):
    """Ctrl-C, as a terminal sends it: to all processes of the group."""
    long = write_drive(tmp_path / "long.npz", seconds=60.0)
    words = ["tune", str(long), *QUICK[:4], "-o", str(tmp_path / "out"), "--jobs", "2"]
    process = subprocess.Popen(
        [sys.executable, "-m", "ellipseg_ros.cli.main", *words],
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    folder = tmp_path / "out" / "windows"
    while process.poll() is None and len(list(folder.glob("*.json"))) < 2:
        time.sleep(0.05)
    os.killpg(process.pid, 2)
    _, said = process.communicate(timeout=60)
    assert process.returncode == 130
    assert said.splitlines()[-1] == "ellipseg: interrupted" and "Traceback" not in said
    assert 2 <= len(list(folder.glob("*.json"))) < 60
    until = time.monotonic() + 30.0
    while alive(process.pid) and time.monotonic() < until:
        time.sleep(0.05)
    assert not alive(process.pid)


def alive(group):
    """Whether a process of the group is left."""
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True
