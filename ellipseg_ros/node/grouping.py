"""Which messages make one update: by their stamps alone, so that replay speed changes nothing."""

import math
from collections.abc import Iterable, Iterator
from dataclasses import replace

from ellipseg_ros.config import Config
from ellipseg_ros.core.fields import join_sweeps
from ellipseg_ros.core.restart import RestartRule
from ellipseg_ros.core.window import MAX_WINDOW_BYTES
from ellipseg_ros.records import SECOND, Sweep

MAX_GROUP_MESSAGES = 10_000


class Grouping:
    """Collects messages until one reaches the next boundary t0 + k period, k = 1, 2, ...

    t0 is the first stamp after a restart. The message that reaches the boundary closes the group
    and belongs to it; boundaries within a gap give no update. A message with which a group has
    more than `max_points`, 1 GiB of fields or 10,000 messages closes it as well: stamps may not
    advance.
    """

    def __init__(self, config: Config) -> None:
        self.configure(config)
        self._open: list[Sweep] = []
        self._points = self._bytes = 0  # of the open group
        self._first: int | None = None  # ns: t0
        self._boundary = 0  # ns: the stamp that closes the open group
        self._restart_rule = RestartRule()

    def configure(self, config: Config) -> None:
        """Apply new settings; the boundaries of the open group stay."""
        self._period = round(config.update_period * SECOND)
        self._max_lateness = round(config.max_lateness * SECOND)
        self._max_points = config.max_points or math.inf

    def push(self, sweep: Sweep) -> list[Sweep]:
        """Take one message; return the groups that it completes: none or one, rarely two.

        Two: a restart ends the group before it, and the message alone is more than `max_points`.
        """
        restart = self._restart_rule.take(sweep, self._max_lateness)
        complete = self.flush() if restart else []
        if restart or self._first is None:
            self._first = sweep.stamp_ns
            self._boundary = sweep.stamp_ns + self._period
        self._open.append(replace(sweep, restart=restart))
        self._points += len(sweep)
        self._bytes += 0 if sweep.fields is None else sweep.fields.nbytes
        full = (
            self._points > self._max_points
            or self._bytes > MAX_WINDOW_BYTES
            or len(self._open) >= MAX_GROUP_MESSAGES
        )
        if sweep.stamp_ns >= self._boundary or full:
            complete += self.flush()
        return complete

    def flush(self) -> list[Sweep]:
        """Close the open group as it is, at the end of a file; returns it, if there is one."""
        if not self._open or self._first is None:
            return []
        parts, self._open = self._open, []  # before joining, which may raise InputError
        self._points = self._bytes = 0
        passed = (self._restart_rule.newest_ns - self._first) // self._period
        self._boundary = self._first + (passed + 1) * self._period
        return [join_sweeps(parts)]


def updates(sweeps: Iterable[Sweep], config: Config) -> Iterator[Sweep]:
    """Yield one sweep an update: the messages between two boundaries, joined."""
    grouping = Grouping(config)
    for sweep in sweeps:
        yield from grouping.push(sweep)
    yield from grouping.flush()
