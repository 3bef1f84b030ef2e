"""A drive without an end: a simulated lap repeated in ever new places."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np

from ellipseg_ros.records import SECOND, Array, Sweep
from ellipseg_ros.simulation.scanner import SWEEPS_PER_SECOND
from ellipseg_ros.simulation.simulator import simulate

NOISE = 0.01  # m: standard deviation of the noise that differs from lap to lap


@dataclass(frozen=True)
class EndlessDrive:
    """Laps of a simulated street, joined end to end, each with new noise; deterministic.

    rate: points/s, for which points of each sweep are repeated or dropped at random, with
    independent noise, as if several scanners measured them; 0: those of the simulated scanner.
    """

    lap_s: float
    laps: int
    rate: float = 0.0
    first: int = 0  # number of the first lap, which determines its place and time
    scene: str = "industrial"
    seed: int = 0

    def __iter__(self) -> Iterator[Sweep]:
        for lap in range(self.first, self.first + self.laps):
            for number, sweep in enumerate(self._lap):
                yield self._copy(sweep, lap, np.random.default_rng((self.seed, lap, number)))

    def __len__(self) -> int:
        return self.laps * len(self._lap)

    @cached_property
    def base_rate(self) -> float:
        """Points/s of the simulated lap."""
        return sum(map(len, self._lap)) / len(self._lap) * SWEEPS_PER_SECOND

    @property
    def _lap(self) -> list[Sweep]:
        return _simulated(self.scene, self.lap_s, self.seed)

    @cached_property
    def _step(self) -> Array:
        """(3,) m, horizontal: from the start of a lap to that of the next."""
        first, last = (np.median(self._lap[k].points, axis=0) for k in (0, -1))
        step: Array = (last - first) * (1.0, 1.0, 0.0)
        return step

    def _copy(self, sweep: Sweep, lap: int, rng: np.random.Generator) -> Sweep:
        if self.rate:
            copies = rng.poisson(self.rate / self.base_rate, len(sweep))
            sweep = sweep.keep(np.repeat(np.arange(len(sweep)), copies))
        assert sweep.fields is not None  # the simulator's
        moved = sweep.points + lap * self._step + NOISE * rng.standard_normal((len(sweep), 3))
        fields = sweep.fields.copy()
        for name, column in zip("xyz", moved.T, strict=True):
            fields[name] = column
        points = np.column_stack([fields[name] for name in "xyz"]).astype(np.float64)
        stamp_ns = sweep.stamp_ns + lap * round(self.lap_s * SECOND)
        return replace(sweep, stamp_ns=stamp_ns, points=points, fields=fields)


@lru_cache(maxsize=2)
def _simulated(scene: str, seconds: float, seed: int) -> list[Sweep]:
    return list(simulate(scene, duration=seconds, seed=seed))
