"""Repeatability over many scenes, as numbers ready for JSON."""

from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from studies.landmarks.methods import OTHERS, OURS, Method
from studies.landmarks.passes import FIRST, SECOND, TwoPasses, drive
from studies.landmarks.recognition import in_one_frame, recognitions
from studies.landmarks.repeatability import errors, scores, truth

Results = dict[str, Any]


class Plan(NamedTuple):
    """What is measured."""

    scenes: Sequence[str]
    seeds: Sequence[int]  # of the scenes
    others: int  # on so many of the seeds, other methods too


def study(plan: Plan, known: list[Results], begin: Callable[[str], object]) -> Iterator[Results]:
    """Yield all runs: drive through every scene three times.

    known: runs of before, which are not measured again; begin: told before every scene.
    """
    yield from known
    there = {(run["scene"], run["seed"], run["method"]) for run in known}
    for scene in plan.scenes:
        for number, seed in enumerate(plan.seeds):
            begin(f"{scene}, seed {seed}")
            methods = [OURS, *OTHERS] if number < plan.others else [OURS]
            methods = [method for method in methods if (scene, seed, method.name) not in there]
            if methods:
                yield from _runs(scene, seed, methods)


def _runs(scene: str, seed: int, methods: list[Method]) -> list[Results]:
    """One scene by some methods, in both directions."""
    first = drive(scene, seed, **FIRST)
    found = [method.find(first.sweep.points) for method in methods]
    runs = []
    for direction, settings in SECOND.items():
        passes = TwoPasses(first, drive(scene, seed, **settings))
        for method, earlier in zip(methods, found, strict=True):
            later = method.find(passes.later.sweep.points)
            run: Results = {"scene": scene, "seed": seed, "direction": direction}
            run |= {"method": method.name, **scores(passes, earlier, later)}
            sets = in_one_frame(passes, earlier, later)
            run["association"] = recognitions(sets, seed, honest=method == OURS)
            if method == OURS:
                run["errors"] = errors(truth(passes, earlier, later))
            runs.append(run)
    return runs


def gathered(runs: list[Results]) -> Results:
    """Runs with what they are of."""
    scenes, seeds = ([run[key] for run in runs] for key in ("scene", "seed"))
    return {"scenes": sorted(set(scenes)), "seeds": sorted(set(seeds)), "runs": runs}


def share(runs: list[Results], kind: str, of: str = "seen") -> list[float]:
    """Repeatability of every run: landmarks found again of those seen, or of all."""
    again = {"seen": "seen_again", "landmarks": "again"}[of]
    tallies = [run["asked"][kind] for run in runs]
    return [tally[again] / tally[of] for tally in tallies if tally[of]]


def chosen(results: Results, **wanted: str) -> list[Results]:
    """The runs of a scene, a direction, a method."""
    return [
        run for run in results["runs"] if all(run[key] == value for key, value in wanted.items())
    ]


def mean_error(runs: list[Results], kind: str) -> tuple[float, float, int]:
    """Mean and median of the normalised errors squared, and how many pairs there are."""
    values = np.concatenate([np.zeros(0), *(run["errors"][kind] for run in runs)])
    if not len(values):
        return float("nan"), float("nan"), 0
    return float(values.mean()), float(np.median(values)), len(values)
