"""Results of `ellipseg tune`: the store of finished windows, files, and printed tables."""

import csv
import json
from argparse import Namespace
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any

from ellipseg_ros.cli.report import Summary, print_results, print_status, write_summary
from ellipseg_ros.cli.settings import Settings, parameter_file
from ellipseg_ros.core.criteria import CRITERIA
from ellipseg_ros.io.atomic_files import replacing, write_text
from ellipseg_ros.settings import flatten
from ellipseg_ros.tuning.choice import Choice, choose
from ellipseg_ros.tuning.curve import COLUMNS, Curve, curve_from
from ellipseg_ros.tuning.tasks import Curves, as_json, in_force
from ellipseg_ros.tuning.windows import Cut

SUMMARY = "tuning.json"
TABLE = "curves.csv"
WINDOWS = "windows"  # folder of the finished windows, by key
PARAMETERS = {name: f"segmenter_{name}.yaml" for name in CRITERIA}
PICTURES = tuple(f"{name}.{kind}" for name in CRITERIA for kind in ("png", "svg"))
NAMES = (SUMMARY, TABLE, *PARAMETERS.values(), *PICTURES)


class CurveStore:
    """The curves of finished windows, a file each, which a later run reuses."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder / WINDOWS
        self._folder.mkdir(parents=True, exist_ok=True)

    def get(self, key: str) -> Curves | None:
        """The curves of a window; None if there is no file, or an incomplete one."""
        try:
            values = json.loads((self._folder / f"{key}.json").read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return None
        return {name: curve_from(curve) for name, curve in values.items()}

    def put(self, key: str, curves: Curves) -> None:
        """Store the curves of a window."""
        write_text(self._folder / f"{key}.json", json.dumps(as_json(curves)))


@dataclass(frozen=True)
class WindowResult:
    """A window and its curves."""

    source: str
    window: int
    start_s: float
    end_s: float
    points: int
    curves: Curves


@dataclass
class TuningRun:
    """The windows of a run and their results."""

    sources: list[str]
    settings: Settings
    criteria: tuple[str, ...]
    results: list[WindowResult] = field(default_factory=list)  # in the order of the sources
    problems: list[str] = field(default_factory=list)
    reused: int = 0  # windows that an earlier run had finished

    def add(self, cut: Cut, curves: Curves, reused: bool = False) -> None:
        """Add the result of a window."""
        span = (cut.start_s, cut.end_s)
        self.results.append(WindowResult(cut.source, cut.number, *span, len(cut.points), curves))
        self.results.sort(key=lambda r: (self.sources.index(r.source), r.window))
        self.reused += reused

    def choices(self) -> dict[str, Choice]:
        """The chosen threshold of every criterion."""
        present = {name: in_force(self.settings.config, name).tau for name in self.criteria}
        return {name: choose(self.curves(name), tau) for name, tau in present.items()}

    def curves(self, criterion: str) -> list[Curve]:
        """The curves of all windows by one criterion."""
        return [result.curves[criterion] for result in self.results]

    def summary(self) -> Summary:
        """JSON-ready."""
        return {
            "ellipseg": version("ellipseg_ros"),
            "sources": self.sources,
            "settings": flatten(self.settings.config),
            "windows": len(self.results),
            "finished_before": self.reused,
            "problems": self.problems,
            "choices": {name: asdict(choice) for name, choice in self.choices().items()},
            "curves": [vars(r) | {"curves": as_json(r.curves)} for r in self.results],
        }


def finish(folder: Path, tuning: TuningRun, args: Namespace) -> None:
    """Write summary, table, parameter files and charts; print minima and choices.

    The windows are stored already.
    """
    write_summary(tuning.summary(), folder / SUMMARY)
    with replacing(folder / TABLE) as part, part.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows(_table(tuning))
    choices = tuning.choices()
    for name, choice in choices.items():
        write_text(folder / PARAMETERS[name], parameters(tuning, choice))
    if not args.no_pictures:
        from ellipseg_ros.plots import tuning as charts

        print_status("drawing ...", args)
        for name, choice in choices.items():
            paths = [folder / f"{name}.{kind}" for kind in ("png", "svg")]
            charts.draw_tuning(tuning.curves(name), choice, paths)
    print_status(f"wrote {folder}/: {', '.join(n for n in NAMES if (folder / n).exists())}", args)
    print_results(tuning.summary(), [*_windows(tuning), "", *_choices(tuning)], args)


def parameters(tuning: TuningRun, choice: Choice) -> str:
    """A parameter file for the node: the tuned threshold, and the settings it was tuned with."""
    tuned = {"criterion": choice.criterion, "threshold": choice.threshold}
    values, defaults = tuning.settings.flat() | tuned, Settings().flat()
    changed = {n: v for n, v in values.items() if v != defaults[n] or n in tuned}
    losses = f"mean loss {choice.mean_loss:.4f}, worst {choice.worst_loss:.4f}"
    head = f"# Tuned on {choice.windows} windows: {losses}.\n"
    return f"{head}# All other parameters have their defaults.\n{parameter_file(changed)}"


def _table(tuning: TuningRun) -> Iterator[list[Any]]:
    """Rows of the CSV file: every threshold of every window and criterion."""
    first = ["source", "window", "start_s", "end_s", "criterion", "points", "singletons"]
    yield [*first, *COLUMNS]
    for result in tuning.results:
        for name, curve in result.curves.items():
            window = [result.source, result.window, result.start_s, result.end_s]
            columns = [getattr(curve, column).tolist() for column in COLUMNS]
            for row in zip(*columns, strict=True):
                yield [*window, name, curve.points, curve.singletons, *row]


def _windows(tuning: TuningRun) -> Iterator[str]:
    """Lines of the table: the minimum of every window and criterion."""
    yield (
        f"{'source':<24} {'window':>14} {'criterion':<9} {'minimum at':>10} {'ellipsoids':>10} "
        f"{'merged':>7} {'AICc':>12} {'variance':>12} {'bias':>10} {'loss set':>8}"
    )
    for result in tuning.results:
        source = result.source if len(result.source) <= 24 else f"...{result.source[-21:]}"
        for name, curve in result.curves.items():
            best = curve.best
            present_loss = curve.loss[curve.row(in_force(tuning.settings.config, name).tau)]
            yield (
                f"{source:<24} {result.start_s:>6.1f}-{result.end_s:>5.1f} s "
                f"{name:<9} {curve.threshold[best]:>10.4g} {curve.count[best]:>10,} "
                f"{curve.completion[best]:>7.1%} {curve.aicc[best]:>12.6g} "
                f"{curve.variance[best]:>12.6g} {curve.bias[best]:>10.5g} {present_loss:>8.4f}"
            )


def _choices(tuning: TuningRun) -> Iterator[str]:
    """Lines of text: the choices, reused windows and problems."""
    for name, choice in tuning.choices().items():
        losses = f"mean loss {choice.mean_loss:.4f}, worst {choice.worst_loss:.4f}"
        minima = f"{choice.lowest_minimum:.4g} to {choice.highest_minimum:.4g}"
        windows = f"{choice.windows} windows, whose minima lie from {minima}"
        yield f"{name}: threshold {choice.threshold:.4g}, {losses} over {windows}"
        losses = f"mean loss {choice.present_mean_loss:.4f}, worst {choice.present_worst_loss:.4f}"
        yield f"  {choice.present:g} as set now: {losses}"
        if choice.at_end:
            yield "  a minimum is at the end of the thresholds tried: extend them, --from, --to"
    if tuning.reused:
        yield f"{tuning.reused} windows were reused from an earlier run"
    yield from (f"failed: {problem}" for problem in tuning.problems)
