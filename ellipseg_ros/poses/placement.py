"""Placement: clouds in the sensor's frame wait for their poses, and move to the fixed frame.

The result depends on the clouds and on the poses, each in their own order, not on how the two
are interleaved, as long as neither is more than MAX_WAIT_NS behind.
"""

import math
from collections import deque
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ellipseg_ros.config import PlacementConfig
from ellipseg_ros.errors import InputError
from ellipseg_ros.poses.filters import filtered
from ellipseg_ros.poses.interpolation import place
from ellipseg_ros.poses.point_times import PointTimes, TimeField, no_times, point_times
from ellipseg_ros.poses.series import MAX_BACK_NS, MAX_WAIT_NS
from ellipseg_ros.poses.sources import PoseSource, Query, Track, Waiting
from ellipseg_ros.poses.transforms import IDENTITY
from ellipseg_ros.records import SECOND, Array, Sweep

MAX_WAITING_POINTS = 20_000_000  # of all clouds that wait
MAX_WAITING_CLOUDS = 10_000


class Unplaced(NamedTuple):
    """A cloud that could not be placed."""

    points: int
    reason: str  # a short key to count by
    text: str  # one line


@dataclass
class _Cloud:
    """A cloud in the queue."""

    sweep: Sweep
    epoch: int
    progress_ns: int  # of the stamps, at its arrival
    times: PointTimes | None = None


class Placement:
    """Places clouds by poses, in the order in which they came.

    Every cloud comes out as a placed Sweep, or as Unplaced: never by a default pose. A placed
    sweep carries ranges, and the numbers of points that were filtered or came before it unplaced.
    """

    def __init__(self, config: PlacementConfig, source: PoseSource) -> None:
        self._config = config
        self._source = source
        self._box = np.array(config.self_box)
        self._limits = (config.min_range, config.max_range or math.inf)
        self._waiting: deque[_Cloud] = deque()
        self._waiting_points = 0
        self._newest_ns: int | None = None
        self._progress_ns = 0
        self._epoch = 0
        self._run: int | None = None  # number of jumps of the poses before the last placed cloud
        self._unplaced = 0  # points since the last placed cloud
        self.understood: dict[str, str] = {}  # how the last cloud was read
        self.waiting_for: Waiting | None = None  # what the first cloud lacks; None: none waits

    def add(self, cloud: Sweep) -> list[Sweep | Unplaced]:
        """Take a cloud in its sensor's frame; returns all clouds that are decided now."""
        newest, stamp = self._newest_ns, cloud.stamp_ns
        if newest is not None and stamp < newest - MAX_BACK_NS:
            self._epoch += 1
            self._newest_ns = stamp
        else:
            self._progress_ns += max(0, stamp - newest) if newest is not None else 0
            self._newest_ns = stamp if newest is None else max(newest, stamp)
        self._waiting.append(_Cloud(cloud, self._epoch, self._progress_ns))
        self._waiting_points += len(cloud)
        return self.take()

    def take(self) -> list[Sweep | Unplaced]:
        """The clouds that are decided now; to be called after poses have arrived."""
        return self._decide_all(at_end=False)

    def flush(self) -> list[Sweep | Unplaced]:
        """Decide all clouds that still wait, at the end of the input."""
        return self._decide_all(at_end=True)

    @property
    def waiting(self) -> int:
        """Number of clouds that wait for poses."""
        return len(self._waiting)

    @property
    def jumps(self) -> int:
        """Number of jumps of the poses up to the last placed cloud."""
        return self._run or 0

    def lag_s(self) -> float | None:
        """Time from the newest pose to the newest cloud, s; None if one is missing."""
        if self._newest_ns is None or not self.understood:
            return None
        newest = self._source.newest_ns(self.understood["cloud frame"])
        return None if newest is None else (self._newest_ns - newest) / SECOND

    def _decide_all(self, at_end: bool) -> list[Sweep | Unplaced]:
        decided: list[Sweep | Unplaced] = []
        self.waiting_for = None
        while self._waiting:
            outcome = self._decide(self._waiting[0])
            if isinstance(outcome, Waiting):
                overdue = self._is_overdue(self._waiting[0])
                if not (overdue or at_end):
                    self.waiting_for = outcome
                    break
                if overdue:
                    self._give_up_epoch()
                outcome = self._lost(outcome.reason, outcome.text)
            decided.append(self._leave(outcome))
        return decided

    def _leave(self, outcome: Sweep | Unplaced) -> Sweep | Unplaced:
        self._waiting_points -= len(self._waiting.popleft().sweep)
        return outcome

    def _is_overdue(self, cloud: _Cloud) -> bool:
        waited_ns = self._progress_ns - cloud.progress_ns
        too_many = len(self._waiting) > MAX_WAITING_CLOUDS
        return too_many or waited_ns > MAX_WAIT_NS or self._waiting_points > MAX_WAITING_POINTS

    def _give_up_epoch(self) -> None:
        """Follow the poses, if the stamps of the clouds alone have jumped back."""
        frame_id = self._waiting[0].sweep.frame_id
        self._epoch = min(self._epoch, self._source.last_epoch(frame_id))
        for cloud in self._waiting:
            cloud.epoch = min(cloud.epoch, self._epoch)

    def _decide(self, cloud: _Cloud) -> Sweep | Unplaced | Waiting:
        sweep = cloud.sweep
        try:
            if cloud.times is None:
                cloud.times = self._point_times(sweep)
            shift_ns = round(self._config.odometry_offset * SECOND)
            begin_ns, end_ns = _span(sweep, cloud.times)
            if self._config.odometry_stamp == "scan_begin" and cloud.times.meaning:
                shift_ns += end_ns - sweep.stamp_ns
            track = self._source.track(
                Query(sweep.frame_id, cloud.epoch, begin_ns - shift_ns, end_ns - shift_ns)
            )
            if isinstance(track, Waiting):
                return track
            return self._place(sweep, cloud.times, track, shift_ns)
        except InputError as error:
            return self._lost(error.reason, str(error))

    def _point_times(self, sweep: Sweep) -> PointTimes:
        """Times of the points for deskewing; without a meaning where the cloud is not deskewed."""
        config = self._config
        chosen = TimeField(config.time_field, config.time_unit.replace("auto", ""))
        if sweep.fields is None or config.deskew == "off":
            times = no_times(len(sweep))
        else:
            times = point_times(sweep.fields, sweep.stamp_ns, chosen)
            offsets = times.offsets_ns[times.valid]
            if not len(offsets) or offsets.min() == offsets.max():
                times = no_times(len(sweep))
        if config.deskew == "on" and not times.meaning:
            problem = "a cloud has no times of points, or all are equal"
            raise InputError(f"{problem}; deskew is on and needs them", "no_point_times")
        self.understood = {
            "cloud frame": sweep.frame_id,
            "point times": times.meaning or "none",
            "deskew": "yes" if times.meaning else "no",
        }
        return times

    def _place(self, sweep: Sweep, times: PointTimes, track: Track, shift_ns: int) -> Sweep:
        times_ns = sweep.stamp_ns + times.offsets_ns - shift_ns
        if track.registered:
            placed = sweep.points
            ranges = _ranges_from(placed, times_ns, track)
            keep = np.ones(len(sweep), bool)
        else:
            ranges, keep = filtered(sweep.points, self._limits, self._box)
            timed = np.where(times.valid[:, None], sweep.points, np.nan)
            placed = place(timed, times_ns, track.poses, track.extrinsic)
        self.understood["fixed frame"] = track.frame_id
        self.understood["registered"] = "yes" if track.registered else "no"
        result = replace(
            sweep,
            points=placed,
            offsets_ns=sweep.offsets_ns if not times.meaning else times.offsets_ns,
            fields=_without_xyz(sweep.fields) if not track.registered else sweep.fields,
            frame_id=track.frame_id,
            restart=sweep.restart or self._restart(track),
            ranges=ranges,
        )
        kept = result if keep.all() else result.keep(keep)
        unplaced, self._unplaced = self._unplaced, 0
        return replace(kept, filtered=len(sweep) - len(kept), unplaced=unplaced)

    def _restart(self, track: Track) -> str:
        """Why the window must restart: the poses jumped since the last placed cloud."""
        if not len(track.poses):
            return ""
        before, self._run = self._run, int(track.poses["run"][0])
        return "" if before in (None, self._run) else "the poses jumped"

    def _lost(self, reason: str, text: str) -> Unplaced:
        points = len(self._waiting[0].sweep)
        self._unplaced += points
        return Unplaced(points, reason, text)


def _span(sweep: Sweep, times: PointTimes) -> tuple[int, int]:
    """First and last time of the points, ns; the stamp where they have none."""
    offsets = times.offsets_ns[times.valid]
    if not times.meaning or not len(offsets):
        return sweep.stamp_ns, sweep.stamp_ns
    return sweep.stamp_ns + int(offsets.min()), sweep.stamp_ns + int(offsets.max())


def _without_xyz(fields: Array | None) -> Array | None:
    """The fields but for the coordinates, which were those of the sensor's frame."""
    if fields is None:
        return None
    names = [name for name in fields.dtype.names or () if name not in ("x", "y", "z")]
    return fields[names] if names else None


def _ranges_from(points: Array, times_ns: Array, track: Track) -> Array | None:
    """Distances from the sensor of registered points (n, 3): (n,) m; None: not known."""
    if not len(track.poses):
        return None
    positions = place(np.zeros_like(points), times_ns, track.poses, IDENTITY)
    return np.asarray(np.linalg.norm(points - positions, axis=1))
