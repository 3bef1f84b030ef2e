"""`python -m studies.paper`: the paper's figures and findings on simulated and own scenes."""

import sys
from argparse import ArgumentParser, Namespace
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path

from ellipseg_ros.cli.main import run_program
from ellipseg_ros.cli.options import SOURCES, add_parameter_options, add_source_options
from ellipseg_ros.cli.report import compile_kernels, print_status
from ellipseg_ros.cli.results import prepare
from ellipseg_ros.cli.settings import Settings, read_settings
from ellipseg_ros.cli.sources import open_input
from ellipseg_ros.cli.tune_results import WINDOWS, CurveStore
from ellipseg_ros.core.criteria import CRITERIA
from ellipseg_ros.io.sources import SIMULATED, Source
from ellipseg_ros.tuning.search import Search
from ellipseg_ros.tuning.tasks import Task
from ellipseg_ros.tuning.tasks import run as tune
from studies.paper.facts import (
    Facts,
    Scene,
    criterion_facts,
    first_window,
    kind_of,
    scene_facts,
    shared_facts,
)
from studies.paper.figures import draw_figures, draw_segmentation
from studies.paper.page import FIGURES, page
from studies.report.command import publish, run_command
from studies.report.progress import progress_steps

EXAMPLES = """examples:
  python -m studies.paper -o paper
  python -m studies.paper monday.mcap tuesday.mcap --set max_points_per_second=15000 -o paper"""
SIMULATIONS = [f"{SIMULATED}{name}" for name in ("industrial", "woodland", "roadway", "mixed")]
SHOWN = ("industrial", "woodland")  # like the two scenes of the paper's figures 5 and 6
VECTOR, PICTURES = "vector", "segmentations"  # folders
NAMES = ("paper.md", "paper.json", VECTOR, PICTURES, *(f"paper_{name}.png" for name in FIGURES))


def main(argv: Sequence[str] | None = None) -> int:
    """Run the study; returns 0, whatever findings hold."""
    return run_command("paper", _options, _run, argv, EXAMPLES)


def _options(parser: ArgumentParser) -> None:
    sources = f"besides the simulated scenes: {SOURCES}"
    parser.add_argument("sources", nargs="*", metavar="SOURCE", help=sources)
    add_source_options(parser)
    add_parameter_options(parser)
    parser.set_defaults(criterion=None, threshold=None, output="paper")
    parser.add_argument("--count", type=int, help="thresholds of the grid (40), then refined")
    parser.add_argument("--no-pictures", action="store_true", help="draw no figures")


def _run(args: Namespace) -> int:
    settings = read_settings(args)
    search = Search() if args.count is None else Search(count=args.count)
    sources = {s: open_input(s, _options_of(s, args)) for s in [*SIMULATIONS, *args.sources]}
    folder = Path(args.output)
    for spec in sources:
        prepare(folder, spec, NAMES, (WINDOWS,))
    compile_kernels(args)
    study = Study(settings, search, folder, not args.no_pictures)
    with progress_steps(len(sources), "scenes", args) as begin:
        for spec, source in sources.items():
            begin(source.name)
            study.add(spec, source)
    print_status("drawing ...", args)
    publish(study.facts(), page, args)
    return 0


class Study:
    """Curves and facts of the scenes so far."""

    def __init__(self, settings: Settings, search: Search, folder: Path, pictures: bool) -> None:
        self._settings, self._search, self._pictures = settings, search, pictures
        self._folder, self._curves = folder, CurveStore(folder)
        self._scenes: list[Scene] = []
        self._facts: list[Facts] = []

    def add(self, spec: str, source: Source) -> None:
        """Tune all criteria on a source, and segment it at the minima of the AICc."""
        config = self._settings.config
        cut = first_window(source, config)
        task = Task(cut, config, tuple(CRITERIA), self._search)
        curves = self._curves.get(task.key)
        if curves is None:
            curves = tune(task)
            self._curves.put(task.key, curves)
        scene = Scene(source.name, kind_of(spec), cut, curves)
        facts = scene_facts(scene)
        for name in CRITERIA:
            segmentation = scene.at_minimum(name, config)
            facts["criteria"][name] = criterion_facts(curves[name], segmentation, config)
            if scene.name in SHOWN and self._pictures:
                draw_segmentation(segmentation, self._folder / PICTURES, f"{scene.name}_{name}")
        self._scenes.append(scene)
        self._facts.append(facts)

    def facts(self) -> Facts:
        """All numbers, JSON-ready; draws the figures."""
        settings, defaults = self._settings.flat(), Settings().flat()
        figures: list[str] = []
        if self._pictures:
            shown = [scene for scene in self._scenes if scene.name in SHOWN]
            figures = draw_figures(shown, self._scenes, self._folder, self._folder / PICTURES)
        return {
            "ellipseg": version("ellipseg_ros"),
            "settings": {n: value for n, value in settings.items() if value != defaults[n]},
            "scenes": self._facts,
            "shared": shared_facts(self._scenes),
            "figures": figures,
        }


def _options_of(spec: str, args: Namespace) -> Namespace:
    """`args` for opening `spec`: --seed and --duration apply to simulated scenes only."""
    if spec.startswith(SIMULATED):
        return args
    return Namespace(**vars(args) | {"seed": None, "duration": None})


if __name__ == "__main__":
    sys.exit(run_program("studies.paper", main))
