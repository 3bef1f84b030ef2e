"""Settings that the drives of all scanners have in common."""

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from ellipseg_ros.records import SECOND
from ellipseg_ros.settings import Checked, setting
from ellipseg_ros.simulation import scanner
from ellipseg_ros.simulation.scenes import LAYOUTS, World, make_world

START_NS = 1_700_000_000 * SECOND  # stamp of the first sweep


@dataclass(frozen=True)
class DriveSettings(Checked):
    """A drive through a scene."""

    frame_id: ClassVar[str] = "odom"  # of the points

    name: str = setting("industrial", "kind of scene", allowed=tuple(LAYOUTS))
    seed: int = setting(0, "of the scene and its noise", "", 0, 2**32)
    duration: float = setting(25.0, "length of the drive", "s", 0.1, 3600.0)
    speed: float = setting(3.0, "speed of the vehicle", "m/s", 0.0, 30.0)
    noise: float = setting(0.015, "standard deviation of a range", "m", 0.0, 1.0)
    drift: float = setting(
        0.05, "standard deviation of the registration after 25 s", "m", 0.0, 10.0
    )
    noise_seed: int = setting(
        -1,
        "of noise and drift, for another drive in the same scene; -1: that of the scene",
        "",
        -1,
        2**32,
    )
    start: float = setting(0.0, "position on the lane where the drive begins", "m", 0.0, 10_000.0)
    aside: float = setting(0.0, "offset to the left of the lane", "m", -2.0, 2.0)
    backwards: bool = setting(False, "drive against the direction of the lane")

    @cached_property
    def _world(self) -> World:
        ahead = 0.0 if self.backwards else self._drive.speed * self.duration
        return make_world(self.name, self.start + ahead, self.seed)

    @property
    def _drive(self) -> scanner.Drive:
        return scanner.Drive(self.speed, self.start, self.aside, self.backwards)

    @cached_property
    def _drift(self) -> scanner.Drift:
        return scanner.make_drift(self.duration, self.drift, self.generator(2))

    def generator(self, *purpose: int) -> np.random.Generator:
        """A random generator for the drive, which does not affect the scene."""
        noise = () if self.noise_seed < 0 else (self.noise_seed,)
        return np.random.default_rng((self.seed, *purpose, *noise))
