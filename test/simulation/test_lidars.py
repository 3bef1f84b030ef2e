"""Lidars of many beams: ray casting against a plain caster, determinism, moving items, truth."""

import numpy as np
import pytest

from ellipseg_ros.core.jit import single_threaded
from ellipseg_ros.errors import ConfigError
from ellipseg_ros.simulation import beams, rays
from ellipseg_ros.simulation.beams import Beams, Movers, cast_beams
from ellipseg_ros.simulation.grid import make_grid, make_table
from ellipseg_ros.simulation.lidar_drive import LidarDrive
from ellipseg_ros.simulation.lidars import LIDARS
from ellipseg_ros.simulation.rays import Terrain
from ellipseg_ros.simulation.shapes import BOX, CONE, Class, Frame, Material, Model, yaw_rotation
from ellipseg_ros.simulation.simulator import SCENES, Scene, simulate

ROLLING = Terrain(np.array([0.4, 0.1]), np.array([[0.3, 0.1], [0.0, 2.0]]), np.zeros(2), 0.4)
EXACT = {"noise": 0.0, "drift": 0.0}


def solid_scene(rng):
    """Boxes, cones and ellipsoids about the origin."""
    model = Model()
    for _ in range(25):
        x, y = rng.uniform(-25.0, 25.0, 2)
        item = model.item(Frame(np.array([x, y, 0.0]), yaw_rotation(rng.uniform(0.0, 6.0))))
        steel = Material(Class.WALL)
        item.box(steel, (0.0, 0.0, 1.0), rng.uniform(0.2, 3.0, 3), pitch=rng.uniform(-1.0, 1.0))
        item.ellipsoid(steel, (2.0, 0.0, 2.0), rng.uniform(0.2, 1.5, 3))
        item.cone(steel, ((0.0, 3.0, 0.0), tuple(rng.uniform(0.5, 3.0, 3))), (0.4, 0.2))
    return model.shapes()


def moving_pair():
    """A box and a ball on it that move by (2, 1, 0) m and turn by 0.4 rad in a sweep."""
    item = Model().separate()
    item.box(Material(Class.VEHICLE), (0.5, 0.0, 1.0), (4.0, 2.0, 1.5))
    item.ellipsoid(Material(Class.VEHICLE), (0.0, 0.0, 2.0), (0.7, 0.7, 0.7))
    shapes = item.shapes()
    begin, end = np.array([[8.0, 1.0, 0.0, 0.1]]), np.array([[10.0, 2.0, 0.0, 0.5]])
    return shapes, Movers(begin, end, np.array([4.0]), np.array([0, 2]), make_table(shapes))


def some_beams(rng, lines=40, count=3):
    direction = rng.normal(size=(lines, count, 3)) * [1.0, 1.0, 0.15]
    direction /= np.linalg.norm(direction, axis=2, keepdims=True)
    origin = np.column_stack([rng.uniform(-3.0, 3.0, (lines, 2)), np.full(lines, 1.8)])
    rotation = np.array([yaw_rotation(angle) for angle in rng.uniform(0.0, 6.0, lines)])
    return Beams(origin, rotation, direction, 30.0, np.uint64(7))


def is_inside(shapes, body, points):
    """Whether points (n, 3) are in a body, by its definition."""
    x, y, z = ((points - shapes.centre[body]) @ shapes.axes[body]).T
    a, b, c = shapes.size[body]
    if shapes.form[body] == BOX:
        return (abs(x) < a) & (abs(y) < b) & (abs(z) < c)
    if shapes.form[body] == CONE:
        return (abs(z) < c) & (np.hypot(x, y) < 0.5 * (a + b) + 0.5 * (b - a) * z / c)
    return (x / a) ** 2 + (y / b) ** 2 + (z / c) ** 2 < 1.0


def first_inside(origin, direction, reach, tests, step=0.004):
    """Distance of the first position in steps that one of the tests holds for, and its number."""
    t = np.arange(0.5 * step, reach, step)
    points = origin + t[:, None] * direction
    found = [
        t[np.argmax(inside)] if inside.any() else np.inf for inside in map_tests(tests, points)
    ]
    nearest = int(np.argmin(found))
    return found[nearest], nearest


def map_tests(tests, points):
    return [test(points) for test in tests]


def test_beams_end_where_steps_along_them_first_enter_a_body_or_the_ground():
    rng = np.random.default_rng(5)
    shapes, (moving, movers), cast = solid_scene(rng), moving_pair(), some_beams(rng)
    ends = cast_beams(cast, make_grid(shapes, ROLLING, np.zeros(2), 40.0), movers)
    standing = [lambda p, k=k: is_inside(shapes, k, p) for k in range(len(shapes.form))]

    def is_under(p, margin=0.0):
        return p[:, 2] < [rays.elevation(ROLLING, x, y) + margin for x, y, _ in p]

    hits = set()
    for line in range(40):
        share = line / 40
        x, y, z, yaw = movers.begin[0] + share * (movers.end[0] - movers.begin[0])
        frame = Frame(np.array([x, y, z]), yaw_rotation(yaw))
        moved = [
            lambda p, k=k, frame=frame: is_inside(moving, k, (p - frame.origin) @ frame.axes)
            for k in (0, 1)
        ]
        for beam in range(3):
            direction = cast.rotation[line] @ cast.direction[line, beam]
            tests = [*standing, *moved, is_under]
            t, body = first_inside(cast.origin[line], direction, cast.reach, tests)
            body = rays.NOTHING if np.isinf(t) else body
            body = rays.GROUND if body == len(tests) - 1 else body
            assert ends.body[line, beam] == body
            if body == rays.GROUND:  # within 1 cm of its height
                end = cast.origin[line] + ends.distance[line, beam] * direction
                assert is_under(end[None], 0.01)[0] and not is_under(end[None], -0.01)[0]
                near = [*tests[:-1], lambda p: is_under(p, -0.01)]
                t, _ = first_inside(cast.origin[line], direction, cast.reach, near)
                assert ends.distance[line, beam] < t + 0.02
            else:
                assert ends.distance[line, beam] == pytest.approx(min(t, rays.FAR), abs=0.01)
            hits.add(min(body, len(standing)))
    assert len(hits) > 10 and {rays.GROUND, len(standing)} <= hits


def plain_uniform(key, number):
    """Splitmix64 of a key with integers of any length."""
    mask = 2**64 - 1
    x = (key * 0xD1342543DE82EF95 + number * 0x9E3779B97F4A7C15) & mask
    x = ((x ^ (x >> 30)) * 0xBF58476D1CE4E5B9) & mask
    x = ((x ^ (x >> 27)) * 0x94D049BB133111EB) & mask
    return ((x ^ (x >> 31)) >> 11) / 2**53


def test_hash_equals_its_definition_and_is_uniform():
    numbers = [beams.uniform(np.uint64(key), 3) for key in range(2000)]
    assert numbers == [plain_uniform(key, 3) for key in range(2000)]
    assert np.mean(numbers) == pytest.approx(0.5, abs=0.02)
    assert np.std(numbers) == pytest.approx(np.sqrt(1 / 12), abs=0.01)
    assert abs(np.corrcoef(numbers[1:], numbers[:-1])[0, 1]) < 0.06


def leaf_distances(key, density=1.5, count=4000):
    """Distances of parallel beams into a box of leaves whose face is 2 m away."""
    model = Model()
    leaves = Material(Class.VEGETATION, density=density)
    model.item(Frame(np.zeros(3), np.eye(3))).box(leaves, (12.0, 0.0, 10.0), (20.0, 40.0, 14.0))
    side = np.linspace(-12.0, 12.0, count)
    origin = np.column_stack([np.zeros(count), side, 8.0 + 2.0 * np.sin(7.0 * side)])
    cast = Beams(
        origin, np.tile(np.eye(3), (count, 1, 1)), np.tile([1.0, 0.0, 0.0], (count, 1, 1)),
        40.0, np.uint64(key),
    )  # fmt: skip
    none = Movers(
        np.zeros((0, 4)), np.zeros((0, 4)), np.zeros(0), np.zeros(1, int), np.zeros((0, 22))
    )
    grid = make_grid(model.shapes(), ROLLING, np.zeros(2), 44.0)
    return cast_beams(cast, grid, none).distance[:, 0]


def test_density_is_the_rate_of_returns_at_the_surface_and_leaves_stay_in_place():
    first, second = leaf_distances(1), leaf_distances(10**6)
    for distance in (first, second):
        stopped = np.mean(distance < 2.0 + beams.LEAF)
        assert stopped == pytest.approx(1.0 - np.exp(-1.5 * beams.LEAF), abs=0.05)
        assert distance.min() >= 2.0 and 2.6 < np.mean(distance) < 3.5
    cubes = [np.floor(distance / beams.LEAF) for distance in (first, second)]
    shuffled = np.random.default_rng(0).permutation(cubes[1])
    assert np.mean(cubes[0] == cubes[1]) > 1.5 * np.mean(cubes[0] == shuffled)


@pytest.mark.parametrize(
    ("lidar", "rate"), [("hdl64e", 1.2e6), ("wide32", 3.2e5), ("solid_state", 2.4e5)]
)
def test_rate_of_a_lidar_is_that_of_its_data_sheet(lidar, rate):
    sweeps = list(simulate("town", lidar, duration=0.2))
    rays_per_second = LIDARS[lidar].lines * len(LIDARS[lidar].elevations) * 10
    assert rays_per_second == pytest.approx(rate, rel=0.07)
    for sweep in sweeps:
        assert 0.6 * rays_per_second < 10 * len(sweep) < rays_per_second
        assert (np.diff(sweep.offsets_ns) >= 0).all() and sweep.offsets_ns[-1] < 100_000_000
        assert np.array_equal(
            np.unique(sweep.fields["ring"]), range(len(LIDARS[lidar].elevations))
        )


@pytest.mark.parametrize("scene", ["town", "forest"])
def test_sweeps_depend_on_the_seed_but_not_on_threads_or_the_length_of_the_drive(scene):
    first = list(simulate(scene, "wide32", duration=0.3))
    with single_threaded():
        long = simulate(scene, "wide32", duration=1.3)
        again = [sweep for sweep, _ in zip(long, range(3), strict=False)]
    for one, other in zip(first, again, strict=True):
        assert np.array_equal(one.points, other.points)  # instances are numbered along the scene
        assert np.array_equal(one.fields["class"], other.fields["class"])
    other = next(iter(simulate(scene, "wide32", duration=0.1, noise_seed=5)))
    assert not np.array_equal(other.points, first[0].points)


def test_directions_of_the_solid_state_lidar_fill_its_view_and_do_not_repeat():
    lidar = LIDARS["solid_state"]
    first, second = (lidar.directions(lidar, k).reshape(-1, 3) for k in (0, 1))
    across, up = (np.degrees(np.arcsin(first[:, k])) for k in (1, 2))
    assert np.ptp(up) == pytest.approx(77.2, abs=1.0) and np.ptp(across) == pytest.approx(
        70.4, abs=1.0
    )
    assert np.median(np.linalg.norm(first - second, axis=1)) > 0.05


def test_moving_items_move_by_their_velocity_and_the_rest_stays():
    first, last = (
        sweep for k, sweep in enumerate(simulate("town", duration=0.6, **EXACT)) if k in (0, 5)
    )
    moved = set()
    for instance in np.unique(first.fields["instance"]):
        rows = [sweep.fields["instance"] == instance for sweep in (first, last)]
        flags = {
            int(f) for s, r in zip((first, last), rows, strict=True) for f in s.fields["moving"][r]
        }
        assert len(flags) == 1
        if flags == {1} and min(r.sum() for r in rows) > 60:
            one, other = (
                s.points[r].mean(axis=0) for s, r in zip((first, last), rows, strict=True)
            )
            moved.add(round(np.linalg.norm(other - one) / 0.5))
    assert moved & {9, 10} and moved & {1, 2}  # m/s: cars, people
    kinds = set(first.fields["class"][first.fields["moving"] == 1])
    assert kinds == {Class.VEHICLE, Class.PERSON}


def test_some_returns_at_edges_are_between_the_two_surfaces(monkeypatch):
    def ranges(divergence):
        lidar = LIDARS["wide32"]._replace(divergence=divergence)
        monkeypatch.setitem(LIDARS, "wide32", lidar)
        scan = next(LidarDrive("town", duration=0.1, lidar="wide32", **EXACT).scans())
        return np.linalg.norm(scan.points, axis=1).reshape(1024, 32)

    wide, sharp = ranges(0.003), ranges(0.0)
    moved = np.argwhere(np.abs(wide - sharp) > 1e-9)
    assert 0.002 * wide.size < len(moved) < 0.03 * wide.size
    for line, beam in moved:
        low, high = sorted((sharp[line, beam], sharp[line + 1, beam]))
        assert np.isnan(high) or low < wide[line, beam] < high


def test_share_of_nan_is_the_requested_one():
    sweep = next(iter(simulate("town", "wide32", duration=0.1, nan_share=0.01)))
    assert np.isnan(sweep.points).all(axis=1).mean() == pytest.approx(0.01, abs=0.002)
    assert np.isnan(sweep.points).any(axis=1).sum() == np.isnan(sweep.points).all(axis=1).sum()


def test_lidar_of_a_scene_may_be_chosen_and_its_settings_are_checked():
    assert isinstance(simulate("roadway"), Scene)
    assert isinstance(simulate("roadway", "hdl64e"), LidarDrive)
    assert len(next(iter(simulate("roadway", "wide32", duration=0.1)))) > 15_000
    assert set(SCENES) == {"woodland", "industrial", "roadway", "mixed"}
    with pytest.raises(ConfigError, match="^lidar is 'radar'; it must be one of hdl64e"):
        simulate("town", "radar")
    with pytest.raises(ConfigError, match="^name is 'town'; it must be one of woodland"):
        simulate("town", "sick")
