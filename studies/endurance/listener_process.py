"""The other end of the listener process: waits for what it tells."""

import json
import signal
import subprocess
import sys
from threading import Thread
from typing import Any

from ellipseg_ros.node.abortable_condition import AbortableCondition

START = "import sys; from studies.endurance.ros.listener import main; sys.exit(main())"
FAREWELL = 10.0  # s


class Listening:
    """A subscriber to the segmenter's topics in a process of its own; a context manager."""

    def __init__(self, ros_args: list[str]) -> None:
        self._args = ros_args
        self._changed = AbortableCondition()
        self._known = False
        self.updates: dict[int, int] = {}  # stamp of an update, ns: when its segments came
        self.diagnostics: dict[str, str] = {}  # the latest

    def __enter__(self) -> "Listening":
        self._process = subprocess.Popen(
            [sys.executable, "-c", START, *self._args],
            stdout=subprocess.PIPE,
            text=True,
            start_new_session=True,  # Ctrl-C ends it through us
        )
        self._thread = Thread(target=self._read, name="listener", daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.read_on()
        self._process.terminate()
        try:
            self._process.wait(FAREWELL)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._thread.join()
        assert self._process.stdout is not None  # a pipe
        self._process.stdout.close()

    def kill(self) -> None:
        """End it as a crash does."""
        self._process.kill()
        self._process.wait()

    def stop_reading(self) -> None:
        """Let it take nothing more from DDS, as if its program hung."""
        self._process.send_signal(signal.SIGSTOP)

    def read_on(self) -> None:
        """Wake it up again."""
        self._process.send_signal(signal.SIGCONT)

    def give_up(self, reason: str) -> None:
        """Let everything that waits fail with `reason`; for any thread."""
        self._changed.abort(reason)

    def wait_for_topics(self, timeout: float) -> None:
        """Wait until all topics are published to it; raises EllipsegError after `timeout` s."""
        self._changed.wait_until(lambda: self._known, timeout, "nothing is published")

    def wait_for_update(self, stamp_ns: int, timeout: float) -> int:
        """When the update of this stamp came, ns; raises EllipsegError after `timeout` s."""
        self._changed.wait_until(
            lambda: stamp_ns in self.updates, timeout, "the update is missing"
        )
        return self.updates[stamp_ns]

    def next_report(self, timeout: float) -> dict[str, str]:
        """What the segmenter's /diagnostics say from now on; raises EllipsegError likewise."""
        with self._changed:
            self.diagnostics = {}
        self._changed.wait_until(lambda: bool(self.diagnostics), timeout, "no /diagnostics arrive")
        return self.diagnostics

    def _read(self) -> None:
        assert self._process.stdout is not None  # a pipe
        for line in self._process.stdout:
            self._take(json.loads(line))
        self.give_up("the subscriber that measures ended")

    def _take(self, news: dict[str, Any]) -> None:
        with self._changed:
            self._known = self._known or news.get("known", False)
            if news.get("stamp_ns"):
                self.updates[news["stamp_ns"]] = news["now_ns"]
            self.diagnostics = news.get("diagnostics", self.diagnostics)
            self._changed.notify_all()
