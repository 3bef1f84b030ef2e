"""The command `ellipseg doctor`: exit codes, output, and what it does without ROS."""

import json
import time
from pathlib import Path

import pytest
import raw_rooms
from numba import config

from ellipseg_ros.cli import doctor
from ellipseg_ros.cli.main import main
from ellipseg_ros.cli.parser import build_parser
from ellipseg_ros.doctor import speed
from ellipseg_ros.doctor.findings import ERROR, Finding, error, ok, warn
from ellipseg_ros.io.bag import BagSink
from ellipseg_ros.segmenter import warm_up


@pytest.mark.parametrize(
    ("findings", "code"),
    [([ok("a")], 0), ([ok("a"), warn("b", "do")], 0), ([warn("b", "do"), error("c", "do")], 1)],
)
def test_exit_code_and_lines(
    findings: list[Finding],
    code: int,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(doctor, "check_installation", lambda _: iter(findings))
    monkeypatch.setattr(doctor, "check_environment", lambda *_: iter(()))
    words = ["doctor", "--offline", "--no-speed"]
    assert main(words) == code
    output = capsys.readouterr().out
    assert all(f"{finding.level:<6} {finding.text}\n" in output for finding in findings)
    assert main([*words, "--quiet"]) == code
    output = capsys.readouterr().out
    assert ("-> do" in output) == (code == 1) and "ok" not in output and "warn" not in output
    assert main([*words, "--json"]) == code
    rows = json.loads(capsys.readouterr().out)
    assert [row["level"] for row in rows] == [finding.level for finding in findings]
    assert rows[0]["section"] == "installation"


@pytest.mark.parametrize("seconds", ["0", "-1", "nan", "1e9"])
def test_invalid_time_of_observation_is_refused(
    seconds: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["doctor", f"--seconds={seconds}"]) == 2
    assert "--seconds" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("program", "problem"),
    [
        ("import rclpi", "ROS does not load: ModuleNotFoundError: No module named 'rclpi'"),
        ("import os; os._exit(102)", "ROS does not load: the process ended with 102"),
        ("import time; time.sleep(600)", "ROS does not load within 5 s"),
    ],
)
def test_ros_that_does_not_load_is_reported(
    program: str, problem: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(doctor, "IMPORT_ROS", program)
    monkeypatch.setattr(doctor, "IMPORT_TIMEOUT_S", 5.0 if "sleep" in program else 60.0)
    assert main(["doctor", "--json", "--no-speed"]) == 1
    rows = json.loads(capsys.readouterr().out)
    assert any(row["text"] == problem and row["level"] == ERROR for row in rows)
    assert not any(row["section"] == "graph" for row in rows)


def test_missing_middleware_is_an_error(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("RMW_IMPLEMENTATION", "rmw_no_such")
    assert main(["doctor", "--json", "--no-speed"]) == 1
    rows = json.loads(capsys.readouterr().out)
    assert any("RMW_IMPLEMENTATION rmw_no_such" in row["text"] for row in rows)
    assert not any(row["section"] == "graph" for row in rows)


def test_recording_is_checked_in_place_of_the_graph(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with BagSink(tmp_path / "raw") as bag:
        for event in raw_rooms.in_order(raw_rooms.clouds(12, 400), raw_rooms.odometry(12)):
            bag.write_event(event)
    main(["doctor", str(tmp_path / "raw"), "--no-speed", "--json"])
    rows = [row for row in json.loads(capsys.readouterr().out) if row["section"] == "recording"]
    assert [row["level"] for row in rows] == ["ok"] * 4, rows
    assert "poses: the topic /odometry" in rows[1]["text"]
    assert rows[3]["text"].endswith("odometry_stamp exact is right")
    assert main(["doctor", str(tmp_path / "missing"), "--no-speed", "--json"]) == 1
    (row,) = [r for r in json.loads(capsys.readouterr().out) if r["section"] == "recording"]
    assert "there is no" in row["text"]


def test_this_installation_works(capsys: pytest.CaptureFixture[str]) -> None:
    code = main(["doctor", "--offline", "--no-speed", "--json"])
    rows = json.loads(capsys.readouterr().out)
    errors = [row for row in rows if row["level"] == ERROR and "NUMBA_DISABLE" not in row["text"]]
    assert not errors, (code, errors)
    assert build_parser().parse_args(["doctor"]).topic == ""


@pytest.mark.skipif(config.DISABLE_JIT, reason="measures compiled kernels")
def test_speed_check_reports_points_per_second_within_its_limit(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    warm_up()
    monkeypatch.setattr(speed, "DRIVE_S", 3.0)
    assert speed.measure_speed() > 1000.0
    started = time.monotonic()
    monkeypatch.setattr(speed, "TIME_LIMIT_S", 0.0)  # ends after the first update
    main(["doctor", "--offline", "--json"])
    assert time.monotonic() - started < 60.0
    (row,) = [row for row in json.loads(capsys.readouterr().out) if row["section"] == "speed"]
    assert row["level"] == "ok" and "points per second" in row["text"]
