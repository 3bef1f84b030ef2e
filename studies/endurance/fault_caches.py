"""The cache of compiled kernels: damaged, not there, shared."""

import os
import random
import re
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from studies.endurance.fault_programs import python
from studies.endurance.promises import Promise, Trial

LIMIT = 900.0  # s: two compile everything at the same time
RESULT = """import hashlib, sys
import numpy as np
from ellipseg_ros.config import Config
from ellipseg_ros.segmenter import segment, warm_up
warm_up()
points = np.random.default_rng(0).uniform(0.0, 20.0, (20_000, 3))
sums = hashlib.sha256()
for criterion in "shape", "density", "parsimony":
    found = segment(points, Config(criterion))
    sums.update(found.labels.tobytes() + repr(found.aicc).encode())
print(sums.hexdigest())"""
SMALL = """from ellipseg_ros.core.linalg.eigen import _sign
print(_sign(1.0, 2.0, 0.0))"""
RESULTS = {RESULT: r"[0-9a-f]{64}", SMALL: r"1\.0"}  # what they print, if they can
DAMAGES: dict[str, Callable[[bytes, random.Random], bytes]] = {
    "truncated": lambda data, rng: data[: rng.randrange(len(data))],
    "zeroed": lambda data, _: bytes(len(data)),
    "flipped in a bit": lambda data, rng: _flip(data, rng.randrange(8 * len(data))),
}


def damaged_caches(trial: Trial) -> Promise:
    """Damage files of a warm cache; what a program computes with it."""
    rng = random.Random(trial.seed)
    with tempfile.TemporaryDirectory() as folder:
        cache = Path(folder) / "cache"
        warm = Path(folder) / "warm"
        trial.say("caches: compiling all kernels, for one to damage")
        code = SMALL if trial.quick else RESULT
        right, cold = _timed(code, warm)
        problems = [] if re.fullmatch(RESULTS[code], right) else [f"without damage: {right}"]
        damaged = 0
        anew = []  # files that were written, each time
        for kind, damage in DAMAGES.items():
            trial.say(f"caches: kernels {kind}")
            shutil.copytree(warm, cache)
            files = sorted(cache.rglob("*.nb?"))
            # Of many kernels nothing is read, as others have them within.
            chosen = files if trial.quick else rng.sample(files, len(files) // 3)
            for path in chosen:
                path.write_bytes(damage(path.read_bytes(), rng))
            before = _contents(cache)
            damaged += len(chosen)
            found, _ = _timed(code, cache)
            anew.append(len(_contents(cache).items() - before.items()))
            problems += [] if found == right else [f"{kind}: {found[-200:]}"]
            shutil.rmtree(cache)
    return Promise(
        "damaged files in the cache of kernels are found out and compiled anew",
        f"{damaged} files truncated, zeroed or with a bit flipped"
        + (", of one kernel" if trial.quick else f", of all kernels ({cold:.0f} s to compile)"),
        f"{sum(anew)} files written anew, at least {min(anew)} in each of {len(anew)} runs; "
        f"results right in {'all' if not problems else 'not all'} of them"
        + (f"; {problems[0]}" if problems else ""),
        not problems and min(anew) > 0,
    )


def shared_caches(trial: Trial) -> Promise:
    """Two processes that compile into one cache, then one that reads; then one without a cache."""
    code = SMALL if trial.quick else RESULT
    trial.say("caches: two processes compile at the same time")
    with tempfile.TemporaryDirectory() as folder:
        cache = Path(folder) / "cache"
        both = [_start(code, cache) for _ in range(2)]
        results = [_end(process) for process in both]
        results.append(_end(_start(code, cache)))
        trial.say("caches: no place for one")
        results.append(_end(_start(code, Path("/proc/nobody/cache"))))
    return Promise(
        "kernels compiled by two processes at once, or without a place for the cache, are right",
        "two processes at the same time, one that uses their cache, one whose cache can't be "
        f"written{'; one kernel' if trial.quick else '; all kernels'}",
        f"{len(results)} results, "
        + ("all equal" if len(set(results)) == 1 else f"{len(set(results))} different ones"),
        len(set(results)) == 1 and bool(re.fullmatch(RESULTS[code], results[0])),
    )


def _flip(data: bytes, bit: int) -> bytes:
    place = bit // 8
    return data[:place] + bytes([data[place] ^ 1 << bit % 8]) + data[place + 1 :]


def _contents(cache: Path) -> dict[Path, bytes]:
    return {path: path.read_bytes() for path in cache.rglob("*.nb?")}


def _timed(code: str, cache: Path) -> tuple[str, float]:
    begun = time.monotonic()
    return _end(_start(code, cache)), time.monotonic() - begun


def _start(code: str, cache: Path) -> "subprocess.Popen[str]":
    return subprocess.Popen(
        python(code),
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env={**os.environ, "NUMBA_CACHE_DIR": str(cache)},
    )


def _end(process: "subprocess.Popen[str]") -> str:
    """What it says, and its exit code if that isn't 0."""
    text, _ = process.communicate(timeout=LIMIT)
    return text.strip() if process.returncode == 0 else f"{text}: exit code {process.returncode}"
