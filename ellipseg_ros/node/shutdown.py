"""How a program ends that is told to by SIGINT or SIGTERM: soon, and without a traceback.

Imports nothing heavy, so that it is at work before the imports that take seconds.
"""

import os
import signal
import sys
import time
from collections.abc import Callable
from threading import Thread
from types import FrameType

SIGNALS = (signal.SIGINT, signal.SIGTERM)
LIMIT = 1.5  # s from the signal to the end


class Farewell:
    """From now on a signal ends the process; for its main thread, one at a time.

    code: the exit code then. words: a line for stderr, if there is no time for anything else.
    do: called at the first signal, others change nothing; None: the process ends at once.

    Python runs handlers only between two steps of the main thread, which may be in a kernel, and
    an exception that a handler raises can get lost. So another thread sees to the limit.
    """

    def __init__(self, code: int, words: str = "", do: Callable[[], object] | None = None) -> None:
        self._code = code
        self._words = words
        self._do = do or self._leave
        self._over = False
        self.asked = False
        reading, writing = os.pipe()
        os.set_blocking(writing, False)
        Thread(target=self._watch, args=[reading], name="farewell", daemon=True).start()
        for number in SIGNALS:
            signal.signal(number, self._on_signal)
        signal.set_wakeup_fd(writing, warn_on_full_buffer=False)
        os.register_at_fork(after_in_child=_watch_nothing)

    def end(self, code: int) -> int:
        """The work is done: its exit code; doesn't return if the process was told to end."""
        self._over = True
        if self.asked:
            self._leave()
        return code

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        if not (self.asked or self._over):
            self.asked = True
            sys.unraisablehook = lambda _: None  # the interrupt, within a destructor
            self._do()

    def _watch(self, pipe: int) -> None:
        while os.read(pipe, 1)[0] not in SIGNALS:  # any signal with a handler is told here
            pass
        time.sleep(LIMIT)
        if not self._over:
            os.write(sys.stderr.fileno(), self._words.encode())
            os._exit(self._code)

    def _leave(self) -> None:
        """End without the interpreter's own farewell, which waits for threads."""
        for stream in (sys.stdout, sys.stderr):
            try:
                stream.flush()
            except (OSError, ValueError):  # nobody reads any more
                pass
        os._exit(self._code)


def _watch_nothing() -> None:
    """A child's signals are no concern of its parent."""
    signal.set_wakeup_fd(-1)
