"""Partition methods for tests. Few imports, since every subprocess repeats them."""

import os
from dataclasses import replace
from functools import partial
from threading import Event

import numpy as np

from studies.partition.methods import CountParameter, Method


def strips(points, settings):
    """Segments across x: `width` m wide, or `segments` in number."""
    x = points[:, 0] - points[:, 0].min()
    many = settings.get("segments", 10**6)
    width = settings.get("width") or np.ptp(x) / many
    return np.minimum(x / width, many - 1).astype(np.int64)


def prepare_strips(points):
    return partial(strips, points)


def prepare_endless(points):
    Event().wait()


def prepare_crash(points):
    os._exit(7)


def prepare_mistake(points):
    raise ValueError("two\nlines")


STRIPS = Method("strips", prepare_strips, ({"width": 3.0},), CountParameter("width", 0.01, 100.0))
COUNTED = Method("counted", prepare_strips, ({"segments": 4},), None)
OURS = replace(COUNTED, name="objects")
THEIRS = replace(STRIPS, name="cut-pursuit")
ABSENT = replace(
    STRIPS, name="absent", package="numpy no-such-package", module="numpy no_such_module"
)
