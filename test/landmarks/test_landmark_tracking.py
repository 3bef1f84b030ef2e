"""Landmarks from update to update."""

import numpy as np
import pytest
from landmark_scenes import wall

from ellipseg_ros.config import Config
from ellipseg_ros.core import jit
from ellipseg_ros.records import SECOND, Landmarks, Sweep
from ellipseg_ros.segmenter import Segmenter, segment
from ellipseg_ros.simulation import simulator


def test_ids_persist_until_a_reset():
    segmenter = Segmenter(Config(window_duration=6.0))
    rng = np.random.default_rng(14)
    seen = []
    for second in range(12):
        points = wall(rng, n=800)
        seen.append(segmenter.process(Sweep(second * SECOND, points)))
    assert {tuple(found.landmarks.ids) for found in seen} == {(1,)}
    last = seen[-1].landmarks
    assert last.first_seen_ns[0] == 0 and 0.0 < last.instability[0] < 1.0
    assert seen[0].landmarks.instability[0] == 0.0
    segmenter.reset()
    after = segmenter.process(Sweep(20 * SECOND, wall(rng, n=800))).landmarks
    assert list(after.removed) == [1] and list(after.ids) == [4]  # the next plane's


def test_an_expired_landmark_is_removed():
    segmenter = Segmenter(Config(window_duration=2.0))
    segmenter.process(Sweep(0, wall(np.random.default_rng(15))))
    later = segmenter.process(Sweep(5 * SECOND, np.zeros((1, 3)))).landmarks
    assert list(later.removed) == [1] and not len(later)


@pytest.fixture(scope="module")
def yard():
    return list(simulator.Scene("industrial", duration=5.0))


def arrays(found: Landmarks):
    names = (
        "ids",
        "kind",
        "count",
        "position",
        "axes",
        "sigma",
        "box_min",
        "box_max",
        "covariance",
    )
    return {name: getattr(found, name) for name in (*names, "instability", "point_labels")}


@pytest.mark.parametrize("threads", [1, 5])
def test_landmarks_do_not_depend_on_the_number_of_threads(yard, threads, monkeypatch):
    expected = [Segmenter().process(sweep).landmarks for sweep in yard[-1:]]
    monkeypatch.setattr(jit, "THREADS", threads)
    monkeypatch.setattr(jit, "MIN_ROWS_PER_THREAD", 10)
    for one, other in zip([Segmenter().process(yard[-1]).landmarks], expected, strict=True):
        assert all(np.array_equal(a, arrays(other)[name]) for name, a in arrays(one).items())


def test_online_landmarks_equal_those_of_the_window_in_batch(yard):
    segmenter = Segmenter(Config(window_duration=2.0))
    for number in range(0, len(yard), 10):
        points = np.vstack([sweep.points for sweep in yard[number : number + 10]])
        found = segmenter.process(Sweep(yard[number].stamp_ns, points))
    batch = segment(found.points, origin=found.origin).landmarks
    one, other = found.landmarks, batch
    assert len(one) == len(other) > 3
    order = (
        np.lexsort((one.position[:, 0], one.kind)),
        np.lexsort((other.position[:, 0], other.kind)),
    )
    for name in ("kind", "count", "position", "axes", "covariance"):
        assert np.array_equal(getattr(one, name)[order[0]], getattr(other, name)[order[1]]), name
