"""Which messages make one update: by their stamps alone, so that replay speed changes nothing."""

from collections.abc import Iterable, Iterator
from dataclasses import replace

from ellipseg_ros.config import Config
from ellipseg_ros.core.window import Window
from ellipseg_ros.data import Sweep, clashing_field, join_sweeps

SECOND = 1_000_000_000  # ns


class Grouping:
    """Collects messages until one reaches the next boundary t0 + k period, k = 1, 2, ...

    t0 is the first stamp after a restart. The message that reaches the boundary closes the group
    and belongs to it; boundaries that a gap jumped over give no update.
    """

    def __init__(self, config: Config) -> None:
        self.configure(config)
        self._open: list[Sweep] = []
        self._first = 0  # ns: t0
        self._newest = 0  # ns: newest stamp
        self._boundary = 0  # ns: the stamp that closes the open group
        self._last: Sweep | None = None  # the last message, without its points

    def configure(self, config: Config) -> None:
        """Take new settings; the boundaries of the open group stay."""
        self._period = round(config.update_period * SECOND)
        self._lateness = round(config.max_lateness * SECOND)

    def push(self, sweep: Sweep) -> list[Sweep]:
        """Take one message; return the groups that it completes (none, one, or two at a jump)."""
        done: list[Sweep] = []
        restart = sweep.restart or self._why_restart(sweep)
        if restart:
            done += self.flush()
        if restart or self._last is None:
            self._first = self._newest = sweep.stamp_ns
            self._boundary = sweep.stamp_ns + self._period
        self._open.append(replace(sweep, restart=restart))
        self._last = sweep.keep(slice(0, 0))
        self._newest = max(self._newest, sweep.stamp_ns)
        if sweep.stamp_ns >= self._boundary:
            done += self.flush()
        return done

    def flush(self) -> list[Sweep]:
        """Close the open group as it is: at the end of a file, before a restart."""
        if not self._open:
            return []
        parts, self._open = self._open, []  # before joining, which may raise InputError
        passed = (self._newest - self._first) // self._period
        self._boundary = self._first + (passed + 1) * self._period
        return [join_sweeps(parts)]

    def _why_restart(self, sweep: Sweep) -> str:
        if self._last is None:
            return ""
        return why_restart(self._last, sweep, self._newest, self._lateness)


def why_restart(before: Sweep | Window, sweep: Sweep, newest_ns: int, lateness_ns: int) -> str:
    """Say why a window that held `before` cannot go on with `sweep`; an empty text if it can.

    newest_ns: the newest stamp so far; lateness_ns: how far a stamp may lie behind it.
    """
    if sweep.frame_id != before.frame_id:
        return f"the frame changed from {before.frame_id!r} to {sweep.frame_id!r}"
    name = clashing_field(before.fields, sweep.fields)
    if name:
        return f"the count of field {name!r} changed"
    behind = newest_ns - sweep.stamp_ns
    if behind > lateness_ns:
        return f"the stamps jumped back by {behind / SECOND:.3f} s"
    return ""


def updates(sweeps: Iterable[Sweep], config: Config) -> Iterator[Sweep]:
    """Yield one sweep an update: the messages between two boundaries, joined."""
    grouping = Grouping(config)
    for sweep in sweeps:
        yield from grouping.push(sweep)
    yield from grouping.flush()
