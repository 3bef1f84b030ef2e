"""Checks of the installed package and of the packages that it needs."""

import os
import re
import sys
from collections.abc import Iterator
from contextlib import suppress
from importlib import import_module
from importlib.metadata import PackageNotFoundError, distributions, version
from importlib.util import find_spec
from itertools import chain
from pathlib import Path

from ellipseg_ros.doctor.environment import NAME, check_storage, folder_at
from ellipseg_ros.doctor.findings import Finding, error, ok, warn

MIN_PYTHON, MAX_PYTHON = (3, 10), (3, 13)
# Module: package of pip.
REQUIRED = {name: name for name in ("numba", "numpy", "rosbags", "tqdm")} | {"yaml": "PyYAML"}
# Extra: its modules, the packages of pip, and what needs them.
OPTIONAL = {
    "files": (("laspy", "pypcd4", "trimesh"), "cloud files (.las, .laz, .pcd, .ply)"),
    "plots": (("PIL", "matplotlib"), "pictures"),
}


def check_installation(ros_error: str) -> Iterator[Finding]:
    """Findings about the installation; ros_error: why ROS or the messages do not load, or ""."""
    yield check_python(sys.version_info[:2])
    yield from check_packages(installed_versions())
    yield check_copies(copies(sys.path))
    yield from check_kernels()
    yield check_cores(len(os.sched_getaffinity(0)))
    if ros_error:
        yield error(ros_error, "install again (`make setup`, `colcon build`), then source it")
    else:
        yield ok("ROS and the libraries of all messages load")


def check_python(version: tuple[int, int]) -> Finding:
    """Finding about a version of Python."""
    text = f"Python {version[0]}.{version[1]}"
    if MIN_PYTHON <= version <= MAX_PYTHON:
        return ok(text)
    return error(text, "use 3.10 to 3.13; ROS 2 Jazzy has 3.12")


def installed_versions() -> dict[str, str]:
    """Versions of the modules that are installed; "" for unknown."""
    names = [*REQUIRED, *chain.from_iterable(modules for modules, _ in OPTIONAL.values())]
    return {name: version_of(REQUIRED.get(name, name), name) for name in names if find_spec(name)}


def check_packages(versions: dict[str, str]) -> Iterator[Finding]:
    """Findings about the packages of which these modules are installed."""
    missing = [package for module, package in REQUIRED.items() if module not in versions]
    if missing:
        yield error(f"not installed: {', '.join(missing)}", f"pip install {' '.join(missing)}")
    else:
        named = [f"{name} {versions[name]}".rstrip() for name in REQUIRED]
        yield ok(f"packages: {', '.join(named)}")
    for extra, (modules, purpose) in OPTIONAL.items():
        missing = [name for name in modules if name not in versions]
        if missing:
            text = f"not installed, and needed for {purpose} only: {', '.join(missing)}"
            yield warn(text, f"pip install '{NAME}[{extra}]'")


def check_copies(versions: dict[str, str]) -> Finding:
    """Finding about the copies of this package: folder -> version, "" if unknown."""
    places = [f"{folder} (version {version or 'unknown'})" for folder, version in versions.items()]
    if len(versions) < 2:
        return ok(f"{NAME}: {', '.join(places)}")
    level = error if len(set(versions.values()) - {""}) > 1 else warn
    text = f"{len(versions)} copies of {NAME}: {'; '.join(places)}; the first is used"
    return level(text, "keep one: a new shell with one setup.bash or environment, no PYTHONPATH")


def check_kernels() -> Iterator[Finding]:
    """Findings about numba and its compiled kernels."""
    if problem := numba_error():
        remedy = "pip install --upgrade numba, which also limits the version of numpy"
        yield error(f"numba does not load: {problem}", remedy)
        return
    if is_interpreted():
        text = "NUMBA_DISABLE_JIT is set: kernels run as plain Python, hundreds of times slower"
        yield error(text, "unset NUMBA_DISABLE_JIT")
    from ellipseg_ros.core.kernel_cache import cache_folder  # only here: numba may not load

    cache = folder_at(cache_folder())
    effect = "every start takes half a minute"
    yield check_storage("compiled kernels", cache, "NUMBA_CACHE_DIR", warn, effect)
    if kernels := sum(1 for _ in Path(cache.path).rglob("*.nbc")):
        yield ok(f"{kernels} compiled kernels")
    else:
        text = "no compiled kernels yet: the first start takes half a minute"
        yield warn(text, "start once before the drive, or run `ellipseg demo`")


def numba_error() -> str:
    """Why numba does not load, in one line; empty if it loads."""
    try:
        import_module("ellipseg_ros.core.kernel_cache")
    except Exception as problem:  # ImportError, or that of numba for a wrong version of numpy
        return f"{type(problem).__name__}: {' '.join(str(problem).split())}"
    return ""


def is_interpreted() -> bool:
    """Whether the environment disables the compilation of kernels."""
    return os.environ.get("NUMBA_DISABLE_JIT", "0") not in ("", "0")


def check_cores(count: int) -> Finding:
    """Finding about the number of cores that the process may use."""
    if count >= 2:
        return ok(f"{count} cores")
    remedy = "give the node two cores or more (taskset, docker --cpus)"
    return warn("one core, shared by arriving clouds and updates", remedy)


def copies(path: list[str]) -> dict[str, str]:
    """Every copy of this package in the folders of a path: folder -> version, "" if unknown."""
    folders = [Path(place or ".") / NAME for place in path]
    own = find_spec(NAME)
    if own is not None and own.origin:  # also of `pip install -e`, which is on no path
        folders.insert(0, Path(own.origin).parent)
    real = [folder.resolve() for folder in folders if (folder / "segmenter.py").is_file()]
    return {str(folder): _version_in(folder.parent) for folder in dict.fromkeys(real)}


def _version_in(parent: Path) -> str:
    versions = [copy.version for copy in distributions(name=NAME, path=[str(parent)])]
    description = parent / "package.xml"
    if not versions and description.is_file():  # a checkout
        versions = re.findall("<version>(.*?)</version>", description.read_text("utf-8"))
    return versions[0] if versions else ""


def version_of(package: str, module: str) -> str:
    """The installed version; empty if pip does not know it."""
    for name in (package, module.partition(".")[0]):
        with suppress(PackageNotFoundError):
            return version(name)
    return ""
