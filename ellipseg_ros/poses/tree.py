"""A buffer of coordinate transforms (tf): a tree of frames, static and in time.

Not tf2's own buffer: tf2_msgs and tf2_ros are not on PyPI, bags are read without ROS, and a
lookup here waits for later messages instead of a clock.
"""

from typing import NamedTuple

import numpy as np

from ellipseg_ros.errors import InputError
from ellipseg_ros.poses.interpolation import interpolated
from ellipseg_ros.poses.series import POSE, PoseSample, PoseSeries
from ellipseg_ros.poses.transforms import IDENTITY, Transform, compose, inverse
from ellipseg_ros.records import Array

MAX_FRAMES = 1000


class Link(NamedTuple):
    """The transform of a frame in its parent: static, or a series in time."""

    parent: str
    moving: PoseSeries | Transform


class Step(NamedTuple):
    """A link on a path between two frames, walked in either direction."""

    moving: PoseSeries | Transform
    inverted: bool  # from the parent to the child


class TransformTree:
    """Transforms by child frame; jump_m and max_gap_ns as in PoseSeries."""

    def __init__(self, jump_m: float, max_gap_ns: int) -> None:
        self._links: dict[str, Link] = {}
        self._jump_m = jump_m
        self._max_gap_ns = max_gap_ns

    def add(self, sample: PoseSample, static: bool) -> None:
        """Take a transform; InputError if it contradicts the tree or the order of time.

        A static transform that comes again is ignored.
        """
        parent, child = (name.lstrip("/") for name in (sample.frame_id, sample.child_frame_id))
        link = self._links.get(child)
        if link is None:
            link = self._new_link(parent, child, sample.pose if static else None)
        if link.parent != parent:
            problem = f"frame {child!r} has two parents, {link.parent!r} and {parent!r}"
            raise InputError(f"{problem}; tf must be a tree", "tf_parents")
        if isinstance(link.moving, PoseSeries) == static:
            problem = f"frame {child!r} is both on /tf and, as static, on /tf_static"
            raise InputError(f"{problem}; it must be on one of them", "tf_static")
        if isinstance(link.moving, PoseSeries):
            link.moving.add(sample.time_ns, sample.pose)

    def _new_link(self, parent: str, child: str, fixed: Transform | None) -> Link:
        if not parent or not child:
            raise InputError("a transform has an empty frame; both must be named", "tf_frame")
        if len(self._links) == MAX_FRAMES:
            raise InputError(f"tf has more than {MAX_FRAMES} frames, the maximum", "tf_frames")
        if child in (parent, *self._ancestors(parent)):
            problem = f"tf has a cycle through {child!r} and {parent!r}"
            raise InputError(f"{problem}; it must be a tree", "tf_cycle")
        moving = PoseSeries(self._jump_m, self._max_gap_ns) if fixed is None else fixed
        return self._links.setdefault(child, Link(parent, moving))

    def static_part(self) -> "TransformTree":
        """A tree with the static transforms of this one."""
        tree = TransformTree(self._jump_m, self._max_gap_ns)
        for child, link in self._links.items():
            if isinstance(link.moving, Transform):
                tree._links[child] = link
        return tree

    def path(self, target: str, source: str) -> list[Step] | None:
        """The links from the target frame to the source frame; None: not connected so far."""
        target, source = target.lstrip("/"), source.lstrip("/")
        up = [target, *self._ancestors(target)]
        down = [source, *self._ancestors(source)]
        common = next((name for name in down if name in up), None)
        if common is None:
            return None
        climb = [Step(self._links[name].moving, True) for name in up[: up.index(common)]]
        descent = [Step(self._links[name].moving, False) for name in down[: down.index(common)]]
        return climb + descent[::-1]

    def root(self, frame: str) -> str:
        """The topmost frame above `frame`, or the frame itself."""
        return [frame.lstrip("/"), *self._ancestors(frame.lstrip("/"))][-1]

    def frames_above(self, frame: str) -> list[str]:
        """The frame and its ancestors, upwards."""
        return [frame.lstrip("/"), *self._ancestors(frame.lstrip("/"))]

    def _ancestors(self, frame: str) -> list[str]:
        names = []
        while frame in self._links:
            frame = self._links[frame].parent
            names.append(frame)
        return names


def static_transform(path: list[Step]) -> Transform | None:
    """The transform along a path of static links; None if a link moves."""
    total = IDENTITY
    for step in path:
        if isinstance(step.moving, PoseSeries):
            return None
        total = compose(total, inverse(step.moving) if step.inverted else step.moving)
    return total


def composed(stretches: list[Array | Transform], inverted: list[bool]) -> Array:
    """Poses along a path: (p,) of POSE, at the times of all samples within all stretches.

    stretches: of each link its poses (p,) of POSE, or its static transform. Between two of the
    times all links are interpolated together.
    """
    moving = [poses for poses in stretches if not isinstance(poses, Transform)]
    begin = max(int(poses["time_ns"][0]) for poses in moving)
    end = min(int(poses["time_ns"][-1]) for poses in moving)
    times = np.unique(np.concatenate([poses["time_ns"] for poses in moving]))
    times = times[(times >= begin) & (times <= end)]
    sampled = [p if isinstance(p, Transform) else interpolated(p, times) for p in stretches]
    result = np.zeros(len(times), POSE)
    result["time_ns"] = times
    result["run"] = sum(poses["run"][0] for poses in moving)
    for row in range(len(times)):
        total = IDENTITY
        for poses, backward in zip(sampled, inverted, strict=True):
            pose = poses
            if not isinstance(poses, Transform):
                pose = Transform(poses["position"][row], poses["rotation"][row])
            total = compose(total, inverse(pose) if backward else pose)
        result["position"][row], result["rotation"][row] = total
    return result
