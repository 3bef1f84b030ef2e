import numpy as np
import pytest
from clouds import SECOND, stream

from ellipseg_ros.config import Config
from ellipseg_ros.core.fields import join_sweeps
from ellipseg_ros.errors import InputError
from ellipseg_ros.node.grouping import MAX_GROUP_MESSAGES, Grouping, updates
from ellipseg_ros.records import Sweep

CONFIG = Config(update_period=1.0)


def sweeps(*stamps, **kwargs):
    return [Sweep(round(s * SECOND), np.full((1, 3), s), **kwargs) for s in stamps]


def stamps(groups):
    return [[float(x) for x in group.points[:, 0]] for group in groups]


def test_message_at_a_boundary_closes_its_group():
    groups = updates(sweeps(5.0, 5.5, 6.0, 6.2, 6.9, 7.1, 7.9, 8.0), CONFIG)
    assert stamps(groups) == [[5.0, 5.5, 6.0], [6.2, 6.9, 7.1], [7.9, 8.0]]


def test_empty_period_gives_no_update_and_end_flushes():
    groups = updates(sweeps(0.0, 0.5, 4.5, 4.9, 5.0, 5.2), CONFIG)
    assert stamps(groups) == [[0.0, 0.5, 4.5], [4.9, 5.0], [5.2]]


def test_late_message_joins_the_open_group_and_a_later_one_restarts():
    groups = list(updates(sweeps(10.0, 10.9, 10.2, 11.0, 11.4, 10.3, 10.5), CONFIG))
    assert stamps(groups) == [[10.0, 10.9, 10.2, 11.0], [11.4], [10.3, 10.5]]
    assert [bool(group.restart) for group in groups] == [False, False, True]
    assert "back by 1.100 s" in groups[2].restart


def test_points_keep_their_times_in_a_group():
    one = Sweep(SECOND, np.zeros((2, 3)), np.array([-5, 7]))
    two = Sweep(3 * SECOND, np.zeros((1, 3)), np.array([1]))
    (group,) = updates([one, two], CONFIG)
    assert list(group.times_ns) == [SECOND - 5, SECOND + 7, 3 * SECOND + 1]


def test_a_frame_change_restarts():
    groups = list(updates(sweeps(0.0, 0.1) + sweeps(0.2, frame_id="map"), CONFIG))
    assert stamps(groups) == [[0.0, 0.1], [0.2]] and "'map'" in groups[1].restart


@pytest.mark.parametrize("parts", [2, 7])
def test_splitting_messages_between_boundaries_changes_no_group(parts):
    whole = list(stream(np.random.default_rng(0)))
    config = Config(update_period=0.5)
    grouping, split = Grouping(config), []
    for s in whole:
        closes = bool(grouping.push(s))  # its first part would close the group: not split
        split += [
            s.keep(rows) for rows in np.array_split(np.arange(len(s)), 1 if closes else parts)
        ]
    for one, other in zip(updates(whole, config), updates(split, config), strict=True):
        assert np.array_equal(one.points, other.points, equal_nan=True)
        assert np.array_equal(one.times_ns, other.times_ns)


def test_group_of_constant_stamps_closes_at_window_size():
    config = Config(update_period=1.0, max_points=10)
    clouds = [Sweep(0, np.zeros((4, 3))) for _ in range(7)]
    assert [len(group) for group in updates(clouds, config)] == [12, 12, 4]
    unlimited = Config(update_period=1.0, max_points=0)
    assert [len(group) for group in updates(clouds, unlimited)] == [28]
    nothing = (Sweep(0, np.zeros((0, 3))) for _ in range(2 * MAX_GROUP_MESSAGES + 1))
    assert len(list(updates(nothing, config))) == 3


def test_restart_by_a_window_sized_message_completes_two_groups():
    grouping = Grouping(Config(max_points=10))
    assert grouping.push(Sweep(9 * SECOND, np.zeros((4, 3)))) == []
    assert [len(group) for group in grouping.push(Sweep(0, np.zeros((11, 3))))] == [4, 11]


def test_group_that_cannot_be_joined_is_dropped():
    grouping = Grouping(CONFIG)
    a = Sweep(0, np.zeros((1, 3)), fields=np.zeros(1, [("a", "f4")]))
    b = Sweep(1, np.zeros((1, 3)), fields=np.zeros(1, [("a", "f4", 2)]))
    grouping.push(a)
    (closed,) = grouping.push(b)  # clashing fields restart instead
    assert len(closed) == 1 and grouping.flush()[0].restart
    with pytest.raises(InputError, match="different counts"):
        join_sweeps([a, b])


def test_group_closes_at_the_limit_of_bytes(monkeypatch):
    monkeypatch.setattr("ellipseg_ros.node.grouping.MAX_WINDOW_BYTES", 1000)
    fields = np.zeros(1, [("x", "f4"), ("y", "f4"), ("z", "f4"), ("rest", "V388")])
    wide = [Sweep(SECOND, np.zeros((1, 3)), fields=fields) for _ in range(7)]
    assert [len(group) for group in updates(wide, CONFIG)] == [3, 3, 1]
    narrow = [Sweep(SECOND, np.zeros((1, 3))) for _ in range(7)]
    assert [len(group) for group in updates(narrow, CONFIG)] == [7]
