"""The study: all methods on all clouds."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from ellipseg_ros.doctor.installation import version_of
from ellipseg_ros.errors import EllipsegError
from ellipseg_ros.simulation.shapes import Class
from studies.partition.evaluation import DEFAULT, Evaluation, evaluate
from studies.partition.methods import OBJECTS, OURS, Method
from studies.partition.metrics import UNKNOWN
from studies.partition.paired_timing import paired_settings, paired_times
from studies.partition.peers import CUT_PURSUIT, PEERS
from studies.partition.scan import Scan
from studies.partition.subprocess_runner import Outcome, run_in_subprocess
from studies.partition.targets import judged
from studies.report.machine import describe

TIMED = (OBJECTS.name, CUT_PURSUIT.name)  # alternating
METHODS = (*PEERS, *OURS)  # objects last: they are cut at the counts that cut-pursuit reached
CLASS_NAMES = [kind.name.lower() for kind in Class]
Results = dict[str, Any]  # JSON-ready


@dataclass(frozen=True)
class Plan:
    """Target counts, time limit and results of an earlier run."""

    counts: tuple[int, ...]  # of segments
    limit: float  # s, of a method on a cloud
    earlier: Results = field(default_factory=dict)  # to which this run adds


def chosen(names: list[str]) -> tuple[Method, ...]:
    """Methods whose name starts with one of `names`; all if there are none."""
    for name in names:
        if not any(method.name.startswith(name) for method in METHODS):
            known = ", ".join(method.name for method in METHODS)
            raise EllipsegError(f"there is no method {name!r}; there are {known}")
    return tuple(m for m in METHODS if not names or m.name.startswith(tuple(names)))


def study(
    scans: list[Scan],
    methods: tuple[Method, ...],
    plan: Plan,
    begin: Callable[[str], object] = lambda _: None,
) -> Results:
    """Evaluate all methods on all clouds; JSON-ready.

    begin: called with a description of each step before it.
    """
    missing: dict[str, str] = {}
    rows = {row["name"]: row for row in plan.earlier.get("scans", [])}
    for scan in scans:
        row = _begin_row(scan, methods, rows.get(scan.name))
        for method in (method for method in methods if method.name not in missing):
            begin(f"{scan.name}: {method.name}")
            targets = _targets(method, plan.counts, row["evaluations"])
            work = partial(evaluate, method, scan, targets)
            _record(run_in_subprocess(work, (method,), plan.limit), method, row, missing)
        _time_pair(scan, methods, row, plan, begin)
        rows[scan.name] = row
    names = {method.name for method in methods}
    earlier = {n: why for n, why in plan.earlier.get("missing", {}).items() if n not in names}
    results: Results = {
        "machine": describe(),
        "counts": list(plan.counts),
        "methods": _described(plan.earlier.get("methods", []), methods),
        "missing": earlier | missing,
        "scans": list(rows.values()),
    }
    return results | {"rows": judged(results)}


def _time_pair(
    scan: Scan,
    methods: tuple[Method, ...],
    row: Results,
    plan: Plan,
    begin: Callable[[str], object],
) -> None:
    """Time objects and cut-pursuit alternately, if one of them was evaluated and both can run."""
    settings = paired_settings(row)
    if settings is None or not {method.name for method in methods} & set(TIMED):
        return
    begin(f"{scan.name}: {' and '.join(TIMED)} alternating")
    named = {method.name: method for method in METHODS}
    ours, theirs = (named[name] for name in TIMED)
    work = partial(paired_times, scan.points, (ours, settings[0]), (theirs, settings[1]))
    row["timing"] = run_in_subprocess(work, (ours, theirs), plan.limit).evaluations


def _begin_row(scan: Scan, methods: tuple[Method, ...], earlier: Results | None) -> Results:
    """Properties of a cloud, with the earlier evaluations of methods that are not repeated."""
    row = _properties(scan)
    if earlier is None:
        return row
    if earlier["points"] != row["points"]:
        raise EllipsegError(
            f"{scan.name} has {row['points']:,} points, {earlier['points']:,} in the earlier "
            "results; one of the two needs another name"
        )
    repeated = {method.name for method in methods}
    kept = [one for one in earlier["evaluations"] if one["method"] not in repeated]
    problems = {m: why for m, why in earlier["problems"].items() if m not in repeated}
    same = {name: earlier[name] for name in ("timing", "picture")}
    return row | same | {"evaluations": kept, "problems": problems}


def _described(earlier: list[Results], methods: tuple[Method, ...]) -> list[Results]:
    """Descriptions of all methods, those of an earlier run included, in a fixed order."""
    rows = {row["name"]: row for row in earlier} | {m.name: _description(m) for m in methods}
    order = {method.name: place for place, method in enumerate(METHODS)}
    return sorted(rows.values(), key=lambda row: order.get(row["name"], len(order)))


def _targets(
    method: Method, counts: tuple[int, ...], evaluations: list[Evaluation]
) -> list[int | str]:
    """The counts to reach; where the count is a setting, those of cut-pursuit too."""
    reference: set[int] = set()
    if method.parameter is None:
        theirs = _of(evaluations, CUT_PURSUIT.name)
        reference = {one["count"] for one in theirs if one["reached"]}
    return [DEFAULT, *sorted(reference | set(counts))]


def _record(outcome: Outcome, method: Method, row: Results, missing: dict[str, str]) -> None:
    row["evaluations"] += outcome.evaluations
    if outcome.missing:
        missing[method.name] = outcome.missing
    if outcome.problem:
        row["problems"][method.name] = outcome.problem


def _of(evaluations: list[Evaluation], method: str) -> Iterator[Evaluation]:
    return (one for one in evaluations if one["method"] == method)


def _description(method: Method) -> Results:
    """Name, version and settings of a method."""
    packages = zip(method.package.split(), method.module.split(), strict=True)
    versions = [f"{package} {version_of(package, module)}".strip() for package, module in packages]
    grid = "; ".join(", ".join(f"{k} {v}" for k, v in one.items()) for one in method.grid)
    return {
        "name": method.name,
        "version": ", ".join(versions),
        "parameter": method.parameter.name if method.parameter else "",
        "grid": grid or "its defaults",
    }


def _properties(scan: Scan) -> Results:
    """Name, size and truth of a cloud, and room for its results."""
    instances = None
    if scan.instances is not None:
        instances = len(set(scan.instances.tolist()) - {UNKNOWN})
    return {
        "name": scan.name,
        "simulated": scan.simulated,
        "points": len(scan),
        "classes": {
            name: int((scan.classes == number).sum())
            for number, name in enumerate(CLASS_NAMES)
            if (scan.classes == number).any()
        },
        "instances": instances,
        "picture": "",
        "evaluations": [],
        "timing": [],
        "problems": {},
    }
