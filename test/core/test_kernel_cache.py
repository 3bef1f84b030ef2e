"""The kernel cache: damaged files, other processes, full disks, read-only folders."""

import errno
import os
import pickle
import shutil
import subprocess
import sys
from pathlib import Path

import numba
import pytest
from numba import njit

import ellipseg_ros
from ellipseg_ros.core.kernel_cache import DIGEST, VERSION, cached

PACKAGE = Path(ellipseg_ros.__file__).parent


def test_edit_of_any_kernel_file_starts_a_new_cache(tmp_path):
    copy = tmp_path / "ellipseg_ros"
    shutil.copytree(PACKAGE, copy, ignore=shutil.ignore_patterns("__pycache__", "msg", "*.so"))
    env = {**os.environ, "PYTHONPATH": str(tmp_path), "XDG_CACHE_HOME": str(tmp_path / "cache")}
    env.pop("NUMBA_CACHE_DIR", None)
    code = "from ellipseg_ros.core.linalg.eigen import _sign; _sign(1.0, -2.0, 0.0)"
    for comment in ("", "", "# edited\n"):
        with (copy / "core" / "window.py").open("a") as source:
            source.write(comment)
        subprocess.run([sys.executable, "-c", code], check=True, env=env, cwd=tmp_path)
    assert len(list((tmp_path / "cache" / "ellipseg_ros").iterdir())) == 2


@pytest.mark.skipif(os.geteuid() == 0 and not shutil.which("setpriv"), reason="root may write all")
def test_package_works_without_a_writable_cache(tmp_path):
    copy = tmp_path / "ellipseg_ros"
    ignored = shutil.ignore_patterns("__pycache__", "msg", "*.so")
    shutil.copytree(PACKAGE, copy, ignore=ignored)
    temporary = tmp_path / "tmp"
    temporary.mkdir(mode=0o777)
    temporary.chmod(0o777)
    for folder in [tmp_path, *(p for p in copy.rglob("*") if p.is_dir()), copy]:
        folder.chmod(0o555)
    for folder in [tmp_path, *list(tmp_path.parents)[:2]]:
        folder.chmod(folder.stat().st_mode | 0o055)
    code = "from ellipseg_ros.core.linalg.eigen import _sign; print(_sign(1.0, -2.0, 0.0))"
    env = {**os.environ, "HOME": "/nowhere", "PYTHONPATH": str(tmp_path), "TMPDIR": str(temporary)}
    env.pop("NUMBA_CACHE_DIR", None)
    env.pop("XDG_CACHE_HOME", None)
    other_user = ["setpriv", "--reuid=65534", "--regid=65534", "--clear-groups"]
    command = [*(other_user if os.geteuid() == 0 else []), sys.executable, "-c", code]
    try:
        done = subprocess.run(command, env=env, cwd="/", capture_output=True, text=True)
    finally:
        for folder in [tmp_path, copy, *(p for p in copy.rglob("*") if p.is_dir())]:
            folder.chmod(0o755)
    assert (done.returncode, done.stdout.strip()) == (0, "-1.0"), done.stderr
    assert not list(temporary.iterdir())  # taken away at the end


REMOVED = b"cellipseg_ros.records\nRemoved\n."  # a pickle of a class that is not there any more

DAMAGE = {
    "of a removed class": lambda data: DIGEST(VERSION + REMOVED).digest() + REMOVED,
    "truncated": lambda data: data[: len(data) // 2],
    "one bit flipped": lambda data: data[:-9] + bytes([data[-9] ^ 4]) + data[-8:],
    "the digest flipped": lambda data: bytes([data[0] ^ 1]) + data[1:],
    "zeros": lambda data: bytes(len(data)),
    "empty": lambda data: b"",
    "of numba's own": lambda data: pickle.dumps(("0.1", {})),
}


def twice(x):
    return 2 * x


def hits():
    """The number of versions loaded from the cache by a call, as in a new process."""
    fresh = cached(njit(twice))
    assert fresh(21) == 42
    return sum(fresh.stats.cache_hits.values())


@pytest.mark.parametrize("damage", DAMAGE.values(), ids=DAMAGE)
@pytest.mark.parametrize("suffix", [".nbi", ".nbc"])
def test_damaged_cache_files_are_compiled_again(suffix, damage, tmp_path, monkeypatch):
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    assert (hits(), hits()) == (0, 1)
    (path,) = tmp_path.rglob(f"*{suffix}")
    path.write_bytes(damage(path.read_bytes()))
    assert (hits(), hits()) == (0, 1)


def test_cache_that_cannot_be_written_is_skipped(tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "file" / "cache"))
    assert (hits(), hits()) == (0, 0)


def test_cache_on_a_full_disk_is_left_as_it_was(tmp_path, monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", full)
        assert hits() == 0
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]
    assert (hits(), hits()) == (0, 1)
    monkeypatch.setattr(os, "replace", full)
    assert hits() == 1


def test_processes_that_compile_simultaneously_share_no_wrong_code(tmp_path):
    code = (
        "import sys, numpy as np; from ellipseg_ros.core.linalg.eigen import _sign as f\n"
        "kinds = [int, np.float32]\n"
        "for kind in kinds if sys.argv[1] == '0' else reversed(kinds):\n"
        "    print(f(kind(1), kind(-2), kind(0)), end=' ')"
    )
    env = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    command = [sys.executable, "-c", code]
    both = [
        subprocess.Popen([*command, str(k)], stdout=subprocess.PIPE, env=env, text=True)
        for k in range(2)
    ]
    assert [process.communicate()[0] for process in both] == ["-1.0 -1.0 "] * 2
    after = subprocess.run([*command, "0"], stdout=subprocess.PIPE, env=env, text=True, check=True)
    assert after.stdout == "-1.0 -1.0 "
