"""The benchmark measures every section and names what it did not measure."""

import json
import time

import numpy as np
import pytest
from tables import check_tables

from ellipseg_ros.segmenter import Segmenter
from ellipseg_ros.simulation.simulator import simulate
from studies.benchmark import peers, stages, streams, targets
from studies.benchmark.__main__ import main
from studies.benchmark.chart import draw
from studies.benchmark.page import page
from studies.benchmark.sections import SECTIONS, compile_kernels, measure
from studies.report import packages

TINY = streams.Sizes(
    window=1.0,
    points=1500,
    runs=2,
    fill=1.0,
    seconds=1,
    tenths=2,
    per_batch=2,
    lengths=(1.0, 4.0),
    densities=(2_000, 20_000),
    density_window=0.5,
    listen=1.0,
    starts=1,
    cold=False,
    factors=(1.0,),
)
OFFLINE = ["batch", "peers", "stages", "updates", "length", "density", "tuning"]
LIVE = ["publishing", "latency", "memory", "start"]


@pytest.fixture(scope="module")
def results():
    """All sections without ROS; one of the other libraries is not installed."""
    absent = peers.KNN._replace(name="absent", module="no_such_module", package="no-such-package")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(peers, "PEERS", (*peers.PEERS[:2], absent))
        return measure(OFFLINE, TINY)


@pytest.fixture(scope="module")
def live_results():
    return measure(LIVE, TINY)


def spreads(value):
    """Every median with its quartiles, however deep."""
    if isinstance(value, dict) and "median" in value:
        yield value
    elif isinstance(value, dict | list):
        for item in value.values() if isinstance(value, dict) else value:
            yield from spreads(item)


def test_an_interrupt_keeps_the_finished_sections(monkeypatch):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setitem(SECTIONS, "batch", lambda *_: {"points": 1})
    monkeypatch.setitem(SECTIONS, "peers", interrupted)
    monkeypatch.setattr("studies.benchmark.sections.compile_kernels", lambda: None)
    monkeypatch.setattr("studies.benchmark.targets.judged", lambda _: [])
    assert measure(["batch", "peers", "stages"], TINY)["sections"] == {"batch": {"points": 1}}
    with pytest.raises(KeyboardInterrupt):
        measure(["peers"], TINY)


def test_every_section_has_its_numbers(results):
    assert set(results["sections"]) == set(OFFLINE)
    assert len(results["sections"]["updates"]["cases"]) == 14
    assert {case["window_s"] for case in results["sections"]["length"]["cases"]} == {1.0, 4.0}
    values = list(spreads(results))
    assert len(values) > 100
    for value in values:
        assert 0.0 <= value["low"] <= value["median"] <= value["high"]
        assert value["runs"] >= 1
    for name in ("batch", "updates", "length", "density", "tuning"):
        for case in results["sections"][name]["cases"]:
            assert case.get("ratio", {"median": 1.0})["median"] > 0.0


def test_every_target_is_judged(results):
    measured = {row["key"]: row for row in results["rows"]}
    assert list(measured) == list(targets.ROWS)
    for key in ("tuning", "update_tenth", "update_second", "length_tenth", "length_second"):
        assert measured[key]["measured"]["median"] > 0.0
        assert measured[key]["result"] in ("aim met", "met", "not met")
    assert measured["memory"]["measured"] is None
    assert measured["memory"]["result"] == "not measured"


def test_a_missing_library_is_named(results):
    missing = results["sections"]["peers"]["missing"]
    assert missing["absent"] == "not installed; pip install no-such-package"
    assert "absent (not installed; pip install no-such-package)" in page(results).tables()


def test_a_library_that_does_not_load_gives_its_reason(monkeypatch):
    def fail(name):
        raise ImportError("libmissing.so: cannot open shared object file")

    monkeypatch.setattr(packages, "import_module", fail)
    assert packages.load(peers.KNN.package, peers.KNN.module)[1].startswith(
        "does not load: libmissing.so"
    )


def test_the_search_of_scipy_finds_the_neighbours():
    points = np.random.default_rng(0).normal(size=(100, 3))
    peer = next(peer for peer in peers.PEERS if peer.package == "scipy")
    distances, indices = peer.prepare(packages.load(peer.package, peer.module)[0], points)()
    assert indices.shape == (100, 10)
    assert (indices[:, 0] == np.arange(100)).all()
    assert (np.diff(distances, axis=1) >= 0.0).all()


def test_the_page_has_a_table_for_every_section(results):
    text = page(results).markdown()
    assert check_tables(text) == 1 + len(OFFLINE)
    assert "Measured with `--quick`" in text


def test_the_chart_has_a_panel_for_what_was_measured(results, tmp_path):
    draw(results, tmp_path / "all.png")
    draw(results | {"sections": {}}, tmp_path / "rows.png")
    sizes = [(tmp_path / name).read_bytes() for name in ("all.png", "rows.png")]
    assert all(data.startswith(b"\x89PNG") for data in sizes)
    assert len(sizes[0]) > len(sizes[1])


def test_the_stages_add_up_to_the_whole(results):
    for name in ("batch", "1 s", "0.1 s"):
        parts = {
            row["stage"]: row[name]["median"] for row in results["sections"]["stages"]["stages"]
        }
        whole = parts.pop("total")
        assert parts["neighbours"] > 0.0 and parts["merge"] > 0.0
        assert sum(parts.values()) == pytest.approx(whole, rel=0.3)


def test_the_stage_clock_restores_the_pipeline():
    before = [getattr(owner, call) for _, owner, call in stages.STAGES]
    with stages.stage_clock() as clock:
        segmentation = Segmenter().process(next(iter(simulate("industrial", duration=0.2))))
    assert len(segmentation.ids)
    assert [getattr(owner, call) for _, owner, call in stages.STAGES] == before
    assert all(seconds >= 0.0 for seconds in clock.seconds.values())


def test_a_nested_stage_counts_once():
    clock = stages.StageClock()
    inner = clock.wrap("ids", lambda: time.sleep(0.02))
    outer = clock.wrap("segments", inner)
    outer()
    assert clock.seconds["ids"] >= 0.02
    assert clock.seconds["segments"] < 0.01


def test_thinning_takes_a_share_evenly():
    sweeps = list(simulate("industrial", duration=1.0))
    kept = list(streams.thinned(sweeps, 0.25))
    for sweep, few in zip(sweeps, kept, strict=True):
        assert len(few) == pytest.approx(0.25 * len(sweep), abs=2)


@pytest.mark.parametrize("rate", [2_000, 20_000])
def test_a_dense_drive_has_the_rate_and_the_length(rate):
    sweeps = list(streams.dense(rate, 1.0))
    assert streams.points_per_second(sweeps) == pytest.approx(rate, rel=0.02)
    stamps = [sweep.stamp_ns for sweep in sweeps]
    assert np.diff(stamps) == pytest.approx(1e8, rel=1e-3)
    assert all((sweep.offsets_ns >= 0).all() for sweep in sweeps)
    assert all((sweep.offsets_ns < 1.1e8).all() for sweep in sweeps)


def test_steps_are_whole():
    drive = iter(simulate("industrial", duration=1.0))
    assert len(list(streams.steps(drive, 0.5, 1))) == 1
    assert len(list(streams.steps(drive, 0.1, 99))) == 5


def test_the_node_is_measured(live_results):
    found = live_results["sections"]
    assert list(found) == LIVE
    assert found["publishing"]["points"] == 1500
    assert found["publishing"]["received_ms"]["median"] > 0.0
    case = found["latency"]["cases"][0]
    assert 0.0 < case["latency_ms"]["p50"] <= case["latency_ms"]["p99"]
    assert case["latency_ms"]["updates"] > 0
    assert case["clouds_lost"] == 0
    assert found["memory"]["points"] == pytest.approx(1500, rel=0.2)
    assert found["memory"]["peak_mb"] > 20.0
    assert found["start"]["warm_s"]["median"] > 0.1
    assert check_tables(page(live_results).markdown()) == len(
        LIVE
    )  # memory: none; requirements: 1


def test_the_command_prints_json(capsys):
    compile_kernels()
    assert main(["--quick", "--only", "batch", "--json"]) == 0
    results = json.loads(capsys.readouterr().out)
    assert list(results["sections"]) == ["batch"]
    assert results["machine"]["cores"] >= 1


def test_the_command_writes_page_numbers_and_chart(monkeypatch, tmp_path, results):
    monkeypatch.setattr("studies.benchmark.__main__.measure", lambda *_: results)
    assert main(["--quick", "-q", "-o", str(tmp_path)]) == 0
    assert {path.name for path in tmp_path.iterdir()} == {
        "benchmark.md",
        "benchmark.json",
        "benchmark.png",
    }
    assert json.loads((tmp_path / "benchmark.json").read_text())["rows"] == results["rows"]


@pytest.mark.parametrize("words", [["--only", "speed"], ["--data", "missing.bag"]])
def test_a_wrong_option_is_one_line(capsys, words):
    assert main(words) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_the_help_names_every_section(capsys):
    with pytest.raises(SystemExit):
        main(["--help"])
    words = capsys.readouterr().out.replace(",", "").split()
    assert set(SECTIONS) <= set(words)
