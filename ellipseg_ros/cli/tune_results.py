"""What `ellipseg tune` prints and writes."""

import csv
import json
from argparse import Namespace
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import yaml

from ellipseg_ros.cli.report import Summary, print_status, write_summary
from ellipseg_ros.cli.settings import Settings
from ellipseg_ros.config import CRITERIA, flatten
from ellipseg_ros.io.atomic_files import replacing, write_text
from ellipseg_ros.tuning.choice import Choice, choose
from ellipseg_ros.tuning.curve import COLUMNS, curve_from
from ellipseg_ros.tuning.tasks import Curves, as_json, in_force
from ellipseg_ros.tuning.windows import Cut

SUMMARY = "tuning.json"
TABLE = "curves.csv"
WINDOWS = "windows"  # finished ones, by key
PARAMETERS = {name: f"segmenter_{name}.yaml" for name in CRITERIA}
PICTURES = tuple(f"{name}.{kind}" for name in CRITERIA for kind in ("png", "svg"))
NAMES = (SUMMARY, TABLE, *PARAMETERS.values(), *PICTURES)
KEPT = (WINDOWS,)


class Finished:
    """The windows that are done: one file each, which another run finds again."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder / WINDOWS
        self._folder.mkdir(parents=True, exist_ok=True)

    def get(self, key: str) -> Curves | None:
        """The curves of a window; None if it is not there or was only half written."""
        try:
            values = json.loads((self._folder / f"{key}.json").read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return None
        return {name: curve_from(curve) for name, curve in values.items()}

    def put(self, key: str, curves: Curves) -> None:
        """Keep the curves of a window."""
        write_text(self._folder / f"{key}.json", json.dumps(as_json(curves)))


@dataclass(frozen=True)
class Result:
    """One window and its curves."""

    source: str
    window: int
    start_s: float
    end_s: float
    points: int
    curves: Curves


@dataclass
class Tuning:
    """All windows of a run."""

    sources: list[str]
    settings: Settings
    criteria: tuple[str, ...]
    found: list[Result] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)
    again: int = 0  # windows that an earlier run had finished

    def take(self, cut: Cut, curves: Curves, again: bool = False) -> None:
        """Note a window."""
        span = (cut.start_s, cut.end_s)
        self.found.append(Result(cut.source, cut.number, *span, len(cut.points), curves))
        self.again += again

    def fail(self, problem: str) -> None:
        """Note, in one line, what could not be done."""
        self.problems.append(problem)

    @property
    def results(self) -> list[Result]:
        """The windows in the order of the sources, whenever they were finished."""
        return sorted(self.found, key=lambda r: (self.sources.index(r.source), r.window))

    def choices(self) -> dict[str, Choice]:
        """The threshold of every criterion."""
        return {
            name: choose(
                [result.curves[name] for result in self.results],
                in_force(self.settings.config, name).tau,
            )
            for name in self.criteria
        }

    def summary(self) -> Summary:
        """JSON-ready."""
        return {
            "ellipseg": version("ellipseg_ros"),
            "sources": self.sources,
            "settings": flatten(self.settings.config),
            "windows": len(self.found),
            "finished_before": self.again,
            "problems": self.problems,
            "choices": {name: asdict(choice) for name, choice in self.choices().items()},
            "curves": [
                asdict(replace(result, curves={})) | {"curves": as_json(result.curves)}
                for result in self.results
            ],
        }


def finish(folder: Path, tuning: Tuning, args: Namespace) -> None:
    """Write everything but the finished windows, which are there already."""
    write_summary(tuning.summary(), folder / SUMMARY)
    with replacing(folder / TABLE) as part, part.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows(_table(tuning))
    for name, choice in tuning.choices().items():
        write_text(folder / PARAMETERS[name], parameters(tuning, choice))
    if not args.no_pictures:
        from ellipseg_ros.plots import tuning as charts

        print_status("drawing ...", args)
        for name, choice in tuning.choices().items():
            curves = [result.curves[name] for result in tuning.results]
            charts.draw_tuning(curves, choice, [folder / f"{name}.{k}" for k in ("png", "svg")])
    print_status(f"wrote {folder}/: {', '.join(n for n in NAMES if (folder / n).exists())}", args)


def parameters(tuning: Tuning, choice: Choice) -> str:
    """A parameter file for the node: the tuned threshold, and all settings that it belongs to."""
    tuned = {"criterion": choice.criterion, "threshold": choice.threshold}
    defaults = Settings().flat()
    nested: dict[str, Any] = {}
    for name, value in (tuning.settings.flat() | tuned).items():
        *path, last = name.split(".")
        if value != defaults[name] or name in tuned:
            place = nested
            for part in path:
                place = place.setdefault(part, {})
            place[last] = value
    head = (
        f"# Tuned on {choice.windows} windows: mean loss {choice.mean_loss:.4f}, "
        f"worst {choice.worst_loss:.4f}.\n# What isn't named has its default.\n"
    )
    return head + yaml.safe_dump({"/**": {"ros__parameters": nested}}, sort_keys=False)


def show(tuning: Tuning, args: Namespace) -> None:
    """Print all as JSON, or the minima and the choices as a table, or nothing."""
    if args.json:
        print(json.dumps(tuning.summary(), indent=2))
    elif not args.quiet:
        print("\n".join([*_windows(tuning), "", *_choices(tuning)]))


def _table(tuning: Tuning) -> Iterator[list[Any]]:
    """Every threshold of every window and criterion, for a spreadsheet."""
    head = ["source", "window", "start_s", "end_s", "criterion", "points", "singletons"]
    yield [*head, *COLUMNS]
    for result in tuning.results:
        for name, curve in result.curves.items():
            first = [result.source, result.window, result.start_s, result.end_s, name]
            columns = [getattr(curve, column).tolist() for column in COLUMNS]
            for row in zip(*columns, strict=True):
                yield [*first, curve.points, curve.singletons, *row]


def _windows(tuning: Tuning) -> Iterator[str]:
    """A line per window and criterion: its minimum."""
    yield (
        f"{'source':<24} {'window':>14} {'criterion':<9} {'minimum at':>10} {'ellipsoids':>10} "
        f"{'merged':>7} {'AICc':>12} {'variance':>12} {'bias':>10} {'loss now':>8}"
    )
    for result in tuning.results:
        for name, curve in result.curves.items():
            best = curve.best
            now = curve.loss[curve.row(in_force(tuning.settings.config, name).tau)]
            yield (
                f"{_short(result.source):<24} {result.start_s:>6.1f}-{result.end_s:>5.1f} s "
                f"{name:<9} {curve.threshold[best]:>10.4g} {curve.count[best]:>10,} "
                f"{curve.completion[best]:>7.1%} {curve.aicc[best]:>12.6g} "
                f"{curve.variance[best]:>12.6g} {curve.bias[best]:>10.5g} {now:>8.4f}"
            )


def _short(source: str) -> str:
    """The end of a long path."""
    return source if len(source) <= 24 else f"...{source[-21:]}"


def _choices(tuning: Tuning) -> Iterator[str]:
    """What to set, and how much that is worth."""
    for name, found in tuning.choices().items():
        yield (
            f"{name}: threshold {found.threshold:.4g}, mean loss {found.mean_loss:.4f}, worst "
            f"{found.worst_loss:.4f} over {found.windows} windows, whose minima lie from "
            f"{found.lowest_minimum:.4g} to {found.highest_minimum:.4g}"
        )
        yield (
            f"  {found.present:g} as set now: mean loss {found.present_mean_loss:.4f}, worst "
            f"{found.present_worst_loss:.4f}"
        )
        if found.at_end:
            yield "  a minimum lies at the end of the thresholds tried: widen them, --from, --to"
    if tuning.again:
        yield f"{tuning.again} windows were finished before"
    for problem in tuning.problems:
        yield f"failed: {problem}"
