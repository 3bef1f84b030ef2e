"""What waits for the worker, in the order of arrival: updates, resets, wishes for all of it."""

from collections import deque
from dataclasses import dataclass, replace
from threading import Condition
from typing import TypeAlias

from ellipseg_ros.config import Config, NodeConfig
from ellipseg_ros.core.fields import Layout, join_sweeps, joined_layout
from ellipseg_ros.core.window import max_window_points
from ellipseg_ros.records import Sweep


@dataclass(frozen=True)
class Update:
    """A group of clouds to segment, and the settings of its time."""

    sweep: Sweep
    config: Config
    shown: NodeConfig
    arrived: float  # s, monotonic clock: when the cloud that closed the group came
    reason: str = "set"  # why the settings are as they are, if they have changed


@dataclass(frozen=True)
class Reset:
    """Forget the window."""

    reason: str


@dataclass(frozen=True)
class ShowAll:
    """Somebody new wants to see every marker."""


@dataclass(frozen=True)
class ListAll:
    """Somebody new wants to know every segment."""


Task = Update | Reset | ShowAll | ListAll


@dataclass(frozen=True)
class Overload:
    """What became of groups that would have waited too long."""

    joined: int  # taken together with another one
    given_up: int  # of a window that a restart ended: nobody would have seen them
    points_given_up: int = 0  # in those
    evicted: int = 0  # points that expired before they were segmented, for `max_points`


class Batch:
    """Groups that are taken together: joined once, when it is their turn."""

    def __init__(self, update: Update) -> None:
        self._parts = deque([update])
        self._layout = _layout(update.sweep)
        self.restart = update.sweep.restart  # of the first group, which may have expired
        self.points = len(update.sweep)

    def add(self, later: "Batch") -> None:
        """Take another one in; raises InputError if their fields cannot be joined."""
        self._layout = joined_layout(self._layout, later._layout)
        self._parts += later._parts
        self.points += later.points

    def make_room(self) -> int:
        """Drop the oldest groups that `max_points` newer points follow; how many points.

        They would not stay in the window. It holds no more either if its fields have 1 GiB.
        """
        before = self.points
        limit = max_window_points(self._parts[-1].config.max_points, self._layout)
        while limit and self.points - len(self._parts[0].sweep) >= limit:
            self.points -= len(self._parts.popleft().sweep)
        return before - self.points

    def joined(self) -> Update:
        """One update with the newest settings, and with the oldest arrival for the latency."""
        if len(self._parts) == 1 and self._parts[0].sweep.restart == self.restart:
            return self._parts[0]
        sweep = join_sweeps([part.sweep for part in self._parts])
        return replace(
            self._parts[-1],
            sweep=replace(sweep, restart=self.restart),
            arrived=self._parts[0].arrived,
        )


def _layout(sweep: Sweep) -> Layout:
    return None if sweep.fields is None else sweep.fields.dtype


Waiting: TypeAlias = Batch | Reset | ShowAll | ListAll


class Backlog:
    """A queue between two threads, with a limit on the updates that wait.

    Beyond the limit, all groups since the last restart are taken together, and those before it
    are given up. Of what is taken together, the oldest groups expire as they would in the window:
    what waits is bounded by `max_points` and a group, however long an update takes.
    """

    def __init__(self) -> None:
        self._tasks: deque[Waiting] = deque()
        self._changed = Condition()
        self._closed = False

    def put(self, task: Task, max_updates: int = 0) -> Overload | None:
        """Add a task; max_updates = 0: no limit. Returns what the limit did, if anything.

        What waits already, and would do no more if it were done twice, is not added: a flood of
        calls or of subscribers makes no flood of tasks.
        Raises InputError if groups that must be taken together cannot be; they are given up.
        """
        with self._changed:
            if self._is_twice(task):
                return None
            self._tasks.append(Batch(task) if isinstance(task, Update) else task)
            self._changed.notify()
            if not 0 < max_updates < self.waiting():
                return None
            tasks = list(self._tasks)
            self._tasks = deque(task for task in tasks if not isinstance(task, Batch))
            self._tasks, overload = _taken_together(tasks)
            return overload

    def _is_twice(self, task: Task) -> bool:
        """Whether a task that waits does the same: a reset only if nothing came after it."""
        if isinstance(task, Reset):
            others = [one for one in self._tasks if not isinstance(one, (ShowAll, ListAll))]
            return bool(others) and isinstance(others[-1], Reset)
        return isinstance(task, (ShowAll, ListAll)) and task in self._tasks

    def get(self, timeout: float) -> Task | None:
        """Wait for the next task; None after `timeout` s, and at once when closed."""
        with self._changed:
            self._changed.wait_for(lambda: self._tasks or self._closed, timeout)
            task = self._tasks.popleft() if self._tasks and not self._closed else None
        # Joining takes a while, in which clouds can be put.
        return task.joined() if isinstance(task, Batch) else task

    def close(self) -> None:
        """Give out nothing more, and wake who waits."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    @property
    def closed(self) -> bool:
        """Whether `close` was called."""
        return self._closed

    def waiting(self) -> int:
        """Number of updates that wait."""
        return sum(isinstance(task, Batch) for task in list(self._tasks))


def _taken_together(tasks: list[Waiting]) -> tuple[deque[Waiting], Overload]:
    start = max((k for k, task in enumerate(tasks) if _restarts(task)), default=0)
    old = [task for task in tasks[:start] if isinstance(task, Batch)]
    new = [task for task in tasks[start:] if isinstance(task, Batch)]
    others: list[Waiting] = [task for task in tasks[start:] if not isinstance(task, Batch)]
    for later in new[1:]:
        new[0].add(later)
    overload = Overload(
        max(0, len(new) - 1),
        len(old),  # what was joined to them is counted already
        sum(batch.points for batch in old),
        new[0].make_room() if new else 0,
    )
    return deque([*others, *new[:1]]), overload


def _restarts(task: Waiting) -> bool:
    return isinstance(task, Reset) or (isinstance(task, Batch) and bool(task.restart))
