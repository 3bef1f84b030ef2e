"""Association of synthetic worlds: with honest noise, and degenerate ones."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
import worlds
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from ellipseg_ros.association.associate import associate
from ellipseg_ros.association.landmark_map import select_landmarks
from ellipseg_ros.config import AssociationConfig
from ellipseg_ros.errors import InputError
from ellipseg_ros.records import Verdict

DRIFTS = [(0.5, 3.0), (3.0, 10.0)]  # m, degrees


def error(found, transform):
    """(6,) m, rad: motion from the estimated transform to the true one, as in Association."""
    turn = transform[:3, :3] @ found.T_earlier_later[:3, :3].T
    centres = [T[:3, :3] @ found.centre + T[:3, 3] for T in (transform, found.T_earlier_later)]
    return np.concatenate([centres[0] - centres[1], Rotation.from_matrix(turn).as_rotvec()])


def known_part(found, deviation):
    """The part of an error along the known directions; m, rad."""
    scale = np.repeat([1.0, found.characteristic_length], 3)
    scaled = deviation * scale
    return (scaled - found.undetermined @ (found.undetermined.T @ scaled)) / scale


def score(seen, found):
    """Pairs found, those of them that are right, true pairs; errors that are determined; NEES."""
    truth, got = set(map(tuple, seen.correspondences)), set(map(tuple, found.pairs))
    deviation = error(found, seen.T_earlier_later)
    known = known_part(found, deviation)
    nees = deviation @ np.linalg.solve(found.covariance, deviation)
    length, angle = np.linalg.norm(known[:3]), np.degrees(np.linalg.norm(known[3:]))
    return len(got), len(got & truth), len(truth), length, angle, nees


def run_many(make, length, degrees, share, seeds=20):
    """Scores of many random worlds (seeds, 6), and the associations."""
    table, found = [], []
    for seed in range(seeds):
        rng = np.random.default_rng([seed, round(10 * length)])
        seen = worlds.observe_twice(make(rng), rng, length, degrees, share)
        found.append(associate(seen.earlier, seen.later))
        table.append(score(seen, found[-1]))
    return np.array(table), found


# --- worlds of which enough is observed ---------------------------------------------------------


@pytest.mark.parametrize("drift", DRIFTS)
@pytest.mark.parametrize(
    ("share", "content"),
    [
        (0.75, {}),
        (0.75, {"planes": 0, "lines": 60, "blobs": 10}),
        (0.5, {"planes": 10, "lines": 40, "blobs": 10}),
        (0.3, {"planes": 10, "lines": 60, "blobs": 20}),
    ],
    ids=["mixed", "trees", "half", "third"],
)
def test_pairs_and_transform_are_right_in_twenty_worlds(drift, share, content):
    table, found = run_many(lambda rng: worlds.world(rng, **content), *drift, share)
    got, right, there, length, angle, nees = table.T
    assert right.sum() >= 0.99 * got.sum()
    assert right.sum() >= 0.9 * there.sum()
    assert np.median(length) < 0.05 and np.quantile(length, 0.9) < 0.1
    assert np.median(angle) < 0.15 and np.quantile(angle, 0.9) < 0.3
    known = [k for k, one in enumerate(found) if one.verdict < Verdict.AMBIGUOUS]
    assert len(known) >= 15
    assert nees[known].sum() < chi2.ppf(0.999, 6 * len(known))  # consistent covariances, but
    assert nees[known].mean() > 1.0  # not too large ones


def test_pair_probabilities_are_calibrated():
    probability, right = [], []
    config = AssociationConfig(min_probability=0.0)
    for seed, share in itertools.product(range(15), (0.2, 0.35, 0.8)):
        rng = np.random.default_rng([seed, 5])
        world = worlds.world(rng, planes=6, lines=30, blobs=25, size=15.0)
        seen = worlds.observe_twice(world, rng, 2.0, 8.0, share)
        found = associate(seen.earlier, seen.later, config)
        truth = set(map(tuple, seen.correspondences))
        probability += found.probability.tolist()
        right += [tuple(pair) in truth for pair in found.pairs]
    probability, right = np.array(probability), np.array(right)
    assert len(probability) > 300
    assert right[probability >= 0.9].mean() >= 0.9
    assert abs(right.mean() - probability.mean()) < 0.05


def test_sets_of_five_hundred_landmarks_are_associated():
    rng = np.random.default_rng(1)
    world = worlds.world(rng, planes=100, lines=350, blobs=200, size=60.0)
    seen = worlds.observe_twice(world, rng, 3.0, 10.0)
    got, right, there, length, angle, _ = score(seen, associate(seen.earlier, seen.later))
    assert min(len(seen.earlier), len(seen.later)) > 450
    assert right >= 0.99 * got and right >= 0.98 * there
    assert length < 0.05 and angle < 0.1


def test_transform_between_a_set_and_itself_is_recovered():
    rng = np.random.default_rng(2)
    world = worlds.world(rng)
    transform = worlds.drift(rng, 2.0, 7.0, world.position.mean(axis=0))
    found = associate(world, worlds.moved(world, np.linalg.inv(transform)))
    assert found.verdict is Verdict.KNOWN
    assert found.pairs.tolist() == [[k, k] for k in range(len(world))]
    # The prior pulls a little.
    np.testing.assert_allclose(found.T_earlier_later, transform, atol=1e-3)
    assert found.distance.max() < 0.05


# --- degenerate worlds --------------------------------------------------------------------------


def directions(found):
    return np.linalg.matrix_rank(found.undetermined) if found.undetermined.size else 0


@pytest.mark.parametrize("drift", DRIFTS)
def test_parallel_walls_leave_the_motion_along_them_undetermined(drift):
    table, found = run_many(lambda rng: worlds.walls(5, rng), *drift, 1.0)
    got, right, there, length, angle, _ = table.T
    assert (right == got).all() and right.sum() > 0.8 * there.sum()
    assert np.quantile(length, 0.9) < 0.05 and np.quantile(angle, 0.9) < 0.4
    for one in found:
        assert one.verdict is not Verdict.KNOWN
        normal = np.array([0.0, 1.0, 0.0]) @ one.T_earlier_later[:3, :3]
        along = np.concatenate([np.cross(normal, [0.0, 0.0, 1.0]), np.zeros(3)])
        along /= np.linalg.norm(along)
        assert np.linalg.norm(one.undetermined.T @ along) > 0.95
        assert 3 <= directions(one) <= 6
        assert one.covariance[2, 2] > 0.5  # of the height


@pytest.mark.parametrize("count", [1, 2])
def test_one_or_two_poles_are_too_few(count):
    def make(rng):
        return worlds.poles(rng.uniform(-20.0, 20.0, (count, 2)), rng)

    for drift in DRIFTS:
        for one in run_many(make, *drift, 1.0, seeds=10)[1]:
            assert one.verdict is Verdict.TOO_FEW
            assert not len(one) and directions(one) == 6
            np.testing.assert_array_equal(one.T_earlier_later, np.eye(4))


@pytest.mark.parametrize("drift", DRIFTS)
def test_collinear_bushes_leave_the_rotation_about_the_line_undetermined(drift):
    def make(rng):
        return worlds.bushes(np.cumsum(rng.uniform(3.0, 8.0, (8, 1)), axis=0) * [1.0, 0.0, 0.0])

    table, found = run_many(make, *drift, 1.0)
    assert (table[:, 0] == table[:, 1]).all()
    for one in found:
        assert one.verdict is not Verdict.KNOWN
        about = np.concatenate([np.zeros(3), one.T_earlier_later[:3, :3] @ [1.0, 0.0, 0.0]])
        assert np.linalg.norm(one.undetermined.T @ about) > 0.9
        assert any("rotation about" in name for name in one.undetermined_names)


@pytest.mark.parametrize("drift", DRIFTS)
@pytest.mark.parametrize("share", [1.0, 0.7])
@pytest.mark.parametrize("rows_of_trees", [1, 4])
def test_equal_trees_in_rows_are_ambiguous_or_right(drift, share, rows_of_trees):
    places = np.array([[2.5 * a, 4.0 * b] for a in range(10) for b in range(rows_of_trees)])
    table, found = run_many(lambda rng: worlds.poles(places, rng, 0.005), *drift, share)
    got, right, *_, nees = table.T
    assert right.sum() >= 0.99 * got.sum()
    assert sum(one.verdict is Verdict.AMBIGUOUS for one in found) >= 10
    assert (nees < 30.0).all()  # the covariance has room for a shift by a tree


@pytest.mark.parametrize("content", [{}, {"planes": 0, "lines": 60}, {"lines": 100, "blobs": 40}])
def test_different_places_are_not_associated(content):
    for seed in range(20):
        rng = np.random.default_rng(seed)
        one, other = (worlds.noisy(worlds.world(rng, **content), rng) for _ in range(2))
        # The ground is the same everywhere.
        assert len(associate(one, other)) <= 1


def test_empty_sets_are_too_few():
    world = worlds.world(np.random.default_rng(3))
    none = select_landmarks(world, slice(0, 0))
    for earlier, later in ((none, none), (world, none), (none, world)):
        found = associate(earlier, later)
        assert found.verdict is Verdict.TOO_FEW and not len(found)
        assert found.undetermined.shape == (6, 6) and found.covariance[0, 0] == pytest.approx(3.0)


@pytest.mark.parametrize("name", ["position", "axes", "sigma", "box_min", "box_max", "covariance"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_values_that_are_not_finite_are_refused_in_one_line(name, value):
    world = worlds.world(np.random.default_rng(4))
    column = getattr(world, name).copy()
    column[7].flat[0] = value
    with pytest.raises(InputError, match=r"^landmark 8 of the later set .* finite") as caught:
        associate(world, replace(world, **{name: column}))
    assert "\n" not in str(caught.value)


def test_row_order_changes_only_the_row_numbers():
    rng = np.random.default_rng(5)
    seen = worlds.observe_twice(worlds.world(rng), rng, 1.0, 5.0)
    first = associate(seen.earlier, seen.later)
    p, q = rng.permutation(len(seen.earlier)), rng.permutation(len(seen.later))
    second = associate(select_landmarks(seen.earlier, p), select_landmarks(seen.later, q))
    again = np.column_stack([p[second.pairs[:, 0]], q[second.pairs[:, 1]]])
    order = np.argsort(again[:, 0])
    assert again[order].tolist() == first.pairs.tolist()
    for name in ("T_earlier_later", "covariance", "undetermined", "centre"):
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))
    np.testing.assert_array_equal(first.probability, second.probability[order])


def test_association_is_invariant_to_a_common_large_translation():
    rng = np.random.default_rng(6)
    seen = worlds.observe_twice(worlds.world(rng), rng, 1.0, 5.0)
    shift = np.eye(4)
    shift[:3, 3] = (4_096_000.0, -512_000.0, 1024.0)
    far = associate(worlds.moved(seen.earlier, shift), worlds.moved(seen.later, shift))
    here = associate(seen.earlier, seen.later)
    assert far.pairs.tolist() == here.pairs.tolist()
    deviation = error(far, shift @ here.T_earlier_later @ np.linalg.inv(shift))
    assert np.abs(deviation).max() < 1e-5
