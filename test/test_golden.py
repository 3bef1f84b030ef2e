"""What the scenes gave once, they give still: on other machines nearly, here to the last bit."""

import json

import golden
import pytest

from ellipseg_ros.core import jit
from studies.endurance.determinism import determinism, run_digests
from studies.endurance.digests import CRITERIA, digest, in_pieces, last_update
from studies.endurance.requirements import Options

EXPECTED = json.loads(golden.FILE.read_text(encoding="utf-8"))
# sin, cos and log differ between machines by an ulp: a merge here and there goes the other way.
COUNTS, AICC = 0.01, 0.01  # share of the number of segments; of the AICc, a point


def assert_golden(found, name):
    facts, expected = golden.facts(found), EXPECTED[name]
    for key in ("points", "segmented"):
        assert facts[key] == expected[key], key
    for key in ("segments", "objects"):
        assert facts[key] == pytest.approx(expected[key], rel=COUNTS, abs=2), key
    assert facts["aicc_per_point"] == pytest.approx(expected["aicc_per_point"], abs=AICC)


@pytest.mark.parametrize(
    "name", [name for name in EXPECTED if name.split(", ")[0] in golden.SIMULATED]
)
def test_simulated_scenes_equal_golden_results(name):
    scene, criterion = name.split(", ")
    assert_golden(last_update(golden.simulated(scene), criterion), name)


@pytest.mark.parametrize("scene", golden.REAL)
def test_real_scenes_equal_golden_results(scene, shared_data):
    assert_golden(last_update(golden.real(shared_data, scene)), f"{scene}, shape")


def test_every_golden_scene_is_compared():
    names = {f"{scene}, {rule}" for scene in golden.SIMULATED for rule in CRITERIA}
    names |= {f"{scene}, shape" for scene in golden.REAL}
    assert EXPECTED.keys() <= names
    assert {name.split(", ")[0] for name in EXPECTED} == {*golden.SIMULATED, *golden.REAL}


def with_threads(count, monkeypatch):
    for module in ("jit", "merge", "edge_sorting"):
        monkeypatch.setattr(f"ellipseg_ros.core.{module}.THREADS", count)
    monkeypatch.setattr(jit, "MIN_ROWS_PER_THREAD", 100)


@pytest.mark.parametrize("criterion", CRITERIA)
def test_results_do_not_depend_on_threads_or_chunks(criterion, monkeypatch):
    sweeps = golden.simulated("industrial")
    expected = digest(last_update(sweeps, criterion))
    for threads in (1, 2, 4):
        with_threads(threads, monkeypatch)
        assert digest(last_update(sweeps, criterion)) == expected, threads
    for pieces in (2, 5):
        assert digest(last_update(list(in_pieces(sweeps, pieces)), criterion)) == expected


def test_a_different_digest_is_reported():
    digests = iter("aabaa")
    (row,) = determinism(Options(quick=True), lambda *_: {"digests": next(digests)})
    assert row.measured == "4 of 5 runs equal" and not row.met


def test_another_process_gives_the_same_digests():
    results = run_digests(("roadway",), 2, 2, [])
    sweeps = golden.simulated("roadway")
    expected = {f"roadway, {rule}": digest(last_update(sweeps, rule)) for rule in CRITERIA}
    assert results["digests"] == expected
