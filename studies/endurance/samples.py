"""A small valid file of every kind that can be read, to be damaged."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

from ellipseg_ros.association.landmark_map import StoredMap
from ellipseg_ros.io.bag_writer import BAG_VERSION
from ellipseg_ros.io.map_file import write_map
from ellipseg_ros.io.pointcloud2 import write_sweep
from ellipseg_ros.io.topics import CLOUD
from ellipseg_ros.records import SECOND, Array, Landmarks, Sweep

POINTS = 200
SWEEPS = 3
START = 1_700_000_000  # s


def write_samples(folder: Path) -> dict[str, Path]:
    """Write one file, or folder, of each kind; returns their paths by kind."""
    paths = {}
    for name, (path, write) in WRITERS.items():
        paths[name] = folder / name / path
        paths[name].parent.mkdir(parents=True)
        write(paths[name])
    return paths


def points() -> Array:
    """(n, 3) float32 m: a wall, which gives a segment."""
    rng = np.random.default_rng(0)
    return rng.uniform((0.0, 0.0, 0.0), (2.0, 2.0, 0.02), (POINTS, 3)).astype(np.float32)


def _sweep(number: int) -> Sweep:
    return Sweep((START + number) * SECOND, points() + number, frame_id="odom")


# --- clouds ----------------------------------------------------------------------------------


def _pcd(encoding: str) -> Callable[[Path], None]:
    def write(path: Path) -> None:
        from pypcd4.pypcd4 import Encoding, PointCloud

        PointCloud.from_xyz_points(points()).save(path, encoding=Encoding(encoding))

    return write


def _ply(kind: str) -> Callable[[Path], None]:
    def write(path: Path) -> None:
        lines = ["ply", f"format {kind} 1.0", f"element vertex {POINTS}"]
        lines += [*(f"property float {name}" for name in "xyz"), "end_header", ""]
        rows = "".join(f"{x} {y} {z}\n" for x, y, z in points().tolist())
        body = rows.encode() if kind == "ascii" else points().tobytes()
        path.write_bytes("\n".join(lines).encode() + body)

    return write


def _las(path: Path) -> None:
    import laspy

    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales = [1e-3] * 3
    las = laspy.LasData(header)
    las.x, las.y, las.z = points().T
    las.write(str(path), do_compress=path.suffix == ".laz")


def _npz(path: Path) -> None:
    times = np.linspace(0.0, 3.0, POINTS)
    np.savez_compressed(path, xyz=points(), t=times, intensity=times.astype(np.float32))


# --- bags ------------------------------------------------------------------------------------


def _bag(plugin: StoragePlugin, mode: CompressionMode) -> Callable[[Path], None]:
    def write(path: Path) -> None:
        store = get_typestore(Stores.ROS2_JAZZY)
        writer = Writer2(path, version=BAG_VERSION, storage_plugin=plugin)
        if mode is not CompressionMode.NONE:
            writer.set_compression(mode, CompressionFormat.ZSTD)
        with writer:
            connection = writer.add_connection("/points", CLOUD, typestore=store)
            for number in range(SWEEPS):
                sweep = _sweep(number)
                writer.write(connection, sweep.stamp_ns, write_sweep(sweep))

    return write


def _ros1_bag(path: Path) -> None:
    old, new = get_typestore(Stores.ROS1_NOETIC), get_typestore(Stores.ROS2_JAZZY)
    with Writer1(path) as writer:
        connection = writer.add_connection("/points", CLOUD, typestore=old)
        for number in range(SWEEPS):
            sweep = _sweep(number)
            msg: Any = new.deserialize_cdr(write_sweep(sweep), CLOUD)
            header = old.types["std_msgs/msg/Header"](number, msg.header.stamp, "odom")
            message = replace(msg, header=header)
            writer.write(connection, sweep.stamp_ns, old.serialize_ros1(message, CLOUD))


# --- others ----------------------------------------------------------------------------------


def _map(path: Path) -> None:
    n = 20
    covariance = np.zeros((n, 6, 6))
    covariance[:, :3, :3] = 1e-4 * np.eye(3)
    landmarks = Landmarks(
        ids=np.arange(1, n + 1, dtype=np.uint32),
        kind=np.full(n, 2, np.uint8),
        count=np.full(n, 50),
        position=points()[:n].astype(np.float64),
        axes=np.tile(np.eye(3), (n, 1, 1)),
        sigma=np.ones((n, 3)),
        box_min=-np.ones((n, 3)),
        box_max=np.ones((n, 3)),
        covariance=covariance,
        instability=np.zeros(n),
        first_seen_ns=np.zeros(n, np.int64),
    )
    write_map(path, StoredMap(landmarks, np.zeros(n, np.int64), "odom", n + 1))


def _parameters(path: Path) -> None:
    path.write_text(
        "/**:\n  ros__parameters:\n    criterion: shape\n    threshold: 4.0\n"
        "    window_duration: 25.0\n    graph:\n      neighbours: 10\n    max_points: 1000000\n",
        encoding="utf-8",
    )


NONE, FILE, MESSAGE = CompressionMode.NONE, CompressionMode.STORAGE, CompressionMode.MESSAGE
WRITERS: dict[str, tuple[str, Callable[[Path], None]]] = {
    "pcd ascii": ("cloud.pcd", _pcd("ascii")),
    "pcd binary": ("cloud.pcd", _pcd("binary")),
    "pcd compressed": ("cloud.pcd", _pcd("binary_compressed")),
    "ply ascii": ("cloud.ply", _ply("ascii")),
    "ply binary": ("cloud.ply", _ply("binary_little_endian")),
    "las": ("cloud.las", _las),
    "laz": ("cloud.laz", _las),
    "npz": ("cloud.npz", _npz),
    "mcap": ("bag", _bag(StoragePlugin.MCAP, NONE)),
    "mcap zstd": ("bag", _bag(StoragePlugin.MCAP, FILE)),
    "sqlite3": ("bag", _bag(StoragePlugin.SQLITE3, NONE)),
    "sqlite3 zstd": ("bag", _bag(StoragePlugin.SQLITE3, MESSAGE)),
    "ROS 1": ("cloud.bag", _ros1_bag),
    "map": ("map.npz", _map),
    "parameters": ("parameters.yaml", _parameters),
}
