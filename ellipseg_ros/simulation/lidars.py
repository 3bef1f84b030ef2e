"""Lidars with many beams: their patterns, limits and fields of time."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ellipseg_ros.records import SECOND, Array
from ellipseg_ros.simulation.scanner import SWEEPS_PER_SECOND

TIME_FIELDS = {  # by vendor: name and type of the time of a point
    "ouster": ("t", np.uint32),  # ns from the beginning of the sweep
    "velodyne": ("time", np.float32),  # s from the stamp
    "hesai": ("timestamp", np.float64),  # s, absolute
    "livox": ("offset_time", np.uint32),  # ns from the beginning of the sweep
}
SWEEP_NS = SECOND // SWEEPS_PER_SECOND
ROSETTE_TURNS = (121.57, -77.73)  # per second, of the two prisms; no common period


class Lidar(NamedTuple):
    """A lidar; a sweep of 0.1 s has `lines`, in each of which all beams fire at one time."""

    directions: Callable[["Lidar", int], Array]  # of a sweep: (lines, beams, 3) unit vectors
    elevations: Array  # (b,) degrees; of the solid-state one, only their number matters
    lines: int  # per sweep
    nearest: float  # m
    farthest: float  # m
    noise: float  # m: standard deviation of a range
    half_power: float  # m: half of the beams return from there off an upright surface of 10 %
    dropout: float  # share of returns that are lost
    divergence: float  # rad: width of a beam
    vendor: str  # row of TIME_FIELDS
    missing: str  # rows of beams without a return: MISSING


MISSING = ("left_out", "zero", "nan")


def turning(lidar: Lidar, sweep: int) -> Array:
    """Directions of a sensor that turns once a sweep, clockwise from the back: (l, b, 3)."""
    del sweep  # all are equal
    azimuth = np.pi * (1.0 - 2.0 * np.arange(lidar.lines) / lidar.lines)[:, None]
    up = np.radians(lidar.elevations)[None, :]
    parts = np.broadcast_arrays(np.cos(azimuth) * np.cos(up), np.sin(azimuth) * np.cos(up))
    return np.stack([*parts, np.broadcast_to(np.sin(up), parts[0].shape)], axis=2)


def rosette(lidar: Lidar, sweep: int) -> Array:
    """Directions of beams through two prisms, which never repeat: (l, b, 3).

    70 x 77 degrees about the forward axis. The beams are turned evenly against one another.
    """
    beams = len(lidar.elevations)
    time = (sweep + np.arange(lidar.lines) / lidar.lines)[:, None] / SWEEPS_PER_SECOND
    turn = 2.0 * np.pi * np.arange(beams) / beams
    first, second = (2.0 * np.pi * rate * time + turn for rate in ROSETTE_TURNS)
    across = np.radians(0.25 * 70.4) * (np.cos(first) + np.cos(second))
    up = np.radians(0.25 * 77.2) * (np.sin(first) + np.sin(second))
    return np.stack([np.cos(up) * np.cos(across), np.cos(up) * np.sin(across), np.sin(up)], axis=2)


LIDARS = {
    # Velodyne HDL-64E: two blocks of 32 lasers; 1.28 million beams a second.
    "hdl64e": Lidar(
        turning,
        np.concatenate([np.linspace(-24.8, -8.83, 32), np.linspace(-8.33, 2.0, 32)]),
        *(2000, 2.0, 90.0, 0.015, 75.0, 0.02, 0.002, "velodyne", "left_out"),
    ),
    # Ouster OS1-32: 327,680 beams a second.
    "wide32": Lidar(
        turning,
        np.linspace(-22.5, 22.5, 32),
        *(1024, 0.8, 90.0, 0.015, 60.0, 0.02, 0.003, "ouster", "zero"),
    ),
    # Livox Avia: 240,000 beams a second from six lasers, more of them in the middle.
    "solid_state": Lidar(
        rosette,
        np.zeros(6),
        *(4000, 1.0, 150.0, 0.02, 90.0, 0.02, 0.003, "livox", "zero"),
    ),
}


def time_column(vendor: str, stamp_ns: int, begin_ns: int, times_ns: Array) -> Array:
    """Times (n,) ns as the vendor's field; begin_ns: of the sweep."""
    kind = TIME_FIELDS[vendor][1]
    if vendor == "velodyne":
        return ((times_ns - stamp_ns) / SECOND).astype(kind)
    if vendor == "hesai":
        return (times_ns / SECOND).astype(kind)
    return (times_ns - begin_ns).astype(kind)
