"""Cars and people that move along or across the lane."""

from typing import NamedTuple

import numpy as np

from ellipseg_ros.records import Array
from ellipseg_ros.simulation.beams import Movers
from ellipseg_ros.simulation.grid import WIDTH, elevations, make_table
from ellipseg_ros.simulation.scanner import Path
from ellipseg_ros.simulation.shapes import Shapes


class Mover(NamedTuple):
    """An item in uniform motion in the coordinates of the lane, see Path."""

    s: float  # m at time 0
    d: float  # m at time 0
    along: float  # m/s
    across: float  # m/s
    lift: float  # m above the ground
    low: float  # m: between these d it goes back and forth, if `across` is not 0
    high: float  # m
    shapes: Shapes  # bodies in the item's frame, x ahead


class Traffic(NamedTuple):
    """The moving items near the scanner during a sweep."""

    movers: Movers
    shapes: tuple[Shapes, ...]


def find_traffic(
    movers: tuple[Mover, ...], path: Path, times: tuple[float, float], reach: tuple[float, float]
) -> Traffic:
    """Those whose s is within `reach` (m) and on the path, from times[0] to times[1] in s."""
    low, high = max(reach[0], path.start + 5.0), min(reach[1], path.end - 5.0)
    near = [m for m in movers if all(low < m.s + m.along * time < high for time in times)]
    begin, end = (_poses(near, path, time) for time in times)
    turn = np.angle(np.exp(1j * (end[:, 3] - begin[:, 3])))
    end[:, 3] = begin[:, 3] + np.where(np.abs(turn) < 1.0, turn, 0.0)  # about face at once
    shapes = tuple(mover.shapes for mover in near)
    tables = [np.zeros((0, WIDTH)), *map(make_table, shapes)]
    radius = [np.max(np.linalg.norm(b.centre, axis=1) + b.radius) for b in shapes]
    starts = np.cumsum([len(table) for table in tables]).astype(np.int64)
    bounds = np.array(radius, np.float64)
    return Traffic(Movers(begin, end, bounds, starts, np.concatenate(tables)), shapes)


def _poses(movers: list[Mover], path: Path, time: float) -> Array:
    """x, y, z (m) and yaw (rad) of the items at a time in s: (m, 4)."""
    rows = np.array([mover[:-1] for mover in movers], np.float64).reshape(-1, 7)
    s, d, along, across, lift, low, high = rows.T
    width = np.maximum(high - low, 1e-9)
    phase = (d - low + across * time) / width % 2.0
    back = phase > 1.0
    d = np.where(across != 0.0, low + width * np.where(back, 2.0 - phase, phase), d)
    across = np.where(back, -across, across)
    nodes = path.nodes
    x, y = (np.interp(s + along * time, nodes, column) for column in path.xy.T)
    heading = np.interp(s + along * time, nodes, path.heading)
    x, y = x - d * np.sin(heading), y + d * np.cos(heading)
    z = elevations(path.terrain, x, y) + lift
    return np.column_stack([x, y, z, heading + np.arctan2(across, along)])
