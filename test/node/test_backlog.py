"""The queue between the callbacks and the worker."""

from dataclasses import replace
from threading import Thread

import numpy as np
import pytest

from ellipseg_ros.config import Config, NodeConfig
from ellipseg_ros.core.fields import join_sweeps
from ellipseg_ros.core.window import Window
from ellipseg_ros.errors import InputError
from ellipseg_ros.io.topics import ELLIPSOIDS, SEGMENTS
from ellipseg_ros.node.backlog import Backlog, Overload, Resend, Reset, Update
from ellipseg_ros.records import Sweep


def update(stamp, restart="", **settings):
    sweep = Sweep(stamp, np.full((2, 3), float(stamp)), restart=restart)
    return Update(sweep, Config(**settings), NodeConfig(), float(stamp))


def drain(backlog):
    backlog.put(Resend(ELLIPSOIDS))  # the end
    tasks = []
    while not isinstance(task := backlog.get(1.0), Resend):
        tasks.append(task)
    return tasks


def test_tasks_keep_their_order():
    backlog = Backlog()
    tasks = [update(1), Reset("why"), update(2), update(3)]
    assert [backlog.put(task) for task in tasks] == [None] * 4
    assert backlog.waiting() == 3
    assert drain(backlog) == tasks


def test_up_to_the_limit_nothing_is_coalesced():
    backlog = Backlog()
    tasks = [update(1), update(2)]
    assert [backlog.put(task, 2) for task in tasks] == [None, None]
    assert drain(backlog) == tasks


def test_beyond_the_limit_all_updates_are_coalesced_without_loss():
    backlog = Backlog()
    for stamp in (1, 2):
        backlog.put(update(stamp), 2)
    assert backlog.put(update(3, criterion="density"), 2) == Overload(coalesced=2, dropped=0)
    (joined,) = drain(backlog)
    assert joined.sweep.times_ns.tolist() == [1, 1, 2, 2, 3, 3]
    assert joined.sweep.points[:, 0].tolist() == [1, 1, 2, 2, 3, 3]
    assert joined.arrival == 1.0  # the latency is that of the one that waited longest
    assert joined.config.criterion == "density"


def test_coalesced_updates_are_coalesced_again():
    backlog = Backlog()
    said = [backlog.put(update(stamp), 1) for stamp in (1, 2, 3)]
    assert said == [None, Overload(1, 0), Overload(1, 0)]
    (joined,) = drain(backlog)
    assert len(joined.sweep) == 6


def test_update_coalesced_and_then_dropped_counts_once():
    backlog = Backlog()
    tasks = [update(1), update(2), update(3), update(4, restart="a jump"), update(5)]
    said = [one for task in tasks if (one := backlog.put(task, 1))]
    taken = len(drain(backlog))
    assert taken + sum(one.coalesced + one.dropped for one in said) == len(tasks)


@pytest.mark.parametrize("restart", [update(3, restart="a jump"), Reset("asked for")])
def test_updates_before_a_restart_are_dropped(restart):
    backlog = Backlog()
    for task in (update(1), update(2), restart, update(4)):
        said = backlog.put(task, 3 if isinstance(restart, Update) else 2)
    assert (said.dropped, said.points_dropped) == (2, 4)
    left = drain(backlog)
    if isinstance(restart, Reset):
        assert left[0] is restart
        assert left[1].sweep.times_ns.tolist() == [4, 4]
    else:
        assert [task.sweep.restart for task in left] == ["a jump"]
        assert left[0].sweep.times_ns.tolist() == [3, 3, 4, 4]


def test_coalesced_updates_evict_points_as_a_window_does():
    backlog, config = Backlog(), Config(max_points=7, window_duration=100.0)
    groups = [update(stamp, max_points=7, window_duration=100.0) for stamp in range(1, 21)]
    groups[0] = replace(groups[0], sweep=replace(groups[0].sweep, restart="a jump"))
    said = [backlog.put(group, 1) for group in groups]
    (joined,) = drain(backlog)
    assert len(joined.sweep) == 8  # whole groups
    assert (joined.arrival, joined.sweep.restart) == (17.0, "a jump")
    whole, bounded = Window(), Window()
    of_all = whole.push(join_sweeps([group.sweep for group in groups]), config).evicted
    of_rest = bounded.push(joined.sweep, config).evicted
    assert sum(one.evicted for one in said[1:]) + of_rest == of_all
    assert bounded.points.position.tolist() == whole.points.position.tolist()
    assert bounded.points.times_ns.tolist() == whole.points.times_ns.tolist()


@pytest.mark.parametrize("limits", [{"max_points": 10}, {"max_points": 10**9}, {"max_points": 0}])
def test_backlog_is_bounded_by_points_and_bytes(limits, monkeypatch):
    monkeypatch.setattr("ellipseg_ros.core.window.MAX_WINDOW_BYTES", 40)
    backlog = Backlog()
    for stamp in range(1, 101):
        group = update(stamp, **limits)
        fields = np.zeros(2, [("x", "f4")])  # 4 bytes a point
        backlog.put(replace(group, sweep=replace(group.sweep, fields=fields)), 2)
    left = sum(len(task.sweep) for task in drain(backlog))
    assert left == 200 if limits["max_points"] == 0 else 10 <= left <= 12


def test_groups_are_joined_once_when_due(monkeypatch):
    lengths = []
    monkeypatch.setattr(
        "ellipseg_ros.node.backlog.join_sweeps",
        lambda sweeps: lengths.append(len(sweeps)) or join_sweeps(sweeps),
    )
    backlog = Backlog()
    for stamp in range(100):
        backlog.put(update(stamp), 1)
    assert lengths == []
    drain(backlog)
    assert lengths == [100]


def test_restarts_do_not_grow_the_backlog():
    backlog = Backlog()
    for stamp in range(100):
        backlog.put(update(stamp, restart="two sensors on one topic"), 2)
        assert backlog.waiting() <= 2


def test_get_returns_on_a_task_and_on_close():
    backlog = Backlog()
    got = []
    for wake, expected in (
        (lambda: backlog.put(Reset("now")), Reset("now")),
        (backlog.close, None),
    ):
        waiter = Thread(target=lambda: got.append(backlog.get(60.0)))
        waiter.start()
        wake()
        waiter.join(10.0)
        assert not waiter.is_alive()
        assert got.pop() == expected
    assert backlog.closed


def test_get_returns_nothing_after_close():
    backlog = Backlog()
    backlog.put(update(1))
    backlog.close()
    assert backlog.get(60.0) is None


def test_failed_coalescing_leaves_a_working_queue():
    backlog = Backlog()
    odd = update(2)
    kinds = [[("x", "f4", (2,))], [("x", "f4", (3,))]]
    first, second = (
        replace(odd, sweep=replace(odd.sweep, fields=np.zeros(2, kind))) for kind in kinds
    )
    tasks = [Reset("stays"), first, update(3)]
    for task in tasks[:2]:
        backlog.put(task, 1)
    with pytest.raises(InputError, match="field x"):
        backlog.put(second, 1)
    backlog.put(tasks[2], 1)
    assert drain(backlog) == [tasks[0], tasks[2]]


def test_redundant_tasks_are_not_queued():
    backlog = Backlog()
    for k in range(1000):
        backlog.put(Reset(f"call {k}"))
        backlog.put(Resend(ELLIPSOIDS))
        backlog.put(Resend(SEGMENTS))
    tasks = [Reset("call 0"), Resend(ELLIPSOIDS), Resend(SEGMENTS)]
    assert [backlog.get(1.0) for _ in tasks] == tasks
    assert backlog.get(0.0) is None


def test_reset_after_an_update_is_queued_again():
    backlog = Backlog()
    tasks = [Reset("one"), update(1), Reset("two")]
    for task in (tasks[0], tasks[0], *tasks[1:]):
        backlog.put(task)
    assert drain(backlog) == tasks
