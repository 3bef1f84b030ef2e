"""Transforms as an odometry: for replays, which publish no tf since tf2_msgs may be missing."""

from collections.abc import Iterable

import numpy as np

from ellipseg_ros.config import PlacementConfig
from ellipseg_ros.errors import InputError
from ellipseg_ros.poses.placer import TransformSample
from ellipseg_ros.poses.series import PoseSample, PoseSeries
from ellipseg_ros.poses.sources import new_tree
from ellipseg_ros.poses.transforms import Transform
from ellipseg_ros.poses.tree import TransformTree, composed
from ellipseg_ros.records import SECOND, Array


def read_tree(events: Iterable[object], config: PlacementConfig) -> TransformTree:
    """The tree of all transforms among the events; those that contradict it are left out."""
    tree = new_tree(config)
    for event in events:
        if isinstance(event, TransformSample):
            try:
                tree.add(event.sample, event.static)
            except InputError:
                continue  # counted where clouds are placed
    return tree


def odometry_of(tree: TransformTree, frame_id: str, config: PlacementConfig) -> list[PoseSample]:
    """Poses of a frame in `fixed_frame`, at the times of all transforms between them.

    Where stamps jump back, only those before count. Raises InputError if nothing moves between.
    """
    path = tree.path(config.fixed_frame, frame_id) or []
    links = [s.moving.poses if isinstance(s.moving, PoseSeries) else s.moving for s in path]
    moving = [poses for poses in links if not isinstance(poses, Transform)]
    if not moving or not all(map(len, moving)):
        problem = f"tf has no moving transforms between {config.fixed_frame!r} and {frame_id!r}"
        raise InputError(f"{problem}; they are needed as an odometry", "no_transform")
    rows = composed(links, [step.inverted for step in path])
    for poses in moving:
        rows = rows[~_in_gaps(rows["time_ns"], poses["time_ns"], config.max_pose_gap)]
    return [
        PoseSample(
            int(row["time_ns"]),
            config.fixed_frame,
            frame_id,
            Transform(row["position"].copy(), row["rotation"].copy()),
        )
        for row in rows
    ]


def _in_gaps(times: Array, known: Array, gap_s: float) -> Array:
    """(m,) bool: times (m,) strictly between two known ones (p,) that are too far apart."""
    after = np.clip(np.searchsorted(known, times, "left"), 1, max(len(known) - 1, 1))
    start, end = known[after - 1], known[np.minimum(after, len(known) - 1)]
    return (end - start > round(gap_s * SECOND)) & (start < times) & (times < end)
