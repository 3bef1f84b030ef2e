"""Facts about colours: stable, told apart, and the ones of the paper's figure 3."""

import colorsys

import numpy as np

from ellipseg_ros.io import colours


def test_colour_of_an_id_does_not_depend_on_other_ids():
    ids = np.array([7, 0, 4_000_000_000, 7], np.uint32)
    rgb = colours.id_colours(ids)
    assert rgb.dtype == np.uint8 and rgb.shape == (4, 3)
    assert np.array_equal(rgb[0], rgb[3])
    assert np.array_equal(rgb[:1], colours.id_colours(ids[:1]))


def test_successive_ids_have_different_hues():
    rgb = colours.id_colours(np.arange(1, 200, dtype=np.uint32)).astype(float)
    assert np.abs(np.diff(rgb, axis=0)).max(axis=1).min() > 60


def test_only_points_without_segment_are_grey():
    rgb = colours.id_colours(np.arange(500, dtype=np.uint32)).astype(int)
    assert tuple(rgb[0]) == colours.NO_SEGMENT
    assert np.ptp(rgb[1:], axis=1).min() > 40


def test_hues_equal_those_of_colorsys():
    hue, saturation, value = np.random.default_rng(1).random((3, 40))
    expected = [colorsys.hsv_to_rgb(*row) for row in zip(hue, saturation, value, strict=True)]
    assert np.allclose(colours._rgb(hue, saturation, value), expected)


def test_shapes_have_the_colours_of_figure_3():
    pure = np.eye(3)  # a plane, a cylinder, a sphere
    assert np.array_equal(colours.shape_colours(*pure), [[0, 0, 1], [1, 0, 0], [0, 1, 0]])
    mixed = colours.shape_colours(np.array([0.25]), np.array([0.75]), np.array([0.0]))
    assert np.allclose(mixed, [[np.sqrt(0.75), 0.0, 0.5]])


def test_no_ids_give_no_colours():
    assert colours.id_colours(np.zeros(0, np.uint32)).shape == (0, 3)
