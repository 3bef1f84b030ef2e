"""Findings about installations and environments."""

import os
from dataclasses import replace
from pathlib import Path

import pytest

from ellipseg_ros.core.kernel_cache import cache_folder
from ellipseg_ros.doctor import installation
from ellipseg_ros.doctor.environment import (
    Environment,
    Folder,
    check_environment,
    folder_at,
    read_environment,
)
from ellipseg_ros.doctor.findings import ERROR, OK, WARN, Finding
from ellipseg_ros.doctor.installation import Installation, check_installation

OPTIONAL = [name for modules, _ in installation.OPTIONAL.values() for name in modules]
PACKAGES = dict.fromkeys((*installation.REQUIRED, *OPTIONAL), "1.0")
CACHE = Folder("/cache", writable=True, free=2**33)
GOOD_INSTALLATION = Installation(
    python=(3, 12),
    versions=PACKAGES,
    copies={"/ws/ellipseg_ros": "0.1.0"},
    cores=4,
    interpreted=False,
    cache=CACHE,
    kernels=90,
)
GOOD_ENVIRONMENT = Environment(
    variables={"ROS_DISTRO": "jazzy"},
    python="3.12",
    middleware="rmw_fastrtps_cpp",
    wheels=False,
    prefixes=("/ws/install/ellipseg_ros",),
    logs=Folder("/home/me/.ros/log", True, 2**33),
    shared_memory=Folder("/dev/shm", True, 2**30),
    receive_buffer=212_992,
)


def problems(findings: list[Finding]) -> list[tuple[str, str]]:
    """Level and text of warnings and errors; each of these has a remedy, and no other finding."""
    assert all(bool(finding.remedy) == (finding.level != OK) for finding in findings)
    return [(finding.level, finding.text) for finding in findings if finding.level != OK]


def without(module: str) -> dict[str, str]:
    return {name: version for name, version in PACKAGES.items() if name != module}


def test_good_installation_has_no_problems() -> None:
    assert problems(list(check_installation(GOOD_INSTALLATION))) == []


@pytest.mark.parametrize(
    ("changes", "level", "text"),
    [
        ({"python": (3, 9)}, ERROR, "Python 3.9"),
        ({"python": (3, 14)}, ERROR, "Python 3.14"),
        ({"versions": {**PACKAGES, "rosbags": ""}}, OK, ""),
        ({"versions": without("yaml")}, ERROR, "PyYAML"),
        ({"versions": without("laspy")}, WARN, "laspy"),
        ({"versions": without("matplotlib")}, WARN, "matplotlib"),
        ({"copies": {"/a": "0.1.0", "/b": "0.1.0"}}, WARN, "2 copies"),
        ({"copies": {"/a": "0.1.0", "/b": "0.2.0"}}, ERROR, "2 copies"),
        ({"cache": None, "numba_error": "ImportError: numpy"}, ERROR, "numba does not load"),
        ({"cache": replace(CACHE, writable=False)}, WARN, "can't be stored"),
        ({"cache": replace(CACHE, free=10**6)}, WARN, "left for compiled kernels"),
        ({"kernels": 0}, WARN, "no compiled kernels yet"),
        ({"interpreted": True}, ERROR, "NUMBA_DISABLE_JIT"),
        ({"cores": 1}, WARN, "one core"),
        ({"ros_error": "messages do not load: X"}, ERROR, "messages do not load"),
    ],
)
def test_problem_of_an_installation(changes: dict[str, object], level: str, text: str) -> None:
    changed = replace(GOOD_INSTALLATION, **changes)  # type: ignore[arg-type]  # as given above
    found = problems(list(check_installation(changed)))
    assert [found_level for found_level, _ in found] == ([level] if level != OK else [])
    assert all(text in found_text for _, found_text in found)


def test_copies_are_listed_once_each(tmp_path: Path) -> None:
    (own,) = installation.copies([])
    assert installation.copies([str(Path(own).parent), ""]).keys() >= {own}
    other = tmp_path / "ellipseg_ros"
    other.mkdir()
    (other / "segmenter.py").touch()
    (tmp_path / "package.xml").write_text("<version>9.8.7</version>")
    assert installation.copies([str(tmp_path), str(tmp_path)])[str(other)] == "9.8.7"
    assert len(installation.copies([str(tmp_path)])) == 2


def test_good_environment_has_no_problems() -> None:
    assert problems(list(check_environment(GOOD_ENVIRONMENT))) == []


@pytest.mark.parametrize(
    ("variables", "level", "text"),
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
def test_problem_of_the_variables(variables: dict[str, str], level: str, text: str) -> None:
    mixed = {**GOOD_ENVIRONMENT.variables, **variables}
    found = problems(list(check_environment(replace(GOOD_ENVIRONMENT, variables=mixed))))
    assert [found_level for found_level, _ in found] == ([level] if level != OK else [])
    assert all(text in found_text for _, found_text in found)


@pytest.mark.parametrize(
    ("changes", "level", "text"),
    [
        ({"wheels": True}, WARN, "may mix"),
        ({"prefixes": ("/a", "/b")}, WARN, "2 times"),
        ({"middleware": ""}, ERROR, "no middleware"),
        ({"missing_files": ("/x.xml",)}, ERROR, "/x.xml"),
        ({"logs": Folder("/l", False, 2**33)}, ERROR, "logs"),
        ({"logs": Folder("/l", True, 2**20)}, WARN, "1 MiB left"),
        ({"shared_memory": None}, WARN, "no shared memory"),
        ({"shared_memory": Folder("/dev/shm", True, 2**21)}, WARN, "2 MiB"),
        ({"receive_buffer": None}, OK, ""),
    ],
)
def test_problem_of_files_and_memory(changes: dict[str, object], level: str, text: str) -> None:
    changed = replace(GOOD_ENVIRONMENT, **changes)  # type: ignore[arg-type]  # as given above
    found = problems(list(check_environment(changed)))
    assert [found_level for found_level, _ in found] == ([level] if level != OK else [])
    assert all(text in found_text for _, found_text in found)


def test_folders_and_files_are_read(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    (tmp_path / "ours" / "share" / "ellipseg_ros").mkdir(parents=True)
    variables = {
        "ROS_HOME": str(tmp_path / "home"),
        "AMENT_PREFIX_PATH": f"{tmp_path / 'ours'}:{tmp_path / 'other'}:{tmp_path / 'ours'}",
        "FASTDDS_DEFAULT_PROFILES_FILE": str(tmp_path / "missing.xml"),
        "FASTRTPS_DEFAULT_PROFILES_FILE": str(tmp_path / "file"),
    }
    environment = read_environment(variables, "3.12", "rmw")
    assert environment.logs.path == str(tmp_path / "home" / "log") and environment.logs.writable
    assert environment.prefixes == (str(tmp_path / "ours"),)
    assert environment.missing_files == (str(tmp_path / "missing.xml"),)
    assert not folder_at(str(tmp_path / "file" / "log")).writable
    assert folder_at(str(tmp_path / ("x" * 300))).writable  # a name that is too long


def test_unreadable_receive_buffer_is_unknown(monkeypatch: pytest.MonkeyPatch) -> None:
    assert isinstance(read_environment({}, "3.12", "rmw").receive_buffer, int)

    def refuse(*_: object, **__: object) -> str:
        raise PermissionError("rmem_max")

    monkeypatch.setattr(Path, "read_text", refuse)
    assert read_environment({}, "3.12", "rmw").receive_buffer is None


def test_folder_of_compiled_kernels_is_that_of_the_kernels() -> None:
    cache = installation.read_installation("").cache
    assert cache is not None and cache.path == os.path.abspath(cache_folder())
