"""The solids and porous bodies of a scene, and what they are made of."""

from enum import IntEnum
from typing import NamedTuple

import numpy as np

from ellipseg_ros.records import Array

BOX, CONE, ELLIPSOID = 0, 1, 2


class Class(IntEnum):
    """What a point belongs to; the numbers are those of the labelled scenes' `coarse`."""

    UNKNOWN = 0
    GROUND = 1  # kerbs and pavements too
    VEGETATION = 2  # foliage, bushes, hedges
    POLE = 3  # trunks and branches too
    WIRE = 4
    WALL = 5  # facades, roofs, fences
    VEHICLE = 6
    PERSON = 7
    OTHER = 8


class Material(NamedTuple):
    """What a body is made of."""

    kind: Class
    reflectivity: float = 0.4
    density: float = 0.0  # 1/m: chance of a return per metre of beam inside; 0: solid
    windows: bool = False  # a box's upright faces have rows of recessed windows


class Shapes(NamedTuple):
    """Bodies as arrays; row i of each is body i."""

    form: Array  # (p,) int64: BOX, CONE or ELLIPSOID
    centre: Array  # (p, 3) m
    axes: Array  # (p, 3, 3): columns are the body's own axes
    size: Array  # (p, 3) m: half edges; radius below, radius above, half height; half axes
    reach: Array  # (p,) m: no point is farther from the centre
    density: Array  # (p,) 1/m
    windows: Array  # (p,) bool
    reflectivity: Array  # (p,)
    kind: Array  # (p,) uint8, see Class
    instance: Array  # (p,) uint32: which thing the body is a part of; 0: the ground

    def near(self, point: Array, distance: float) -> "Shapes":
        """Those that come nearer to `point` than `distance`, in the same order."""
        keep = np.linalg.norm(self.centre - point, axis=1) - self.reach < distance
        return Shapes(*(column[keep] for column in self))


class Frame(NamedTuple):
    """Where a thing stands: origin (3,) m, axes (3, 3) with the thing's own as columns."""

    origin: Array
    axes: Array

    def point(self, at: tuple[float, float, float]) -> Array:
        """(3,) m in the world of a place given in the thing's own axes."""
        return np.asarray(self.origin + self.axes @ np.array(at))

    def moved(self, at: tuple[float, float, float], yaw: float = 0.0) -> "Frame":
        """The frame at a place of this one, turned by `yaw` radians about its z axis."""
        return Frame(self.point(at), self.axes @ turned(yaw))


class Model:
    """Collects the bodies of a scene."""

    def __init__(self) -> None:
        self._rows: list[tuple[object, ...]] = []
        self._things = 0

    def begin(self) -> None:
        """Let the bodies from here on be parts of a new thing."""
        self._things += 1

    def box(
        self,
        frame: Frame,
        material: Material,
        centre: tuple[float, float, float],
        edges: tuple[float, float, float],
        pitch: float = 0.0,
    ) -> None:
        """Add a box with the frame's axes, pitched by radians about its y axis."""
        half = 0.5 * np.array(edges)
        axes = frame.axes @ pitched(pitch)
        self._add(BOX, material, frame.point(centre), axes, half, float(np.linalg.norm(half)))

    def ellipsoid(
        self,
        frame: Frame,
        material: Material,
        centre: tuple[float, float, float],
        half_axes: tuple[float, float, float],
    ) -> None:
        """Add an ellipsoid with the frame's axes."""
        size = np.array(half_axes)
        self._add(ELLIPSOID, material, frame.point(centre), frame.axes, size, float(size.max()))

    def cone(
        self,
        frame: Frame,
        material: Material,
        ends: tuple[tuple[float, float, float], tuple[float, float, float]],
        radii: tuple[float, float],
    ) -> None:
        """Add a round rod between two places, with a radius at each."""
        low, high = (frame.point(end) for end in ends)
        half = 0.5 * float(np.linalg.norm(high - low))
        axes = along((high - low) / (2.0 * half))
        reach = float(np.hypot(half, max(radii)))
        self._add(CONE, material, 0.5 * (low + high), axes, np.array([*radii, half]), reach)

    def _add(
        self, form: int, material: Material, centre: Array, axes: Array, size: Array, reach: float
    ) -> None:
        thing = 0 if material.kind == Class.GROUND else self._things
        rest = (reach, material.density, material.windows, material.reflectivity, material.kind)
        self._rows.append((form, centre, axes, size, *rest, thing))

    def shapes(self) -> Shapes:
        """Everything collected so far."""
        kinds = (np.int64, *[np.float64] * 5, np.bool_, np.float64, np.uint8, np.uint32)
        columns = zip(*self._rows, strict=True)
        return Shapes(
            *(np.array(column, kind) for column, kind in zip(columns, kinds, strict=True))
        )


def turned(yaw: float) -> Array:
    """(3, 3) turn by `yaw` radians about z."""
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def pitched(angle: float) -> Array:
    """(3, 3) turn by `angle` radians about y."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def along(direction: Array) -> Array:
    """(3, 3) axes of which the third is the unit vector `direction`."""
    helper = np.eye(3)[int(np.argmin(np.abs(direction)))]
    first = np.cross(helper, direction)
    first /= np.linalg.norm(first)
    return np.column_stack([first, np.cross(direction, first), direction])
