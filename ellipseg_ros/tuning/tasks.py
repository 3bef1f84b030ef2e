"""The tuning of one window as a task for another process, and its result as JSON."""

import hashlib
import json
from dataclasses import dataclass, field, replace
from importlib.metadata import version
from typing import Any

from ellipseg_ros.config import Config
from ellipseg_ros.core.jit import single_threaded
from ellipseg_ros.settings import flatten
from ellipseg_ros.tuning.curve import Curve
from ellipseg_ros.tuning.search import Search, tune_window
from ellipseg_ros.tuning.window_graph import window_graph
from ellipseg_ros.tuning.windows import Cut

Curves = dict[str, Curve]  # by criterion


@dataclass(frozen=True)
class Task:
    """A window with everything that its curves depend on; it needs no file.

    The threshold of `config` is in force for its criterion; the others have their defaults.
    """

    cut: Cut
    config: Config
    criteria: tuple[str, ...]
    search: Search = field(default_factory=Search)

    @property
    def key(self) -> str:
        """Identifies the result: it changes with points, settings and version."""
        settings = {**flatten(self.config), **flatten(self.search), "criteria": self.criteria}
        digest = hashlib.sha256(json.dumps([version("ellipseg_ros"), settings]).encode())
        digest.update(self.cut.points.tobytes())
        digest.update(self.cut.origin.tobytes())
        return digest.hexdigest()[:32]


def in_force(config: Config, criterion: str) -> Config:
    """`config` for a criterion; with its default threshold unless it is the one in force."""
    if criterion == config.criterion:
        return config
    return replace(config, criterion=criterion, threshold=None)


def run(task: Task) -> Curves:
    """Tune the window by every criterion, on all cores."""
    graph = window_graph(task.cut.points, task.config, task.cut.origin)
    configs = {name: in_force(task.config, name) for name in task.criteria}
    return {name: tune_window(graph, at, task.search) for name, at in configs.items()}


def run_single_threaded(task: Task) -> Curves:
    """Tune the window on one core, beside other processes."""
    with single_threaded():
        return run(task)


def as_json(curves: Curves) -> dict[str, Any]:
    """JSON-ready, by criterion."""
    return {name: curve.as_dict() for name, curve in curves.items()}
