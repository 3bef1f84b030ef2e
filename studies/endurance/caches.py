"""Subject `caches`: compiled kernels on the disk that are damaged, missing or shared."""

import random
import re
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from studies.endurance.programs import checkout_environment, python
from studies.endurance.requirements import Options, Requirement, first_of

COMPILE_TIMEOUT_S = 900.0  # for two processes that compile everything at the same time
ALL_KERNELS = """import hashlib, sys
import numpy as np
from ellipseg_ros.config import Config
from ellipseg_ros.segmenter import segment, warm_up
warm_up()
points = np.random.default_rng(0).uniform(0.0, 20.0, (20_000, 3))
sums = hashlib.sha256()
for criterion in "shape", "density", "parsimony":
    result = segment(points, Config(criterion))
    sums.update(result.labels.tobytes() + repr(result.aicc).encode())
print(sums.hexdigest())"""
ONE_KERNEL = """from ellipseg_ros.core.linalg.eigen import _sign
print(_sign(1.0, 2.0, 0.0))"""
OUTPUTS = {ALL_KERNELS: r"[0-9a-f]{64}", ONE_KERNEL: r"1\.0"}  # without an error
DAMAGES: dict[str, Callable[[bytes, random.Random], bytes]] = {
    "truncated": lambda data, rng: data[: rng.randrange(len(data))],
    "zeroed": lambda data, _: bytes(len(data)),
    "flipped in a bit": lambda data, rng: _flip(data, rng.randrange(8 * len(data))),
}


def caches(options: Options) -> list[Requirement]:
    """Run programs with damaged, shared and missing caches."""
    return [*damaged_caches(options), *shared_caches(options)]


def damaged_caches(options: Options) -> list[Requirement]:
    """Damage files of a filled cache and compare what a program computes with it."""
    code = ONE_KERNEL if options.quick else ALL_KERNELS
    rng = random.Random(options.seed)
    with tempfile.TemporaryDirectory() as folder:
        filled = Path(folder) / "filled"
        options.log("caches: compiling all kernels, to damage them")
        begun = time.monotonic()
        expected = _wait(_start(code, filled))
        compile_s = time.monotonic() - begun
        problems = [] if re.fullmatch(OUTPUTS[code], expected) else [f"undamaged: {expected}"]
        damaged, rewritten = 0, []  # files; the latter of each run
        for kind in DAMAGES:
            options.log(f"caches: kernels {kind}")
            cache = Path(folder) / "cache"
            shutil.copytree(filled, cache)
            damaged += _damage(cache, kind, rng, options)
            before = _contents(cache)
            output = _wait(_start(code, cache))
            rewritten.append(len(_contents(cache).items() - before.items()))
            problems += [] if output == expected else [f"{kind}: {output[-200:]}"]
            shutil.rmtree(cache)
    kernels = "one kernel" if options.quick else f"all kernels ({compile_s:.0f} s to compile)"
    return [
        Requirement(
            "damaged files in the cache of kernels are detected and compiled again",
            f"{damaged} files of {kernels} truncated, zeroed or with a bit flipped",
            f"{sum(rewritten)} files rewritten, at least {min(rewritten)} in each of "
            f"{len(rewritten)} runs; results correct in {'all' if not problems else 'not all'} of "
            f"them{first_of(problems)}",
            not problems and min(rewritten) > 0,
        )
    ]


def _damage(cache: Path, kind: str, rng: random.Random, options: Options) -> int:
    """Damage files of a cache; returns their number."""
    files = sorted(cache.rglob("*.nb?"))
    # The files of many kernels are never read, since other kernels contain them.
    chosen = files if options.quick else rng.sample(files, len(files) // 3)
    for path in chosen:
        path.write_bytes(DAMAGES[kind](path.read_bytes(), rng))
    return len(chosen)


def shared_caches(options: Options) -> list[Requirement]:
    """Run two processes that fill one cache, one that reads it, and one without a cache."""
    code = ONE_KERNEL if options.quick else ALL_KERNELS
    options.log("caches: two processes compile at the same time")
    with tempfile.TemporaryDirectory() as folder:
        cache = Path(folder) / "cache"
        both = [_start(code, cache) for _ in range(2)]
        outputs = [_wait(process) for process in both]
        outputs.append(_wait(_start(code, cache)))
        options.log("caches: a folder that cannot be written")
        outputs.append(_wait(_start(code, Path("/proc/missing/cache"))))
    different = len(set(outputs))
    equal = "all equal" if different == 1 else f"{different} different ones"
    return [
        Requirement(
            "results are correct if two processes compile kernels simultaneously, or if the cache "
            "cannot be written",
            "two simultaneous processes, one that uses their cache, one whose cache cannot be "
            f"written{'; one kernel' if options.quick else '; all kernels'}",
            f"{len(outputs)} results, {equal}",
            different == 1 and bool(re.fullmatch(OUTPUTS[code], outputs[0])),
        )
    ]


def _flip(data: bytes, bit: int) -> bytes:
    place = bit // 8
    return data[:place] + bytes([data[place] ^ 1 << bit % 8]) + data[place + 1 :]


def _contents(cache: Path) -> dict[Path, bytes]:
    return {path: path.read_bytes() for path in cache.rglob("*.nb?")}


def _start(code: str, cache: Path) -> "subprocess.Popen[str]":
    return subprocess.Popen(
        python(code),
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env=checkout_environment(NUMBA_CACHE_DIR=str(cache)),
    )


def _wait(process: "subprocess.Popen[str]") -> str:
    """Output of a process, and its exit code unless that is 0."""
    text, _ = process.communicate(timeout=COMPILE_TIMEOUT_S)
    return text.strip() if process.returncode == 0 else f"{text}: exit code {process.returncode}"
