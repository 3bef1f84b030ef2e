"""News between threads: to wait for some with a limit, and to be told that none will come."""

from collections.abc import Callable
from threading import Condition

from ellipseg_ros.errors import EllipsegError


class News(Condition):
    """A condition that can be given up; hold it while what it tells of changes, then notify."""

    def __init__(self) -> None:
        super().__init__()
        self._given_up = ""

    def expect(
        self, done: Callable[[], bool], timeout: float, otherwise: str | Callable[[], str]
    ) -> None:
        """Wait until it is done; raises EllipsegError after `timeout` s, and if given up.

        otherwise: what is wrong then, or what tells it then.
        """
        with self:
            self.wait_for(lambda: done() or bool(self._given_up), timeout)
            if self._given_up:
                raise EllipsegError(self._given_up)
            if not done():
                problem = otherwise if isinstance(otherwise, str) else otherwise()
                raise EllipsegError(f"{problem} within {timeout:g} s")

    def give_up(self, reason: str) -> None:
        """Let everything that waits, now or later, fail with the first reason; for any thread."""
        with self:
            self._given_up = self._given_up or reason
            self.notify_all()
