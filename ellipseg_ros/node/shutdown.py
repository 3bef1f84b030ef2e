"""Ending a process on SIGINT or SIGTERM within a bounded time and without a traceback.

Imports nothing heavy, so that it is active before the imports that take seconds.
"""

import os
import signal
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from threading import Thread
from types import FrameType

SIGNALS = (signal.SIGINT, signal.SIGTERM)
SHUTDOWN_TIMEOUT_S = 1.5  # from the signal to the forced exit


class ShutdownHandler:
    """Signal handlers that end the process; made in the main thread, one at a time.

    exit_code: of a forced exit. message: written to stderr on a forced exit.
    on_signal: called once, at the first signal; None: exit immediately.

    Python runs signal handlers only between two bytecodes of the main thread, which may be inside
    a kernel, and an exception raised by a handler can get lost in a destructor. Therefore a
    watchdog thread enforces the timeout.
    """

    def __init__(
        self, exit_code: int, message: str = "", on_signal: Callable[[], object] | None = None
    ) -> None:
        self._exit_code = exit_code
        self._message = message
        self._on_first_signal = on_signal or self._exit
        self._finished = False
        self.requested = False  # whether a signal has arrived
        reading, writing = os.pipe()
        os.set_blocking(writing, False)
        Thread(target=self._watchdog, args=[reading], name="shutdown", daemon=True).start()
        for number in SIGNALS:
            signal.signal(number, self._on_signal)
        signal.set_wakeup_fd(writing, warn_on_full_buffer=False)
        # Keep signals of a forked child out of the parent's pipe.
        os.register_at_fork(after_in_child=lambda: signal.set_wakeup_fd(-1))

    def finish(self, code: int) -> int:
        """Disarm the watchdog and return `code`; exits the process if a signal has arrived."""
        self._finished = True
        if self.requested:
            self._exit()
        return code

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        if not (self.requested or self._finished):
            self.requested = True
            sys.unraisablehook = lambda _: None  # the interrupt, raised inside a destructor
            self._on_first_signal()

    def _watchdog(self, pipe: int) -> None:
        while os.read(pipe, 1)[0] not in SIGNALS:  # signals with other handlers arrive here, too
            pass
        time.sleep(SHUTDOWN_TIMEOUT_S)
        if not self._finished:
            os.write(sys.stderr.fileno(), self._message.encode())
            os._exit(self._exit_code)

    def _exit(self) -> None:
        """Exit without the interpreter's finalization, which waits for threads."""
        for stream in (sys.stdout, sys.stderr):
            with suppress(OSError, ValueError):  # the reader has closed its end
                stream.flush()
        os._exit(self._exit_code)
