"""What is a landmark, how sure it is, and that it stays the same one."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ellipseg_ros.config import Config, LandmarksConfig, ObjectsConfig
from ellipseg_ros.core import jit
from ellipseg_ros.core.members import group_boxes, group_members
from ellipseg_ros.errors import InputError
from ellipseg_ros.landmarks import fits
from ellipseg_ros.landmarks.cylinder import PARAMETERS, across, axial, fit_cylinder
from ellipseg_ros.landmarks.innovation import innovations, normalised_squares
from ellipseg_ros.landmarks.of_segmentation import landmarks
from ellipseg_ros.records import DETERMINED, SECOND, Kind, Landmarks, Sweep
from ellipseg_ros.segmenter import Segmenter, segment
from ellipseg_ros.simulation import simulator
from studies.landmarks.agreement import agreeing_pairs, transformed
from studies.landmarks.passes import rigid_transform
from studies.landmarks.repeatability import normalised_errors

NOISE = 0.015  # m


def wall(rng, n=4000, size=(6.0, 2.5)):
    """A noisy wall in the plane x = 3, seen at random places."""
    y, z = rng.uniform(0.0, size[0], n), rng.uniform(0.0, size[1], n)
    return np.column_stack([rng.normal(3.0, NOISE, n), y, z])


def trunk(rng, n=1500, radius=0.15, length=4.0, foot=(0.0, 0.0, 0.0), lean=0.0):
    """The half of a trunk that faces -x, which leans along y by `lean` radians."""
    turn, z = rng.uniform(0.5 * np.pi, 1.5 * np.pi, n), rng.uniform(0.0, length, n)
    r = radius + rng.normal(0.0, NOISE, n)
    points = np.column_stack([r * np.cos(turn), r * np.sin(turn), z])
    return points @ Rotation.from_euler("x", -lean).as_matrix().T + foot


def ball(rng, n=800, size=0.2, at=(0.0, 0.0, 1.0)):
    """A bush, as a cloud of leaves."""
    return rng.normal(0.0, size, (n, 3)) + at


def found_in(*things, config=None):
    """The landmarks of a scene; points in random order: a beam sees now this, now that.

    What else it sees, most of the time, is spread too thinly to be anything.
    """
    rng = np.random.default_rng(0)
    else_seen = rng.uniform(-100.0, 100.0, (4 * sum(map(len, things)), 3)) + [0.0, 0.0, 500.0]
    points = np.vstack([*things, else_seen])
    return segment(points[rng.permutation(len(points))], config).landmarks


def of_kind(found, kind):
    return np.flatnonzero(found.kind == kind)


# --- what is one


def test_a_wall_in_tiles_is_one_plane_with_the_right_normal():
    rng = np.random.default_rng(1)
    points = wall(rng)
    coarse = segment(points, Config(threshold=1.0))
    assert len(coarse.ellipsoids) > 3  # tiles
    found = coarse.landmarks
    assert list(found.kind) == [Kind.PLANE]
    assert abs(found.axes[0, :, 2] @ [1.0, 0.0, 0.0]) > math.cos(math.radians(0.2))
    assert found.position[0, 0] == pytest.approx(3.0, abs=0.003)
    size = found.box_max[0] - found.box_min[0]
    assert size[:2] == pytest.approx([6.0, 2.5], abs=0.15)


def test_two_walls_at_right_angles_are_two_planes():
    rng = np.random.default_rng(2)
    other = wall(rng)[:, [1, 0, 2]] + [3.0, -3.0, 0.0]
    found = found_in(wall(rng), other)
    assert sorted(found.kind) == [Kind.PLANE, Kind.PLANE]
    assert abs(found.axes[0, :, 2] @ found.axes[1, :, 2]) < 0.02


@pytest.mark.parametrize("lean", [0.0, 0.15])
def test_a_trunk_is_one_line_on_its_axis_though_only_half_of_it_is_seen(lean):
    found = found_in(trunk(np.random.default_rng(3), lean=lean))
    assert list(found.kind) == [Kind.LINE]
    axis = found.axes[0, :, 0]
    truth = np.array([0.0, math.sin(lean), math.cos(lean)])
    assert abs(axis @ truth) > math.cos(math.radians(0.5))
    aside = found.position[0] - (found.position[0] @ axis) * axis
    assert np.linalg.norm(aside) < 0.02  # the mean of the points is 0.1 m off
    assert found.box_max[0, 0] - found.box_min[0, 0] == pytest.approx(4.0, abs=0.3)


def test_a_lone_bush_is_a_blob_and_a_large_one_is_none():
    rng = np.random.default_rng(4)
    found = found_in(ball(rng), ball(rng, size=1.0, n=5000, at=(20.0, 0.0, 3.0)))
    assert list(found.kind) == [Kind.BLOB]
    assert found.position[0] == pytest.approx([0.0, 0.0, 1.0], abs=0.03)


def test_a_rounded_ground_has_no_plane():
    rng = np.random.default_rng(5)
    x, y = rng.uniform(-4.0, 4.0, (2, 6000))
    z = 0.3 * np.sin(2.0 * x) * np.cos(2.0 * y) + rng.normal(0.0, NOISE, 6000)
    assert not len(of_kind(found_in(np.column_stack([x, y, z])), Kind.PLANE))


def test_a_single_sweep_of_the_beam_is_no_line():
    rng = np.random.default_rng(6)
    y = np.linspace(0.0, 6.0, 200)
    sweep = np.column_stack([np.full(200, 3.0), y, np.full(200, 1.0)])
    sweep += rng.normal(0.0, NOISE, sweep.shape)
    assert not len(segment(sweep).landmarks)
    assert not len(segment(np.vstack([sweep, sweep + [0.0, 0.02, 0.01]])).landmarks)


def test_too_few_points_and_no_points_are_no_landmark():
    rng = np.random.default_rng(7)
    assert not len(found_in(wall(rng, n=30)))
    for points in (np.zeros((0, 3)), np.zeros((50, 3)), np.full((5, 3), np.nan)):
        assert not len(segment(points).landmarks)


def test_the_points_and_segments_of_landmarks_are_named():
    rng = np.random.default_rng(8)
    points = np.vstack([wall(rng), trunk(rng, foot=(-3.0, 0.0, 0.0))])
    found = segment(points)
    marks = found.landmarks
    assert list(np.bincount(marks.point_labels + 1)[1:]) == list(marks.count)
    for row in range(len(marks)):
        assert set(marks.segments[row]) == set(found.labels[marks.point_labels == row])
    assert (np.diff(marks.ids.astype(int)) > 0).all()


def test_without_being_asked_for_there_are_none():
    points = wall(np.random.default_rng(9))
    off = Config(landmarks=LandmarksConfig(enabled=False))
    found = segment(points, off)
    assert found.landmarks is None
    assert len(landmarks(found)) == 1  # but they can be had
    nothing = replace(off, objects=ObjectsConfig(enabled=False))
    with pytest.raises(InputError, match="adjacency"):
        landmarks(segment(points, nothing))


def test_landmarks_of_a_segmentation_are_those_it_has():
    rng = np.random.default_rng(10)
    found = segment(np.vstack([wall(rng), trunk(rng, foot=(-3.0, 0.0, 0.0))]) + [4e5, 5e6, 100.0])
    again = landmarks(found)
    for name in ("kind", "count", "position", "axes", "covariance", "point_labels"):
        assert np.array_equal(getattr(found.landmarks, name), getattr(again, name)), name


def test_a_moved_scene_has_moved_landmarks():
    rng = np.random.default_rng(11)
    points = np.vstack([wall(rng), trunk(rng, foot=(-3.0, 0.0, 0.0))])
    points = points[rng.permutation(len(points))]
    turn = np.eye(4)
    turn[:3, :3] = Rotation.from_euler("xyz", [0.2, -0.3, 1.0]).as_matrix()
    turn[:3, 3] = [5.0, -2.0, 1.0]
    one = segment(points).landmarks
    other = segment(points @ turn[:3, :3].T + turn[:3, 3]).landmarks
    pairs = agreeing_pairs(transformed(one, turn), other)
    assert set(pairs.earlier) == set(range(len(one))) == set(pairs.later)


# --- how sure


@pytest.mark.parametrize("thing", [wall, trunk])
def test_covariances_are_honest_where_errors_are_independent(thing):
    config = Config(landmarks=LandmarksConfig(registration_noise=0.0))
    runs = [found_in(thing(np.random.default_rng(s), n=400), config=config) for s in range(30)]
    runs = [run for run in runs if len(run) == 1]
    assert len(runs) > 20
    kind = np.array([run.kind[0] for run in runs])
    position, axes = (
        np.stack([getattr(r, name)[0] for r in runs]) for name in ("position", "axes")
    )
    truth = axes.copy()
    pole = 2 if thing is wall else 0
    for row, frame in enumerate(axes):
        right = [1.0, 0.0, 0.0] if thing is wall else [0.0, 0.0, 1.0]
        turn, _ = Rotation.align_vectors(
            [right], [frame[:, pole] * np.sign(frame[:, pole] @ right)]
        )
        truth[row] = turn.as_matrix() @ frame
    where = np.array([3.0, 0.0, 0.0]) if thing is wall else np.zeros(3)
    error = innovations(kind, (np.broadcast_to(where, position.shape), truth), (position, axes))
    covariance = np.stack([run.covariance[0] for run in runs])
    squared = normalised_squares(kind, error, covariance)
    assert 0.15 < squared.mean() < 1.6  # never too sure; planes have an allowance for crookedness


def test_errors_in_common_raise_the_uncertainty():
    rng = np.random.default_rng(12)
    n, matrix = 1600, np.diag([1600.0])
    alone = rng.normal(0.0, 1.0, n)
    common = np.repeat(rng.normal(0.0, 1.0, fits.CHUNKS), n // fits.CHUNKS)
    made = []
    for error in (alone, common):
        scores = error.reshape(fits.CHUNKS, -1).sum(axis=1)[:, None]
        made.append(
            fits.fit_covariance(matrix.copy(), scores, error.var())[0, 0] * n / error.var()
        )
    assert made[0] < 2.5
    assert 50.0 < made[1] < 150.0  # a hundred points are worth one


def test_normalised_errors_of_right_covariances_are_one():
    rng = np.random.default_rng(13)
    n = 3000
    kind = rng.integers(0, 3, n).astype(np.uint8)
    axes = Rotation.random(n, random_state=3).as_matrix()
    position = rng.uniform(-10.0, 10.0, (n, 3))
    sigma = np.array([0.02, 0.03, 0.04, 0.004, 0.005, 0.006])
    covariance, motion = np.zeros((n, 6, 6)), np.zeros((n, 6))
    for which, wanted in DETERMINED.items():
        rows = np.flatnonzero(kind == which)
        for m in wanted:
            covariance[rows, m, m] = sigma[m] ** 2
            motion[rows, m] = rng.normal(0.0, sigma[m], len(rows))
    shifted = position - np.einsum("nij,nj->ni", axes, motion[:, :3])
    turned = axes @ Rotation.from_rotvec(-motion[:, 3:]).as_matrix()
    found = innovations(kind, (shifted, turned), (position, axes))
    assert np.abs(found - motion).max() < 2e-3  # up to products of small angles
    assert normalised_squares(kind, found, covariance).mean() == pytest.approx(1.0, abs=0.05)


def test_what_is_known_without_error_may_stay_where_it_is():
    kind, covariance = np.array([2, 2], np.uint8), np.zeros((2, 6, 6))
    covariance[1, :3, :3] = np.eye(3)
    motion = np.array([[0.0] * 6, [1.0] * 3 + [0.0] * 3])
    assert normalised_squares(kind, motion, covariance).tolist() == [0.0, 1.0]
    covariance[1, :3, :3] = 1.0  # known across, without error, and free along (1, 1, 1)
    assert normalised_squares(kind, motion, covariance)[1] == pytest.approx(1.0 / 3.0)


# --- that it stays


def test_ids_stay_and_a_reset_ends_them():
    segmenter = Segmenter(Config(window_duration=6.0))
    rng = np.random.default_rng(14)
    seen = []
    for second in range(12):
        points = wall(rng, n=800)
        seen.append(segmenter.process(Sweep(second * SECOND, points)))
    assert {tuple(found.landmarks.ids) for found in seen} == {(1,)}
    last = seen[-1].landmarks
    assert last.first_seen_ns[0] == 0 and 0.0 < last.stability[0] < 1.0
    assert seen[0].landmarks.stability[0] == 0.0
    segmenter.reset()
    after = segmenter.process(Sweep(20 * SECOND, wall(rng, n=800))).landmarks
    assert list(after.removed) == [1] and list(after.ids) == [4]  # the next plane's


def test_one_that_expires_is_removed():
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
    return {name: getattr(found, name) for name in (*names, "stability", "point_labels")}


@pytest.mark.parametrize("threads", [1, 5])
def test_the_number_of_threads_changes_nothing(yard, threads, monkeypatch):
    expected = [Segmenter().process(sweep).landmarks for sweep in yard[-1:]]
    monkeypatch.setattr(jit, "THREADS", threads)
    monkeypatch.setattr(jit, "MIN_ROWS_PER_THREAD", 10)
    for one, other in zip([Segmenter().process(yard[-1]).landmarks], expected, strict=True):
        assert all(np.array_equal(a, arrays(other)[name]) for name, a in arrays(one).items())


def test_online_landmarks_are_those_of_a_batch_of_the_window(yard):
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


# --- kernels


@pytest.mark.nojit
def test_members_and_boxes_are_those_of_a_plain_loop():
    rng = np.random.default_rng(16)
    points, labels = rng.normal(size=(200, 3)), rng.integers(-2, 9, 200).astype(np.int32)
    group = np.array([0, 1, 1, -1, 2, 0, 2, 2, 1], np.int32)
    found, around = group_members(labels, group, 3), group_boxes(points, labels, group, 3)
    for g in range(3):
        rows = [i for i in range(200) if labels[i] >= 0 and group[labels[i]] == g]
        assert list(found.rows[found.starts[g] : found.starts[g + 1]]) == rows
        assert np.array_equal(around.low[g], points[rows].min(axis=0))
        assert np.array_equal(around.high[g], points[rows].max(axis=0))


@pytest.mark.nojit
def test_passages_count_runs_of_points():
    assert fits.count_passes(np.array([0, 1, 2, 10, 12, 13, 99])) == 3
    assert fits.count_passes(np.zeros(0, np.int64)) == 0


@pytest.mark.nojit
def test_a_cylinder_is_fitted_as_a_general_solver_does():
    optimize = pytest.importorskip("scipy.optimize")
    points = trunk(np.random.default_rng(18), n=60, radius=0.2)
    point, axis = np.array([-0.1, 0.02, 2.0]), np.array([0.0, 0.02, 1.0])
    axis /= np.linalg.norm(axis)
    u, v = across(axis)
    assert np.allclose(np.linalg.det(np.column_stack([axis, u, v])), 1.0)
    fit = np.zeros(PARAMETERS)
    fit[4] = 0.15
    spread = fit_cylinder(points, np.arange(len(points)), point, axis, fit)

    def distances(x):
        offset = points - point
        along = offset @ axis
        a, b = offset @ u - x[0] - x[2] * along, offset @ v - x[1] - x[3] * along
        return np.hypot(a, b) - x[4] - x[5] * along

    best = optimize.least_squares(distances, fit).x
    assert spread == pytest.approx(NOISE, rel=0.4)
    assert np.abs(best[:2] - fit[:2]).max() < 0.02 and abs(best[4] - fit[4]) < 0.03
    along, aside = axial(points, 0, point, axis)
    assert math.hypot(along, aside) == pytest.approx(np.linalg.norm(points[0] - point))


# --- two passes


def test_the_true_motion_is_found():
    rng = np.random.default_rng(19)
    points, turn = rng.normal(size=(50, 3)), Rotation.random(random_state=1).as_matrix()
    motion = rigid_transform(points, points @ turn.T + [1.0, 2.0, 3.0])
    assert np.allclose(motion[:3, :3], turn) and np.allclose(motion[:3, 3], [1.0, 2.0, 3.0])


def test_what_agrees_must_be_near_in_what_is_determined_alone():
    rng = np.random.default_rng(20)
    here = found_in(wall(rng), trunk(rng, foot=(-3.0, 0.0, 0.0)), ball(rng, at=(-6.0, 5.0, 0.0)))
    assert sorted(here.kind) == [Kind.PLANE, Kind.LINE, Kind.BLOB]

    def agree(shift):
        motion = np.eye(4)
        motion[:3, 3] = shift
        return {
            int(here.kind[row]) for row in agreeing_pairs(here, transformed(here, motion)).earlier
        }

    assert agree([0.0, 0.0, 0.0]) == {Kind.PLANE, Kind.LINE, Kind.BLOB}
    assert agree([0.0, 0.0, 1.0]) == {Kind.PLANE, Kind.LINE}  # along both
    assert agree([0.0, 1.0, 0.0]) == {Kind.PLANE}
    assert agree([0.08, 0.0, 0.0]) == {Kind.LINE, Kind.BLOB}
    assert agree([0.0, 20.0, 0.0]) == set()  # beside the wall


def test_normalised_errors_of_equal_landmarks_are_zero():
    here = found_in(wall(np.random.default_rng(21)))
    errors = normalised_errors(here, here, np.eye(4))
    assert errors["plane"] == [pytest.approx(0.0, abs=1e-6)]
