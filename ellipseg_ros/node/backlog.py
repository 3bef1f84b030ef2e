"""The queue of tasks between the callbacks and the worker, in the order of arrival."""

from collections import deque
from dataclasses import dataclass, replace
from threading import Condition
from typing import TypeAlias

from ellipseg_ros.config import Config, NodeConfig
from ellipseg_ros.core.fields import join_sweeps, joined_layout, layout_of
from ellipseg_ros.core.window import max_window_points
from ellipseg_ros.io.topics import Topic
from ellipseg_ros.records import Sweep


@dataclass(frozen=True)
class Update:
    """A group of clouds to segment, with the settings at its arrival."""

    sweep: Sweep
    config: Config
    node_config: NodeConfig
    arrival: float  # s, monotonic clock: arrival of the cloud that closed the group
    threshold_change: str = "set"  # reason of the last change of criterion or threshold


@dataclass(frozen=True)
class Reset:
    """Empty the window."""

    reason: str


@dataclass(frozen=True)
class Resend:
    """Send the last update to a new subscriber of a topic."""

    topic: Topic


Task: TypeAlias = Update | Reset | Resend


@dataclass(frozen=True)
class Overload:
    """How `Backlog.put` enforced the limit on waiting updates."""

    coalesced: int  # updates merged into another one
    dropped: int  # updates of a window that a restart has ended
    points_dropped: int = 0  # their points
    evicted: int = 0  # points that `max_points` evicted before they were segmented


class Batch:
    """Updates that are coalesced: their groups are joined once, when they are due."""

    def __init__(self, update: Update) -> None:
        self._updates = deque([update])
        self._layout = layout_of(update.sweep.fields)
        self.restart = update.sweep.restart  # of the first group, which may have been evicted
        self.points = len(update.sweep)

    def add(self, later: "Batch") -> None:
        """Append a later batch; raises InputError if the fields of the two can't be joined."""
        self._layout = joined_layout(self._layout, later._layout)
        self._updates += later._updates
        self.points += later.points

    def evict(self) -> int:
        """Drop the oldest groups that would not stay in the window; return their points.

        A window holds at most `max_points` points, and at most 1 GiB of fields.
        """
        before = self.points
        limit = max_window_points(self._updates[-1].config.max_points, self._layout)
        while limit and self.points - len(self._updates[0].sweep) >= limit:
            self.points -= len(self._updates.popleft().sweep)
        return before - self.points

    def joined(self) -> Update:
        """Join the groups to one update, with the newest settings and the oldest arrival."""
        first, last = self._updates[0], self._updates[-1]
        if first is last and first.sweep.restart == self.restart:
            return first
        sweep = join_sweeps([update.sweep for update in self._updates])
        return replace(last, sweep=replace(sweep, restart=self.restart), arrival=first.arrival)


Entry: TypeAlias = Batch | Reset | Resend


class Backlog:
    """A queue between two threads, with a limit on the number of waiting updates.

    Beyond the limit, all updates since the last restart are coalesced, and those before it are
    dropped. Of coalesced updates the oldest groups are evicted as from the window: memory is
    bounded by `max_points` and a group, however long an update takes.
    """

    def __init__(self) -> None:
        self._entries: deque[Entry] = deque()
        self._changed = Condition()
        self.closed = False  # whether `close` was called

    def put(self, task: Task, max_updates: int = 0) -> Overload | None:
        """Append a task; return what the limit did, if anything. max_updates = 0: no limit.

        A task that would repeat a waiting one is not appended, so that a flood of calls or of
        subscribers does not become a flood of tasks.
        Raises InputError if updates can't be coalesced; they are dropped.
        """
        with self._changed:
            if self._is_redundant(task):
                return None
            self._entries.append(Batch(task) if isinstance(task, Update) else task)
            self._changed.notify()
            if not 0 < max_updates < self.waiting():
                return None
            entries = list(self._entries)
            self._entries = deque(item for item in entries if not isinstance(item, Batch))
            self._entries, overload = _coalesce(entries)
            return overload

    def _is_redundant(self, task: Task) -> bool:
        """Whether a waiting task has the same effect; for a reset: if no update follows it."""
        if isinstance(task, Reset):
            changes = [item for item in self._entries if not isinstance(item, Resend)]
            return bool(changes) and isinstance(changes[-1], Reset)
        return isinstance(task, Resend) and task in self._entries

    def get(self, timeout: float) -> Task | None:
        """Wait for the next task; None after `timeout` s, and immediately when closed."""
        with self._changed:
            self._changed.wait_for(lambda: self._entries or self.closed, timeout)
            entry = self._entries.popleft() if self._entries and not self.closed else None
        # Joining takes time, in which clouds must not be blocked.
        return entry.joined() if isinstance(entry, Batch) else entry

    def close(self) -> None:
        """Make `get` return None from now on."""
        with self._changed:
            self.closed = True
            self._changed.notify_all()

    def waiting(self) -> int:
        """Number of waiting updates."""
        return sum(isinstance(entry, Batch) for entry in list(self._entries))


def _coalesce(entries: list[Entry]) -> tuple[deque[Entry], Overload]:
    """Coalesce the updates since the last restart, and drop all entries before it."""
    start = 0
    for k, entry in enumerate(entries):
        if isinstance(entry, Reset) or (isinstance(entry, Batch) and entry.restart):
            start = k
    dropped = [entry for entry in entries[:start] if isinstance(entry, Batch)]
    kept = [entry for entry in entries[start:] if isinstance(entry, Batch)]
    others: list[Entry] = [entry for entry in entries[start:] if not isinstance(entry, Batch)]
    for later in kept[1:]:
        kept[0].add(later)
    overload = Overload(
        coalesced=max(0, len(kept) - 1),
        dropped=len(dropped),  # updates merged into them count as coalesced already
        points_dropped=sum(batch.points for batch in dropped),
        evicted=kept[0].evict() if kept else 0,
    )
    return deque([*others, *kept[:1]]), overload
