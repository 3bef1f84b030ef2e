"""Pictures of windows: size, colours, and degenerate windows."""

from dataclasses import replace

import numpy as np
import pytest
import simple_shapes
from matplotlib.colors import rgb_to_hsv
from matplotlib.image import imread

from ellipseg_ros.config import Config
from ellipseg_ros.core.fields import join_sweeps
from ellipseg_ros.plots import window as plots
from ellipseg_ros.segmenter import segment

SINGLE = [plots.draw_segments, plots.draw_ellipsoids]
DRAWERS = [*SINGLE, plots.draw_levels]
VIEWS = [plots.BIRDSEYE, plots.OBLIQUE]


def cloud():
    rng = np.random.default_rng(0)
    parts = [
        simple_shapes.wall(rng)[0],
        simple_shapes.trunk(rng)[0],
        simple_shapes.boxes(rng, gap=1.0)[0],
    ]
    return join_sweeps(parts).points


def found_in(points):
    return segment(points, Config(threshold=12.0))


def drawn(draw, found, path, view=plots.BIRDSEYE):
    """(rows, columns, 3) in 0...1: the part of the picture with the data."""
    draw(found, path, view)
    image = imread(path)[..., :3]
    assert image.shape[1] == plots.WIDTH
    return image[plots.HEADER : -plots.FOOTER]


def coloured(image):
    """(rows, columns) bool: pixels of a colour, neither background nor grey."""
    return np.ptp(image, axis=2) > 0.2


@pytest.mark.parametrize("view", VIEWS)
@pytest.mark.parametrize("draw", SINGLE)
def test_picture_shows_the_segments(draw, view, tmp_path):
    image = drawn(draw, found_in(cloud()), tmp_path / "a.png", view)
    assert 0.25 < image.shape[0] / image.shape[1] < 1.0
    assert coloured(image).sum() > 2000
    rows, columns = np.nonzero(coloured(image))
    assert np.ptp(columns) > 0.7 * image.shape[1] or np.ptp(rows) > 0.7 * image.shape[0]


def test_segments_have_different_colours(tmp_path):
    image = drawn(plots.draw_segments, found_in(cloud()), tmp_path / "a.png", plots.OBLIQUE)
    tints = np.unique(np.round(image[coloured(image)] * 4.0), axis=0)
    assert len(tints) > 12


@pytest.mark.parametrize(("thing", "channel"), [(simple_shapes.trunk, 0), (simple_shapes.wall, 2)])
def test_stems_are_red_and_square_walls_blue(thing, channel, tmp_path):
    points = thing(np.random.default_rng(1), 0.2 if thing is simple_shapes.trunk else 6.0, 6.0)[
        0
    ].points
    found = segment(points, Config(threshold=1e6))
    assert len(found.ellipsoids) == 1
    image = drawn(plots.draw_ellipsoids, found, tmp_path / "a.png", plots.OBLIQUE)
    mean = image[coloured(image)].mean(axis=0)
    assert int(np.argmax(mean)) == channel


def test_levels_show_ground_truth_if_the_input_has_it(tmp_path):
    points = cloud()
    fields = np.zeros(len(points), [("instance", np.uint32), ("class", np.uint8)])
    fields["class"] = 1
    fields["instance"][: len(points) // 2] = 9
    found = replace(found_in(points), fields=fields)
    image = drawn(plots.draw_levels, found, tmp_path / "a.png")
    hues = []
    for part in np.array_split(image, 3, axis=1):
        hue = rgb_to_hsv(part[coloured(part)])[:, 0]
        hues.append(np.count_nonzero(np.histogram(hue, bins=36, range=(0, 1))[0] > 20))
    assert hues[0] > hues[2] >= 1
    without = drawn(plots.draw_levels, replace(found, fields=None), tmp_path / "b.png")
    assert without.shape[0] != image.shape[0]  # two panels are wider, so taller


def test_small_segments_are_grey_points_among_ellipsoids(tmp_path):
    points = 1.5 * np.arange(3.0)[:, None] + np.random.default_rng(0).normal(0.0, 0.1, (3, 3))
    image = drawn(plots.draw_ellipsoids, found_in(points), tmp_path / "a.png")
    assert not coloured(image).any()
    assert (image.max(axis=2) > 0.2).sum() > 10


@pytest.mark.parametrize("draw", DRAWERS)
@pytest.mark.parametrize("points", [np.zeros((0, 3)), np.zeros((1, 3)), np.full((2, 3), np.nan)])
def test_window_without_segments_is_drawn(draw, points, tmp_path):
    for view in VIEWS:
        image = drawn(draw, found_in(points), tmp_path / "a.png", view)
        assert not coloured(image).any()


@pytest.mark.parametrize("draw", DRAWERS)
def test_identical_points_are_drawn(draw, tmp_path):
    image = drawn(draw, found_in(np.ones((30, 3))), tmp_path / "a.png")
    assert coloured(image).any()


@pytest.mark.parametrize("draw", DRAWERS)
def test_few_distant_points_do_not_shrink_the_scene(draw, tmp_path):
    points = cloud()
    near = drawn(draw, found_in(points), tmp_path / "a.png", plots.OBLIQUE)
    far = drawn(
        draw,
        found_in(np.vstack([points, [[900.0, -2000.0, 300.0]]])),
        tmp_path / "b.png",
        plots.OBLIQUE,
    )
    assert coloured(far).mean() > 0.7 * coloured(near).mean()


@pytest.mark.parametrize("draw", DRAWERS)
def test_picture_does_not_depend_on_the_position_in_the_world(draw, tmp_path):
    found = found_in(np.round(cloud() * 1024.0) / 1024.0)
    shift = np.array([5e6, 4e5, 100.0])
    moved = replace(
        found,
        points=found.points + shift,
        ellipsoids=replace(found.ellipsoids, mean=found.ellipsoids.mean + shift),
    )
    here, there = drawn(draw, found, tmp_path / "a.png"), drawn(draw, moved, tmp_path / "b.png")
    assert here.shape == there.shape
    assert np.abs(here - there).mean() < 0.01


@pytest.mark.parametrize("draw", DRAWERS)
def test_equal_windows_give_equal_files(draw, tmp_path):
    found = found_in(cloud())
    for name in ("a.png", "b.png"):
        draw(found, tmp_path / name)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


@pytest.mark.parametrize(("length", "bar"), [(1.0, 1.0), (4.9, 2.0), (73.0, 50.0), (0.3, 0.2)])
def test_scale_bar_has_a_round_length(length, bar):
    assert plots._round_down(length) == pytest.approx(bar)
