"""Association of landmarks: made-up worlds with honest noise, degenerate ones, and plain twins."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
import worlds
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from ellipseg_ros.association.associate import associate
from ellipseg_ros.association.candidates import (
    Bounds,
    Candidates,
    Limits,
    add_claim,
    agreement,
    candidates,
    claims,
)
from ellipseg_ros.association.cliques import cliques
from ellipseg_ros.association.hypotheses import hypotheses, pose
from ellipseg_ros.association.landmark_map import take
from ellipseg_ros.association.pairing import DEGREES, ROWS, compare, near, scratch, spread, things
from ellipseg_ros.association.registration import LIMITS, fit
from ellipseg_ros.config import AssociationConfig
from ellipseg_ros.errors import InputError
from ellipseg_ros.records import DETERMINED, Kind, Verdict

DRIFTS = [(0.5, 3.0), (3.0, 10.0)]  # m, degrees
BOUNDS = Bounds(3.0, np.radians(10.0), 0.5, 2.0)


def rows(found):
    return things(found, np.arange(len(found)), 0.02, np.radians(0.2))


def error(found, transform):
    """(6,) m, rad: from the found transform to the true one, as Association says."""
    turn = transform[:3, :3] @ found.T_earlier_later[:3, :3].T
    centres = [T[:3, :3] @ found.centre + T[:3, 3] for T in (transform, found.T_earlier_later)]
    return np.concatenate([centres[0] - centres[1], Rotation.from_matrix(turn).as_rotvec()])


def known_part(found, deviation):
    """The part of an error along the known directions; m, rad."""
    scale = np.repeat([1.0, found.characteristic_length], 3)
    scaled = deviation * scale
    return (scaled - found.undetermined @ (found.undetermined.T @ scaled)) / scale


def judge(looks, found):
    """Pairs found, pairs found and right, pairs there; errors in the known directions; NEES."""
    truth, got = set(map(tuple, looks.same)), set(map(tuple, found.pairs))
    deviation = error(found, looks.T_earlier_later)
    known = known_part(found, deviation)
    nees = deviation @ np.linalg.solve(found.covariance, deviation)
    length, angle = np.linalg.norm(known[:3]), np.degrees(np.linalg.norm(known[3:]))
    return len(got), len(got & truth), len(truth), length, angle, nees


def study(make, length, degrees, seen, seeds=20):
    """(seeds, 6) what `judge` says, and the associations."""
    table, found = [], []
    for seed in range(seeds):
        rng = np.random.default_rng([seed, round(10 * length)])
        looks = worlds.looks(make(rng), rng, length, degrees, seen)
        found.append(associate(looks.earlier, looks.later))
        table.append(judge(looks, found[-1]))
    return np.array(table), found


# --- worlds of which enough is seen ------------------------------------------------------------


@pytest.mark.parametrize("drift", DRIFTS)
@pytest.mark.parametrize(
    ("seen", "things_there"),
    [
        (0.75, {}),
        (0.75, {"planes": 0, "lines": 60, "blobs": 10}),
        (0.5, {"planes": 10, "lines": 40, "blobs": 10}),
        (0.3, {"planes": 10, "lines": 60, "blobs": 20}),
    ],
    ids=["mixed", "trees", "half", "third"],
)
def test_pairs_and_transform_are_right_over_twenty_worlds(drift, seen, things_there):
    table, found = study(lambda rng: worlds.world(rng, **things_there), *drift, seen)
    got, right, there, length, angle, nees = table.T
    assert right.sum() >= 0.99 * got.sum()
    assert right.sum() >= 0.9 * there.sum()
    assert np.median(length) < 0.05 and np.quantile(length, 0.9) < 0.1
    assert np.median(angle) < 0.15 and np.quantile(angle, 0.9) < 0.3
    told = [k for k, one in enumerate(found) if one.verdict < Verdict.AMBIGUOUS]
    assert len(told) >= 15
    assert nees[told].sum() < chi2.ppf(0.999, 6 * len(told))  # honest, and
    assert nees[told].mean() > 1.0  # not by being vague


def test_most_of_the_pairs_said_to_be_likely_are_right():
    said, right = [], []
    config = AssociationConfig(min_probability=0.0)
    for seed, seen in itertools.product(range(15), (0.2, 0.35, 0.8)):
        rng = np.random.default_rng([seed, 5])
        world = worlds.world(rng, planes=6, lines=30, blobs=25, size=15.0)
        looks = worlds.looks(world, rng, 2.0, 8.0, seen)
        found = associate(looks.earlier, looks.later, config)
        truth = set(map(tuple, looks.same))
        said += found.probability.tolist()
        right += [tuple(pair) in truth for pair in found.pairs]
    said, right = np.array(said), np.array(right)
    assert len(said) > 300
    assert right[said >= 0.9].mean() >= 0.9
    assert abs(right.mean() - said.mean()) < 0.05


def test_five_hundred_landmarks_on_either_side():
    rng = np.random.default_rng(1)
    world = worlds.world(rng, planes=100, lines=350, blobs=200, size=60.0)
    looks = worlds.looks(world, rng, 3.0, 10.0)
    got, right, there, length, angle, _ = judge(looks, associate(looks.earlier, looks.later))
    assert min(len(looks.earlier), len(looks.later)) > 450
    assert right >= 0.99 * got and right >= 0.98 * there
    assert length < 0.05 and angle < 0.1


def test_a_known_transform_of_one_set_is_found():
    rng = np.random.default_rng(2)
    world = worlds.world(rng)
    transform = worlds.drift(rng, 2.0, 7.0, world.position.mean(axis=0))
    found = associate(world, worlds.moved(world, np.linalg.inv(transform)))
    assert found.verdict is Verdict.KNOWN
    assert found.pairs.tolist() == [[k, k] for k in range(len(world))]
    np.testing.assert_allclose(
        found.T_earlier_later, transform, atol=1e-3
    )  # the bounds pull a little
    assert found.distance.max() < 0.05


# --- worlds that do not tell -------------------------------------------------------------------


def directions(found):
    return np.linalg.matrix_rank(found.undetermined) if found.undetermined.size else 0


@pytest.mark.parametrize("drift", DRIFTS)
def test_parallel_walls_leave_what_is_along_them_unknown(drift):
    table, found = study(lambda rng: worlds.walls(5, rng), *drift, 1.0)
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
        assert one.covariance[2, 2] > 0.5  # nothing is known of the height, and that is said


@pytest.mark.parametrize("count", [1, 2])
def test_one_pole_or_two_are_too_few(count):
    def make(rng):
        return worlds.poles(rng.uniform(-20.0, 20.0, (count, 2)), rng)

    for drift in DRIFTS:
        for one in study(make, *drift, 1.0, seeds=10)[1]:
            assert one.verdict is Verdict.TOO_FEW
            assert not len(one) and directions(one) == 6
            np.testing.assert_array_equal(one.T_earlier_later, np.eye(4))


@pytest.mark.parametrize("drift", DRIFTS)
def test_of_bushes_in_a_line_the_turn_about_it_stays_unknown(drift):
    def make(rng):
        return worlds.bushes(np.cumsum(rng.uniform(3.0, 8.0, (8, 1)), axis=0) * [1.0, 0.0, 0.0])

    table, found = study(make, *drift, 1.0)
    assert (table[:, 0] == table[:, 1]).all()
    for one in found:
        assert one.verdict is not Verdict.KNOWN
        about = np.concatenate([np.zeros(3), one.T_earlier_later[:3, :3] @ [1.0, 0.0, 0.0]])
        assert np.linalg.norm(one.undetermined.T @ about) > 0.9
        assert any("rotation about" in name for name in one.undetermined_names)


@pytest.mark.parametrize("drift", DRIFTS)
@pytest.mark.parametrize("seen", [1.0, 0.7])
@pytest.mark.parametrize("rows_of_trees", [1, 4])
def test_equal_trees_in_rows_are_ambiguous_or_right(drift, seen, rows_of_trees):
    places = np.array([[2.5 * a, 4.0 * b] for a in range(10) for b in range(rows_of_trees)])
    table, found = study(lambda rng: worlds.poles(places, rng, 0.005), *drift, seen)
    got, right, *_, nees = table.T
    assert right.sum() >= 0.99 * got.sum()
    assert sum(one.verdict is Verdict.AMBIGUOUS for one in found) >= 10
    assert (nees < 30.0).all()  # the covariance has room for a shift by a tree


@pytest.mark.parametrize("there", [{}, {"planes": 0, "lines": 60}, {"lines": 100, "blobs": 40}])
def test_two_places_that_have_nothing_in_common_are_not_associated(there):
    for seed in range(20):
        rng = np.random.default_rng(seed)
        one, other = (worlds.noisy(worlds.world(rng, **there), rng) for _ in range(2))
        # The ground is the same everywhere.
        assert len(associate(one, other)) <= 1


def test_empty_sets():
    world = worlds.world(np.random.default_rng(3))
    none = take(world, slice(0, 0))
    for earlier, later in ((none, none), (world, none), (none, world)):
        found = associate(earlier, later)
        assert found.verdict is Verdict.TOO_FEW and not len(found)
        assert found.undetermined.shape == (6, 6) and found.covariance[0, 0] == pytest.approx(3.0)


@pytest.mark.parametrize("name", ["position", "axes", "sigma", "box_min", "box_max", "covariance"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_what_is_not_finite_is_refused_in_one_line(name, value):
    world = worlds.world(np.random.default_rng(4))
    column = getattr(world, name).copy()
    column[7].flat[0] = value
    with pytest.raises(InputError, match=r"^landmark 8 of the later set .* finite") as caught:
        associate(world, replace(world, **{name: column}))
    assert "\n" not in str(caught.value)


def test_the_order_of_the_rows_changes_only_their_numbers():
    rng = np.random.default_rng(5)
    looks = worlds.looks(worlds.world(rng), rng, 1.0, 5.0)
    first = associate(looks.earlier, looks.later)
    p, q = rng.permutation(len(looks.earlier)), rng.permutation(len(looks.later))
    second = associate(take(looks.earlier, p), take(looks.later, q))
    again = np.column_stack([p[second.pairs[:, 0]], q[second.pairs[:, 1]]])
    order = np.argsort(again[:, 0])
    assert again[order].tolist() == first.pairs.tolist()
    for name in ("T_earlier_later", "covariance", "undetermined", "centre"):
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))
    np.testing.assert_array_equal(first.probability, second.probability[order])


def test_whole_kilometres_away_it_is_the_same():
    rng = np.random.default_rng(6)
    looks = worlds.looks(worlds.world(rng), rng, 1.0, 5.0)
    shift = np.eye(4)
    shift[:3, 3] = (4_096_000.0, -512_000.0, 1024.0)
    far = associate(worlds.moved(looks.earlier, shift), worlds.moved(looks.later, shift))
    here = associate(looks.earlier, looks.later)
    assert far.pairs.tolist() == here.pairs.tolist()
    deviation = error(far, shift @ here.T_earlier_later @ np.linalg.inv(shift))
    assert np.abs(deviation).max() < 1e-5


# --- the kernels beside plain twins -------------------------------------------------------------


def adjoint(axes, position, place):
    """(6, 6): a small motion in the own axes at a position -> in the world's, at a place."""
    twist = np.zeros((6, 6))
    twist[:3, :3] = twist[3:, 3:] = axes
    twist[:3, 3:] = np.column_stack([np.cross(axis, place - position) for axis in axes.T])
    return twist


def perturbed(found, row, motion, place):
    """A set, one row of which moves by (6,) about a place."""
    turn = Rotation.from_rotvec(motion[3:]).as_matrix()
    position, axes = found.position.copy(), found.axes.copy()
    position[row] = turn @ (position[row] - place) + place + motion[:3]
    axes[row] = turn @ axes[row]
    return replace(found, position=position, axes=axes)


def pair_of_each_kind(rng):
    """Two sets of three landmarks, one of each kind; nearly the same."""
    world = worlds.world(rng, planes=1, lines=1, blobs=1)
    world = take(world, [0, 1, 2])
    return world, worlds.noisy(world, rng)


@pytest.mark.nojit
@pytest.mark.parametrize("row", range(3))
def test_the_jacobian_is_the_derivative_and_exact_for_half_way(row):
    rng = np.random.default_rng(row)
    one, _ = pair_of_each_kind(rng)
    place, found = rng.normal(size=3), scratch()
    for size in (1e-4, 0.15):  # rad; and m
        motion = size * rng.normal(size=6) / 3.0
        other = perturbed(one, row, motion, place)
        count = compare(rows(one), rows(other), row, row, np.eye(4), place, found)
        assert count == DEGREES[one.kind[row]] == len(DETERMINED[Kind(one.kind[row])])
        expected = found.jacobian[:count] @ motion
        np.testing.assert_allclose(found.r[:count], expected, atol=2.0 * size**2)


@pytest.mark.nojit
@pytest.mark.parametrize("row", range(3))
def test_the_noise_is_that_of_both_carried_to_the_point_half_way(row):
    rng = np.random.default_rng(10 + row)
    one, other = pair_of_each_kind(rng)
    determined = list(DETERMINED[Kind(one.kind[row])])
    full = []
    for found in (one, other):
        root = rng.normal(size=(len(determined), len(determined))) * 0.05
        covariance = np.zeros((3, 6, 6))
        covariance[row][np.ix_(determined, determined)] = root @ root.T
        full.append(replace(found, covariance=covariance))
    a, b = rows(full[0]), rows(full[1])
    found = scratch()
    count = compare(a, b, row, row, np.eye(4), np.zeros(3), found)
    half_way = (a.position[row] + b.position[row]) / 2.0
    expected = np.zeros((6, 6))
    frame = np.zeros((6, 6))
    frame[:3, :3] = frame[3:, 3:] = found.frame.T
    for part in (a, b):
        carry = frame @ adjoint(part.axes[row], part.position[row], half_way)
        expected += carry @ part.covariance[row] @ carry.T
    picked = ROWS[one.kind[row]][:count]
    np.testing.assert_allclose(found.noise[:count, :count], expected[np.ix_(picked, picked)])
    uncertainty = np.diag(rng.uniform(0.001, 0.01, 6))
    jacobian, r = found.jacobian[:count].copy(), found.r[:count].copy()
    total = expected[np.ix_(picked, picked)] + jacobian @ uncertainty @ jacobian.T
    square, log_determinant = spread(found, count, uncertainty)
    assert square == pytest.approx(r @ np.linalg.solve(total, r))
    assert log_determinant == pytest.approx(np.linalg.slogdet(total)[1])


@pytest.mark.nojit
def test_what_is_like_enough_is_never_called_far():
    rng = np.random.default_rng(20)
    found, heard = scratch(), 0
    for _ in range(200):
        one, other = pair_of_each_kind(rng)
        transform = worlds.drift(rng, 0.05, 0.3, np.zeros(3))
        a, b = rows(one), rows(other)
        for row in range(3):
            count = compare(a, b, row, row, transform, np.zeros(3), found)
            square, _ = spread(found, count, np.zeros((6, 6)))
            if square <= LIMITS[one.kind[row]]:
                heard += 1
                assert near(a, b, row, row, transform, (0.0, 0.0, 0.5))
    assert heard > 50


@pytest.mark.nojit
@pytest.mark.parametrize("seed", range(5))
def test_candidates_hold_every_true_pair(seed):
    rng = np.random.default_rng(seed)
    looks = worlds.looks(worlds.world(rng, 3, 6, 4), rng, 3.0, 10.0)
    a, b = rows(looks.earlier), rows(looks.later)
    pairs = candidates(a, b, b.position.mean(axis=0), BOUNDS)
    held = set(zip(pairs.earlier.tolist(), pairs.later.tolist(), strict=True))
    assert set(map(tuple, looks.same)) <= held
    assert all(a.kind[i] == b.kind[j] for i, j in held)


@pytest.mark.nojit
def test_two_candidates_agree_as_least_squares_say():
    rng = np.random.default_rng(30)
    looks = worlds.looks(worlds.world(rng, 2, 8, 3, size=6.0), rng, 2.0, 8.0, 1.0)
    a, b = rows(looks.earlier), rows(looks.later)
    centre, prior = b.position.mean(axis=0), np.repeat([1.0 / 3.0, 98.0], 3)
    pairs = candidates(a, b, centre, BOUNDS)
    chosen = np.arange(min(40, len(pairs.later)))
    made = claims(a, b, centre, pairs, chosen)
    limits = Limits(prior, 16.0, 3.0, np.radians(15.0))
    agree = agreement(made, pairs, chosen, limits)
    assert 0 < agree.sum() < agree.size / 2
    for n, m in itertools.combinations(range(len(chosen)), 2):
        shared = pairs.earlier[n] == pairs.earlier[m] or pairs.later[n] == pairs.later[m]
        stack, right = [np.diag(np.sqrt(prior))], [np.zeros(6)]
        for k in (n, m):  # whitened rows
            found = scratch()
            count = compare(a, b, pairs.earlier[k], pairs.later[k], np.eye(4), centre, found)
            white = np.linalg.inv(np.linalg.cholesky(found.noise[:count, :count]))
            stack.append(white @ found.jacobian[:count])
            right.append(-white @ found.r[:count])
        matrix, vector = np.concatenate(stack), np.concatenate(right)
        motion = np.linalg.lstsq(matrix, vector, rcond=None)[0]
        square = ((matrix @ motion - vector) ** 2).sum()
        fine = square <= 16.0 and np.linalg.norm(motion[:3]) <= limits.translation
        fine = fine and np.linalg.norm(motion[3:]) <= limits.rotation and not shared
        assert agree[n, m] == agree[m, n] == fine


@pytest.mark.nojit
@pytest.mark.parametrize("seed", range(10))
def test_cliques_are_maximal_and_the_largest_is_large(seed):
    rng = np.random.default_rng(seed)
    n, planted = 24, np.arange(6) * 3
    agree = np.triu(rng.random((n, n)) < 0.2, 1)
    agree |= agree.T
    agree[np.ix_(planted, planted)] = ~np.eye(6, dtype=bool)
    found = cliques(agree.astype(np.uint8), 8)
    assert [len(one) for one in found] == sorted(map(len, found), reverse=True)
    for one in found:
        assert all(agree[a, b] for a, b in itertools.combinations(one, 2))
        outside = np.setdiff1d(np.arange(n), one)
        assert not agree[np.ix_(outside, one)].all(axis=1).any()
    assert len(found[0]) >= 6


@pytest.mark.nojit
def test_the_transform_is_the_one_of_least_squares():
    rng = np.random.default_rng(40)
    looks = worlds.looks(worlds.world(rng, 3, 4, 3, size=12.0), rng, 2.0, 8.0, 1.0)
    a, b = rows(looks.earlier), rows(looks.later)
    pairs = Candidates(np.zeros(1, int), looks.same[:, 0].copy(), looks.same[:, 1].copy())
    centre, prior = b.position.mean(axis=0), np.repeat([1.0 / 3.0, 98.0], 3)
    found = fit((a, b), centre, pairs, np.arange(len(looks.same)), prior, np.eye(4))

    def cost(transform):
        """Sum of squares, and the motion's by the prior."""
        total, out = 0.0, scratch()
        for i, j in looks.same:
            count = compare(a, b, i, j, transform, centre, out)
            r, noise = out.r[:count], out.noise[:count, :count]
            total += r @ np.linalg.solve(noise, r)
        motion = transform[:3, :3] @ centre + transform[:3, 3] - centre
        turn = Rotation.from_matrix(transform[:3, :3]).as_rotvec()
        return total + prior[0] * motion @ motion + prior[3] * turn @ turn

    place, best = centre + found.motion[:3], cost(found.transform)
    np.testing.assert_allclose(
        found.motion[3:], Rotation.from_matrix(found.transform[:3, :3]).as_rotvec(), atol=1e-12
    )
    for k, sign in itertools.product(range(6), (-1.0, 1.0)):
        step = np.zeros(6)
        step[k] = sign * 0.3 / np.sqrt(found.information[k, k])
        moved = np.eye(4)
        moved[:3, :3] = Rotation.from_rotvec(step[3:]).as_matrix()
        moved[:3, 3] = place - moved[:3, :3] @ place + step[:3]
        rise = cost(moved @ found.transform) - best
        assert rise == pytest.approx(0.09, rel=0.25)  # 0.3^2: the information is the curvature


@pytest.mark.nojit
def test_claims_of_a_pair_are_its_normal_equations():
    rng = np.random.default_rng(50)
    one, other = (rows(found) for found in pair_of_each_kind(rng))
    for row in range(3):
        found, matrix, vector = scratch(), np.zeros((6, 6)), np.zeros(6)
        count = compare(one, other, row, row, np.eye(4), np.zeros(3), found)
        j, r = found.jacobian[:count].copy(), found.r[:count].copy()
        weight = np.linalg.inv(found.noise[:count, :count].copy())
        square = add_claim(found, count, matrix, vector)
        np.testing.assert_allclose(matrix, j.T @ weight @ j, atol=1e-6 * np.abs(matrix).max())
        np.testing.assert_allclose(vector, -j.T @ weight @ r, atol=1e-6 * np.abs(vector).max())
        assert square == pytest.approx(r @ weight @ r)


@pytest.mark.nojit
def test_the_best_hypothesis_has_the_most_evidence():
    rng = np.random.default_rng(60)
    looks = worlds.looks(worlds.world(rng, 3, 6, 4, size=12.0), rng, 1.0, 5.0, 1.0)
    found = hypotheses(pose(rows(looks.earlier), rows(looks.later), BOUNDS))
    evidence = [hypothesis.evidence for hypothesis in found]
    assert evidence == sorted(evidence, reverse=True) and evidence[0] > 20.0
