"""Methods are compared at equal counts, in subprocesses; what cannot run is named."""

import json
from dataclasses import replace
from functools import partial

import numpy as np
import partitions
import pytest
from matplotlib.image import imread
from partitions import ABSENT, COUNTED, OURS, STRIPS, THEIRS
from tables import check_tables

from ellipseg_ros.config import Config
from ellipseg_ros.errors import EllipsegError
from ellipseg_ros.node.memory import peak_mb, resident_mb
from ellipseg_ros.segmenter import segment
from studies.memory import reset_peak
from studies.partition import study
from studies.partition.__main__ import main
from studies.partition.chart import draw
from studies.partition.evaluation import evaluate, measured, segment_count
from studies.partition.means import means
from studies.partition.methods import OBJECTS, CountParameter, ellipsoids, prepare_objects
from studies.partition.page import page
from studies.partition.parameter_search import Search, reached
from studies.partition.peers import PEERS
from studies.partition.scan import Scan, completed, neighbour_edges
from studies.partition.subprocess_runner import Outcome, run_in_subprocess
from studies.partition.targets import judged
from studies.partition.truth import complete_instances
from studies.report import packages

DRIVE = ["sim:industrial", "--duration", "0.5"]


def scan(n=400, name="made"):
    """Two classes side by side, of four instances; some points of unknown class."""
    rng = np.random.default_rng(0)
    points = rng.uniform(0.0, [8.0, 2.0, 0.1], (n, 3))
    classes = np.where(points[:, 0] < 4.0, 1, 5)
    instances = np.where(classes == 1, 0, points[:, 0].astype(int))
    classes[:10] = 0
    return Scan(name, False, points, classes, instances)


# --- clouds ----------------------------------------------------------------------------------


def test_the_edges_are_those_of_nearest_neighbours():
    points = np.random.default_rng(1).normal(size=(60, 3))
    distance = np.linalg.norm(points[:, None] - points, axis=2)
    expected = set()
    for i in range(60):
        for j in np.argsort(distance[i])[1:11]:
            expected.add((min(i, int(j)), max(i, int(j))))
    assert sorted(map(tuple, neighbour_edges(points).tolist())) == sorted(expected)


def test_points_without_a_segment_join_the_nearest():
    points = np.array([[0.0, 0, 0], [1, 0, 0], [5, 0, 0], [3.5, 0, 0]])
    assert completed(np.array([4, -1, 9, -2]), points).tolist() == [4, 4, 9, 9]
    assert completed(np.array([-1, -1]), points[:2]).tolist() == [0, 0]


def test_incomplete_instances_are_ignored():
    classes = np.array([0, 1, 2, 3])
    for instances, complete in (([0, 0, 1, 2], True), ([0, 0, 1, 0], False)):
        assert (complete_instances(np.array(instances), classes) is not None) is complete
    assert complete_instances(np.zeros(2, int), np.array([0, 1])) is None


# --- the search for a count ------------------------------------------------------------------


@pytest.mark.parametrize("target", [3, 100, 250, 2500])
@pytest.mark.parametrize("power", [0.5, 1.0, 2.5])
def test_a_search_reaches_the_count(target, power):
    runs = []

    def count(value):
        runs.append(value)
        return max(2, round(300 / value**power))

    search = Search(CountParameter("x", 1e-4, 1e4), count)
    search.evaluate(1.0)
    assert reached(search.known[search.seek(target)], target)
    assert len(runs) == len(set(runs)) <= 9


def test_a_search_stops_at_the_nearest_possible_count():
    search = Search(
        CountParameter("x", 1, 64, integer=True), lambda value: max(40, 100 - int(value))
    )
    search.evaluate(8.0)
    assert search.known[search.seek(10)] == 40
    assert search.known[search.seek(1000)] == 99
    assert max(search.known) == 64 and min(search.known) == 1


# --- one method ------------------------------------------------------------------------------


def test_evaluations_have_scores_and_costs():
    default, many = evaluate(STRIPS, scan(), ["default", 500])
    assert default["count"] == 3 and default["settings"] == {"width": 3.0}
    assert default["seconds"] >= 0.0 and default["memory_mb"] >= 0.0
    assert many["reached"] is False and "purity" not in many
    eight = next(evaluate(COUNTED, scan(), [8]))
    assert eight["count"] == 8 and eight["mean_iou"] > 0.95
    assert eight["ari"] == pytest.approx(1.0, abs=0.15)
    json.dumps([default, many, eight], allow_nan=False)


def test_the_best_settings_of_the_grid_count():
    grid = ({"width": 8.0}, {"width": 2.0}, {"width": 4.1})
    best = next(evaluate(replace(STRIPS, grid=grid), scan(), ["default"]))
    assert best["settings"] == {"width": 2.0}


def test_a_count_that_is_a_setting_is_met():
    assert [one["count"] for one in evaluate(COUNTED, scan(), ["default", 6, 37])] == [4, 6, 37]


@pytest.mark.parametrize("criterion", ["shape", "density", "parsimony"])
def test_segments_at_a_threshold_equal_a_batch(criterion):
    points = scan(300).points
    run = ellipsoids(criterion).prepare(points)
    for threshold in (0.5, 8.0, 0.02):
        expected = segment(points, Config(criterion=criterion, threshold=threshold)).labels
        np.testing.assert_array_equal(run({"threshold": threshold}), expected)


def test_objects_equal_those_of_the_library():
    points = scan(2000).points
    found = segment(points)
    run = prepare_objects(points)
    own = np.append(found.objects.segment_labels, -1)[np.maximum(found.labels, -1)]
    default, finer = OBJECTS.grid
    np.testing.assert_array_equal(run(default), own)
    assert segment_count(run(default | {"segments": 5})) == 5
    assert segment_count(run(default | {"segments": 10**6})) == len(found.ellipsoids)
    assert segment_count(run(finer | {"segments": 10**6})) > len(found.ellipsoids)


@pytest.mark.parametrize("method", PEERS, ids=lambda method: method.name)
def test_another_library_labels_every_point_and_its_parameter_lowers_the_count(method):
    for package, module in zip(method.package.split(), method.module.split(), strict=True):
        reason = packages.load(package, module)[1]
        if reason:
            pytest.skip(f"{package}: {reason}")
    points = scan(2000).points
    run = method.prepare(points)
    for settings in method.grid:
        labels = run(settings)
        assert labels.shape == (2000,) and labels.dtype.kind == "i"
        np.testing.assert_array_equal(labels, run(settings))
    name, high = method.parameter.name, method.parameter.high
    strong = run(method.grid[0] | {name: min(high, 100 * method.grid[0][name])})
    assert segment_count(strong) <= segment_count(run(method.grid[0]))


def test_memory_is_that_of_the_run():
    def use(megabytes):
        return measured(lambda: np.ones((megabytes, 1_000_000 // 8)).sum())["memory_mb"]

    first, second = use(200), use(50)
    assert 190.0 < first < 260.0
    assert 45.0 < second < 100.0
    reset_peak()
    assert peak_mb() == pytest.approx(resident_mb(), rel=0.2)


# --- subprocesses ----------------------------------------------------------------------------


def test_a_subprocess_gives_the_same_evaluations():
    work = partial(evaluate, STRIPS, scan(), ["default", 8])
    outcome = run_in_subprocess(work, (STRIPS,), 60.0)
    assert not outcome.problem and not outcome.missing
    for there, here in zip(outcome.evaluations, work(), strict=True):
        for name in ("count", "settings", "purity", "mean_iou", "iou", "ari", "quality"):
            assert there[name] == here[name]


@pytest.mark.parametrize(
    ("prepare", "limit", "problem"),
    [
        (partitions.prepare_endless, 0.2, "stopped after 0.2 s"),
        (partitions.prepare_crash, 60.0, "its process ended with 7"),
        (partitions.prepare_mistake, 60.0, "ValueError: two lines"),
    ],
)
def test_the_end_of_a_method_is_reported(prepare, limit, problem):
    method = replace(STRIPS, prepare=prepare)
    work = partial(evaluate, method, scan(), ["default"])
    outcome = run_in_subprocess(work, (method,), limit)
    assert (outcome.evaluations, outcome.problem) == ([], problem)


def test_a_method_that_is_not_installed_is_named():
    work = partial(evaluate, ABSENT, scan(), ["default"])
    outcome = run_in_subprocess(work, (ABSENT,), 60.0)
    assert outcome.missing == "not installed; pip install no-such-package"


# --- the study -------------------------------------------------------------------------------


def in_this_process(work, methods, limit):
    """Replaces run_in_subprocess."""
    if any(method.package for method in methods):
        return Outcome(missing="not installed; pip install no-such-package")
    return Outcome(list(work()))


PLAN = study.Plan((4, 25), 60.0)


@pytest.fixture(scope="module")
def results():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(study, "run_in_subprocess", in_this_process)
        patch.setattr(study, "METHODS", (THEIRS, ABSENT, OURS))
        return study.study([scan(), scan(name="again")], (THEIRS, ABSENT, OURS), PLAN)


def test_a_different_cloud_of_the_same_name_is_refused(results):
    with pytest.raises(EllipsegError, match="made has 401 points, 400 in the earlier results"):
        study.study([scan(401)], (OURS,), study.Plan(PLAN.counts, 60.0, results))


def test_a_study_has_all_clouds_and_methods(results):
    assert [row["name"] for row in results["scans"]] == ["made", "again"]
    assert results["missing"] == {"absent": "not installed; pip install no-such-package"}
    evaluations = results["scans"][0]["evaluations"]
    counts = [one["count"] for one in evaluations if one["method"] == "objects"]
    assert counts == [4, 3, 4, 25]  # default, and those of cut-pursuit
    assert results == json.loads(json.dumps(results))


def test_objects_are_judged_at_the_counts_of_cut_pursuit(results):
    rows = judged(results)
    assert rows == results["rows"] and len(rows) == 3
    assert results["scans"][0]["timing"][0]["ratio"]["runs"] == 3
    assert rows[2]["measured"] > 0.0
    requirement = "clouds of 2 with a higher mean IoU, at its default count"
    assert rows[0]["requirement"] == requirement
    assert rows[0]["measured"] == 0  # both methods cut strips
    assert rows[1]["measured"] == pytest.approx(0.0, abs=0.1)


def test_means_are_over_clouds_on_which_all_reached_the_count():
    def cloud(name, **counts):
        return {
            "name": name,
            "evaluations": [
                {"method": m, "target": 9, "count": c, "reached": c > 0, "purity": 0.1 * c}
                for m, c in counts.items()
            ],
        }

    clouds = [cloud("x", a=9, b=8), cloud("y", a=1, b=0, c=5), cloud("z", a=2, b=4, c=9)]
    clouds.append(cloud("w", a=1, b=3))
    rows = means(clouds, ["a", "b", "c"], 9)
    assert [(row["method"], row["scans"], row["count"]) for row in rows] == [
        ("a", 3, 4.0),
        ("b", 3, 5.0),
    ]
    assert rows[0]["purity"] == pytest.approx(0.4)


def test_earlier_results_are_kept(results, monkeypatch):
    monkeypatch.setattr(study, "run_in_subprocess", in_this_process)
    monkeypatch.setattr(study, "METHODS", (THEIRS, ABSENT, OURS))
    again = study.study([scan()], (OURS,), study.Plan(PLAN.counts, 60.0, results))
    assert [row["name"] for row in again["scans"]] == ["made", "again"]
    methods = [one["method"] for one in again["scans"][0]["evaluations"]]
    assert methods == [one["method"] for one in results["scans"][0]["evaluations"]]
    assert len(again["rows"]) == 3
    assert again["missing"] == results["missing"]


def test_the_page_has_requirements_and_missing_methods(results, tmp_path):
    text = page(results).markdown()
    assert check_tables(text) > 5
    assert "absent (not installed; pip install no-such-package)" in text
    assert "clouds of 2 with a higher mean IoU" in text
    draw(results, tmp_path / "a.png")
    assert imread(tmp_path / "a.png").shape == (1100, 1900, 4)


# --- the command -----------------------------------------------------------------------------


@pytest.fixture
def run(capsys, monkeypatch):
    """Run the command; returns exit code, stdout, stderr."""
    monkeypatch.setattr(study, "run_in_subprocess", in_this_process)
    monkeypatch.setattr(study, "METHODS", (THEIRS, OURS, ABSENT))

    def run_main(*words):
        code = main([*map(str, words)])
        return (code, *capsys.readouterr())

    return run_main


def test_the_command_prints_json(run):
    code, out, _ = run(*DRIVE, "--counts", 20, "--json")
    results = json.loads(out)
    assert code == 0
    assert results["scans"][0]["instances"] > 3
    assert [one["target"] for one in results["scans"][0]["evaluations"]][:2] == ["default", 20]


def test_the_command_writes_and_adds(run, tmp_path):
    words = [*DRIVE, "--counts", 20, "-q", "-o", tmp_path]
    assert run(*words, "--methods", "cut")[0] == 0
    assert run(*words, "--methods", "obj", "--add-to", tmp_path / "partition.json")[0] == 0
    text = (tmp_path / "partition.md").read_text(encoding="utf-8")
    assert "| cut-pursuit" in text and "| objects" in text and "absent" not in text
    assert "](partition_industrial.png)" in text
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "partition.json",
        "partition.md",
        "partition.png",
        "partition_industrial.png",
    ]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["missing.npz"], "there is no missing.npz"),
        (["bare.npz"], "bare.npz has no classes; it must have a field class or coarse"),
        (["blank.npz"], "blank.npz has no point of a known class"),
        (["good.npz", "--duration", "3"], "--duration applies to simulated scenes"),
        (["good.npz", "--methods", "magic"], "there is no method 'magic'; there are cut-pursuit"),
        (["good.npz", "--counts", "0"], "--counts has 0; it must be 1 or more"),
        (["good.npz", "--limit", "0"], "--limit is 0; it must be more than 0 s"),
        (["good.npz", "--add-to", "broken.json"], "broken.json holds no results"),
        (["good.npz", "--add-to", "other.json"], "other.json is of --counts 7; give the same"),
        (["good.npz", "--add-to", "nowhere.json"], "nowhere.json: No such file"),
    ],
)
def test_an_error_is_one_line(run, tmp_path, monkeypatch, words, message):
    monkeypatch.chdir(tmp_path)
    points = np.zeros((3, 3))
    np.savez("bare.npz", xyz=points)
    np.savez("blank.npz", xyz=points, coarse=np.zeros(3, np.int8))
    np.savez("good.npz", xyz=points, coarse=np.ones(3, np.int8))
    (tmp_path / "broken.json").write_text("{", encoding="utf-8")
    (tmp_path / "other.json").write_text('{"counts": [7]}', encoding="utf-8")
    code, out, err = run(*words)
    assert (code, out) == (2, "")
    assert err.startswith(f"studies.partition: {message}") and err.count("\n") == 1
