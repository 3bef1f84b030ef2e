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
        name = text.removeprefix(SIMULATED)
        if name not in SCENES:
            raise InputError(f"there is no scene {name!r}; there are {', '.join(SCENES)}", "scene")
        drive = simulate(name, **scene)
        return Source(name, drive.frame_id, len(drive), drive.duration, drive)
    path = Path(text)
    if not path.exists():
        raise InputError(f"there is no {text}; it must be {SUPPORTED}", "missing")
    sweeps: BagSweeps | CloudSweeps
    if is_bag(path):
        sweeps = BagSweeps(path, topic)
    elif path.suffix.lower() in FORMATS and path.is_file():
        sweeps = CloudSweeps(path)
    else:
        raise InputError(f"{text} has no readable format; it must be {SUPPORTED}", "suffix")
    name = path.resolve().stem if path.is_file() else path.resolve().name
    return Source(name, sweeps.frame_id, sweeps.count, sweeps.duration, sweeps)
