"""Poses of one frame in another, in time: accepted samples, jumps, and stretches of them."""

from bisect import bisect_left, bisect_right
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from ellipseg_ros.core.column import Column
from ellipseg_ros.errors import InputError
from ellipseg_ros.poses.transforms import Transform
from ellipseg_ros.records import SECOND, Array

# run: number of jumps before the pose, so that poses of different runs are not interpolated.
POSE = np.dtype(
    [("time_ns", "i8"), ("position", "f8", (3,)), ("rotation", "f8", (4,)), ("run", "i4")]
)
MAX_BACK_NS = SECOND  # a stamp farther behind the newest starts a new epoch: a looping bag
MAX_WAIT_NS = 5 * SECOND  # of stamps, that a cloud waits for later poses
MIN_CLOCK_OFFSET_S = 1000.0  # between stamps of different clocks
MAX_EPOCHS = 8  # that are kept
MAX_POSES = 100_000  # that are kept of an epoch: 8 minutes at 200 Hz
# Motion that a vehicle can make on top of a constant velocity; more is a jump.
MAX_ACCELERATION = 10.0  # m/s^2: twice that of an emergency stop
MAX_ANGULAR_ACCELERATION = 10.0  # rad/s^2
JUMP_ANGLE = np.radians(20.0)


class PoseSample(NamedTuple):
    """One message of an odometry or of tf."""

    time_ns: int
    frame_id: str
    child_frame_id: str
    pose: Transform  # p_frame = pose p_child


class PoseSeries:
    """Samples of one transform in time.

    An epoch ends where stamps jump back. jump_m: least deviation of a pose from a motion of
    constant velocity that is a jump, m, 0: never.
    """

    def __init__(self, jump_m: float, max_gap_ns: int) -> None:
        self._jump_m = jump_m
        self._max_gap_ns = max_gap_ns
        self._epochs = [Column(np.zeros(0, POSE))]
        self._first_epoch = 0  # number of _epochs[0]
        self.jump = ""  # description of the last jump
        self.jumps = 0

    @property
    def last_epoch(self) -> int:
        """Number of the present epoch, from 0."""
        return self._first_epoch + len(self._epochs) - 1

    @property
    def newest_ns(self) -> int | None:
        """Time of the newest pose of the present epoch."""
        poses = self._epochs[-1].values
        return int(poses["time_ns"][-1]) if len(poses) else None

    @property
    def poses(self) -> Array:
        """Poses (p,) of POSE of the first epoch that is kept."""
        return self._epochs[0].values

    def add(self, time_ns: int, pose: Transform) -> None:
        """Append a pose; InputError if it is not newer than the last one."""
        newest = self.newest_ns
        if newest is not None and time_ns <= newest:
            behind = newest - time_ns
            if behind <= MAX_BACK_NS:
                problem = f"a pose is {behind / SECOND:.3f} s older than the one before"
                if not behind:
                    problem = "two poses have the same stamp"
                raise InputError(f"{problem}; poses must come in the order of time", "pose_order")
            self._epochs.append(Column(np.zeros(0, POSE)))
            if len(self._epochs) > MAX_EPOCHS:
                del self._epochs[0]
                self._first_epoch += 1
        column = self._epochs[-1]
        run = self._run(column.values, time_ns, pose)
        column.append(np.array([(time_ns, pose.position, pose.rotation, run)], POSE))
        if len(column.values) > MAX_POSES:
            column.drop(np.arange(len(column.values)) < MAX_POSES // 10)

    def stretch(self, epoch: int, begin_ns: int, end_ns: int) -> Array | None:
        """Poses (p,) of POSE from the last one at or before the begin to the first at the end.

        epoch: of the clouds. None: a later pose may complete it. Raises InputError if none can.
        """
        while epoch < self.last_epoch and self._is_over(epoch, begin_ns):
            epoch += 1
        if epoch > self.last_epoch:
            return None
        poses = self._epochs[max(0, epoch - self._first_epoch)].values
        if not len(poses):
            return None
        times = poses["time_ns"]
        if begin_ns < times[0]:
            early = (int(times[0]) - begin_ns) / SECOND
            text = f"a cloud is {early:.3f} s older than the first pose{other_clock(early)}"
            raise InputError(text, "before_poses")
        if end_ns > times[-1]:
            if epoch == self.last_epoch:
                return None
            raise InputError("the stamps of the poses jumped back before this cloud", "poses_back")
        first = int(np.searchsorted(times, begin_ns, "right")) - 1
        last = int(np.searchsorted(times, end_ns, "left"))
        return self._checked(poses[first : last + 1])

    def _checked(self, poses: Array) -> Array:
        gap = int(np.diff(poses["time_ns"]).max(initial=0))
        if gap > self._max_gap_ns:
            problem = f"there is no pose for {gap / SECOND:.3f} s"
            limit = f"at most {self._max_gap_ns / SECOND:g} s are interpolated"
            raise InputError(f"{problem}; {limit} (max_pose_gap)", "pose_gap")
        if poses["run"][0] != poses["run"][-1]:
            raise InputError("the poses jump within a cloud; they must be continuous", "pose_jump")
        return poses

    def _is_over(self, epoch: int, begin_ns: int) -> bool:
        poses = self._epochs[max(0, epoch - self._first_epoch)].values
        return not len(poses) or begin_ns > int(poses["time_ns"][-1]) + MAX_WAIT_NS

    def _run(self, poses: Array, time_ns: int, pose: Transform) -> int:
        """Number of jumps up to the new pose."""
        first = _velocity_start(poses, time_ns) if len(poses) else 0
        if not self._jump_m or first >= len(poses) - 1:
            return self.jumps
        found = _deviation(poses[[first, -1]], time_ns, pose)
        if found.moved > found.scale * self._jump_m + MAX_ACCELERATION * found.slack or (
            found.turned > found.scale * JUMP_ANGLE + MAX_ANGULAR_ACCELERATION * found.slack
        ):
            self.jumps += 1
            angle = np.degrees(found.turned)
            self.jump = f"the poses jumped by {found.moved:.2f} m and {angle:.1f} deg"
        return self.jumps


class _Deviation(NamedTuple):
    """Deviation of a pose from a motion of constant velocity."""

    moved: float  # m
    turned: float  # rad
    slack: float  # s^2, the deviation per acceleration
    scale: float  # by which errors of the poses before are multiplied, at least 1


def other_clock(seconds: float) -> str:
    """Advice, if a cloud and the poses are too far apart to be of one clock."""
    if seconds < MIN_CLOCK_OFFSET_S:
        return ""
    return ": of another clock? Clouds and poses must be stamped by one"


def _velocity_start(poses: Array, time_ns: int) -> int:
    """Row of the pose of the last one's run from which the velocity up to the last one is taken.

    The latest that is at least as long before the last one as time_ns is after it, so that errors
    of the poses are not multiplied; the first of the run, if there is no such pose.
    """
    times, runs = poses["time_ns"], poses["run"]
    newest = int(times[-1])
    first = bisect_left(runs, runs[-1])
    return max(first, bisect_right(times, newest - (time_ns - newest), first) - 1)


def _deviation(last: Array, time_ns: int, pose: Transform) -> _Deviation:
    """Deviation of a pose from the velocity between two poses before, last (2,) of POSE."""
    before = (int(last["time_ns"][1]) - int(last["time_ns"][0])) / SECOND
    after = (time_ns - int(last["time_ns"][1])) / SECOND
    share = after / before
    position = last["position"]
    predicted = position[1] + share * (position[1] - position[0])
    turns = Rotation.from_quat(last["rotation"])
    step = (turns[0].inv() * turns[1]).as_rotvec() * share
    expected = turns[1] * Rotation.from_rotvec(step)
    turned = (expected.inv() * Rotation.from_quat(pose.rotation)).magnitude()
    moved = np.linalg.norm(pose.position - predicted)
    slack = 0.5 * after * (after + before)
    return _Deviation(float(moved), float(turned), slack, max(1.0, share))
