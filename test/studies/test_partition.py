"""Methods are compared at equal counts, apart from one another, and what is missing is named."""

import json
import re
from dataclasses import replace
from functools import partial

import numpy as np
import partitions
import pytest
from matplotlib.image import imread
from partitions import ABSENT, COUNTED, OURS, STRIPS, THEIRS

from ellipseg_ros.cli.main import main
from ellipseg_ros.config import Config
from ellipseg_ros.doctor import packages
from ellipseg_ros.errors import EllipsegError
from ellipseg_ros.node.memory import peak_mb, reset_peak, resident_mb
from ellipseg_ros.segmenter import segment
from studies.partition import cells, study
from studies.partition import subprocess_runner as apart
from studies.partition.means import means
from studies.partition.methods import OBJECTS, Dial, ellipsoids, prepare_objects
from studies.partition.page import page
from studies.partition.parameter_search import Search, reached
from studies.partition.peers import PEERS
from studies.partition.picture import draw
from studies.partition.promises import row, rows
from studies.partition.reading import complete_instances
from studies.partition.scan import Scan, completed, neighbour_edges

DRIVE = ["sim:industrial", "--duration", "0.5"]


def scan(n=400, name="made"):
    """Two classes side by side, of four things; some points of no known class."""
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


def test_instances_count_only_if_they_are_complete():
    classes = np.array([0, 1, 2, 3])
    for instances, complete in (([0, 0, 1, 2], True), ([0, 0, 1, 0], False)):
        assert (complete_instances(np.array(instances), classes) is not None) is complete
    assert complete_instances(np.zeros(2, int), np.array([0, 1])) is None


# --- the search for a count ------------------------------------------------------------------


@pytest.mark.parametrize("wanted", [3, 100, 250, 2500])
@pytest.mark.parametrize("power", [0.5, 1.0, 2.5])
def test_a_search_comes_to_the_count(wanted, power):
    runs = []

    def count(value):
        runs.append(value)
        return max(2, round(300 / value**power))

    search = Search(Dial("x", 1e-4, 1e4), count)
    search.begin(1.0)
    assert reached(search.known[search.seek(wanted)], wanted)
    assert len(runs) == len(set(runs)) <= 9


def test_a_search_ends_where_a_count_cannot_be():
    search = Search(Dial("x", 1, 64, whole=True), lambda value: max(40, 100 - int(value)))
    search.begin(8.0)
    assert search.known[search.seek(10)] == 40
    assert search.known[search.seek(1000)] == 99
    assert max(search.known) == 64 and min(search.known) == 1


# --- one method ------------------------------------------------------------------------------


def test_cells_have_scores_and_costs():
    own, many = cells.cells(STRIPS, scan(), ["own", 500])
    assert own["count"] == 3 and own["settings"] == {"width": 3.0}
    assert own["seconds"] >= 0.0 and own["memory_mb"] >= 0.0
    assert many["reached"] is False and "purity" not in many
    eight = list(cells.cells(COUNTED, scan(), [8]))[0]
    assert eight["count"] == 8 and eight["mean_iou"] > 0.95
    assert eight["ari"] == pytest.approx(1.0, abs=0.15)
    json.dumps([own, many, eight], allow_nan=False)


def test_the_best_of_the_grid_is_shown():
    grid = ({"width": 8.0}, {"width": 2.0}, {"width": 4.1})
    found = next(cells.cells(replace(STRIPS, grid=grid), scan(), ["own"]))
    assert found["settings"] == {"width": 2.0}


def test_a_count_that_is_a_setting_is_met():
    assert [c["count"] for c in cells.cells(COUNTED, scan(), ["own", 6, 37])] == [4, 6, 37]


@pytest.mark.parametrize("criterion", ["shape", "density", "parsimony"])
def test_a_threshold_that_is_turned_gives_what_a_batch_gives(criterion):
    points = scan(300).points
    run = ellipsoids(criterion).prepare(points)
    for threshold in (0.5, 8.0, 0.02):
        expected = segment(points, Config(criterion=criterion, threshold=threshold)).labels
        np.testing.assert_array_equal(run({"threshold": threshold}), expected)


def test_objects_are_those_of_the_library():
    points = scan(2000).points
    found = segment(points)
    run = prepare_objects(points)
    own = np.append(found.objects.segment_labels, -1)[np.maximum(found.labels, -1)]
    default, finer = OBJECTS.grid
    np.testing.assert_array_equal(run(default), own)
    assert cells.segments(run(default | {"segments": 5})) == 5
    assert cells.segments(run(default | {"segments": 10**6})) == len(found.ellipsoids)
    assert cells.segments(run(finer | {"segments": 10**6})) > len(found.ellipsoids)


@pytest.mark.parametrize("method", PEERS, ids=lambda method: method.name)
def test_a_peer_labels_every_point_and_its_dial_turns_the_right_way(method):
    for package, module in zip(method.package.split(), method.module.split(), strict=True):
        why = packages.load(package, module)[1]
        if why:
            pytest.skip(f"{package}: {why}")
    points = scan(2000).points
    run = method.prepare(points)
    for settings in method.grid:
        labels = run(settings)
        assert labels.shape == (2000,) and labels.dtype.kind == "i"
        np.testing.assert_array_equal(labels, run(settings))
    dial = method.dial
    strong = run(method.grid[0] | {dial.name: min(dial.high, 100 * method.grid[0][dial.name])})
    assert cells.segments(strong) <= cells.segments(run(method.grid[0]))


def test_memory_is_that_of_the_run():
    def use(megabytes):
        return cells.measured(lambda: np.ones((megabytes, 1_000_000 // 8)).sum())["memory_mb"]

    first, second = use(200), use(50)
    assert 190.0 < first < 260.0
    assert 45.0 < second < 100.0
    reset_peak()
    assert peak_mb() == pytest.approx(resident_mb(), rel=0.2)


# --- apart -----------------------------------------------------------------------------------


def test_a_process_of_its_own_gives_the_same():
    outcome = apart.run_apart(partial(cells.cells, STRIPS, scan(), ["own", 8]), (STRIPS,), 60.0)
    assert not outcome.problem and not outcome.missing
    here = list(cells.cells(STRIPS, scan(), ["own", 8]))
    for there, cell in zip(outcome.cells, here, strict=True):
        for name in ("count", "settings", "purity", "mean_iou", "iou", "ari", "quality"):
            assert there[name] == cell[name]


@pytest.mark.parametrize(
    ("prepare", "limit", "words"),
    [
        (partitions.prepare_endless, 0.2, "stopped after 0.2 s"),
        (partitions.prepare_crash, 60.0, "its process ended with 7"),
        (partitions.prepare_mistake, 60.0, "ValueError: two lines"),
    ],
)
def test_what_stops_a_method_is_said(prepare, limit, words):
    method = replace(STRIPS, prepare=prepare)
    outcome = apart.run_apart(partial(cells.cells, method, scan(), ["own"]), (method,), limit)
    assert (outcome.cells, outcome.problem) == ([], words)


def test_a_method_that_is_not_installed_is_named():
    outcome = apart.run_apart(partial(cells.cells, ABSENT, scan(), ["own"]), (ABSENT,), 60.0)
    assert outcome.missing == "not installed; pip install no-such-package"


# --- all of them -----------------------------------------------------------------------------


def here(work, methods, limit):
    """As run_apart, without another process."""
    if any(method.package for method in methods):
        return apart.Outcome(missing="not installed; pip install no-such-package")
    return apart.Outcome(list(work()))


PLAN = study.Plan((4, 25), 60.0)


@pytest.fixture(scope="module")
def results():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(study, "run_apart", here)
        patch.setattr(study, "METHODS", (THEIRS, ABSENT, OURS))
        return study.study([scan(), scan(name="again")], (THEIRS, ABSENT, OURS), PLAN)


def test_another_cloud_of_the_same_name_is_refused(results):
    with pytest.raises(EllipsegError, match="made has 401 points, 400 in the earlier results"):
        study.study([scan(401)], (OURS,), study.Plan(PLAN.counts, 60.0, results))


def test_a_study_has_all_clouds_and_methods(results):
    assert [row["name"] for row in results["scans"]] == ["made", "again"]
    assert results["missing"] == {"nobody": "not installed; pip install no-such-package"}
    counts = [c["count"] for c in results["scans"][0]["cells"] if c["method"] == "objects"]
    assert counts == [4, 3, 4, 25]  # own, and those of cut-pursuit
    assert results == json.loads(json.dumps(results))


def test_objects_are_judged_at_the_counts_of_cut_pursuit(results):
    judged = rows(results)
    assert len(judged) == 3
    assert results["scans"][0]["races"][0]["ratio"]["runs"] == 3
    assert judged[2]["value"] > 0.0
    assert judged[0]["title"] == "scans of 2 with a higher mean IoU, at its own count"
    assert judged[0]["value"] == 0  # strips are strips
    assert judged[1]["value"] == pytest.approx(0.0, abs=0.1)


@pytest.mark.parametrize(
    ("value", "must", "aim", "verdict"),
    [(0.05, 0.03, 0.05, "aim"), (0.04, 0.03, 0.05, "must"), (0.02, 0.03, 0.05, "neither")]
    + [(0.1, 0.2, 0.1, "aim"), (0.15, 0.2, 0.1, "must"), (0.3, 0.2, 0.1, "neither")],
)
def test_a_promise_is_kept_or_not(value, must, aim, verdict):
    assert row("what", value, must, aim)["reached"] == verdict


def test_means_are_over_clouds_that_all_came_to():
    def cloud(name, **counts):
        return {
            "name": name,
            "cells": [
                {"method": m, "wanted": 9, "count": c, "reached": c > 0, "purity": 0.1 * c}
                for m, c in counts.items()
            ],
        }

    clouds = [cloud("x", a=9, b=8), cloud("y", a=1, b=0, c=5), cloud("z", a=2, b=4, c=9)]
    clouds.append(cloud("w", a=1, b=3))
    found = means(clouds, ["a", "b", "c"], 9)
    assert [(row["method"], row["scans"], row["count"]) for row in found] == [
        ("a", 3, 4.0),
        ("b", 3, 5.0),
    ]
    assert found[0]["purity"] == pytest.approx(0.4)


def test_what_is_not_measured_again_stays(results, monkeypatch):
    monkeypatch.setattr(study, "run_apart", here)
    monkeypatch.setattr(study, "METHODS", (THEIRS, ABSENT, OURS))
    again = study.study([scan()], (OURS,), study.Plan(PLAN.counts, 60.0, results))
    assert [row["name"] for row in again["scans"]] == ["made", "again"]
    methods = [cell["method"] for cell in again["scans"][0]["cells"]]
    assert methods == [cell["method"] for cell in results["scans"][0]["cells"]]
    assert len(rows(again)) == 3
    assert again["missing"] == results["missing"]


def test_the_page_says_it_all(results, tmp_path):
    text = page(results)
    for block in re.findall(r"(?:^\|.*\|\n)+", text, re.MULTILINE):
        assert len({line.count("|") for line in block.splitlines()}) == 1
    assert "nobody (not installed; pip install no-such-package)" in text
    assert "scans of 2 with a higher mean IoU" in text
    draw(results, tmp_path / "a.png")
    assert imread(tmp_path / "a.png").shape == (1100, 1900, 4)


# --- the command -----------------------------------------------------------------------------


@pytest.fixture
def evaluate(capsys, monkeypatch):
    """Run the command; gives exit code, stdout, stderr."""
    monkeypatch.setattr(study, "run_apart", here)
    monkeypatch.setattr(study, "METHODS", (THEIRS, OURS, ABSENT))

    def run(*words):
        code = main(["evaluate", "partition", *map(str, words)])
        return (code, *capsys.readouterr())

    return run


def test_the_command_prints_json(evaluate):
    code, out, _ = evaluate(*DRIVE, "--counts", 20, "--json")
    results = json.loads(out)
    assert code == 0
    assert results["scans"][0]["instances"] > 3
    assert [cell["wanted"] for cell in results["scans"][0]["cells"]][:2] == ["own", 20]


def test_the_command_writes_and_adds(evaluate, tmp_path):
    words = [*DRIVE, "--counts", 20, "-q", "-o", tmp_path]
    assert evaluate(*words, "--methods", "cut")[0] == 0
    assert evaluate(*words, "--methods", "obj", "--add-to", tmp_path / "quality.json")[0] == 0
    text = (tmp_path / "quality.md").read_text(encoding="utf-8")
    assert "| cut-pursuit" in text and "| objects" in text and "nobody" not in text
    assert "](quality_industrial.png)" in text
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "quality.json",
        "quality.md",
        "quality.png",
        "quality_industrial.png",
    ]


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["missing.npz"], "there is no missing.npz"),
        (["bare.npz"], "bare.npz has no classes; it must have a field class or coarse"),
        (["blank.npz"], "blank.npz has no point of a known class"),
        (["good.npz", "--duration", "3"], "--duration is for simulated scenes"),
        (["good.npz", "--methods", "magic"], "there is no method 'magic'; there are cut-pursuit"),
        (["good.npz", "--counts", "0"], "--counts has 0; it must be 1 or more"),
        (["good.npz", "--limit", "0"], "--limit is 0; it must be more than 0 s"),
        (["good.npz", "--add-to", "broken.json"], "broken.json holds no results"),
        (["good.npz", "--add-to", "other.json"], "other.json is of --counts 7; give the same"),
        (["good.npz", "--add-to", "nowhere.json"], "nowhere.json: No such file"),
    ],
)
def test_what_is_wrong_is_one_line(evaluate, tmp_path, monkeypatch, words, says):
    monkeypatch.chdir(tmp_path)
    points = np.zeros((3, 3))
    np.savez("bare.npz", xyz=points)
    np.savez("blank.npz", xyz=points, coarse=np.zeros(3, np.int8))
    np.savez("good.npz", xyz=points, coarse=np.ones(3, np.int8))
    (tmp_path / "broken.json").write_text("{", encoding="utf-8")
    (tmp_path / "other.json").write_text('{"counts": [7]}', encoding="utf-8")
    code, out, err = evaluate(*words)
    assert (code, out) == (2, "")
    assert err.startswith(f"ellipseg: {says}") and err.count("\n") == 1
