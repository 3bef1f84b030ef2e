"""The same results to the last bit: with any number of threads, in other chunks, by any Python."""

import hashlib
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import ellipseg_ros
from ellipseg_ros.config import Config, ObjectsConfig
from ellipseg_ros.errors import EllipsegError
from ellipseg_ros.node.grouping import updates
from ellipseg_ros.records import Segmentation, Sweep
from ellipseg_ros.segmenter import Segmenter
from ellipseg_ros.simulation.simulator import simulate
from studies.endurance.promises import Promise, Trial

SCENES = ("woodland", "industrial", "roadway", "mixed")
CRITERIA = ("shape", "density", "parsimony")
THREADS = (1, 2, 4)
PIECES = (1, 2, 5)  # clouds that one is cut into
DURATION = 3.0  # s of driving
PYTHONS = ("3.10", "3.11", "3.12", "3.13")
PACKAGES = ("numpy", "scipy", "numba")  # all that segmenting needs
LIMIT = 1800.0  # s for one Python: it is fetched, and compiles everything
PROGRAM = """
import os, sys
os.sched_getaffinity = lambda _: set(range({threads}))
from studies.endurance.determinism import tell
tell({pieces}, {scenes})
"""


def sameness(trial: Trial) -> list[Promise]:
    """One drive again and again; each run is a process of its own."""
    scenes = SCENES[:1] if trial.quick else SCENES
    promises = [_threads_and_pieces(scenes, trial)]
    if not trial.quick:  # other Pythons are fetched from the network
        promises.append(_pythons(scenes, trial))
    return promises


def last_update(sweeps: Iterable[Sweep], criterion: str = "shape") -> Segmentation:
    """The last window of a drive."""
    config = Config(criterion, objects=ObjectsConfig(enabled=criterion == "shape"))
    segmenter = Segmenter(config)
    *_, found = (segmenter.process(group) for group in updates(sweeps, config))
    return found


def digest(found: Segmentation) -> str:
    """SHA-256 of labels, moments and objects; of nothing that depends on the updates before."""
    sums = hashlib.sha256()
    columns = [found.labels, *vars(found.ellipsoids).values()]
    if found.objects is not None:
        columns += [
            found.objects.segment_labels,
            found.objects.box_min,
            found.objects.hierarchy.cost,
        ]
    for column in columns:
        sums.update(np.ascontiguousarray(column).tobytes())
    return sums.hexdigest()


def in_pieces(sweeps: Iterable[Sweep], pieces: int) -> Iterator[Sweep]:
    """Yield the same points in more clouds, of the same stamps."""
    for sweep in sweeps:
        for piece in range(pieces):
            rows = slice(piece * len(sweep) // pieces, (piece + 1) * len(sweep) // pieces)
            yield sweep.keep(rows)


def tell(pieces: int, scenes: tuple[str, ...]) -> None:
    """Write the versions and the digests as JSON: what the processes of the trial do."""
    import numba  # only here: a name, for the page

    found = {
        f"{scene}, {criterion}": digest(
            last_update(in_pieces(simulate(scene, duration=DURATION), pieces), criterion)
        )
        for scene in scenes
        for criterion in CRITERIA
    }
    python = ".".join(map(str, sys.version_info[:3]))
    versions = f"{python} with numpy {np.__version__}, numba {numba.__version__}"
    sys.stdout.write(json.dumps({"versions": versions, "digests": found}))


def _threads_and_pieces(scenes: tuple[str, ...], trial: Trial) -> Promise:
    runs = [(threads, 1) for threads in THREADS] + [(THREADS[-1], n) for n in PIECES[1:]]
    found = []
    for threads, pieces in runs:
        trial.say(f"sameness: {threads} threads, clouds in {pieces} pieces")
        found.append(_run(scenes, threads, pieces)["digests"])
    same = sum(one == found[0] for one in found)
    return Promise(
        "results depend on neither threads nor chunks",
        f"{', '.join(scenes)}, {DURATION:g} s of driving, criteria {', '.join(CRITERIA)}; "
        f"{', '.join(map(str, THREADS))} threads, clouds in {', '.join(map(str, PIECES))} pieces; "
        "SHA-256 of labels, moments, AICc and objects of the last window",
        f"{same} of {len(runs)} runs the same",
        same == len(runs),
    )


def _pythons(scenes: tuple[str, ...], trial: Trial) -> Promise:
    """Fetched by uv, with the newest packages that each of them takes."""
    uv = shutil.which("uv") or str(Path(sys.executable).with_name("uv"))
    found: list[dict[str, object]] = [_run(scenes, 2, 1)]
    missing, failed = [], []
    for version in PYTHONS:
        trial.say(f"sameness: Python {version}")
        given = [word for name in PACKAGES for word in ("--with", name)]
        words = [uv, "run", "-q", "--no-project", "--isolated", "--python", version, *given]
        words.append("python")
        if not _is_to_be_had(words):
            missing.append(version)
            continue
        try:
            found.append(_run(scenes, 2, 1, *words))
        except EllipsegError as error:
            failed.append(f"; {version}: {error}")
    same = sum(one["digests"] == found[0]["digests"] for one in found)
    tried = dict.fromkeys(str(one["versions"]) for one in found)
    return Promise(
        "results do not depend on the version of Python or numpy",
        f"the same scenes and criteria, with each Python that uv can fetch; {'; '.join(tried)}",
        f"{same} of {len(found) + len(failed)} runs the same"
        + (f"; not to be had: {', '.join(missing)}" if missing else "")
        + "".join(failed),
        same == len(found) and not failed and len(tried) > 1,
    )


def _is_to_be_had(python: list[str]) -> bool:
    """Whether these words start a Python that has all that segmenting needs."""
    words = [*python, "-c", f"import {', '.join(PACKAGES)}"]
    try:
        return not subprocess.run(words, capture_output=True, timeout=LIMIT).returncode
    except OSError:
        return False


def _run(scenes: tuple[str, ...], threads: int, pieces: int, *python: str) -> dict[str, object]:
    """What `tell` tells; python: words that start another one than this."""
    program = PROGRAM.format(threads=threads, pieces=pieces, scenes=scenes)
    with TemporaryDirectory() as folder:
        environment = dict(os.environ)
        if python:  # with the package alone: what lies beside it belongs to this Python
            (Path(folder) / "ellipseg_ros").symlink_to(Path(ellipseg_ros.__file__).parent)
            environment |= {"PYTHONPATH": folder, "PYTHONDONTWRITEBYTECODE": "1"}
            environment["NUMBA_CACHE_DIR"] = f"{folder}/cache"
        ended = subprocess.run(
            [*(python or [sys.executable]), "-c", program],
            env=environment,
            cwd=folder,
            capture_output=True,
            timeout=LIMIT,
            check=False,
        )
    if ended.returncode:
        text = ended.stderr.decode("utf-8", "replace").strip().splitlines()
        raise EllipsegError(f"a run ended with {ended.returncode}: {''.join(text[-1:])}")
    return dict(json.loads(ended.stdout))
