"""Checks of the installed package and of the packages that it needs."""

import os
import re
import sys
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, distributions, version
from importlib.util import find_spec
from pathlib import Path

from ellipseg_ros.doctor.environment import NAME, Folder, folder_at
from ellipseg_ros.doctor.findings import Finding, error, ok, warn

MIN_PYTHON, MAX_PYTHON = (3, 10), (3, 13)
# Module: package of pip.
REQUIRED = {name: name for name in ("numba", "numpy", "rosbags", "tqdm")} | {"yaml": "PyYAML"}
# Extra: its modules, the packages of pip, and what needs them.
OPTIONAL = {
    "files": (("laspy", "pypcd4", "trimesh"), "cloud files (.las, .laz, .pcd, .ply)"),
    "plots": (("PIL", "matplotlib"), "pictures"),
}
MIN_CACHE_BYTES = 200 * 2**20  # free, for compiled kernels


@dataclass(frozen=True)
class Installation:
    """The facts that `check_installation` is about."""

    python: tuple[int, int]
    versions: dict[str, str]  # of the modules that there are; "" for unknown
    copies: dict[str, str]  # of this package: folder -> version, "" for unknown
    cores: int  # usable by the process
    interpreted: bool  # NUMBA_DISABLE_JIT is set
    cache: Folder | None  # of compiled kernels; None: numba does not load
    kernels: int = 0  # compiled, in the cache
    numba_error: str = ""  # why numba does not load, in one line
    ros_error: str = ""  # why ROS or the messages do not load, in one line


def read_installation(ros_error: str) -> Installation:
    """Collect the facts; ros_error: why ROS or the messages do not load, "" if they do."""
    cache, kernels, numba_error = None, 0, ""
    try:
        from ellipseg_ros.core.kernel_cache import cache_folder  # only here: numba may not load

        cache = folder_at(cache_folder())
        kernels = sum(1 for _ in Path(cache.path).rglob("*.nbc"))
    except Exception as problem:  # ImportError, or that of numba for a wrong version of numpy
        numba_error = f"{type(problem).__name__}: {' '.join(str(problem).split())}"
    optional = {name: name for names, _ in OPTIONAL.values() for name in names}
    packages = {name: pip for name, pip in (REQUIRED | optional).items() if find_spec(name)}
    return Installation(
        python=sys.version_info[:2],
        versions={name: version_of(package, name) for name, package in packages.items()},
        copies=copies(sys.path),
        cores=len(os.sched_getaffinity(0)),
        interpreted=os.environ.get("NUMBA_DISABLE_JIT", "0") not in ("", "0"),
        cache=cache,
        kernels=kernels,
        numba_error=numba_error,
        ros_error=ros_error,
    )


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


def check_installation(installation: Installation) -> Iterator[Finding]:
    """Findings about an installation."""
    python = f"Python {'.'.join(map(str, installation.python))}"
    supported = MIN_PYTHON <= installation.python <= MAX_PYTHON
    yield ok(python) if supported else error(python, "use 3.10 to 3.13; ROS 2 Jazzy has 3.12")
    yield from _packages(installation.versions)
    yield _copies(installation.copies)
    yield from _numba(installation)
    if installation.ros_error:
        remedy = "install again (`make setup`, `colcon build`), then source it"
        yield error(installation.ros_error, remedy)
    else:
        yield ok("ROS and the libraries of all messages load")


def _packages(versions: dict[str, str]) -> Iterator[Finding]:
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


def _copies(versions: dict[str, str]) -> Finding:
    places = [f"{folder} (version {version or 'unknown'})" for folder, version in versions.items()]
    if len(versions) < 2:
        return ok(f"{NAME}: {', '.join(places)}")
    level = error if len(set(versions.values()) - {""}) > 1 else warn
    text = f"{len(versions)} copies of {NAME}: {'; '.join(places)}; the first is used"
    return level(text, "keep one: a new shell with one setup.bash or environment, no PYTHONPATH")


def _numba(installation: Installation) -> Iterator[Finding]:
    if installation.cache is None:
        text = f"numba does not load: {installation.numba_error}"
        yield error(text, "pip install --upgrade numba, which also limits the version of numpy")
        return
    if installation.interpreted:
        text = "NUMBA_DISABLE_JIT is set: kernels run as plain Python, hundreds of times slower"
        yield error(text, "unset NUMBA_DISABLE_JIT")
    yield _cache(installation.cache, installation.kernels)
    if installation.cores < 2:
        remedy = "give the node two cores or more (taskset, docker --cpus)"
        yield warn("one core, shared by arriving clouds and updates", remedy)
    else:
        yield ok(f"{installation.cores} cores")


def _cache(cache: Folder, kernels: int) -> Finding:
    if not cache.writable:
        text = f"compiled kernels can't be stored in {cache.path}: every start takes half a minute"
        return warn(text, "set NUMBA_CACHE_DIR to a writable folder")
    if cache.free < MIN_CACHE_BYTES:
        text = f"{cache.free / 2**20:.0f} MiB left for compiled kernels in {cache.path}"
        return warn(text, "make room, or set NUMBA_CACHE_DIR to a folder on another disk")
    if not kernels:
        text = f"no compiled kernels yet in {cache.path}: the first start takes half a minute"
        return warn(text, "start once before the drive, or run `ellipseg demo`")
    return ok(f"{kernels} compiled kernels in {cache.path}")


def version_of(package: str, module: str) -> str:
    """The installed version; empty if pip does not know it."""
    for name in (package, module.partition(".")[0]):
        with suppress(PackageNotFoundError):
            return version(name)
    return ""
