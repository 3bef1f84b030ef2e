"""Search of the threshold of least AICc: a coarse grid, then refinements at the minimum."""

from dataclasses import dataclass, replace

import numpy as np

from ellipseg_ros.config import Config
from ellipseg_ros.core.criteria import CRITERIA
from ellipseg_ros.errors import ConfigError
from ellipseg_ros.records import Array
from ellipseg_ros.settings import Checked, setting
from ellipseg_ros.tuning.curve import Curve
from ellipseg_ros.tuning.window_graph import WindowGraph, threshold_curve, window_graph

CRITERION_RANGE = -1.0


@dataclass(frozen=True)
class Search(Checked):
    """Parameters of the search."""

    lowest: float = setting(CRITERION_RANGE, "of the grid; -1: the criterion's", "", -1.0, 1e9)
    highest: float = setting(CRITERION_RANGE, "of the grid; -1: the criterion's", "", -1.0, 1e9)
    count: int = setting(40, "thresholds of the grid, evenly spread in log", "", 3, 10_000)
    refinements: int = setting(2, "number of refinements around the minimum", "", 0, 10)
    finer: int = setting(8, "thresholds added by a refinement", "", 1, 1000)

    def grid(self, criterion: str) -> Array:
        """The thresholds (count,) of the grid, ascending."""
        low, high = CRITERIA[criterion].search_range
        low = low if self.lowest == CRITERION_RANGE else self.lowest
        high = high if self.highest == CRITERION_RANGE else self.highest
        if not 0.0 < low < high:
            given = f"the thresholds of {criterion} go from {low:g} to {high:g}"
            raise ConfigError(f"{given}; they must ascend from above 0")
        return np.geomspace(low, high, self.count)


def curve(points: Array, config: Config, thresholds: Array, origin: Array | None = None) -> Curve:
    """AICc of the segmentation of points (n, 3), m, by `config` at each of the thresholds (t,).

    Every value is that of `segment(points, ...)` bit for bit, at a fraction of its cost:
    neighbours, initial ellipsoids and edges are computed once.
    """
    return threshold_curve(window_graph(points, config, origin), config, thresholds)


def tune(
    points: Array, config: Config, search: Search | None = None, origin: Array | None = None
) -> Curve:
    """Search the threshold of least AICc for points (n, 3), m; other settings by `config`.

    The curve holds the grid, its refinements, and the threshold of `config`.
    """
    return tune_window(window_graph(points, config, origin), config, search or Search())


def tune_window(window: WindowGraph, config: Config, search: Search) -> Curve:
    """Search as `tune` does, on a graph, which all criteria can share."""
    config = replace(config, threshold=config.tau)
    result = threshold_curve(window, config, np.append(search.grid(config.criterion), config.tau))
    for _ in range(search.refinements):
        low, high = max(result.best - 1, 0), min(result.best + 1, len(result.threshold) - 1)
        finer = _between(result.threshold[low], result.threshold[high], search.finer)
        result = result.with_rows_of(threshold_curve(window, config, finer))
    return result


def _between(low: float, high: float, count: int) -> Array:
    """Evenly spread in log, without the ends; a threshold of 0 has no logarithm."""
    if low <= 0.0:
        return np.linspace(low, high, count + 2)[1:-1]
    return np.geomspace(low, high, count + 2)[1:-1]
