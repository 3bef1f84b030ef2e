"""Pages, requirement tables, JSON, timing and the command line that all studies share."""

import json

import pytest

import studies
from ellipseg_ros.errors import EllipsegError
from studies.__main__ import main as list_studies
from studies.report.command import read_results, run_command, write
from studies.report.machine import machine_line
from studies.report.page import Page, Section, Table, json_text
from studies.report.requirements import Target, check, requirement_table
from studies.report.timing import in_turn, ratio, spread


def test_columns_of_numbers_are_aligned_to_the_right():
    text = Table(["what", "ms"], [["a", "1.5 (1 to 2)"], ["b", "-"]]).markdown()
    assert text.splitlines()[1:] == [
        "| ---- | -----------: |",
        "| a    | 1.5 (1 to 2) |",
        "| b    |            - |",
    ]


def test_a_page_has_its_parts_in_order():
    page = Page(
        name="speed",
        title="Speed",
        introduction=["How fast it is."],
        sections=[Section("Times", ["All of " + "many " * 30 + "times.", Table(["s"], [["1"]])])],
        method=["Alternating runs."],
        command="python -m studies.speed",
        chart="Times as bars",
    )
    text = page.markdown()
    parts = ["# Speed\n", "How fast", "![Times as bars](speed.png)", "## Times\n", "|   s |"]
    parts += ["## How it was measured", "Alternating", "```bash\npython -m studies.speed\n```\n"]
    places = [text.index(part) for part in parts]
    assert places == sorted(places)
    assert max(map(len, text.splitlines())) <= 99
    assert page.tables().startswith("## Times\n") and "![" not in page.tables()


@pytest.mark.parametrize(("load", "busy"), [(0.5, False), (2.0, False), (2.1, True)])
def test_load_by_other_programs_is_reported(load, busy):
    versions = {"numba": "1"}
    machine = {"cpu": "x", "cores": 2, "memory_gb": 8.0, "system": "Linux", "python": "3"}
    line = machine_line(machine | {"versions": versions, "load_before": load})
    assert ("Other programs were running" in line) is busy


@pytest.mark.parametrize(
    ("value", "must", "aim", "result"),
    [(0.05, 0.03, 0.05, "aim met"), (0.04, 0.03, 0.05, "met"), (0.02, 0.03, 0.05, "not met")]
    + [(0.1, 0.2, 0.1, "aim met"), (0.15, 0.2, 0.1, "met"), (0.3, 0.2, 0.1, "not met")]
    + [({"median": 0.15}, 0.2, 0.1, "met"), (None, 0.2, 0.1, "not measured")],
)
def test_a_target_is_an_upper_or_a_lower_limit(value, must, aim, result):
    assert Target("what", must, aim).judge(value)["result"] == result


def test_a_requirement_table_has_the_columns_that_apply():
    limits = requirement_table([Target("time", 2.0, 1.0, "s").judge(spread([3.0, 3.0]))])
    assert limits.head == ["requirement", "must", "aim", "measured", "runs", "result"]
    cells = ["time", "≤ 2 s", "≤ 1 s", "3 (3 to 3) s", "2", "**not met**"]
    assert limits.rows == [cells]
    checks = requirement_table([check("it ends", "SIGINT, 9 times", "in 1 s", True)])
    assert checks.head == ["requirement", "test", "measured", "result"]
    assert checks.rows == [["it ends", "SIGINT, 9 times", "in 1 s", "met"]]


def test_json_has_a_line_for_each_flat_record():
    results = {"name": "x", "rows": [{"a": 1, "b": {"c": 2}}, {"a": 3, "b": {"c": [4]}}], "no": []}
    text = json_text(results)
    assert json.loads(text) == results
    assert '  {"a": 1, "b": {"c": 2}},\n' in text
    assert text.count("\n") > 6


def test_calls_alternate_and_slow_ones_run_once():
    called = []
    calls = {"a": lambda: called.append("a"), "b": lambda: called.append("b")}
    times = in_turn(calls, 2)
    assert called == ["a", "b"] * 3
    assert {name: len(values) for name, values in times.items()} == {"a": 2, "b": 2}
    called.clear()
    assert len(in_turn(calls, 2, max_repeated_s=0.0)["a"]) == 1
    assert called == ["a", "b"]


def test_ratios_are_of_pairs():
    assert ratio([2.0, 40.0, 600.0], [1.0, 10.0, 100.0])["median"] == 4.0
    assert spread([1.0, 2.0, 3.0, 4.0, 5.0], 10.0) == {
        "median": 30.0,
        "low": 20.0,
        "high": 40.0,
        "runs": 5,
    }


def test_every_study_is_listed(capsys):
    assert list_studies() == 0
    lines = capsys.readouterr().out.splitlines()
    for name, (measures, duration) in studies.STUDIES.items():
        assert any(
            line.startswith(name) and measures in line and duration in line for line in lines
        )


def test_results_are_written_and_read(tmp_path):
    def page(results):
        return Page("speed", "Speed", [str(results["ms"])], [], "python -m studies.speed")

    def draw(results, path):
        path.write_bytes(b"PNG")

    paths = write({"ms": 5}, page, tmp_path / "new", draw)
    assert [path.name for path in paths] == ["speed.md", "speed.json", "speed.png"]
    assert read_results(tmp_path / "new" / "speed.json", "ms") == {"ms": 5}
    with pytest.raises(EllipsegError, match="speed.json holds no results of this study"):
        read_results(tmp_path / "new" / "speed.json", "rows")


def fails(error):
    def run(args):
        raise error

    return run


@pytest.mark.parametrize(
    ("error", "code", "message"),
    [
        (EllipsegError("there is no x"), 2, "studies.paper: there is no x\n"),
        (
            FileNotFoundError(2, "No such file", "x.json"),
            2,
            "studies.paper: x.json: No such file\n",
        ),
        (KeyboardInterrupt(), 130, "studies.paper: interrupted\n"),
    ],
)
def test_an_expected_error_is_one_line(error, code, message, capsys):
    assert run_command("paper", lambda parser: None, fails(error), []) == code
    assert capsys.readouterr() == ("", message)


def test_the_help_has_description_and_examples(capsys):
    with pytest.raises(SystemExit) as ended:
        run_command("paper", lambda parser: None, lambda args: 0, ["--help"], "examples:\n  one")
    text = capsys.readouterr().out
    assert ended.value.code == 0
    assert "python -m studies.paper" in text and "examples:\n  one" in text
    assert all(option in text for option in ("--output", "--json", "--quiet"))
