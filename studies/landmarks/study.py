"""Repeatability and association over many scenes, as JSON-ready results."""

from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from studies.landmarks.association import all_scores, landmark_sets
from studies.landmarks.candidates import OTHERS, OURS, Method
from studies.landmarks.passes import DIRECTIONS, Route, TwoPasses, drive
from studies.landmarks.repeatability import normalised_errors, repeatability

Results = dict[str, Any]


class Plan(NamedTuple):
    """What is measured."""

    scenes: Sequence[str]
    seeds: Sequence[int]  # of the scenes
    others: int  # number of seeds with the other methods, too
    route: Route


def study(plan: Plan, known: list[Results], begin: Callable[[str], object]) -> Iterator[Results]:
    """Yield a run for each scene, seed, direction and method.

    known: earlier runs, which are not measured again. begin: called before each scene.
    """
    yield from known
    done = {(run["scene"], run["seed"], run["method"]) for run in known}
    for scene in plan.scenes:
        for number, seed in enumerate(plan.seeds):
            begin(f"{scene}, seed {seed}")
            methods = [OURS, *OTHERS] if number < plan.others else [OURS]
            methods = [method for method in methods if (scene, seed, method.name) not in done]
            if methods:
                yield from _runs(scene, seed, methods, plan.route)


def _runs(scene: str, seed: int, methods: list[Method], route: Route) -> Iterator[Results]:
    first = drive(scene, seed, **route.first())
    landmarks = [method.extract(first.sweep.points) for method in methods]
    for direction in DIRECTIONS:
        passes = TwoPasses(first, drive(scene, seed, **route.second(direction)))
        for method, earlier in zip(methods, landmarks, strict=True):
            later = method.extract(passes.later.sweep.points)
            run: Results = {"scene": scene, "seed": seed, "direction": direction}
            run |= {"method": method.name, **repeatability(passes, earlier, later)}
            sets = landmark_sets(passes, earlier, later)
            run["association"] = all_scores(sets, seed, has_covariance=method == OURS)
            if method == OURS:
                run["errors"] = normalised_errors(earlier, later, passes.T_earlier_later)
            yield run


def summary(runs: list[Results]) -> Results:
    """Runs with their scenes and seeds."""
    scenes, seeds = ([run[key] for run in runs] for key in ("scene", "seed"))
    return {"scenes": sorted(set(scenes)), "seeds": sorted(set(seeds)), "runs": runs}


def runs_with(runs: list[Results], **values: str) -> list[Results]:
    """The runs of a scene, a direction, a method."""
    return [run for run in runs if all(run[key] == value for key, value in values.items())]


def compared_runs(results: Results) -> list[Results]:
    """The runs of the seeds on which all methods were tried; empty if there are none."""
    seeds = {run["seed"] for run in results["runs"] if run["method"] != OURS.name}
    return [run for run in results["runs"] if run["seed"] in seeds]


def methods_of(runs: list[Results]) -> list[str]:
    """Names of the methods, in the order of the runs."""
    return list(dict.fromkeys(run["method"] for run in runs))


def repeated_shares(runs: list[Results], kind: str, among: str = "visible") -> list[float]:
    """Repeatability of every run among the landmarks that are visible, or all ("landmarks")."""
    repeated = {"visible": "visible_repeated", "landmarks": "repeated"}[among]
    counts = [run["counts"][kind] for run in runs]
    return [count[repeated] / count[among] for count in counts if count[among]]


class ErrorSummary(NamedTuple):
    """Normalised squared errors of several runs."""

    mean: float
    median: float
    pairs: int


def error_summary(runs: list[Results], kind: str) -> ErrorSummary | None:
    """Summary of the errors of a kind of landmark; None if there are no pairs."""
    values = np.concatenate([np.zeros(0), *(run["errors"][kind] for run in runs)])
    if not len(values):
        return None
    return ErrorSummary(float(values.mean()), float(np.median(values)), len(values))
