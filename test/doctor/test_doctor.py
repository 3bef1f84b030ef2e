"""The doctor finds what is wrong, and nothing where nothing is."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from ellipseg_ros.cli import doctor
from ellipseg_ros.cli.main import main
from ellipseg_ros.cli.parser import build_parser
from ellipseg_ros.doctor import clouds, environment, graph, installation
from ellipseg_ros.doctor.environment import Environment, Place
from ellipseg_ros.doctor.findings import ERROR, OK, WARN, Finding, error, ok, warn
from ellipseg_ros.doctor.installation import Cache, Installation
from ellipseg_ros.doctor.seen import Cloud, End, Graph, SegmenterSeen, Topic
from ellipseg_ros.records import SECOND

ROOT = Path(__file__).parents[2]
PACKAGES = dict.fromkeys((*installation.NEEDED, *installation.FOR_FILES), "1.0")
CACHE = Cache(Path("/cache"), writable=True, kernels=90, free=2**33)
INSTALLED = Installation((3, 12), PACKAGES, {"/ws/ellipseg_ros": "0.1.0"}, 4, False, CACHE)
SURROUNDINGS = Environment(
    variables={"ROS_DISTRO": "jazzy"},
    python="3.12",
    middleware="rmw_fastrtps_cpp",
    wheels=False,
    prefixes=("/ws/install/ellipseg_ros",),
    logs=Place("/home/me/.ros/log", True, 2**33),
    shared_memory=Place("/dev/shm", True, 2**30),
    receive_buffer=212_992,
)


def bad(findings: list[Finding]) -> list[tuple[str, str]]:
    """Level and text of what isn't fine; whatever isn't comes with advice."""
    assert all(bool(one.do) == (one.level != OK) for one in findings)
    return [(one.level, one.what) for one in findings if one.level != OK]


def cloud(k: int, **changes: object) -> Cloud:
    """The k-th of a faultless stream of ten a second."""
    made = Cloud(
        arrived=100.0 + k / 10,
        age=0.05,
        stamp_ns=50 * SECOND + k * SECOND // 10,
        frame_id="odom",
        points=1000,
        finite=1000,
        size=16_000,
        fields=("x", "y", "z", "intensity"),
    )
    return replace(made, **changes)  # type: ignore[arg-type]  # whatever a test gives


SENDER = End("/odometry", graph.CLOUD, "reliable", "volatile")
RECEIVER = End("/ellipseg_segmenter", graph.CLOUD, "best_effort", "volatile")
VIEWER = End("/rviz", "ellipseg_ros/msg/SegmentArray", "reliable", "volatile")
POINTS = Topic("/points", (SENDER,), (RECEIVER,))
SEGMENTER = SegmenterSeen(
    node="/ellipseg_segmenter",
    inputs=(POINTS,),
    outputs=(Topic("/segments", (), (VIEWER,)),),
    level=0,
    message="segmenting",
    parameters={"use_sim_time": False, "max_points_per_second": 0, "max_lateness": 1.0},
)
GRAPH = Graph(POINTS, 5.0, tuple(map(cloud, range(40))), (), (SEGMENTER,), nodes=3)


def test_a_good_installation_is_good() -> None:
    assert bad(list(installation.check(INSTALLED))) == []


@pytest.mark.parametrize(
    ("changes", "level", "what"),
    [
        ({"python": (3, 9)}, ERROR, "Python 3.9"),
        ({"python": (3, 14)}, ERROR, "Python 3.14"),
        ({"versions": {**PACKAGES, "rosbags": ""}}, OK, ""),
        ({"versions": {k: v for k, v in PACKAGES.items() if k != "yaml"}}, ERROR, "PyYAML"),
        ({"versions": {k: v for k, v in PACKAGES.items() if k != "laspy"}}, WARN, "laspy"),
        ({"copies": {"/a": "0.1.0", "/b": "0.1.0"}}, WARN, "2 copies"),
        ({"copies": {"/a": "0.1.0", "/b": "0.2.0"}}, ERROR, "2 copies"),
        ({"cache": None, "problem": "ImportError: numpy"}, ERROR, "numba does not load"),
        ({"cache": replace(CACHE, writable=False)}, WARN, "can't be kept"),
        ({"cache": replace(CACHE, free=10**6)}, WARN, "left for compiled kernels"),
        ({"cache": replace(CACHE, kernels=0)}, WARN, "no compiled kernels yet"),
        ({"interpreted": True}, ERROR, "NUMBA_DISABLE_JIT"),
        ({"cores": 1}, WARN, "one core"),
        ({"messages": "messages do not load: X"}, ERROR, "messages do not load"),
    ],
)
def test_what_is_wrong_with_an_installation(
    changes: dict[str, object], level: str, what: str
) -> None:
    found = bad(list(installation.check(replace(INSTALLED, **changes))))  # type: ignore[arg-type]  # as given
    assert [one[0] for one in found] == ([level] if level != OK else [])
    assert all(what in text for _, text in found)


def test_copies_are_found_once_each(tmp_path: Path) -> None:
    (own,) = installation.copies([])
    assert installation.copies([str(Path(own).parent), ""]).keys() >= {own}
    other = tmp_path / "ellipseg_ros"
    other.mkdir()
    (other / "segmenter.py").touch()
    (tmp_path / "package.xml").write_text("<version>9.8.7</version>")
    assert installation.copies([str(tmp_path), str(tmp_path)])[str(other)] == "9.8.7"
    assert len(installation.copies([str(tmp_path)])) == 2


def test_a_good_environment_is_good() -> None:
    assert bad(list(environment.check(SURROUNDINGS))) == []


@pytest.mark.parametrize(
    ("variables", "level", "what"),
    [
        ({"ROS_DISTRO": "humble"}, ERROR, "humble"),
        ({"ROS_DOMAIN_ID": "300"}, ERROR, "300"),
        ({"ROS_DOMAIN_ID": "me"}, ERROR, "'me'"),
        ({"ROS_DOMAIN_ID": "150"}, WARN, "150"),
        ({"ROS_DOMAIN_ID": "42"}, OK, ""),
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "OFF"}, ERROR, "OFF"),
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNETS"}, ERROR, "SUBNETS"),
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}, OK, ""),
        ({"ROS_LOCALHOST_ONLY": "1"}, WARN, "ROS_LOCALHOST_ONLY"),
        ({"RMW_IMPLEMENTATION": "rmw_cyclonedds_cpp"}, WARN, "rmw_cyclonedds_cpp"),
        ({"RMW_IMPLEMENTATION": "rmw_fastrtps_cpp"}, OK, ""),
        ({"PYTHONPATH": "/opt/ros/jazzy/lib/python3.10/site-packages"}, ERROR, "3.10"),
        ({"PYTHONPATH": "/opt/ros/jazzy/lib/python3.12/site-packages"}, OK, ""),
        ({"ROS_SECURITY_ENABLE": "true"}, WARN, "starts unsecured"),
        ({"ROS_SECURITY_ENABLE": "true", "ROS_SECURITY_STRATEGY": "Enforce"}, OK, ""),
    ],
)
def test_what_is_wrong_with_the_variables(
    variables: dict[str, str], level: str, what: str
) -> None:
    mixed = {**SURROUNDINGS.variables, **variables}
    found = bad(list(environment.check(replace(SURROUNDINGS, variables=mixed))))
    assert [one[0] for one in found] == ([level] if level != OK else [])
    assert all(what in text for _, text in found)


@pytest.mark.parametrize(
    ("changes", "level", "what"),
    [
        ({"wheels": True}, WARN, "may mix"),
        ({"prefixes": ("/a", "/b")}, WARN, "2 times"),
        ({"middleware": ""}, ERROR, "no middleware"),
        ({"missing_files": ("/x.xml",)}, ERROR, "/x.xml"),
        ({"logs": Place("/l", False, 2**33)}, ERROR, "logs"),
        ({"logs": Place("/l", True, 2**20)}, WARN, "1 MiB left"),
        ({"shared_memory": None}, WARN, "no shared memory"),
        ({"shared_memory": Place("/dev/shm", True, 2**21)}, WARN, "2 MiB"),
        ({"receive_buffer": None}, OK, ""),
    ],
)
def test_what_is_wrong_with_the_surroundings(
    changes: dict[str, object], level: str, what: str
) -> None:
    found = bad(list(environment.check(replace(SURROUNDINGS, **changes))))  # type: ignore[arg-type]  # as given
    assert [one[0] for one in found] == ([level] if level != OK else [])
    assert all(what in text for _, text in found)


def test_folders_and_files_are_looked_at(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    (tmp_path / "ours" / "share" / "ellipseg_ros").mkdir(parents=True)
    variables = {
        "ROS_HOME": str(tmp_path / "home"),
        "AMENT_PREFIX_PATH": f"{tmp_path / 'ours'}:{tmp_path / 'other'}:{tmp_path / 'ours'}",
        "FASTDDS_DEFAULT_PROFILES_FILE": str(tmp_path / "missing.xml"),
        "FASTRTPS_DEFAULT_PROFILES_FILE": str(tmp_path / "file"),
    }
    found = environment.look(variables, "3.12", "rmw")
    assert found.logs.folder == str(tmp_path / "home" / "log") and found.logs.writable
    assert found.prefixes == (str(tmp_path / "ours"),)
    assert found.missing_files == (str(tmp_path / "missing.xml"),)
    assert not environment.place(str(tmp_path / "file" / "log")).writable
    assert environment.place(str(tmp_path / ("x" * 300))).writable  # looking at it is an error


def test_a_good_graph_is_good() -> None:
    assert bad(list(graph.check(GRAPH, receive_buffer=212_992))) == []


STREAM = GRAPH.clouds


@pytest.mark.parametrize(
    ("changes", "level", "what"),
    [
        ({"clouds": ()}, ERROR, "no cloud came"),
        ({"clouds": STREAM[:1]}, WARN, "a single cloud"),
        ({"clouds": (*STREAM[:9], *STREAM[25:])}, WARN, "none came for 1.7 s"),
        ({"clouds": tuple(replace(c, stamp_ns=0) for c in STREAM)}, ERROR, "zero"),
        ({"clouds": tuple(replace(c, stamp_ns=7 * SECOND) for c in STREAM)}, ERROR, "7.000 s"),
        ({"clouds": (*STREAM[:9], cloud(9, stamp_ns=0))}, WARN, "jumped back 1 times"),
        ({"clouds": (*STREAM[:9], cloud(9, stamp_ns=50 * SECOND))}, WARN, "younger"),
        ({"clouds": tuple(replace(c, age=7200.0) for c in STREAM)}, WARN, "2 h behind"),
        ({"clouds": tuple(replace(c, age=7200.0) for c in STREAM), "clock": True}, OK, ""),
        ({"clouds": tuple(replace(c, age=-1.5) for c in STREAM)}, WARN, "1.5 s ahead"),
        ({"clouds": tuple(replace(c, frame_id="velodyne") for c in STREAM)}, WARN, "velodyne"),
        ({"clouds": tuple(replace(c, frame_id="") for c in STREAM)}, WARN, "frame_id is empty"),
        ({"clouds": (*STREAM[:9], cloud(9, frame_id="map"))}, ERROR, "the frame changes"),
        ({"clouds": tuple(replace(c, finite=300) for c in STREAM)}, WARN, "70% of the points"),
        ({"clouds": tuple(replace(c, finite=0) for c in STREAM)}, ERROR, "all are NaN"),
        ({"clouds": tuple(replace(c, points=0, finite=0) for c in STREAM)}, ERROR, "is empty"),
        ({"clouds": (*STREAM[:9], cloud(9, problem="no x"))}, WARN, "1 of 10 clouds"),
        ({"clouds": tuple(replace(c, problem="no x") for c in STREAM)}, ERROR, "no x"),
        ({"clouds": tuple(replace(c, points=9000, finite=9000) for c in STREAM)}, WARN, "90,000"),
        ({"clouds": tuple(replace(c, size=10**6) for c in STREAM)}, WARN, "rmem_max"),
        ({"topic": replace(POINTS, mismatches=("/a to /b: x",))}, ERROR, "QoS does not match"),
        ({"topic": replace(POINTS, publishers=(SENDER, SENDER))}, WARN, "2 publishers"),
        ({"twins": ("/ellipseg_segmenter",)}, ERROR, "several nodes are named"),
        ({"segmenters": ()}, WARN, "no segmenter runs"),
        ({"segmenters": (SEGMENTER, replace(SEGMENTER, node="/b"))}, ERROR, "2 segmenters"),
        ({"segmenters": (SEGMENTER, replace(SEGMENTER, node="/ns/b"))}, OK, ""),
        ({"segmenters": (replace(SEGMENTER, inputs=()),)}, WARN, "not subscribe to clouds yet"),
        (
            {"segmenters": (replace(SEGMENTER, inputs=(Topic("/mute"),)),)},
            ERROR,
            "/mute, which nobody publishes",
        ),
        ({"segmenters": (replace(SEGMENTER, level=1, message="slow"),)}, WARN, "slow"),
        ({"segmenters": (replace(SEGMENTER, level=2, message="stuck"),)}, ERROR, "stuck"),
        ({"segmenters": (replace(SEGMENTER, level=None),)}, ERROR, "no /diagnostics"),
        ({"segmenters": (replace(SEGMENTER, parameters={}),)}, ERROR, "does not answer"),
        (
            {"segmenters": (replace(SEGMENTER, parameters={"use_sim_time": True}),)},
            WARN,
            "nobody publishes /clock",
        ),
        ({"segmenters": (replace(SEGMENTER, outputs=()),)}, WARN, "nobody subscribes"),
        ({"clock": True}, OK, ""),
    ],
)
def test_what_is_wrong_with_a_graph(changes: dict[str, object], level: str, what: str) -> None:
    found = list(graph.check(replace(GRAPH, **changes), 212_992))  # type: ignore[arg-type]  # as given
    assert [one[0] for one in bad(found)] == ([level] if level != OK else [])
    assert all(what in f"{one.what} {one.do}" for one in found if one.level != OK)


def test_clouds_elsewhere_are_told_with_what_to_type() -> None:
    mute = replace(
        GRAPH, topic=Topic("/points"), clouds=(), segmenters=(), elsewhere=("/cloud_registered",)
    )
    nobody, segmenter = [one for one in graph.check(mute) if one.level != OK]
    assert (nobody.level, nobody.what) == (ERROR, "nobody publishes /points")
    assert "-r points:=/cloud_registered" in nobody.do
    assert "-r points:=/cloud_registered" in segmenter.do


def test_a_topic_of_another_type_is_an_error() -> None:
    scan = replace(SENDER, kind="sensor_msgs/msg/LaserScan")
    found = list(graph.check(replace(GRAPH, topic=Topic("/points", (scan,)), clouds=())))
    assert found[0].level == ERROR and "LaserScan" in found[0].what


def test_thinned_clouds_may_be_dense() -> None:
    thinning = replace(SEGMENTER, parameters={"max_points_per_second": 5000})
    dense = tuple(replace(one, points=9000, finite=9000) for one in STREAM)
    found = list(graph.check(replace(GRAPH, clouds=dense, segmenters=(thinning,))))
    assert bad(found) == []
    assert any("90,000 points a second, thinned to 5,000" in one.what for one in found)


def test_the_rate_that_is_called_real_time_was_measured() -> None:
    found = json.loads((ROOT / "docs" / "benchmarks.json").read_text())
    rates = [
        case["points_per_second"]
        for case in found["sections"]["density"]["cases"]
        if case["period"] == 1.0 and case["update_ms"]["median"] < 1000.0
    ]
    assert clouds.BENCHED in rates


@pytest.mark.parametrize(
    ("findings", "code"),
    [([ok("a")], 0), ([ok("a"), warn("b", "do")], 0), ([warn("b", "do"), error("c", "do")], 1)],
)
def test_the_exit_code_and_the_lines(
    findings: list[Finding],
    code: int,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(installation, "check", lambda _: iter(findings))
    monkeypatch.setattr(environment, "check", lambda _: iter(()))
    assert main(["doctor", "--offline"]) == code
    told = capsys.readouterr().out
    assert all(f"{one.level:<6} {one.what}\n" in told for one in findings)
    assert main(["doctor", "--offline", "--quiet"]) == code
    told = capsys.readouterr().out
    assert ("-> do" in told) == (code == 1) and "ok" not in told and "warn" not in told
    assert main(["doctor", "--offline", "--json"]) == code
    rows = json.loads(capsys.readouterr().out)
    assert [row["level"] for row in rows] == [one.level for one in findings]
    assert rows[0]["section"] == "installation"


@pytest.mark.parametrize("seconds", ["0", "-1", "nan", "1e9"])
def test_a_time_to_listen_that_makes_no_sense_is_refused(
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
def test_a_ros_that_does_not_load_is_told(
    program: str, problem: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(doctor, "LOAD", program)
    monkeypatch.setattr(doctor, "PATIENCE", 5.0 if "sleep" in program else 60.0)
    assert doctor._load() == ("", problem)


def test_a_middleware_that_is_not_there_is_an_error(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("RMW_IMPLEMENTATION", "rmw_no_such")
    assert main(["doctor", "--json"]) == 1
    rows = json.loads(capsys.readouterr().out)
    assert any("RMW_IMPLEMENTATION rmw_no_such" in row["what"] for row in rows)
    assert not any(row["section"] == "graph" for row in rows)


def test_this_installation_works(capsys: pytest.CaptureFixture[str]) -> None:
    code = main(["doctor", "--offline", "--json"])
    rows = json.loads(capsys.readouterr().out)
    wrong = [row for row in rows if row["level"] == ERROR and "NUMBA_DISABLE" not in row["what"]]
    assert not wrong, (code, wrong)
    assert build_parser().parse_args(["doctor"]).topic == ""
