"""numba's cache of compiled kernels, with checks of what it loads.

numba runs whatever machine code lies in its cache, notices edits in the kernel's own file only,
and fails where a file cannot be read or written. Here the folder goes by a digest of all sources
with kernels (code compiled against an older callee can crash), every file begins with a digest of
its contents (damaged files are compiled again), and a cache that cannot be written is only read.
test/core/test_kernel_cache.py has these failures. numba's own settings stay as they are.
"""

import functools
import hashlib
import os
import pickle
import uuid
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numba
from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile
from numba.core.dispatcher import Dispatcher

# Their kernels call one another, and take the records.
KERNEL_SOURCES = (
    "core",
    "objects",
    "landmarks",
    "association",
    "poses",
    "simulation",
    "records.py",
)
DIGEST = hashlib.sha256
VERSION = f"{numba.__version__}/1".encode()  # of numba, and of this format


def cache_folder() -> str:
    """NUMBA_CACHE_DIR where it is set, else a folder of the user's cache for these sources."""
    return numba.config.CACHE_DIR or _default_folder()


@functools.cache
def _default_folder() -> str:
    package = Path(__file__).resolve().parents[1]
    digest = hashlib.sha1(usedforsecurity=False)
    for source in sorted(path for name in KERNEL_SOURCES for path in _sources(package / name)):
        digest.update(source.read_bytes())
    home = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    return os.path.join(home, "ellipseg_ros", digest.hexdigest())


def _sources(path: Path) -> Iterable[Path]:
    return path.rglob("*.py") if path.is_dir() else [path]


def cached(kernel: Any) -> Any:
    """The same kernel with this cache; plain Python, where the compiler is off, as it is."""
    if isinstance(kernel, Dispatcher):
        kernel._cache = _Cache(kernel.py_func)  # type: ignore[attr-defined]  # numba's own
    return kernel


class _Files(IndexDataCacheFile):  # type: ignore[misc]  # numba is not typed
    """The index of the compiled versions of a kernel, and a file for each version."""

    def load(self, key: Any) -> Any:
        try:
            return self._read(self._data_path(self._load_index()[key]))
        except (OSError, KeyError):
            return None

    def _load_index(self) -> dict[Any, str]:
        try:
            stamp, names = self._read(self._index_path)
        except OSError:
            return {}
        return names if stamp == self._source_stamp else {}

    def _save_index(self, names: dict[Any, str]) -> None:
        self._write(self._index_path, (self._source_stamp, names))

    def _save_data(self, name: str, data: Any) -> None:
        self._write(self._data_path(name), data)

    def _data_name(self, number: int) -> str:
        """A name that no other process uses at the same time for another version."""
        return f"{self._index_name.removesuffix('.nbi')}.{uuid.uuid4().hex[:16]}.nbc"

    def _read(self, path: str) -> Any:
        """The contents; OSError if they are damaged, of another numba, or of another package."""
        with open(path, "rb") as file:
            digest, content = file.read(DIGEST().digest_size), file.read()
        if digest != DIGEST(VERSION + content).digest():
            raise OSError(f"{path} is damaged")
        try:
            return pickle.loads(content)
        except (AttributeError, ImportError) as error:  # of a record that has moved since
            raise OSError(f"{path} is out of date") from error

    def _write(self, path: str, value: Any) -> None:
        content = self._dump(value)
        with self._open_for_write(path) as file:
            file.write(DIGEST(VERSION + content).digest() + content)


class _Locator:
    """The cache folder, whether or not it can be written."""

    def __init__(self, path: str, line: int) -> None:
        self._path = path
        self._line = line

    @classmethod
    def from_function(cls, function: Any, path: str) -> "_Locator":
        return cls(path, function.__code__.co_firstlineno)

    def ensure_cache_path(self) -> None:
        os.makedirs(self.get_cache_path(), exist_ok=True)

    def get_cache_path(self) -> str:
        folder = os.path.dirname(os.path.abspath(self._path))
        name = hashlib.sha1(folder.encode(), usedforsecurity=False).hexdigest()
        return os.path.join(cache_folder(), f"{os.path.basename(folder)}_{name}")

    def get_source_stamp(self) -> tuple[float, int]:
        found = os.stat(self._path)
        return found.st_mtime, found.st_size

    def get_disambiguator(self) -> str:
        return str(self._line)


class _Kernels(CompileResultCacheImpl):  # type: ignore[misc]  # numba is not typed
    _locator_classes = [_Locator]


class _Cache(FunctionCache):  # type: ignore[misc]  # numba is not typed
    _impl_class = _Kernels

    def __init__(self, function: Any) -> None:
        super().__init__(function)
        stamp = self._impl.locator.get_source_stamp()
        self._cache_file = _Files(self._cache_path, self._impl.filename_base, stamp)

    def save_overload(self, signature: Any, compiled: Any) -> None:
        with suppress(OSError):  # a full disk, or one that may only be read
            super().save_overload(signature, compiled)
