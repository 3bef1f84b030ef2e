"""A condition variable whose waiters fail with a reason after a timeout or an abort."""

from collections.abc import Callable
from threading import Condition

from ellipseg_ros.errors import EllipsegError


class AbortableCondition(Condition):
    """A threading.Condition that can be aborted; notify it after changing the guarded state."""

    def __init__(self) -> None:
        super().__init__()
        self._abort_reason = ""

    def wait_until(
        self,
        predicate: Callable[[], bool],
        timeout: float,
        problem: str | Callable[[], str],
    ) -> None:
        """Block until `predicate()` is true.

        timeout: s. problem: the error text after a timeout, or a function that returns it.
        Raises EllipsegError after the timeout, and with the abort's reason after `abort`.
        """
        with self:
            self.wait_for(lambda: predicate() or bool(self._abort_reason), timeout)
            if self._abort_reason:
                raise EllipsegError(self._abort_reason)
            if not predicate():
                text = problem if isinstance(problem, str) else problem()
                raise EllipsegError(f"{text} within {timeout:g} s")

    def abort(self, reason: str) -> None:
        """Make all present and future waits fail with the first reason given; thread-safe."""
        with self:
            self._abort_reason = self._abort_reason or reason
            self.notify_all()
