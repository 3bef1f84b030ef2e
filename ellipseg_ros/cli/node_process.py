"""The segmenter node as a process of its own, which ends when its block ends."""

import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Thread

from ellipseg_ros.errors import EllipsegError
from ellipseg_ros.node.memory import peak_mb, resident_mb

START = """
import ctypes, signal, sys
ctypes.CDLL(None).prctl(1, signal.SIGINT)  # PR_SET_PDEATHSIG: it doesn't outlive who started it
from ellipseg_ros.ros.start import segmenter
sys.exit(segmenter())
"""
FAREWELL = 10.0  # s that the node gets to end before it is killed


class NodeProcess:
    """A segmenter that `start` starts; a context manager, which ends it whatever happens.

    args: `--ros-args ...` of the node. log: file for all that it prints.
    on_death: called, in another thread, with the reason if it ends before `stop` is called.
    """

    def __init__(self, args: list[str], log: Path, on_death: Callable[[str], None]) -> None:
        self._args = args
        self._log = log
        self._on_death = on_death
        self._asked = False
        self._process: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> "NodeProcess":
        return self

    def __exit__(self, *_: object) -> None:
        self._end()

    def start(self) -> None:
        """Start it; raises KeyboardInterrupt only when it can be ended again."""
        with self._log.open("wb") as log, interrupts_held_back():
            self._process = subprocess.Popen(
                [sys.executable, "-c", START, *self._args],
                stdout=log,
                stderr=subprocess.STDOUT,
                start_new_session=True,  # Ctrl-C ends it through us, in order
            )
        Thread(target=self._watch, args=[self._process], name="node", daemon=True).start()

    def stop(self) -> None:
        """End it as Ctrl-C does; raises EllipsegError if it does not end well."""
        code = self._end()
        if code:
            raise EllipsegError(f"the node ended with {code}; see {self._log}")

    def memory_mb(self) -> float:
        """Memory that it holds now, in MB (10^6 bytes)."""
        assert self._process is not None  # it is for after `start`
        return resident_mb(self._process.pid)

    def kill(self) -> None:
        """End it as a crash does."""
        assert self._process is not None  # it is for after `start`
        self._asked = True
        self._process.kill()
        self._process.wait()

    def peak_memory_mb(self) -> float:
        """Most memory that it has held so far, in MB (10^6 bytes)."""
        assert self._process is not None  # it is for after `start`
        return peak_mb(self._process.pid)

    def _end(self) -> int:
        self._asked = True
        process = self._process
        if process is None:
            return 0
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
        try:
            return process.wait(FAREWELL)
        except subprocess.TimeoutExpired:
            process.kill()
            return process.wait()
        except BaseException:  # a second Ctrl-C
            process.kill()
            raise

    def _watch(self, process: subprocess.Popen[bytes]) -> None:
        code = process.wait()
        if not self._asked:
            self._on_death(f"the node ended too early, with {code}; see {self._log}")


@contextmanager
def interrupts_held_back() -> Iterator[None]:
    """Let Ctrl-C and SIGTERM wait for the end of the block: a child half started would be lost."""
    came: list[int] = []
    usual = {
        number: signal.signal(number, lambda which, _: came.append(which))
        for number in (signal.SIGINT, signal.SIGTERM)
    }
    try:
        yield
    finally:
        for number, handler in usual.items():
            signal.signal(number, handler)
    if came:
        raise KeyboardInterrupt
