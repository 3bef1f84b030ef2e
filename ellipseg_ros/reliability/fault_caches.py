"""The cache of compiled kernels: damaged, not there, shared."""

import os
import random
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from ellipseg_ros.reliability.fault_programs import command
from ellipseg_ros.reliability.promises import Promise, Trial

LIMIT = 900.0  # s: two compile everything at the same time
RESULT = """import hashlib, sys
import numpy as np
from ellipseg_ros.segmenter import segment, warm_up
warm_up()
found = segment(np.random.default_rng(0).uniform(0.0, 20.0, (20_000, 3)))
print(hashlib.sha256(found.labels.tobytes() + repr(found.aicc).encode()).hexdigest())"""
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
        trial.say("faults: compiling all kernels, for a cache to damage")
        right, cold = _timed(warm) if not trial.quick else _small(warm)
        problems = []
        damaged = 0
        for number in range(3 if trial.quick else 6):
            kind = list(DAMAGES)[number % len(DAMAGES)]
            trial.say(f"faults: cached kernels {kind}")
            shutil.copytree(warm, cache)
            files = sorted(cache.rglob("*.nb?"))
            chosen = rng.sample(files, min(len(files), 6))
            for path in chosen:
                path.write_bytes(DAMAGES[kind](path.read_bytes(), rng))
            damaged += len(chosen)
            found, _ = _small(cache) if trial.quick else _timed(cache)
            problems += [] if found == right else [f"{kind}: {found[-200:]}"]
            shutil.rmtree(cache)
    return Promise(
        "damaged files in the cache of kernels are found out and compiled anew",
        f"{damaged} files truncated, zeroed or with a bit flipped"
        + (", of one kernel" if trial.quick else f", of all kernels ({cold:.0f} s to compile)"),
        f"results right in {'all' if not problems else 'not all'} runs"
        + (f"; {problems[0]}" if problems else ""),
        not problems,
    )


def shared_caches(trial: Trial) -> Promise:
    """Two processes that compile into one cache, then one that reads; then one without a cache."""
    call = _start_small if trial.quick else _start
    trial.say("faults: two processes compile at the same time")
    with tempfile.TemporaryDirectory() as folder:
        cache = Path(folder) / "cache"
        both = [call(cache) for _ in range(2)]
        results = [_end(process) for process in both]
        results.append(_end(call(cache)))
        trial.say("faults: no place for a cache")
        results.append(_end(call(Path("/proc/nobody/cache"))))
    return Promise(
        "kernels compiled by two processes at once, or without a place for the cache, are right",
        "two processes at the same time, one that uses their cache, one whose cache can't be "
        f"written{'; one kernel' if trial.quick else '; all kernels'}",
        f"{len(results)} results, "
        + ("all equal" if len(set(results)) == 1 else f"{len(set(results))} different ones"),
        len(set(results)) == 1 and len(results[0]) == (3 if trial.quick else 64),
    )


SMALL = """from ellipseg_ros.core.eigen import _sign
print(_sign(1.0, 2.0, 0.0))"""


def _flip(data: bytes, bit: int) -> bytes:
    place = bit // 8
    return data[:place] + bytes([data[place] ^ 1 << bit % 8]) + data[place + 1 :]


def _timed(cache: Path) -> tuple[str, float]:
    begun = time.monotonic()
    return _end(_start(cache)), time.monotonic() - begun


def _small(cache: Path) -> tuple[str, float]:
    return _end(_start_small(cache)), 0.0


def _start(cache: Path) -> "subprocess.Popen[str]":
    return _process(RESULT, cache)


def _start_small(cache: Path) -> "subprocess.Popen[str]":
    return _process(SMALL, cache)


def _process(code: str, cache: Path) -> "subprocess.Popen[str]":
    words = command()
    words[words.index("-c") + 1] = code
    return subprocess.Popen(
        words,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env={**os.environ, "NUMBA_CACHE_DIR": str(cache)},
    )


def _end(process: "subprocess.Popen[str]") -> str:
    """What it says, and its exit code if that isn't 0."""
    text, _ = process.communicate(timeout=LIMIT)
    return text.strip() if process.returncode == 0 else f"{text}: exit code {process.returncode}"
