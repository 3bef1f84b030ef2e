"""Simulated scenes, the scanner, ray casting, and the ground truth of points."""

from functools import lru_cache

import numpy as np
import pytest
import simple_shapes

from ellipseg_ros.core.fields import join_sweeps
from ellipseg_ros.errors import ConfigError
from ellipseg_ros.records import Sweep
from ellipseg_ros.settings import iterate_settings
from ellipseg_ros.simulation import rays, scanner, simulator
from ellipseg_ros.simulation.rays import Lines, Terrain
from ellipseg_ros.simulation.shapes import WORLD, Class, Material, Model
from ellipseg_ros.simulation.simulator import SCENES, Scene, simulate

STEEL = Material(Class.WALL)
FLAT = Terrain(np.zeros(1), np.ones((1, 2)), np.zeros(1), 0.0)
EXACT = {"noise": 0.0, "drift": 0.0}


@lru_cache(maxsize=20)
def drive(name: str, **settings: float) -> Sweep:
    return join_sweeps(list(simulate(name, **settings)))


def classes(sweep):
    return sweep.fields["class"]


def cast_beams(model, directions, origin=(0.0, 0.0, 1.0), uniform=0.5, terrain=FLAT):
    """Distance, body and cosine of beams cast with one scan line each, straight ahead."""
    forward = np.asarray(directions, float)
    forward /= np.linalg.norm(forward, axis=1, keepdims=True)
    lines = Lines(np.tile(np.array(origin), (len(forward), 1)), forward, np.zeros_like(forward))
    side = np.cross(forward, [0.6, 0.0, 0.8])
    lines = lines._replace(side=side / np.linalg.norm(side, axis=1, keepdims=True))
    chances = np.broadcast_to(np.reshape(uniform, (-1, 1)), (len(forward), 1)).copy()
    found = rays.cast(lines, np.zeros(1), chances, model.shapes(), terrain)
    return found.distance[:, 0], found.body[:, 0], found.cosine[:, 0]


# --- the drives


@pytest.mark.parametrize("name", SCENES)
def test_drive_has_as_many_points_as_a_sick_lms_returns(name):
    assert 140_000 <= len(drive(name)) <= 190_000


@pytest.mark.parametrize("name", SCENES)
def test_times_ascend_within_the_drive(name):
    stamps = [sweep.stamp_ns for sweep in simulate(name, duration=3.0)]
    assert stamps == [simulator.START_NS + k * 100_000_000 for k in range(30)]
    times = drive(name).times_ns
    assert (np.diff(times) >= 0).all()
    assert times[0] >= simulator.START_NS
    assert times[-1] < simulator.START_NS + 25_000_000_000


@pytest.mark.nojit
@pytest.mark.parametrize("duration", [0.1, 0.25])
def test_sweep_is_a_tenth_of_a_second_and_equals_its_fields(duration):
    scene = simulate("roadway", duration=duration)
    sweeps = list(scene)
    assert len(sweeps) == len(scene)
    for sweep in sweeps:
        assert sweep.frame_id == scene.frame_id == "odom"
        assert sweep.fields.dtype == simulator.FIELDS
        assert (0 <= sweep.offsets_ns).all() and (sweep.offsets_ns < 100_000_000).all()
        assert np.array_equal(sweep.fields["t"], sweep.offsets_ns)
        for k, axis in enumerate("xyz"):
            assert np.array_equal(sweep.fields[axis], sweep.points[:, k])


@pytest.mark.parametrize("duration", [0.11, 0.79, 1.0, 2.32])
def test_length_of_a_scene_is_the_number_of_its_sweeps(duration):
    scene = simulate("woodland", duration=duration)
    assert len(scene) == len(list(scene))


def test_drives_are_equal_only_for_equal_seeds():
    scene = simulate("mixed", seed=3, duration=2.0)
    first, second, rebuilt = (
        join_sweeps(list(s)) for s in (scene, scene, simulate("mixed", seed=3, duration=2.0))
    )
    for other in (second, rebuilt):
        assert np.array_equal(first.points, other.points)
        assert np.array_equal(first.fields, other.fields)
    other = drive("mixed", seed=4, duration=2.0)
    assert len(other) != len(first) or not np.array_equal(other.points, first.points)


@pytest.mark.parametrize("name", SCENES)
def test_longer_drive_begins_like_a_shorter_one(name):
    short, long = (list(simulate(name, seed=1, duration=d)) for d in (2.0, 12.0))
    for one, other in zip(short, long, strict=False):
        assert np.array_equal(one.points, other.points)
        assert np.array_equal(classes(one), classes(other))


def test_invalid_settings_are_refused_in_one_line():
    with pytest.raises(ConfigError, match="^name is 'moon'; it must be one of woodland, "):
        simulate("moon")
    with pytest.raises(ConfigError, match="^duration is -1; it must be from 0.1 to 3600 s"):
        simulate("mixed", duration=-1.0)


def test_every_setting_is_described():
    assert all(about.about for _, _, about in iterate_settings(Scene()))


# --- the scanner


def test_returns_of_a_line_are_in_one_plane_on_beams_one_degree_apart():
    scene = simulate("industrial", duration=1.0, **EXACT)
    sweep = join_sweeps(list(scene))
    numbers = np.arange(75)
    lines = scanner.scan_lines(scene._world.path, numbers / 75.0, scanner.Drive(scene.speed))
    line = np.searchsorted(numbers * 1_000_000_000 // 75, sweep.times_ns - simulator.START_NS)
    beam = sweep.points - lines.origin[line]
    distance = np.linalg.norm(beam, axis=1)
    normal = np.cross(lines.forward, lines.side)[line]
    assert np.abs(np.sum(beam * normal, axis=1)).max() < 1e-4
    assert scanner.NEAREST < distance.min() and distance.max() < scanner.FARTHEST
    angle = np.degrees(np.arccos(np.sum(beam * lines.forward[line], axis=1) / distance))
    assert np.abs(angle - np.rint(angle))[distance > 2.0].max() < 0.01


def test_scan_plane_rotates_by_half_a_turn_per_second():
    path = simulate("industrial")._world.path
    sides = scanner.scan_lines(path, np.array([0.0, 0.5, 1.0]), scanner.Drive(speed=0.0)).side
    assert abs(sides[0] @ sides[1]) < 0.1
    assert sides[0] @ sides[2] < -0.99


def test_second_drive_in_the_opposite_direction_has_the_same_scene():
    there = simulate("industrial", duration=4.0, seed=3)
    back = simulate(
        "industrial", duration=2.0, seed=3, noise_seed=1, start=12.0, speed=6.0, backwards=True
    )
    for one, other in zip(there._world.shapes, back._world.shapes, strict=True):
        assert np.array_equal(one, other)
    lines = [
        scanner.scan_lines(scene._world.path, np.array(times), scene._drive)
        for scene, times in ((there, (1.0,)), (back, (1.5,)))
    ]
    assert np.allclose(lines[0].origin, lines[1].origin, atol=0.02)  # but for the sway
    assert np.allclose(lines[0].forward, -lines[1].forward, atol=0.02)
    beside = scanner.scan_lines(there._world.path, np.array([1.0]), scanner.Drive(3.0, aside=1.0))
    assert np.linalg.norm(beside.origin - lines[0].origin) == pytest.approx(1.0, abs=0.03)


def test_noise_seed_changes_the_noise_only():
    exact = {"duration": 0.3, "seed": 1, **EXACT}
    one, other = (join_sweeps(list(simulate("roadway", noise_seed=k, **exact))) for k in (1, 2))
    solid = [np.isin(s.fields["class"], (Class.GROUND, Class.WALL)) for s in (one, other)]
    near = [
        np.unique(np.round(s.points[m], 2), axis=0)
        for s, m in zip((one, other), solid, strict=True)
    ]
    both = np.concatenate(near)
    assert len(both) - len(np.unique(both, axis=0)) > 0.7 * min(map(len, near))
    assert len(one) != len(other)  # different returns are lost


def test_noise_has_the_requested_standard_deviation():
    noisy, exact = (
        drive("roadway", duration=1.0, drift=0.0, noise=noise) for noise in (0.03, 0.0)
    )
    error = np.linalg.norm(noisy.points - exact.points, axis=1)
    assert np.sqrt(np.mean(error**2)) == pytest.approx(0.03, rel=0.05)


def test_drift_begins_at_zero_and_grows_slowly():
    drifted, exact = (drive("roadway", noise=0.0, drift=drift) for drift in (0.1, 0.0))
    error = drifted.points - exact.points
    second = (exact.times_ns - simulator.START_NS) // 1_000_000_000
    means = np.array([error[second == k].mean(axis=0) for k in range(25)])
    size = np.linalg.norm(means, axis=1)
    assert size[0] < 0.05 and 0.02 < size.max() < 0.6
    assert np.linalg.norm(np.diff(means, axis=0), axis=1).max() < 0.12


def test_dark_distant_and_oblique_surfaces_return_less():
    def chance(distance=10.0, cosine=0.5, reflectivity=0.1):
        return scanner.return_probability(np.array(distance), cosine, reflectivity)

    usual = chance()
    assert 0.0 < chance(distance=20.0) < usual < 1.0
    assert chance(cosine=0.1) < usual and chance(reflectivity=0.01) < usual
    assert chance(distance=41.0) == chance(distance=0.1) == 0.0


# --- the truth


def test_classes_are_numbered_as_in_the_labelled_scenes():
    names = "UNKNOWN GROUND VEGETATION POLE WIRE WALL VEHICLE PERSON OTHER"
    assert [kind.name for kind in Class] == names.split()
    assert [int(kind) for kind in Class] == list(range(9))


@pytest.mark.parametrize("name", SCENES)
def test_every_point_off_the_ground_has_an_instance(name):
    sweep = drive(name)
    assert not (classes(sweep) == Class.UNKNOWN).any()
    assert np.array_equal(sweep.fields["instance"] == 0, classes(sweep) == Class.GROUND)


@pytest.mark.parametrize(
    ("name", "kinds"),
    [
        ("woodland", [1, 2, 3, 8]),
        ("industrial", [1, 2, 3, 4, 5, 6, 7, 8]),
        ("roadway", [1, 2, 3, 4, 5, 6, 7, 8]),
        ("mixed", [1, 2, 3, 4, 5, 6, 7, 8]),
    ],
)
def test_scene_has_the_classes_of_its_kind(name, kinds):
    count = np.bincount(classes(drive(name)), minlength=9)
    assert list(np.flatnonzero(count)) == kinds
    assert count[kinds].min() > 100


def test_instance_has_one_class_unless_it_is_a_tree():
    sweep = drive("mixed")
    pairs = np.unique(np.column_stack([sweep.fields["instance"], classes(sweep)]), axis=0)
    several = {
        int(thing): set(pairs[pairs[:, 0] == thing, 1])
        for thing, count in zip(*np.unique(pairs[:, 0], return_counts=True), strict=True)
        if count > 1
    }
    assert len(several) > 20
    assert all(kinds == {Class.VEGETATION, Class.POLE} for kinds in several.values())


@pytest.mark.parametrize(
    ("name", "kerb"), [("woodland", 0.0), ("industrial", 0.0), ("roadway", 0.13)]
)
def test_ground_points_are_on_the_terrain(name, kerb):
    scene = simulate(name, duration=4.0, **EXACT)
    sweep = join_sweeps(list(scene))
    ground = sweep.points[classes(sweep) == Class.GROUND]
    terrain = scene._world.path.terrain
    above = ground[:, 2] - [rays.elevation(terrain, x, y) for x, y, _ in ground]
    assert above.min() > -0.05 and above.max() < kerb + 0.05
    assert (np.abs(above) < 0.01).mean() > 0.6


def test_crowns_have_returns_through_their_depth():
    sweep = drive("roadway", **EXACT)

    def smallest_spread(kind):
        rows = classes(sweep) == kind
        instances = sweep.fields["instance"][rows]
        spread = []
        for instance in np.unique(instances):
            points = sweep.points[rows][instances == instance]
            if len(points) > 250:
                spread.append(np.sqrt(np.linalg.eigvalsh(np.cov(points.T))[0]))
        return np.array(spread)

    crowns = smallest_spread(Class.VEGETATION)
    assert len(crowns) > 5 and np.median(crowns) > 0.3


def test_walls_of_a_scene_are_plane():
    sweep = drive("industrial", drift=0.0)
    scene = simulate("industrial", drift=0.0)
    shapes = scene._world.shapes
    wide = np.flatnonzero((shapes.kind == Class.WALL) & (shapes.size[:, 0] > 8.0))
    checked = 0
    for body in wide:
        local = (sweep.points - shapes.centre[body]) @ shapes.axes[body]
        half = shapes.size[body]
        front = (np.abs(np.abs(local[:, 1]) - half[1]) < 0.1) & (
            np.abs(local[:, [0, 2]]) < half[[0, 2]] - 0.3
        ).all(axis=1)
        if front.sum() > 500:
            checked += 1
            off = np.abs(local[front, 1]) - half[1]
            assert abs(np.median(off)) < 0.005
    assert checked >= 2


# --- beams


@pytest.mark.nojit
def test_beam_ends_at_the_face_of_a_box():
    model = Model()
    item = model.item(WORLD)
    item.box(STEEL, (5.0, 0.0, 1.0), (2.0, 4.0, 2.0))
    distance, body, cosine = cast_beams(model, [[1, 0, 0], [1, 0.25, 0], [0, 1, 0], [-1, 0, 0]])
    assert np.allclose(distance, [4.0, 4.0 * np.hypot(1, 0.25), rays.FAR, rays.FAR])
    assert list(body) == [0, 0, rays.NOTHING, rays.NOTHING]
    assert np.allclose(cosine[:2], [1.0, 1.0 / np.hypot(1, 0.25)])


@pytest.mark.nojit
def test_beam_ends_at_a_cone_an_ellipsoid_and_the_nearest_body():
    model = Model()
    item = model.item(WORLD)
    item.cone(STEEL, ((6.0, 0.0, 0.0), (6.0, 0.0, 4.0)), (0.5, 0.3))
    item.ellipsoid(STEEL, (0.0, 8.0, 1.0), (1.0, 2.0, 3.0))
    item.ellipsoid(STEEL, (20.0, 0.0, 1.0), (1.0, 1.0, 1.0))
    distance, body, cosine = cast_beams(model, [[1, 0, 0], [0, 1, 0], [1, 0, 0.9]])
    assert np.allclose(distance[:2], [6.0 - 0.45, 6.0])
    assert list(body) == [0, 1, rays.NOTHING]
    assert np.allclose(cosine[:2], 1.0, atol=0.01)


@pytest.mark.nojit
def test_beam_ends_on_rolling_ground():
    terrain = Terrain(np.array([0.4, 0.1]), np.array([[0.3, 0.1], [0.0, 2.0]]), np.zeros(2), 0.4)
    down = np.array([[1, 0, -0.3], [0.3, -1, -0.15], [0, 0, -1], [1, 1, 0.5]])
    model = Model()
    item = model.item(WORLD)
    item.ellipsoid(STEEL, (0.0, 0.0, 90.0), (1.0, 1.0, 1.0))
    distance, body, _ = cast_beams(model, down, terrain=terrain)
    assert list(body) == [rays.GROUND] * 3 + [rays.NOTHING]
    unit = down / np.linalg.norm(down, axis=1, keepdims=True)
    for end in np.array([0.0, 0.0, 1.0]) + distance[:3, None] * unit[:3]:
        assert abs(end[2] - rays.elevation(terrain, end[0], end[1])) < 0.003


@pytest.mark.nojit
def test_depth_of_returns_in_leaves_follows_their_density():
    model = Model()
    item = model.item(WORLD)
    item.box(Material(Class.VEGETATION, density=2.0), (55.0, 0.0, 1.0), (100.0, 4.0, 2.0))
    uniform = (np.arange(400) + 0.5) / 400.0
    distance, _, _ = cast_beams(model, np.tile([1.0, 0.0, 0.0], (400, 1)), uniform=uniform)
    depth = distance - 5.0
    assert depth.min() >= 0.0
    assert np.mean(depth) == pytest.approx(0.5, rel=0.03)  # 1 / density
    assert np.median(depth) == pytest.approx(np.log(2.0) / 2.0, rel=0.03)


@pytest.mark.nojit
def test_stem_is_visible_through_thin_leaves():
    model = Model()
    item = model.item(WORLD)
    item.ellipsoid(Material(Class.VEGETATION, density=0.5), (6.0, 0.0, 1.0), (2.0, 2.0, 2.0))
    item.cone(STEEL, ((6.0, 0.0, -1.0), (6.0, 0.0, 3.0)), (0.2, 0.2))
    uniform = (np.arange(100) + 0.5) / 100.0
    distance, body, _ = cast_beams(model, np.tile([1.0, 0.0, 0.0], (100, 1)), uniform=uniform)
    assert (body == 1).mean() == pytest.approx(np.exp(-0.5 * 1.8), abs=0.02)
    assert np.allclose(distance[body == 1], 5.8)


@pytest.mark.nojit
def test_panes_are_recessed_and_return_weakly():
    model = Model()
    item = model.item(WORLD)
    item.box(Material(Class.WALL, windows=True), (6.0, 0.0, 1.5), (2.0, 2.8, 3.0))
    pane, wall = [1.0, 0.0, 0.13], [1.0, 0.23, 0.0]
    distance, _, cosine = cast_beams(model, [pane, wall])
    along_x = distance / [np.linalg.norm(pane), np.linalg.norm(wall)]
    assert np.allclose(along_x, [5.0 + rays.WINDOW_RECESS, 5.0])
    assert cosine[0] < 0.3 < cosine[1]


# --- single items


def test_wall_has_its_size_and_range_noise():
    sweep, truth = simple_shapes.wall(np.random.default_rng(0), width=10.0, height=4.0)
    assert len(sweep) == len(truth) == 2400 and set(truth) == {1}
    assert np.allclose(np.ptp(sweep.points, axis=0)[1:], [10.0, 4.0], atol=0.1)
    assert 0.01 < sweep.points[:, 0].std() < 0.016
    assert abs(sweep.points[:, 0].mean() - 8.0) < 0.002


def test_trunk_is_round_and_upright():
    sweep, _ = simple_shapes.trunk(np.random.default_rng(0), radius=0.25, height=5.0)
    from_axis = np.hypot(sweep.points[:, 0] - 6.0, sweep.points[:, 1])
    assert abs(from_axis.mean() - 0.25) < 0.01 and from_axis.std() < 0.02
    assert np.ptp(sweep.points[:, 2]) > 4.9
    assert (sweep.points[:, 0] < 6.06).all()


def test_boxes_have_the_requested_gap():
    sweep, truth = simple_shapes.boxes(gap=1.0, rng=np.random.default_rng(0))
    assert set(truth) == {1, 2, 3, 4}
    for box in (1, 2, 3):
        left, right = (sweep.points[truth == k, 1] for k in (box, box + 1))
        assert right.min() - left.max() == pytest.approx(1.0, abs=0.1)
