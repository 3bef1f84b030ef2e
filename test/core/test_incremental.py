"""After every update the segmentation equals that of a batch, bit for bit."""

from dataclasses import replace

import numpy as np
import pytest
from clouds import SECOND, grid, street
from hypothesis import given, settings
from hypothesis import strategies as st
from streams import assert_batch, wild_stream

from ellipseg_ros.config import Config, GraphConfig, ModelConfig
from ellipseg_ros.core import jit
from ellipseg_ros.core.criteria import CRITERIA
from ellipseg_ros.node.grouping import Grouping, updates
from ellipseg_ros.records import Sweep
from ellipseg_ros.segmenter import Segmenter

MODES = [("shape", 4.0), ("shape", 25.0), ("density", 0.5), ("density", 5.0), ("parsimony", 5.0)]


def window(**changes):
    return Config(window_duration=0.9, update_period=0.1, **changes)


@pytest.mark.nojit
@pytest.mark.parametrize(("criterion", "tau"), MODES)
def test_every_update_of_a_short_stream_equals_batch(criterion, tau):
    config = window(criterion=criterion, threshold=tau)
    segmenter = Segmenter(config)
    for sweep in wild_stream(np.random.default_rng(0), 6 if jit.PLAIN else 40):
        assert_batch(segmenter.process(sweep), config)


@pytest.mark.parametrize("cloud", [street, grid])
@pytest.mark.parametrize(("criterion", "tau"), MODES)
def test_every_update_of_a_wild_stream_equals_batch(criterion, tau, cloud):
    config = window(criterion=criterion, threshold=tau)
    segmenter = Segmenter(config)
    kept = 0
    for sweep in wild_stream(np.random.default_rng(1), 150, cloud):
        found = segmenter.process(sweep)
        assert_batch(found, config)
        kept += np.count_nonzero(found.state == 2)
    assert kept > 0  # some segments stayed as they were


@given(
    seed=st.integers(0, 2**32), mode=st.sampled_from(MODES), cloud=st.sampled_from([street, grid])
)
@settings(max_examples=40, deadline=None)
def test_every_update_of_a_random_stream_equals_batch(seed, mode, cloud):
    rng = np.random.default_rng(seed)
    config = Config(
        criterion=mode[0],
        threshold=mode[1],
        window_duration=float(rng.choice([0.05, 0.3, 2.0])),
        graph=GraphConfig(
            neighbours=int(rng.choice([3, 10])),
            isolation_distance=float(rng.choice([0.3, 2.0])),
        ),
    )
    segmenter = Segmenter(config)
    for sweep in wild_stream(rng, 12, cloud):
        assert_batch(segmenter.process(sweep), config)


def test_updates_equal_batch_after_settings_change():
    rng = np.random.default_rng(2)
    config = window()
    segmenter = Segmenter(config)
    for number, sweep in enumerate(wild_stream(rng, 120)):
        if number % 3 == 0:
            criterion, tau = MODES[int(rng.integers(len(MODES)))]
            config = replace(config, criterion=criterion, threshold=tau)
        if number % 10 == 5:
            floor, noise = 10.0 ** rng.uniform(-5, -2, 2)
            config = replace(config, model=ModelConfig(floor, noise))
        if number % 20 == 7:
            graph = GraphConfig(int(rng.integers(3, 12)), float(rng.uniform(0.2, 3.0)))
            config = replace(config, graph=graph)
        if number % 25 == 9:
            config = replace(config, window_duration=float(rng.uniform(0.2, 2.0)))
        segmenter.configure(config)
        assert_batch(segmenter.process(sweep), config)


def test_updates_equal_batch_after_an_empty_window():
    rng = np.random.default_rng(3)
    config = window()
    segmenter = Segmenter(config)
    for number in range(12):
        points = street(100, rng) if number % 3 else np.full((1, 3), np.nan)
        found = segmenter.process(Sweep(number * 5 * SECOND, points))
        assert_batch(found, config)
        assert found.counts.segmented == (0 if number % 3 == 0 else found.ellipsoids.count.sum())


def test_isolated_points_follow_their_neighbours():
    config = Config(window_duration=1.0)
    segmenter = Segmenter(config)

    def step(time, *points):
        found = segmenter.process(
            Sweep(round(time * SECOND), np.array(points, float).reshape(-1, 3))
        )
        assert_batch(found, config)
        return list(found.labels)

    assert step(0.0, [0, 0, 0], [50, 0, 0]) == [-1, -1]
    assert step(0.5, [1, 0, 0]) == [0, -1, 0]  # the first one enters with the third
    assert step(1.2, [51, 0, 0]) == [-1, -1]  # those of 0.0 are gone: both alone again
    assert step(1.4, [1.5, 0, 0], [51, 1, 0]) == [0, 0, 0, 0]


@pytest.mark.parametrize("parts", [1, 3])
def test_ids_do_not_depend_on_how_messages_are_split(parts):
    config = Config(window_duration=1.0, update_period=0.5)
    whole = [s for s in wild_stream(np.random.default_rng(4), 80) if len(s)]
    grouping, split = Grouping(config), []
    for sweep in whole:
        closes = bool(grouping.push(sweep))  # its first part would close the group: not split
        rows = np.array_split(np.arange(len(sweep)), 1 if closes else parts)
        split += [sweep.keep(part) for part in rows]
    one, other = Segmenter(config), Segmenter(config)
    groups = zip(updates(whole, config), updates(split, config), strict=True)
    for a, b in groups:
        first, second = one.process(a), other.process(b)
        assert np.array_equal(first.ids, second.ids)
        assert np.array_equal(first.labels, second.labels)


def test_two_thousand_updates_stay_exact_in_constant_memory():
    config = window(threshold=6.0)
    segmenter = Segmenter(config)
    largest = 0
    for number, sweep in enumerate(wild_stream(np.random.default_rng(5), 2000)):
        found = segmenter.process(sweep)
        largest = max(largest, len(found.points))
        if number % 50 == 0:
            assert_batch(found, config)
            assert state_bytes(segmenter) <= 1300 * largest + 20_000


def state_bytes(thing, seen=None):
    """Bytes of all arrays that an object holds on to."""
    seen = set() if seen is None else seen
    if id(thing) in seen:
        return 0
    seen.add(id(thing))
    if isinstance(thing, np.ndarray):
        return thing.nbytes
    if isinstance(thing, (list, tuple)):
        return sum(state_bytes(part, seen) for part in thing)
    parts = vars(thing).values() if hasattr(thing, "__dict__") else ()
    return sum(state_bytes(part, seen) for part in parts)


@pytest.mark.nojit
@pytest.mark.parametrize("cloud", [street, grid])
@pytest.mark.parametrize("criterion", CRITERIA)
def test_updates_equal_batch_for_descending_thresholds(criterion, cloud):
    """On a window that moves, and on one that stays."""
    rng = np.random.default_rng(3)
    segmenter = Segmenter()
    highest = {"shape": 60.0, "density": 20.0, "parsimony": 80.0}[criterion]
    for number, sweep in enumerate(wild_stream(rng, 6 if jit.PLAIN else 60, cloud)):
        tau = highest * rng.choice([0.9, 0.5]) ** (number % 15)
        config = window(criterion=criterion, threshold=tau)
        segmenter.configure(config)
        stays = replace(sweep, points=sweep.points[:0], offsets_ns=sweep.offsets_ns[:0])
        assert_batch(segmenter.process(stays if number % 2 else sweep), config)
