"""Solid and porous bodies of a scene, and their materials."""

from collections.abc import Sequence
from enum import IntEnum
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from ellipseg_ros.records import Array

Vector: TypeAlias = Sequence[float] | Array  # 3 numbers

BOX, CONE, ELLIPSOID = 0, 1, 2
ORIGIN = (0.0, 0.0, 0.0)


class Class(IntEnum):
    """Class of a point; numbered like the field `coarse` of the recorded labelled scenes."""

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
    """Material of a body."""

    kind: Class
    reflectivity: float = 0.4
    density: float = 0.0  # 1/m: rate of returns along a beam inside; 0: solid
    windows: bool = False  # a box's upright faces have rows of recessed windows


class Shapes(NamedTuple):
    """Bodies as arrays; row i of each is body i."""

    form: Array  # (p,) int64: BOX, CONE or ELLIPSOID
    centre: Array  # (p, 3) m
    axes: Array  # (p, 3, 3): columns are the axes of the body in the world
    size: Array  # (p, 3) m: half edges; radius below, radius above, half height; half axes
    radius: Array  # (p,) m: of a bounding sphere about the centre
    density: Array  # (p,) 1/m
    windows: Array  # (p,) bool
    reflectivity: Array  # (p,)
    kind: Array  # (p,) uint8, see Class
    instance: Array  # (p,) uint32: number of the item that the body is part of; 0: ground

    def near(self, point: Array, distance: float) -> "Shapes":
        """The bodies within `distance` m of a point (3,), in the same order."""
        keep = np.linalg.norm(self.centre - point, axis=1) - self.radius < distance
        return Shapes(*(column[keep] for column in self))


class Frame(NamedTuple):
    """Pose of an item in the world: origin (3,) m, axes (3, 3) as columns."""

    origin: Array
    axes: Array

    def point(self, at: Vector) -> Array:
        """Position (3,) m in the world of a position in this frame."""
        return np.asarray(self.origin + self.axes @ np.array(at))

    def moved(self, at: Vector, yaw: float = 0.0) -> "Frame":
        """The frame at a position in this one, rotated by `yaw` rad about its z axis."""
        return Frame(self.point(at), self.axes @ yaw_rotation(yaw))


WORLD = Frame(np.zeros(3), np.eye(3))


class Item(NamedTuple):
    """An item under construction, which consists of bodies."""

    bodies: list[tuple[Any, ...]]  # of the whole scene; rows of Shapes
    number: int  # Shapes.instance
    frame: Frame  # of the positions of the bodies

    def moved(self, at: Vector, yaw: float = 0.0) -> "Item":
        """The same item in a moved frame, see Frame.moved."""
        return self._replace(frame=self.frame.moved(at, yaw))

    def box(self, material: Material, centre: Vector, edges: Vector, pitch: float = 0.0) -> None:
        """Add a box with the axes of the frame, rotated by `pitch` rad about its y axis."""
        half = 0.5 * np.array(edges)
        axes = self.frame.axes @ pitch_rotation(pitch)
        self._add(BOX, material, self.frame.point(centre), axes, half, np.linalg.norm(half))

    def ellipsoid(self, material: Material, centre: Vector, half_axes: Vector) -> None:
        """Add an ellipsoid with the axes of the frame."""
        place, axes = self.frame.point(centre), self.frame.axes
        self._add(ELLIPSOID, material, place, axes, np.array(half_axes), max(half_axes))

    def cone(
        self, material: Material, ends: tuple[Vector, Vector], radii: tuple[float, float]
    ) -> None:
        """Add a truncated cone between two positions, with a radius at each."""
        low, high = (self.frame.point(end) for end in ends)
        half = 0.5 * np.linalg.norm(high - low)
        axes = axes_along((high - low) / (2.0 * half))
        radius = np.hypot(half, max(radii))
        self._add(CONE, material, 0.5 * (low + high), axes, np.array([*radii, half]), radius)

    def shapes(self) -> Shapes:
        """The bodies in the item's list."""
        return _as_shapes(self.bodies)

    def _add(self, form: int, material: Material, *geometry: Any) -> None:
        """Add a body; geometry: centre, axes, size and radius of Shapes."""
        kind, reflectivity, density, windows = material
        surface = (density, windows, reflectivity, kind)
        self.bodies.append((form, *geometry, *surface, self.number))


def _as_shapes(bodies: list[tuple[Any, ...]]) -> Shapes:
    kinds = (np.int64, *[np.float64] * 5, np.bool_, np.float64, np.uint8, np.uint32)
    columns = zip(*bodies, strict=True)
    return Shapes(*map(np.array, columns, kinds))


class Model:
    """Collects the items of a scene."""

    def __init__(self) -> None:
        self._bodies: list[tuple[Any, ...]] = []
        self._items = 0

    def item(self, frame: Frame) -> Item:
        """Begin a new item at a frame."""
        self._items += 1
        return Item(self._bodies, self._items, frame)

    def ground(self, frame: Frame) -> Item:
        """The ground, for bodies at a frame that belong to it."""
        return Item(self._bodies, 0, frame)

    def separate(self) -> Item:
        """Begin a new item that moves: its bodies are not part of `shapes`, see Item.shapes."""
        self._items += 1
        return Item([], self._items, WORLD)

    def shapes(self) -> Shapes:
        """All bodies so far."""
        return _as_shapes(self._bodies)


def yaw_rotation(angle: float) -> Array:
    """Rotation (3, 3) by `angle` rad about z."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def pitch_rotation(angle: float) -> Array:
    """Rotation (3, 3) by `angle` rad about y."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def axes_along(direction: Array) -> Array:
    """Axes (3, 3) as columns, of which the third is the unit vector `direction`."""
    helper = np.eye(3)[int(np.argmin(np.abs(direction)))]
    first = np.cross(helper, direction)
    first /= np.linalg.norm(first)
    return np.column_stack([first, np.cross(direction, first), direction])
