"""The segmenter node as a child process."""

import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from pathlib import Path
from threading import Thread

from ellipseg_ros.errors import EllipsegError
from ellipseg_ros.node.memory import peak_mb

PROGRAM = """
import ctypes, signal, sys
ctypes.CDLL(None).prctl(1, signal.SIGINT)  # PR_SET_PDEATHSIG: end together with the parent
from ellipseg_ros.ros.start import segmenter
sys.exit(segmenter())
"""
START_TIMEOUT_S = 180.0  # imports, and the first compilation of all kernels
SHUTDOWN_TIMEOUT_S = 10.0  # after which the process is killed


class NodeProcess(AbstractContextManager["NodeProcess"]):
    """A segmenter process, from `start` to the end of the `with` block at the latest.

    args: `--ros-args ...` of the node. log: file for its output.
    on_death: called, in another thread, with the reason if it ends before `stop` is called.
    """

    def __init__(self, args: list[str], log: Path, on_death: Callable[[str], None]) -> None:
        self._args = args
        self._log = log
        self._on_death = on_death
        self._stopping = False
        self._process: subprocess.Popen[bytes] | None = None

    def __exit__(self, *_: object) -> None:
        self._end()

    def start(self) -> None:
        """Start the process; KeyboardInterrupt is raised only when it can be stopped again."""
        with self._log.open("wb") as log, delayed_interrupts():
            self._process = subprocess.Popen(
                [sys.executable, "-c", PROGRAM, *self._args],
                stdout=log,
                stderr=subprocess.STDOUT,
                start_new_session=True,  # Ctrl-C reaches it only through `stop`
            )
        Thread(target=self._watch, args=[self._process], name="node", daemon=True).start()

    def stop(self) -> None:
        """End it as Ctrl-C does; raises EllipsegError if its exit code is not 0."""
        code = self._end()
        if code:
            raise EllipsegError(f"the node ended with {code}; see {self._log}")

    def peak_memory_mb(self) -> float:
        """Peak resident memory, in MB (10^6 bytes)."""
        return peak_mb(self.pid)

    @property
    def pid(self) -> int:
        """The number of the started process."""
        assert self._process is not None, "call `start` first"
        return self._process.pid

    def _end(self) -> int:
        self._stopping = True
        process = self._process
        if process is None:
            return 0
        process.send_signal(signal.SIGINT)  # no effect if it has ended
        try:
            with suppress(subprocess.TimeoutExpired):
                process.wait(SHUTDOWN_TIMEOUT_S)
        finally:  # also at a second Ctrl-C
            process.kill()  # no effect if it has ended
        return process.wait()

    def _watch(self, process: "subprocess.Popen[bytes]") -> None:
        code = process.wait()
        if not self._stopping:
            self._on_death(f"the node ended too early, with {code}; see {self._log}")


@contextmanager
def delayed_interrupts() -> Iterator[None]:
    """Delay SIGINT and SIGTERM to the end of the block, so that no half started child is lost."""
    received: list[int] = []
    signals = (signal.SIGINT, signal.SIGTERM)
    handlers = [signal.signal(n, lambda number, _: received.append(number)) for n in signals]
    try:
        yield
    finally:
        for number, handler in zip(signals, handlers, strict=True):
            signal.signal(number, handler)
    if received:
        raise KeyboardInterrupt
