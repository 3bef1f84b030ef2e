"""A subscriber to the segmenter's topics in a process of its own, and its reports."""

import json
import signal
import subprocess
from threading import Thread
from typing import Any

from ellipseg_ros.node.abortable_condition import AbortableCondition
from studies.endurance.programs import checkout_environment, python

PROGRAM = "import sys; from studies.endurance.ros.subscriber import main; sys.exit(main())"
SHUTDOWN_TIMEOUT_S = 10.0


class SubscriberProcess:
    """A process that subscribes to all topics of a segmenter; a context manager.

    ros_args: `--ros-args ...`, for a namespace. Waiting methods raise EllipsegError at their
    timeout (s), after `abort`, and if the process ends.
    """

    def __init__(self, ros_args: list[str]) -> None:
        self._args = ros_args
        self._changed = AbortableCondition()
        self._connected = False
        self.updates: dict[int, int] = {}  # stamp of an update: arrival of its segments, both ns
        self.diagnostics: dict[str, str] = {}  # the latest

    def __enter__(self) -> "SubscriberProcess":
        self._process = subprocess.Popen(
            [*python(PROGRAM), *self._args],
            env=checkout_environment(),
            stdout=subprocess.PIPE,
            text=True,
            start_new_session=True,  # Ctrl-C ends it through this process
        )
        self._thread = Thread(target=self._read, name="subscriber", daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.resume()
        self._process.terminate()
        try:
            self._process.wait(SHUTDOWN_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            self.kill()
        self._thread.join()
        assert self._process.stdout is not None  # a pipe
        self._process.stdout.close()

    def kill(self) -> None:
        """End it with SIGKILL, as a crash does."""
        self._process.kill()
        self._process.wait()

    def pause(self) -> None:
        """Stop the process, which then takes nothing from DDS, as if it hung."""
        self._process.send_signal(signal.SIGSTOP)

    def resume(self) -> None:
        """Continue a stopped process."""
        self._process.send_signal(signal.SIGCONT)

    def abort(self, reason: str) -> None:
        """Let everything that waits fail with `reason`; for any thread."""
        self._changed.abort(reason)

    def wait_for_topics(self, timeout_s: float) -> None:
        """Wait until the process is connected to publishers of all topics."""
        self._changed.wait_until(lambda: self._connected, timeout_s, "nothing is published")

    def wait_for_update(self, stamp_ns: int, timeout_s: float) -> int:
        """Wait for the update of this stamp; returns when its segments arrived, ns."""
        arrived = "an update did not arrive"
        self._changed.wait_until(lambda: stamp_ns in self.updates, timeout_s, arrived)
        return self.updates[stamp_ns]

    def next_report(self, timeout_s: float) -> dict[str, str]:
        """Wait for the segmenter's next /diagnostics; returns their values by name."""
        with self._changed:
            self.diagnostics = {}
        missing = "no /diagnostics arrived"
        self._changed.wait_until(lambda: bool(self.diagnostics), timeout_s, missing)
        return self.diagnostics

    def _read(self) -> None:
        assert self._process.stdout is not None  # a pipe
        for line in self._process.stdout:
            self._take(json.loads(line))
        self.abort("the measuring subscriber ended")

    def _take(self, report: dict[str, Any]) -> None:
        with self._changed:
            self._connected = self._connected or report.get("connected", False)
            if report.get("stamp_ns"):
                self.updates[report["stamp_ns"]] = report["now_ns"]
            self.diagnostics = report.get("diagnostics", self.diagnostics)
            self._changed.notify_all()
