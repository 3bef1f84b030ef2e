"""Whether the package, and what it needs, is installed and works."""

import os
import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.metadata import distributions
from importlib.util import find_spec
from pathlib import Path

from ellipseg_ros.doctor.findings import Finding, error, ok, warn
from ellipseg_ros.doctor.packages import version_of

NAME = "ellipseg_ros"
OLDEST, NEWEST = (3, 10), (3, 13)  # Python
# By the name of the module: that of pip.
NEEDED = {
    "PIL": "pillow",
    "matplotlib": "matplotlib",
    "numba": "numba",
    "numpy": "numpy",
    "rosbags": "rosbags",
    "tqdm": "tqdm",
    "trimesh": "trimesh",
    "yaml": "PyYAML",
}
FOR_FILES = {"laspy": "laspy[lazrs]", "pypcd4": "pypcd4"}  # of single clouds
SPACE = 200 * 1024 * 1024  # bytes that should be left for compiled kernels


@dataclass(frozen=True)
class Cache:
    """Where numba keeps the compiled kernels."""

    folder: Path
    writable: bool
    kernels: int  # compiled ones in it
    free: int  # bytes on its disk


@dataclass(frozen=True)
class Installation:
    """What was found of the installation."""

    python: tuple[int, int]
    versions: dict[str, str]  # of what is there, by the name of the module; "" for not known
    copies: dict[str, str]  # of this package: folder -> version ("" for not known)
    cores: int  # that the process may use
    interpreted: bool  # NUMBA_DISABLE_JIT is set
    cache: Cache | None  # None: numba could not be loaded
    problem: str = ""  # of numba, in one line
    messages: str = ""  # what is wrong with ROS or our messages, in one line


def copies(path: list[str]) -> dict[str, str]:
    """Every copy of this package in the folders of a path: folder -> version, "" if not known."""
    places = [Path(place or ".") / NAME for place in path]
    own = find_spec(NAME)
    if own is not None and own.origin:  # also of `pip install -e`, which is on no path
        places.insert(0, Path(own.origin).parent)
    real = [folder.resolve() for folder in places if (folder / "segmenter.py").is_file()]
    return {str(folder): _version_of_copy(folder.parent) for folder in dict.fromkeys(real)}


def _version_of_copy(parent: Path) -> str:
    found = [one.version for one in distributions(name=NAME, path=[str(parent)])]
    if not found and (parent / "package.xml").is_file():  # a checkout
        found = re.findall("<version>(.*?)</version>", (parent / "package.xml").read_text("utf-8"))
    return found[0] if found else ""


def look(messages: str) -> Installation:
    """Find out; messages: what is wrong with ROS or our messages, which only ros/ can tell."""
    cache, problem = None, ""
    try:
        cache = _cache()
    except Exception as found:  # ImportError, or what numba says of the version of numpy
        problem = f"{type(found).__name__}: {' '.join(str(found).split())}"
    there = [name for name in (*NEEDED, *FOR_FILES) if find_spec(name)]
    return Installation(
        python=sys.version_info[:2],
        versions={name: _version(name) for name in there},
        copies=copies(sys.path),
        cores=len(os.sched_getaffinity(0)),
        interpreted=os.environ.get("NUMBA_DISABLE_JIT", "0") not in ("", "0"),
        cache=cache,
        problem=problem,
        messages=messages,
    )


def _version(module: str) -> str:
    return version_of((NEEDED | FOR_FILES)[module].partition("[")[0], module)


def _cache() -> Cache:
    from numba import config  # only here: numba may be what is broken

    import ellipseg_ros.core.jit  # noqa: F401, it sets CACHE_DIR

    folder = Path(config.CACHE_DIR)
    nearest = next(place for place in (folder, *folder.parents) if os.path.exists(place))
    disk = os.statvfs(nearest)
    return Cache(
        folder=folder,
        writable=os.access(nearest, os.W_OK),
        kernels=sum(1 for _ in folder.rglob("*.nbc")) if os.path.exists(folder) else 0,
        free=disk.f_bavail * disk.f_frsize,
    )


def check(found: Installation) -> Iterator[Finding]:
    """Yield what there is to say of an installation."""
    yield _python(found.python)
    yield from _packages(found)
    yield from _copies(found.copies)
    yield from _numba(found)
    if found.messages:
        yield error(found.messages, "install again (`make setup`, `colcon build`), then source it")
    else:
        yield ok("ROS and the libraries of all messages load")


def _python(version: tuple[int, int]) -> Finding:
    text = ".".join(map(str, version))
    if OLDEST <= version <= NEWEST:
        return ok(f"Python {text}")
    return error(f"Python {text}", "use 3.10 to 3.13; ROS 2 Jazzy has 3.12")


def _packages(found: Installation) -> Iterator[Finding]:
    missing = [NEEDED[name] for name in NEEDED if name not in found.versions]
    if missing:
        yield error(f"not installed: {', '.join(missing)}", f"pip install {' '.join(missing)}")
    else:
        named = [f"{name} {found.versions[name]}".rstrip() for name in NEEDED]
        yield ok(f"packages: {', '.join(named)}")
    optional = [package for name, package in FOR_FILES.items() if name not in found.versions]
    if optional:
        quoted = " ".join(f"'{package}'" for package in optional)
        yield warn(
            f"not installed, and needed for single clouds only: {', '.join(optional)}",
            f"pip install {quoted}, to read .pcd, .las and .laz",
        )


def _copies(found: dict[str, str]) -> Iterator[Finding]:
    places = [f"{folder} ({version or 'version not known'})" for folder, version in found.items()]
    if len(found) < 2:
        yield ok(f"{NAME}: {', '.join(places)}")
        return
    told = f"{len(found)} copies of {NAME}: {'; '.join(places)}; the first is used"
    do = "keep one: a new shell, with one setup.bash or one virtual environment, and no PYTHONPATH"
    known = set(found.values()) - {""}
    yield error(told, do) if len(known) > 1 else warn(told, do)


def _numba(found: Installation) -> Iterator[Finding]:
    if found.cache is None:
        yield error(
            f"numba does not load: {found.problem}",
            "pip install --upgrade numba, which also bounds the version of numpy",
        )
        return
    if found.interpreted:
        yield error(
            "NUMBA_DISABLE_JIT is set: kernels run as plain Python, hundreds of times slower",
            "unset NUMBA_DISABLE_JIT",
        )
    yield _cache_finding(found.cache)
    if found.cores < 2:
        yield warn(
            "one core: arriving clouds and updates share it",
            "give the node two cores or more (taskset, docker --cpus)",
        )
    else:
        yield ok(f"{found.cores} cores")


def _cache_finding(cache: Cache) -> Finding:
    if not cache.writable:
        return warn(
            f"compiled kernels can't be kept ({cache.folder}): every start compiles those "
            "that are not there, half a minute or more",
            "set NUMBA_CACHE_DIR to a folder that can be written to",
        )
    if cache.free < SPACE:
        return warn(
            f"{cache.free / 2**20:.0f} MiB left for compiled kernels in {cache.folder}",
            "make room, or set NUMBA_CACHE_DIR to a folder on another disk",
        )
    if not cache.kernels:
        return warn(
            f"no compiled kernels yet in {cache.folder}: the first start takes half a minute",
            "start once before the drive, or run `ellipseg demo`",
        )
    return ok(f"{cache.kernels} compiled kernels in {cache.folder}")
