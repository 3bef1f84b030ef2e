"""The study of the paper: figures, numbers, and verdicts that follow from them."""

import json
import re

import numpy as np
import pytest
from matplotlib.image import imread
from tables import check_tables

from ellipseg_ros.config import Config
from ellipseg_ros.core.criteria import CRITERIA
from ellipseg_ros.io.sources import open_source
from ellipseg_ros.segmenter import segment
from ellipseg_ros.tuning.curve import Curve
from ellipseg_ros.tuning.search import Search, tune
from studies.paper import readings
from studies.paper.__main__ import main
from studies.paper.facts import criterion_facts, first_window, shared, with_threshold
from studies.paper.findings import ADDITIONAL, FINDINGS, Finding, judge
from studies.paper.page import page

FIGURES = ["figure3", "figure4", "figure5", "figure6_industrial", "figure6_woodland", "figure7"]


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """The results of the command on scenes of half a second and a cloud."""
    parent = tmp_path_factory.mktemp("paper")
    cloud = parent / "yard.npz"
    np.savez(cloud, xyz=np.random.default_rng(0).uniform(0.0, [20.0, 20.0, 0.2], (800, 3)))
    folder = parent / "out"
    words = [str(cloud), "--duration", "0.5", "--count", "5", "-q", "-o", str(folder)]
    assert main(words) == 0
    return folder


@pytest.fixture(scope="module")
def facts(results):
    return json.loads((results / "paper.json").read_text())


def curve(losses, thresholds=(1.0, 2.0, 4.0)):
    """A curve of shape, whose singletons have an AICc of 1."""
    values = np.array(losses)
    return Curve("shape", 10, 1.0, np.array(thresholds), values, values, np.array([9, 5, 1]))


def test_the_scenes_are_the_simulated_and_the_given_ones(facts):
    kinds = {scene["name"]: scene["kind"] for scene in facts["scenes"]}
    simulated = ("industrial", "woodland", "roadway", "mixed")
    assert kinds == dict.fromkeys(simulated, "simulated") | {"yard": "recorded"}
    assert all(list(scene["criteria"]) == list(CRITERIA) for scene in facts["scenes"])


def test_the_numbers_are_those_of_a_segmentation_at_the_minimum(facts):
    source = open_source("sim:woodland", duration=0.5)
    cut = first_window(source, Config())
    scene = next(scene for scene in facts["scenes"] if scene["name"] == "woodland")
    for name, one in scene["criteria"].items():
        found = segment(cut.points, Config(name, one["threshold"]), cut.origin)
        count = found.ellipsoids.count
        assert one["aicc"] == found.aicc / found.counts.segmented
        assert one["count"] == len(count)
        assert one["small"] == np.count_nonzero(count < 12)
        assert one["largest"] == count.max() / found.counts.segmented
        assert one["variance"] + one["bias"] == pytest.approx(one["aicc"])
        largest = np.sort(count)[::-1]
        assert largest[: one["half"]].sum() >= 0.5 * count.sum()
        assert largest[: one["half"] - 1].sum() < 0.5 * count.sum()


def test_the_size_is_the_mean_semi_axis_of_the_median_point():
    rng = np.random.default_rng(1)
    points = rng.normal(0.0, [2.0, 1.0, 0.5], (2000, 3))
    tuned = tune(points, Config(), Search(count=3, refinements=0))
    everything = segment(points, Config(threshold=1e9))
    facts = criterion_facts(tuned, everything, Config())
    assert len(everything.ellipsoids) == 1
    assert facts["size_m"] == pytest.approx(1.0, rel=0.1)
    assert facts["half"] == 1 and facts["largest"] == 1.0


def test_the_shared_threshold_has_the_lowest_maximum_loss():
    first, second = curve([0.0, 0.1, 0.8]), curve([0.9, 0.2, 0.0])
    assert shared([first, second]) == {"threshold": 2.0, "worst_loss": pytest.approx(0.2)}


def test_a_curve_keeps_the_settings_but_criterion_and_threshold():
    config = Config("density", window_duration=3.0)
    changed = with_threshold(config, curve([0.5, 0.1, 0.8]))
    assert (changed.criterion, changed.threshold) == ("shape", 2.0)
    assert changed.window_duration == 3.0


def scene(**changes):
    """Facts of a scene that shows every finding, with some changed: shape_count=5, say."""
    one = {"loss_at_lowest": 0.5, "loss_at_highest": 0.5, "loss_at_default": 0.01}
    criteria = {
        "shape": one
        | {"aicc": 3.0, "completion": 0.9, "count": 5000, "small": 4000}
        | {"largest": 0.4, "half": 5, "size_m": 1.0},
        "density": one
        | {
            "aicc": 2.0,
            "completion": 0.95,
            "count": 4000,
            "half": 900,
            "size_m": 0.2,
            "largest": 0.01,
        },
        "parsimony": one | {"aicc": 1.0, "completion": 0.99, "count": 500},
    }
    for name, value in changes.items():
        criterion, _, key = name.partition("_")
        criteria[criterion][key] = value
    return {"criteria": criteria}


@pytest.mark.parametrize(
    ("change", "lost"),
    [
        ({}, []),
        ({"shape_loss_at_highest": 0.01}, ["The AICc over the threshold has a minimum"]),
        ({"shape_completion": 0.7}, ["The minima are at 80 % merge completion or later"]),
        (
            {"shape_completion": 0.96},
            ["The minimum of density is at a later merge completion than that of shape"],
        ),
        ({"shape_aicc": 1.5}, ["The minimum of density is lower than that of shape"]),
        (
            {"shape_count": 900, "shape_small": 800},
            ["Shape leaves thousands of ellipsoids", "Density leaves fewer ellipsoids than shape"],
        ),
        ({"shape_small": 100}, ["Many of the ellipsoids that shape leaves are small"]),
        ({"density_half": 4}, ["Shape finds larger structures than density"]),
        ({"density_size_m": 1.1}, ["Density fits more tightly than shape"]),
        ({"density_largest": 0.3}, ["Density tessellates the ground"]),
        ({"shape_largest": 0.1}, ["Shape makes the ground of a forest one segment"]),
        ({"density_aicc": 0.5}, ["Parsimony has a lower AICc than shape and density"]),
        ({"parsimony_count": 4500}, ["Parsimony leaves fewer ellipsoids than shape and density"]),
        ({"density_loss_at_default": 0.06}, ["The default thresholds are near the minima"]),
    ],
)
def test_a_scene_that_differs_does_not_show_the_finding(change, lost):
    scenes = [scene(**change)]
    shown = {one.text: judge(one, scenes).holds for one in FINDINGS + ADDITIONAL}
    assert [text for text, holds in shown.items() if holds == "no"] == lost


def test_the_number_of_scenes_that_show_a_finding_is_given():
    finding = Finding(
        "", "", "", lambda one: one["shape"]["count"] > 1, lambda scenes: str(len(scenes))
    )
    verdict = judge(finding, [scene(), scene(shape_count=1), scene()])
    assert (verdict.measured, verdict.holds) == ("3", "in 2 of 3")
    assert judge(finding, []).holds == "-"


def test_the_page_follows_from_the_numbers(results, facts):
    text = (results / "paper.md").read_text()
    assert text == page(facts).markdown()
    assert check_tables(text) == 4
    for link in re.findall(r"\]\(([^)]+\.png)\)", text):
        assert (results / link).exists()
    assert facts["figures"] == FIGURES


def test_the_figures_show_something(results):
    for name in FIGURES:
        image = imread(results / f"paper_{name}.png")[..., :3]
        assert (np.ptp(image, axis=2) > 0.3).sum() > 2000
    seven = (results / "vector" / "paper_figure7.svg").read_text()
    for text in ("AICc per point", "threshold τ [m]", "woodland", "yard"):
        assert text in seven
    four = (results / "vector" / "paper_figure4.svg").read_text()
    assert "variance term" in four and four.count("τ = ") == 3
    assert "merge completion" in (results / "vector" / "paper_figure5.svg").read_text()


def test_a_second_run_gives_the_same(results, facts, capsys):
    cloud = results.parent / "yard.npz"
    words = [str(cloud), "--duration", "0.5", "--count", "5", "--no-pictures", "--json"]
    assert main([*words, "-o", str(results.parent / "again")]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    assert json.loads(out) == facts | {"figures": []}


def test_a_missing_source_is_one_line(tmp_path, capsys):
    assert main([str(tmp_path / "no.mcap"), "-o", str(tmp_path / "out")]) == 2
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.parametrize("group", ["SHAPES", "DENSITIES", "PARSIMONIES"])
def test_the_first_reading_of_a_group_equals_the_package(group):
    reading = getattr(readings, group)[0]
    cut = first_window(open_source("sim:roadway", duration=0.5), Config())
    scene = readings.scene_of(cut.points, cut.origin)
    name = dict(zip(["SHAPES", "DENSITIES", "PARSIMONIES"], CRITERIA, strict=True))[group]
    for threshold in (0.01, 1.0, 4.0):
        found = segment(cut.points, Config(name, threshold), cut.origin)
        aicc, count, largest = readings.try_threshold(scene, reading, threshold)
        assert count == len(found.ellipsoids)
        assert aicc == pytest.approx(found.aicc / found.counts.segmented, rel=1e-9)
        assert largest == found.ellipsoids.count.max() / found.counts.segmented
