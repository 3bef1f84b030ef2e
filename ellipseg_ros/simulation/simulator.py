"""Simulated drives: a rotating scanner on a vehicle, in scenes with ground truth."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from ellipseg_ros.records import SECOND, Array, Sweep
from ellipseg_ros.settings import setting
from ellipseg_ros.simulation import rays, scanner
from ellipseg_ros.simulation.drive import START_NS, DriveSettings
from ellipseg_ros.simulation.lidar_drive import LidarDrive
from ellipseg_ros.simulation.scanner import ANGLES, LINES_PER_SECOND, SICK, SWEEPS_PER_SECOND
from ellipseg_ros.simulation.scenes import LAYOUTS
from ellipseg_ros.simulation.shapes import Class

SCENES = tuple(name for name, layout in LAYOUTS.items() if layout.lidar == SICK)
BLOCK = LINES_PER_SECOND  # lines cast in one call and with one random generator: a second
FIELDS = np.dtype(
    [
        *((name, np.float32) for name in "xyz"),
        ("intensity", np.float32),  # 0 to 100
        ("t", np.uint32),  # ns from the stamp
        ("class", np.uint8),  # see Class
        ("instance", np.uint32),  # number of the item; 0: the ground
    ]
)


@dataclass(frozen=True)
class Scene(DriveSettings):
    """A drive through a scene: an iterable of sweeps of 0.1 s, identical in every iteration.

    `fields` of a sweep has the layout FIELDS. A tree is one instance: its wood is of class POLE,
    its leaves are VEGETATION. Points are registered like those of a SLAM front end: in their true
    positions but for noise and drift.
    """

    name: str = setting("industrial", "kind of scene", allowed=SCENES)

    def __len__(self) -> int:
        return (self._lines - 1) * SWEEPS_PER_SECOND // LINES_PER_SECOND + 1

    def __iter__(self) -> Iterator[Sweep]:
        for start in range(0, self._lines, BLOCK):
            yield from self._block(np.arange(start, min(start + BLOCK, self._lines)))

    @property
    def _lines(self) -> int:
        return max(1, round(self.duration * LINES_PER_SECOND))

    def _block(self, numbers: Array) -> Iterator[Sweep]:
        """Yield the sweeps of the scan lines `numbers`."""
        returns, line = self._scan(numbers, self.generator(3, int(numbers[0])))
        sweep = numbers * SWEEPS_PER_SECOND // LINES_PER_SECOND
        stamps_ns = sweep * SECOND // SWEEPS_PER_SECOND
        returns["t"] = (numbers * SECOND // LINES_PER_SECOND - stamps_ns)[line]
        for stamp_ns in np.unique(stamps_ns):
            fields = returns[stamps_ns[line] == stamp_ns]
            points = np.column_stack([fields[name] for name in "xyz"]).astype(np.float64)
            offsets_ns = fields["t"].astype(np.int64)
            yield Sweep(START_NS + int(stamp_ns), points, offsets_ns, fields, self.frame_id)

    def _scan(self, numbers: Array, rng: np.random.Generator) -> tuple[Array, Array]:
        """The returns of the scan lines `numbers`, with noise and drift, in order of the beams.

        Returns (n,) of FIELDS, with `t` still 0, and (n,) the row of `numbers` of each.
        """
        times = numbers / LINES_PER_SECOND
        world = self._world
        lines = scanner.scan_lines(world.path, times, self._drive)
        middle = 0.5 * (lines.origin[0] + lines.origin[-1])
        travel = float(np.linalg.norm(lines.origin[-1] - middle))
        shapes = world.shapes.near(middle, scanner.FARTHEST + travel)
        uniform = rng.random((2, len(numbers), len(ANGLES)))
        noise = rng.standard_normal(uniform.shape)
        ends = rays.cast(lines, ANGLES, uniform[0], shapes, world.path.terrain)

        reflectivity = np.append(shapes.reflectivity, [world.soil, 0.0])[ends.body]
        probability = scanner.return_probability(ends.distance, ends.cosine, reflectivity)
        line, beam = at = np.nonzero(uniform[1] < probability)
        distance = ends.distance[at] + self.noise * noise[0][at]
        true = lines.origin[line] + distance[:, None] * scanner.directions(lines, line, beam)
        points = self._drift.apply(times[line], true, lines.origin[line])

        fields = np.zeros(len(points), FIELDS)
        for name, column in zip("xyz", points.T, strict=True):
            fields[name] = column
        intensity = 100.0 * reflectivity[at] * np.sqrt(ends.cosine[at]) + 2.0 * noise[1][at]
        fields["intensity"] = np.clip(intensity, 0.0, 100.0)
        fields["class"] = np.append(shapes.kind, [Class.GROUND, Class.UNKNOWN])[ends.body[at]]
        fields["instance"] = np.append(shapes.instance, [0, 0])[ends.body[at]]
        return fields, line


def simulate(scene: str, lidar: str = "", **settings: Any) -> Scene | LidarDrive:
    """A drive through a scene; lidar: SICK or one of LIDARS, empty: the usual one of the scene.

    settings: fields of Scene or LidarDrive, such as `seed` and `duration`.
    Raises ConfigError for an unknown scene or lidar or a setting out of range.
    """
    if not lidar and scene in LAYOUTS:
        lidar = LAYOUTS[scene].lidar
    if lidar in ("", SICK):
        return Scene(scene, **settings)
    return LidarDrive(scene, lidar=lidar, **settings)
