import naive
import numpy as np
import pytest

from ellipseg_ros.core.tracking import Tracker
from ellipseg_ros.records import State

pytestmark = pytest.mark.nojit


def facts(labels):
    count = labels.max(initial=-1) + 1
    return np.bincount(labels[labels >= 0], minlength=count)[:, None].astype(float)


def numbered(labels):
    """Labels that ascend by first appearance, as the merging gives them."""
    names = {}
    return np.array(
        [names.setdefault(label, len(names)) if label >= 0 else -1 for label in labels], np.int32
    )


def test_ids_parents_and_removed_follow_the_rules_on_random_histories():
    rng = np.random.default_rng(0)
    tracker, before, next_id, given = Tracker(), [], 1, 0
    arrival, labels = np.arange(30), rng.integers(-1, 5, 30)
    for _ in range(60):
        labels = numbered(labels)
        now = [set(arrival[labels == s]) for s in range(labels.max(initial=-1) + 1)]
        old_sets = [points for _, points in before]
        known = [
            old_sets.index(points) if points in old_sets and rng.random() < 0.7 else -1
            for points in now
        ]
        tracks = tracker.assign(arrival, labels, facts(labels), np.array(known, np.int32))
        given += sum(row >= 0 for row in known)
        ids = naive.inherit(before, now, next_id)
        assert list(tracks.ids) == ids
        old_ids = {id_ for id_, _ in before}
        assert list(tracks.removed) == sorted(old_ids - set(ids))
        for s, points in enumerate(now):
            parents = {id_ for id_, old in before if old & points} - {ids[s]}
            assert list(tracks.parents[s]) == sorted(parents)
            same = (ids[s], points) in before
            kind = State.UNCHANGED if same else State.UPDATED if ids[s] in old_ids else State.NEW
            assert tracks.state[s] == kind
        next_id = max([next_id, *(i + 1 for i in ids)])
        before = list(zip(ids, now, strict=True))
        # Some points expire, some arrive, some change sides.
        stay = rng.random(len(arrival)) < rng.choice([0.8, 1.0])
        stay[: len(stay) // 4] = rng.random() < 0.5
        new = int(rng.integers(0, 20))
        last = arrival[-1] if len(arrival) else -1
        arrival = np.concatenate([arrival[stay], last + 1 + np.arange(new)])
        labels = np.concatenate([labels[stay], rng.integers(-1, 6, new)])
        move = rng.random(len(labels)) < rng.choice([0.0, 0.1])
        labels[move] = rng.integers(-1, 6, move.sum())
    assert given > 20


def test_reset_ends_all_ids_and_reuses_none():
    tracker = Tracker()
    labels = np.array([0, 0, 1], np.int32)
    first = tracker.assign(np.arange(3), labels, facts(labels))
    tracker.reset()
    tracker.reset()
    second = tracker.assign(np.arange(3), labels, facts(labels))
    assert list(first.ids) == [1, 2] and list(second.ids) == [3, 4]
    assert list(second.removed) == [1, 2] and not len(second.parents.values)
    assert (second.state == State.NEW).all()


def test_changed_moments_of_the_same_points_are_an_update():
    tracker = Tracker()
    labels = np.zeros(3, np.int32)
    tracker.assign(np.arange(3), labels, np.array([[3.0, 1.0]]))
    assert tracker.assign(np.arange(3), labels, np.array([[3.0, 1.0]])).state == [State.UNCHANGED]
    assert tracker.assign(np.arange(3), labels, np.array([[3.0, 1.5]])).state == [State.UPDATED]


def test_exhausted_ids_restart_without_those_in_use(monkeypatch):
    monkeypatch.setattr("ellipseg_ros.core.tracking.LAST_ID", 50)
    tracker = Tracker()
    labels = np.arange(6, dtype=np.int32)
    stays, seen = None, set()
    for update in range(20):  # segment 0 keeps its points, the other five are new every time
        arrival = np.concatenate([[0], 1 + np.arange(5 * update, 5 * update + 5)])
        tracks = tracker.assign(arrival, labels, facts(labels))
        stays = stays or tracks.ids[0]
        assert tracks.ids[0] == stays == 1
        assert len(set(tracks.ids.tolist()) - {0}) == 6 and tracks.ids.max() <= 50
        assert not set(tracks.ids.tolist()) & set(tracks.removed.tolist())
        seen |= set(tracks.ids.tolist())
    assert seen >= set(range(1, 41))
