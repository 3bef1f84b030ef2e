"""Subject `determinism`: equal results for any thread count, cloud size and version of Python."""

import json
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import ellipseg_ros
import studies
from ellipseg_ros.errors import EllipsegError
from studies.endurance.digests import CRITERIA, DURATION, SCENES
from studies.endurance.programs import checkout_environment
from studies.endurance.requirements import Options, Requirement

THREADS = (1, 2, 4)
PIECES = (1, 2, 5)  # sweeps that one is cut into
PYTHONS = ("3.10", "3.11", "3.12", "3.13")
DEPENDENCIES = ("numpy", "scipy", "numba")  # of segmentation
RUN_TIMEOUT_S = 1800.0  # for one Python, which is downloaded and compiles all kernels
PROGRAM = """
import os, sys
os.sched_getaffinity = lambda _: set(range({threads}))
from studies.endurance.digests import print_digests
print_digests({pieces}, {scenes})
"""
Run = Callable[[tuple[str, ...], int, int, list[str]], dict[str, Any]]


def run_digests(
    scenes: tuple[str, ...], threads: int, pieces: int, python: list[str]
) -> dict[str, Any]:
    """Versions and digests of scenes, computed in a new process.

    python: command line of another Python than this one, which then sees the two packages only;
    empty: this one.
    """
    program = PROGRAM.format(threads=threads, pieces=pieces, scenes=scenes)
    with TemporaryDirectory() as folder:
        environment = checkout_environment()
        if python:
            for package in (ellipseg_ros, studies):
                source = Path(str(package.__file__)).parent
                (Path(folder) / source.name).symlink_to(source)
            environment |= {"PYTHONPATH": folder, "PYTHONDONTWRITEBYTECODE": "1"}
            environment["NUMBA_CACHE_DIR"] = f"{folder}/cache"
        ended = subprocess.run(
            [*(python or [sys.executable]), "-c", program],
            env=environment,
            cwd=folder,
            capture_output=True,
            timeout=RUN_TIMEOUT_S,
            check=False,
        )
    if ended.returncode:
        text = ended.stderr.decode("utf-8", "replace").strip().splitlines()
        raise EllipsegError(f"a run ended with {ended.returncode}: {''.join(text[-1:])}")
    return dict(json.loads(ended.stdout))


def determinism(options: Options, run: Run = run_digests) -> list[Requirement]:
    """Segment the same drives repeatedly, each time in a new process, and compare digests."""
    scenes = SCENES[:1] if options.quick else SCENES
    results = [_threads_and_pieces(scenes, options, run)]
    if not options.quick:  # other Pythons are downloaded
        results.append(_pythons(scenes, options, run))
    return results


def _threads_and_pieces(scenes: tuple[str, ...], options: Options, run: Run) -> Requirement:
    cases = [(threads, 1) for threads in THREADS] + [(THREADS[-1], n) for n in PIECES[1:]]
    digests = []
    for threads, pieces in cases:
        options.log(f"determinism: {threads} threads, clouds in {pieces} pieces")
        digests.append(run(scenes, threads, pieces, [])["digests"])
    equal = digests.count(digests[0])
    return Requirement(
        "results depend neither on the number of threads nor on the size of clouds",
        f"{', '.join(scenes)}, {DURATION:g} s of driving, criteria {', '.join(CRITERIA)}; "
        f"{', '.join(map(str, THREADS))} threads, clouds in {', '.join(map(str, PIECES))} pieces; "
        "SHA-256 of labels, moments, AICc and objects of the last window",
        f"{equal} of {len(cases)} runs equal",
        equal == len(cases),
    )


def _pythons(scenes: tuple[str, ...], options: Options, run: Run) -> Requirement:
    """Compare the Pythons that uv can download, each with the newest dependencies it supports."""
    uv = shutil.which("uv") or str(Path(sys.executable).with_name("uv"))
    runs = [run(scenes, 2, 1, [])]
    unavailable, failed = [], []
    for version in PYTHONS:
        options.log(f"determinism: Python {version}")
        packages = [word for name in DEPENDENCIES for word in ("--with", name)]
        python = [uv, "run", "-q", "--no-project", "--isolated", "--python", version, *packages]
        python.append("python")
        if not _is_available(python):
            unavailable.append(version)
            continue
        try:
            runs.append(run(scenes, 2, 1, python))
        except EllipsegError as error:
            failed.append(f"; {version}: {error}")
    equal = sum(each["digests"] == runs[0]["digests"] for each in runs)
    versions = dict.fromkeys(str(each["versions"]) for each in runs)
    return Requirement(
        "results do not depend on the version of Python or numpy",
        f"the same scenes and criteria with each Python that uv can download; "
        f"{'; '.join(versions)}",
        f"{equal} of {len(runs) + len(failed)} runs equal"
        + (f"; not available: {', '.join(unavailable)}" if unavailable else "")
        + "".join(failed),
        equal == len(runs) and not failed and len(versions) > 1,
    )


def _is_available(python: list[str]) -> bool:
    """Whether this command line starts a Python with all dependencies."""
    words = [*python, "-c", f"import {', '.join(DEPENDENCIES)}"]
    try:
        return not subprocess.run(words, capture_output=True, timeout=RUN_TIMEOUT_S).returncode
    except OSError:
        return False
