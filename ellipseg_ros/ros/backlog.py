"""What waits for the worker, in the order of arrival: updates, resets, wishes for all of it."""

from collections import deque
from dataclasses import dataclass, replace
from threading import Condition

from ellipseg_ros.config import Config, NodeConfig
from ellipseg_ros.data import Sweep, join_sweeps


@dataclass(frozen=True)
class Update:
    """A group of clouds to segment, and the settings of its time."""

    sweep: Sweep
    config: Config
    shown: NodeConfig
    arrived: float  # s, monotonic clock: when the cloud that closed the group came
    groups: int = 1  # how many were taken together
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


class Backlog:
    """A queue between two threads, with a limit on the updates that wait.

    Beyond the limit, all groups since the last restart are taken together, and those before it
    are given up.
    """

    def __init__(self) -> None:
        self._tasks: deque[Task] = deque()
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
            self._tasks.append(task)
            self._changed.notify()
            if not 0 < max_updates < self.waiting():
                return None
            tasks = list(self._tasks)
            self._tasks = deque(task for task in tasks if not isinstance(task, Update))
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
            return self._tasks.popleft() if self._tasks and not self._closed else None

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
        return sum(isinstance(task, Update) for task in list(self._tasks))


def _taken_together(tasks: list[Task]) -> tuple[deque[Task], Overload]:
    start = max((k for k, task in enumerate(tasks) if _restarts(task)), default=0)
    old = [task for task in tasks[:start] if isinstance(task, Update)]
    new = [task for task in tasks[start:] if isinstance(task, Update)]
    others: list[Task] = [task for task in tasks[start:] if not isinstance(task, Update)]
    overload = Overload(max(0, len(new) - 1), sum(update.groups for update in old))
    return deque([*others, *_joined(new)]), overload


def _restarts(task: Task) -> bool:
    return isinstance(task, Reset) or (isinstance(task, Update) and bool(task.sweep.restart))


def _joined(updates: list[Update]) -> list[Update]:
    """One update with the newest settings, and with the oldest arrival for the latency."""
    if not updates:
        return []
    sweep = join_sweeps([update.sweep for update in updates])
    groups = sum(update.groups for update in updates)
    return [replace(updates[-1], sweep=sweep, arrived=updates[0].arrived, groups=groups)]
