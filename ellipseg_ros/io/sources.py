"""Sources of clouds: bags, cloud files and simulated scenes; with poses beside raw clouds."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from ellipseg_ros.config import PlacementConfig
from ellipseg_ros.errors import InputError
from ellipseg_ros.io.bag import SUFFIXES, BagSweeps, is_bag
from ellipseg_ros.io.cloud_file import CloudSweeps
from ellipseg_ros.io.formats import FORMATS
from ellipseg_ros.io.pose_choice import (
    Clouds,
    OnlyClouds,
    Poses,
    choose_poses,
    without_transforms,
)
from ellipseg_ros.io.raw_drive import RawDrive, is_raw_drive
from ellipseg_ros.poses.placement import Unplaced
from ellipseg_ros.poses.placer import Event, Placer, RefusedPose, outcomes
from ellipseg_ros.records import Sweep
from ellipseg_ros.simulation.scenes import LAYOUTS
from ellipseg_ros.simulation.simulator import simulate

SIMULATED = "sim:"
SUPPORTED = (
    f"a bag ({', '.join(SUFFIXES)} or a folder of `ros2 bag record`), "
    f"a cloud ({', '.join(FORMATS)}), or {SIMULATED} and one of {', '.join(LAYOUTS)}"
)


@dataclass(frozen=True)
class Source:
    """A source of sweeps in a fixed frame, which may be iterated several times."""

    name: str  # short, usable in file names
    frame_id: str  # of the first cloud, or the fixed frame where clouds are placed by poses
    count: int | None  # clouds, if known
    duration: float | None  # s of sensor time, if known
    events: Iterable[Event]  # clouds as they are stored, and poses, in the order of arrival
    placement: PlacementConfig = PlacementConfig(pose_source="registered")  # how they are placed
    about_poses: str = ""  # where the poses come from, in words; empty: the clouds are registered
    problems: dict[str, str] = field(default_factory=dict)  # text by reason, of the last iteration

    def __iter__(self) -> Iterator[Sweep]:
        """Yield the placed sweeps; `problems` then names what could not be used, and why."""
        self.problems.clear()
        for outcome in outcomes(self.events, Placer(self.placement)):
            if isinstance(outcome, Unplaced | RefusedPose):
                self.problems.setdefault(outcome.reason, outcome.text)
            else:
                yield outcome


def open_source(
    spec: str | Path,
    topic: str = "",
    odometry: str = "",
    placement: PlacementConfig | None = None,
    **scene: Any,
) -> Source:
    """Open a bag, a cloud file or a simulated scene.

    spec: a path, or "sim:industrial" and the like.
    topic: of the clouds, if a bag has several.
    odometry: where poses of raw clouds come from: a topic, "/tf", a file in the form of TUM or
        KITTI, "kiss-icp", or "registered" for clouds that need none. Empty: decided by the
        settings, and by what the bag holds.
    scene: settings of a simulated scene, lidar, seed, duration, ... of simulate
    Raises InputError, in one line, if the source can't be read, ConfigError for a wrong setting.
    """
    text = str(spec)
    if text.startswith(SIMULATED):
        return _scene(text.removeprefix(SIMULATED), scene)
    path = Path(text)
    if not path.exists():
        raise InputError(f"there is no {text}; it must be {SUPPORTED}", "missing")
    clouds: Clouds
    if is_bag(path):
        clouds = BagSweeps(path, topic)
    elif path.suffix == ".npz" and is_raw_drive(path):
        clouds = RawDrive(path)
    elif path.suffix.lower() in FORMATS and path.is_file():
        clouds = CloudSweeps(path)
    else:
        raise InputError(f"{text} has no readable format; it must be {SUPPORTED}", "suffix")
    name = path.resolve().stem if path.is_file() else path.resolve().name
    poses = choose_poses(clouds, odometry, placement or PlacementConfig())
    return _source(name, clouds, poses)


def as_odometry(source: Source) -> Source:
    """The source with its poses as an odometry alone, as a replayer publishes them."""
    frame_id = next((cloud.frame_id for cloud in OnlyClouds(source.events)), "")
    poses = without_transforms(Poses(source.events, source.placement), frame_id)
    return replace(source, events=poses.events, placement=poses.placement)


def _source(name: str, clouds: Clouds, poses: Poses) -> Source:
    frame_id = poses.frame_id or clouds.frame_id
    source = Source(name, frame_id, clouds.count, clouds.duration, poses.events)
    return replace(source, placement=poses.placement, about_poses=poses.about)


def _scene(name: str, scene: dict[str, Any]) -> Source:
    if name not in LAYOUTS:
        raise InputError(f"there is no scene {name!r}; there are {', '.join(LAYOUTS)}", "scene")
    drive = simulate(name, **scene)
    return Source(name, drive.frame_id, len(drive), drive.duration, drive)
