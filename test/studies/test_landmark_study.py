"""The command `python -m studies.landmarks` on short drives."""

import json

import pytest

from studies.landmarks.__main__ import main

SHORT = ["--scenes", "woodland", "--seeds", "1", "--others", "0", "--quick", "-q"]


@pytest.fixture(scope="module")
def output(tmp_path_factory):
    folder = tmp_path_factory.mktemp("landmarks")
    assert main([*SHORT, "-o", str(folder)]) == 0
    return folder


def test_the_study_counts_repeated_landmarks(output):
    results = json.loads((output / "landmarks.json").read_text())
    assert [run["direction"] for run in results["runs"]] == ["same", "opposite"]
    for run in results["runs"]:
        counts = run["counts"]["all"]
        assert counts["visible_repeated"] <= min(counts["visible"], counts["repeated"])
        assert counts["landmarks"] == sum(run["landmarks"]) > 10
        assert counts["visible_repeated"] > 0.5 * counts["visible"] > 0
    same = results["runs"][0]["association"]["0.5 m, 3 degrees"]
    assert 0 < same["correct"] <= same["pairs"]


def test_the_study_writes_page_and_chart(output):
    page = (output / "landmarks.md").read_text()
    assert "woodland" in page and "## Association" in page
    assert (output / "landmarks.png").stat().st_size > 10_000


def test_earlier_runs_are_not_measured_again(output, tmp_path, monkeypatch):
    monkeypatch.setattr("studies.landmarks.study.drive", lambda *_, **__: pytest.fail("driven"))
    earlier = output / "landmarks.json"
    assert main([*SHORT, "--add-to", str(earlier), "-o", str(tmp_path)]) == 0
    results = (json.loads((f / "landmarks.json").read_text()) for f in (output, tmp_path))
    runs, again = (result["runs"] for result in results)
    assert runs == again


@pytest.mark.parametrize(
    ("options", "words"),
    [(["--scenes", "moon"], "no scene 'moon'"), (["--seeds", "0"], "--seeds is 0; it must be 1")],
)
def test_invalid_options_are_refused_in_one_line(options, words, capsys):
    assert main(options) == 2
    assert words in capsys.readouterr().err
