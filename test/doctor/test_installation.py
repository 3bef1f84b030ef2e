"""Findings about installations and environments."""

import os
import sys
from pathlib import Path

import pytest

from ellipseg_ros.core.kernel_cache import cache_folder
from ellipseg_ros.doctor import environment, installation
from ellipseg_ros.doctor.environment import Folder, check_environment, check_storage, folder_at
from ellipseg_ros.doctor.findings import ERROR, OK, WARN, Finding, warn
from ellipseg_ros.doctor.installation import (
    check_copies,
    check_cores,
    check_installation,
    check_kernels,
    check_packages,
    check_python,
)

OPTIONAL = [name for modules, _ in installation.OPTIONAL.values() for name in modules]
PACKAGES = dict.fromkeys((*installation.REQUIRED, *OPTIONAL), "1.0")
MIDDLEWARE = "rmw_fastrtps_cpp"


def problems(findings: list[Finding]) -> list[tuple[str, str]]:
    """Level and text of warnings and errors; each of these has a remedy, and no other finding."""
    assert all(bool(finding.remedy) == (finding.level != OK) for finding in findings)
    return [(finding.level, finding.text) for finding in findings if finding.level != OK]


def without(module: str) -> dict[str, str]:
    return {name: version for name, version in PACKAGES.items() if name != module}


@pytest.mark.parametrize(
    ("findings", "level", "text"),
    [
        ([check_python((3, 12))], OK, "3.12"),
        ([check_python((3, 9))], ERROR, "Python 3.9"),
        ([check_python((3, 14))], ERROR, "Python 3.14"),
        (check_packages(PACKAGES), OK, "numba 1.0"),
        (check_packages({**PACKAGES, "rosbags": ""}), OK, "rosbags,"),
        (check_packages(without("yaml")), ERROR, "PyYAML"),
        (check_packages(without("laspy")), WARN, "laspy"),
        (check_packages(without("matplotlib")), WARN, "matplotlib"),
        ([check_copies({"/ws/ellipseg_ros": "0.1.0"})], OK, "0.1.0"),
        ([check_copies({"/a": "0.1.0", "/b": "0.1.0"})], WARN, "2 copies"),
        ([check_copies({"/a": "0.1.0", "/b": "0.2.0"})], ERROR, "2 copies"),
        ([check_cores(1)], WARN, "one core"),
        ([check_cores(2)], OK, "2 cores"),
    ],
)
def test_finding_about_an_installation(findings: list[Finding], level: str, text: str) -> None:
    found = list(findings)
    assert [found_level for found_level, _ in problems(found)] == ([level] if level != OK else [])
    assert any(text in finding.text for finding in found if finding.level == level)


def test_ros_that_does_not_load_is_an_error() -> None:
    assert (ERROR, "messages do not load: X") in problems(
        list(check_installation("messages do not load: X"))
    )


def test_numba_that_does_not_load_is_the_only_finding_about_kernels(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def refuse(name: str) -> None:
        raise ImportError("Numba needs NumPy 2.3\nor less")

    monkeypatch.setattr(installation, "import_module", refuse)
    (finding,) = check_kernels()
    assert finding.level == ERROR
    assert finding.text == "numba does not load: ImportError: Numba needs NumPy 2.3 or less"


def test_kernels_are_counted_in_the_folder_where_numba_stores_them(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.delenv("NUMBA_DISABLE_JIT", raising=False)
    storage = next(check_kernels())
    assert os.path.abspath(cache_folder()) in storage.text
    monkeypatch.setattr("ellipseg_ros.core.kernel_cache.cache_folder", lambda: str(tmp_path))
    assert [finding.level for finding in check_kernels()] == [OK, WARN]
    (tmp_path / "core").mkdir()
    (tmp_path / "core" / "kernel.1.nbc").touch()
    assert [finding.text for finding in check_kernels()][1] == "1 compiled kernels"
    monkeypatch.setenv("NUMBA_DISABLE_JIT", "1")
    assert next(check_kernels()).level == ERROR


@pytest.mark.parametrize(
    ("folder", "text"),
    [
        (Folder("/f", True, 2**33), "files in /f"),
        (Folder("/f", False, 2**33), "files can't be stored in /f: slow"),
        (Folder("/f", True, 2**20), "1 MiB left for files in /f"),
    ],
)
def test_finding_about_a_folder(folder: Folder, text: str) -> None:
    finding = check_storage("files", folder, "FILES", warn, "slow")
    assert finding.text == text
    assert finding.remedy.count("FILES") == (finding.level == WARN)


def test_copies_are_listed_once_each(tmp_path: Path) -> None:
    (own,) = installation.copies([])
    assert installation.copies([str(Path(own).parent), ""]).keys() >= {own}
    other = tmp_path / "ellipseg_ros"
    other.mkdir()
    (other / "segmenter.py").touch()
    (tmp_path / "package.xml").write_text("<version>9.8.7</version>")
    assert installation.copies([str(tmp_path), str(tmp_path)])[str(other)] == "9.8.7"
    assert len(installation.copies([str(tmp_path)])) == 2


@pytest.fixture
def good_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    """A machine without problems, whatever runs the tests."""
    monkeypatch.setattr(environment, "folder_at", lambda path: Folder(path, True, 2**33))
    monkeypatch.setattr(environment, "receive_buffer", lambda: 212_992)


PYTHON = f"python3.{sys.version_info.minor}"


@pytest.mark.usefixtures("good_machine")
@pytest.mark.parametrize(
    ("variables", "level", "text"),
    [
        ({}, OK, ""),
        ({"ROS_DISTRO": "humble"}, ERROR, "humble"),
        ({"_ROS_WHEELS_BOOTSTRAP_COMPLETE": "1"}, WARN, "may mix"),
        ({"ROS_DOMAIN_ID": "300"}, ERROR, "300"),
        ({"ROS_DOMAIN_ID": "me"}, ERROR, "'me'"),
        ({"ROS_DOMAIN_ID": "150"}, WARN, "150"),
        ({"ROS_DOMAIN_ID": "42"}, OK, ""),
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "OFF"}, ERROR, "OFF"),
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNETS"}, ERROR, "SUBNETS"),
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}, OK, ""),
        ({"ROS_LOCALHOST_ONLY": "1"}, WARN, "ROS_LOCALHOST_ONLY"),
        ({"RMW_IMPLEMENTATION": "rmw_cyclonedds_cpp"}, WARN, "rmw_cyclonedds_cpp"),
        ({"RMW_IMPLEMENTATION": MIDDLEWARE}, OK, ""),
        ({"PYTHONPATH": "/opt/ros/jazzy/lib/python3.5/site-packages"}, ERROR, "3.5"),
        ({"PYTHONPATH": f"/opt/ros/jazzy/lib/{PYTHON}/site-packages"}, OK, ""),
        ({"FASTDDS_DEFAULT_PROFILES_FILE": "/no/such.xml"}, ERROR, "/no/such.xml"),
        ({"FASTDDS_DEFAULT_PROFILES_FILE": __file__}, OK, ""),
    ],
)
def test_problem_of_the_variables(variables: dict[str, str], level: str, text: str) -> None:
    found = problems(list(check_environment({"ROS_DISTRO": "jazzy", **variables}, MIDDLEWARE)))
    assert [found_level for found_level, _ in found] == ([level] if level != OK else [])
    assert all(text in found_text for _, found_text in found)


@pytest.mark.usefixtures("good_machine")
def test_security_needs_a_keystore_and_should_be_enforced(tmp_path: Path) -> None:
    variables = {"ROS_SECURITY_ENABLE": "true"}
    assert [level for level, _ in problems(list(check_environment(variables, MIDDLEWARE)))] == [
        ERROR,
        WARN,
    ]
    variables |= {"ROS_SECURITY_KEYSTORE": str(tmp_path), "ROS_SECURITY_STRATEGY": "Enforce"}
    assert problems(list(check_environment(variables, MIDDLEWARE))) == []


@pytest.mark.usefixtures("good_machine")
def test_missing_middleware_is_an_error() -> None:
    ((level, text),) = problems(list(check_environment({}, "")))
    assert level == ERROR and "no middleware could be loaded" in text


@pytest.mark.usefixtures("good_machine")
def test_shared_memory_should_be_there_and_have_room(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(environment, "MIN_SHARED_MEMORY_BYTES", 2**40)
    ((level, text),) = problems(list(check_environment({}, MIDDLEWARE)))
    assert level == WARN and "8192 MiB of shared memory left" in text
    monkeypatch.setattr(environment, "SHARED_MEMORY", str(tmp_path / "none"))
    ((level, text),) = problems(list(check_environment({}, MIDDLEWARE)))
    assert level == WARN and "no shared memory" in text


def test_folders_are_read_from_the_variables(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    paths = [tmp_path / "ours", tmp_path / "other", tmp_path / "ours", tmp_path / "mine"]
    for name in ("ours", "mine"):
        (tmp_path / name / "share" / "ellipseg_ros").mkdir(parents=True)
    variables = {"ROS_HOME": str(tmp_path), "AMENT_PREFIX_PATH": ":".join(map(str, paths))}
    found = list(check_environment(variables, MIDDLEWARE))
    assert any(finding.text == f"logs in {tmp_path}/log" for finding in found)
    text = f"AMENT_PREFIX_PATH has ellipseg_ros 2 times: {paths[0]}, {paths[3]}; the first is used"
    assert (WARN, text) in problems(found)
    variables["ROS_LOG_DIR"] = str(tmp_path / "file" / "log")
    errors = [
        text for level, text in problems(list(check_environment(variables, ""))) if level == ERROR
    ]
    assert any(text.endswith("file/log: no node starts") for text in errors)
    assert folder_at(str(tmp_path / ("x" * 300))).writable  # a name that is too long


def test_unreadable_receive_buffer_is_unknown(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(environment, "RECEIVE_BUFFER", tmp_path / "none")
    assert environment.receive_buffer() is None
    (tmp_path / "none").write_text("212992\n")
    assert environment.receive_buffer() == 212_992
