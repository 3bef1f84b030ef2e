"""All methods on all clouds."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from ellipseg_ros.doctor.packages import version_of
from ellipseg_ros.errors import EllipsegError
from ellipseg_ros.records import Array
from ellipseg_ros.simulation.shapes import Class
from studies.partition.cells import OWN, Cell, cells
from studies.partition.methods import OBJECTS, OURS, Method
from studies.partition.metrics import UNKNOWN
from studies.partition.peers import CUT_PURSUIT, PEERS
from studies.partition.promises import rows
from studies.partition.race import race, rivals
from studies.partition.scan import Scan
from studies.partition.subprocess_runner import Outcome, run_apart
from studies.report.machine import describe

RIVALS = (OBJECTS.name, CUT_PURSUIT.name)
METHODS = (*PEERS, *OURS)  # those without a dial last: they meet the counts of the others
Results = dict[str, Any]  # JSON-ready


@dataclass(frozen=True)
class Plan:
    """What is measured, other than methods and clouds."""

    counts: tuple[int, ...]  # of segments, to come to
    limit: float  # s, of one method on one cloud
    earlier: Results = field(default_factory=dict)  # of a run to which this one adds


def chosen(names: list[str]) -> tuple[Method, ...]:
    """Methods by name, or by the beginning of one; all if none is named."""
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
    """Measure everything; JSON-ready.

    begin: called with a few words before each method on each cloud.
    """
    missing: dict[str, str] = {}
    rows_of = {row["name"]: row for row in plan.earlier.get("scans", [])}
    for scan in scans:
        row = start(scan, methods, rows_of.get(scan.name))
        for method in (method for method in methods if method.name not in missing):
            begin(f"{scan.name}: {method.name}")
            counts = wanted(method, plan.counts, row["cells"])
            work = partial(cells, method, scan, counts)
            take(run_apart(work, (method,), plan.limit), method, row, missing)
        run_race(scan, methods, row, plan, begin)
        rows_of[scan.name] = row
    results: Results = {"machine": describe(), "counts": list(plan.counts)}
    results["methods"] = known(plan.earlier, methods)
    earlier = plan.earlier.get("missing", {})
    ours = {method.name for method in methods}
    results["missing"] = {n: w for n, w in earlier.items() if n not in ours} | missing
    results["scans"] = list(rows_of.values())
    return results | {"rows": rows(results)}


def run_race(
    scan: Scan,
    methods: tuple[Method, ...],
    row: Results,
    plan: Plan,
    begin: Callable[[str], object],
) -> None:
    """Time objects and cut-pursuit in turn, if one of them is new and both are there."""
    settings = rivals(row)
    if settings is None or not {method.name for method in methods} & set(RIVALS):
        return
    begin(f"{scan.name}: {' and '.join(RIVALS)} in turn")
    named = {method.name: method for method in METHODS}
    ours, theirs = named[RIVALS[0]], named[RIVALS[1]]
    work = partial(race, scan.points, (ours, settings[0]), (theirs, settings[1]))
    row["races"] = run_apart(work, (ours, theirs), plan.limit).cells


def start(scan: Scan, methods: tuple[Method, ...], earlier: Results | None) -> Results:
    """The facts of a cloud, and of an earlier run what is not going to be measured again."""
    row = facts(scan)
    if earlier is None:
        return row
    if earlier["points"] != row["points"]:
        raise EllipsegError(
            f"{scan.name} has {row['points']:,} points, {earlier['points']:,} in the earlier "
            "results; one of the two needs another name"
        )
    again = {method.name for method in methods}
    row["cells"] = [cell for cell in earlier["cells"] if cell["method"] not in again]
    row["races"], row["picture"] = earlier["races"], earlier["picture"]
    row["problems"] = {m: why for m, why in earlier["problems"].items() if m not in again}
    return row


def known(earlier: Results, methods: tuple[Method, ...]) -> list[Results]:
    """What the page says of the methods, of an earlier run too."""
    said = {one["name"]: one for one in earlier.get("methods", [])}
    said |= {method.name: about(method) for method in methods}
    order = {method.name: place for place, method in enumerate(METHODS)}
    return sorted(said.values(), key=lambda one: order.get(one["name"], len(order)))


def wanted(method: Method, counts: tuple[int, ...], before: list[Cell]) -> list[int | str]:
    """The counts to come to; where the count is a setting, those of cut-pursuit too."""
    mark: set[int] = set()
    if method.dial is None:
        mark = {cell["count"] for cell in of(before, CUT_PURSUIT.name) if cell["reached"]}
    return [OWN, *sorted(mark | set(counts))]


def take(outcome: Outcome, method: Method, row: Results, missing: dict[str, str]) -> None:
    """Note what came of a method."""
    row["cells"] += outcome.cells
    if outcome.missing:
        missing[method.name] = outcome.missing
    if outcome.problem:
        row["problems"][method.name] = outcome.problem


def of(cells: list[Cell], method: str) -> Iterator[Cell]:
    """The cells of one method."""
    return (cell for cell in cells if cell["method"] == method)


def about(method: Method) -> Results:
    """What the page says of a method."""
    pairs = zip(method.package.split(), method.module.split(), strict=True)
    versions = [f"{package} {version_of(package, module)}".strip() for package, module in pairs]
    turned = "count is a setting" if method.dial is None else method.dial.name
    grid = "; ".join(", ".join(f"{k} {v}" for k, v in one.items()) for one in method.grid)
    return {
        "name": method.name,
        "version": ", ".join(versions),
        "turned": turned,
        "grid": grid or "its defaults",
    }


def facts(scan: Scan) -> Results:
    """What there is in a cloud."""
    return {
        "name": scan.name,
        "simulated": scan.simulated,
        "points": len(scan),
        "classes": {
            name: int((scan.classes == number).sum())
            for number, name in enumerate(CLASS_NAMES)
            if (scan.classes == number).any()
        },
        "instances": None if scan.instances is None else _things(scan.instances),
        "picture": "",
        "cells": [],
        "races": [],
        "problems": {},
    }


def _things(instances: Array) -> int:
    return len(set(instances.tolist()) - {UNKNOWN})


CLASS_NAMES = [kind.name.lower() for kind in Class]
