"""Sources of sweeps: bags, cloud files and simulated scenes."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ellipseg_ros.errors import InputError
from ellipseg_ros.io.bag import SUFFIXES, BagSweeps, is_bag
from ellipseg_ros.io.cloud_file import CloudSweeps
from ellipseg_ros.io.formats import FORMATS
from ellipseg_ros.records import Sweep
from ellipseg_ros.simulation.simulator import SCENES, simulate

SIMULATED = "sim:"
SUPPORTED = (
    f"a bag ({', '.join(SUFFIXES)} or a folder of `ros2 bag record`), "
    f"a cloud ({', '.join(FORMATS)}), or {SIMULATED} and one of {', '.join(SCENES)}"
)


@dataclass(frozen=True)
class Source:
    """A source of sweeps, which may be iterated several times."""

    name: str  # short, usable in file names
    frame_id: str  # of the first sweep
    count: int | None  # sweeps, if known
    duration: float | None  # s of sensor time, if known
    sweeps: Iterable[Sweep]

    def __iter__(self) -> Iterator[Sweep]:
        return iter(self.sweeps)


def open_source(spec: str | Path, topic: str = "", **scene: Any) -> Source:
    """Open a bag, a cloud file or a simulated scene.

    spec: a path, or "sim:industrial" and the like.
    topic: of the clouds, if a bag has several.
    scene: settings of a simulated scene, fields of simulator.Scene: seed, duration, ...
    Raises InputError, in one line, if the source can't be read, ConfigError for a wrong setting.
    """
    text = str(spec)
    if text.startswith(SIMULATED):
        return _simulated(text.removeprefix(SIMULATED), scene)
    path = Path(text)
    if not path.exists():
        raise InputError(f"there is no {text}; it must be {SUPPORTED}", "missing")
    if is_bag(path):
        bag = BagSweeps(path, topic)
        return Source(_name(path), bag.frame_id, bag.count, bag.duration, bag)
    if path.suffix.lower() in FORMATS and path.is_file():
        cloud = CloudSweeps(path)
        return Source(_name(path), cloud.frame_id, cloud.count, cloud.duration, cloud)
    raise InputError(f"{text} has no readable format; it must be {SUPPORTED}", "suffix")


def _simulated(name: str, settings: dict[str, Any]) -> Source:
    if name not in SCENES:
        raise InputError(f"there is no scene {name!r}; there are {', '.join(SCENES)}", "scene")
    scene = simulate(name, **settings)
    return Source(name, scene.frame_id, len(scene), scene.duration, scene)


def _name(path: Path) -> str:
    return path.resolve().stem if path.is_file() else path.resolve().name
