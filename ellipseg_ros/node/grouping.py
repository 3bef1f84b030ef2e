"""Which messages make one update: by their stamps alone, so that replay speed changes nothing."""

import math
from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import NamedTuple

from ellipseg_ros.config import Config
from ellipseg_ros.core.window import MOST_BYTES
from ellipseg_ros.records import (
    SECOND,
    WIDEST,
    Layout,
    Sweep,
    clashing_field,
    join_sweeps,
    joined_layout,
    too_wide,
)

MOST_MESSAGES = 10_000  # of a group


class Grouping:
    """Collects messages until one reaches the next boundary t0 + k period, k = 1, 2, ...

    t0 is the first stamp after a restart. The message that reaches the boundary closes the group
    and belongs to it; boundaries that a gap jumped over give no update. A message with which a
    group has more than `max_points`, 1 GiB of fields or 10,000 messages closes it, too: stamps
    may stand still.
    """

    def __init__(self, config: Config) -> None:
        self.configure(config)
        self._open: list[Sweep] = []
        self._points = self._bytes = 0  # of the open group
        self._first = 0  # ns: t0
        self._before: Before | None = None  # what came so far
        self._boundary = 0  # ns: the stamp that closes the open group

    def configure(self, config: Config) -> None:
        """Take new settings; the boundaries of the open group stay."""
        self._period = round(config.update_period * SECOND)
        self._lateness = round(config.max_lateness * SECOND)
        self._most = config.max_points or math.inf

    def push(self, sweep: Sweep) -> list[Sweep]:
        """Take one message; return the groups that it completes: none or one, rarely two.

        Two: a restart ends the group before it, and the message alone is more than `max_points`.
        """
        done: list[Sweep] = []
        before = self._before
        restart = sweep.restart or (why_restart(before, sweep, self._lateness) if before else "")
        if restart:
            done += self.flush()
        if restart or before is None:
            self._first = sweep.stamp_ns
            self._boundary = sweep.stamp_ns + self._period
            before = None
        self._open.append(replace(sweep, restart=restart))
        self._before = and_then(before, sweep)
        self._points += len(sweep)
        self._bytes += 0 if sweep.fields is None else sweep.fields.nbytes
        full = (
            self._points > self._most
            or self._bytes > MOST_BYTES
            or len(self._open) >= MOST_MESSAGES
        )
        if sweep.stamp_ns >= self._boundary or full:
            done += self.flush()
        return done

    def flush(self) -> list[Sweep]:
        """Close the open group as it is: at the end of a file, before a restart."""
        if not self._open:
            return []
        parts, self._open = self._open, []  # before joining, which may raise InputError
        self._points = self._bytes = 0
        newest = self._before.newest_ns if self._before else 0
        passed = (newest - self._first) // self._period
        self._boundary = self._first + (passed + 1) * self._period
        return [join_sweeps(parts)]


class Before(NamedTuple):
    """What of the sweeps so far decides whether a window can go on with the next one."""

    newest_ns: int  # newest stamp
    frame_id: str
    layout: Layout  # of the fields


def and_then(before: Before | None, sweep: Sweep) -> Before:
    """What came so far, with one more sweep."""
    layout = None if sweep.fields is None else sweep.fields.dtype
    if before is None:
        return Before(sweep.stamp_ns, sweep.frame_id, layout)
    newest = max(before.newest_ns, sweep.stamp_ns)
    return Before(newest, before.frame_id, joined_layout(before.layout, layout))


def why_restart(before: Before, sweep: Sweep, lateness_ns: int) -> str:
    """Say why the window cannot go on with `sweep`; an empty text if it can.

    lateness_ns: how far a stamp may lie behind the newest.
    """
    if sweep.frame_id != before.frame_id:
        return f"the frame changed from {before.frame_id!r} to {sweep.frame_id!r}"
    layout = None if sweep.fields is None else sweep.fields.dtype
    name = clashing_field(before.layout, layout)
    if name:
        return f"the count of field {name!r} changed"
    if too_wide(before.layout, layout):
        return f"the fields changed, and with those before they take more than {WIDEST} bytes"
    behind = before.newest_ns - sweep.stamp_ns
    if behind > lateness_ns:
        return f"the stamps jumped back by {behind / SECOND:.3f} s"
    return ""


def updates(sweeps: Iterable[Sweep], config: Config) -> Iterator[Sweep]:
    """Yield one sweep an update: the messages between two boundaries, joined."""
    grouping = Grouping(config)
    for sweep in sweeps:
        yield from grouping.push(sweep)
    yield from grouping.flush()
