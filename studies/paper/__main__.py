"""`ellipseg paper`: the paper's figures on scenes of ours, and what of its findings holds."""

import json
from argparse import Namespace
from importlib.metadata import version
from pathlib import Path

from ellipseg_ros.cli.report import print_status, progress_bar, write_summary
from ellipseg_ros.cli.results import prepare
from ellipseg_ros.cli.settings import Settings, read_settings
from ellipseg_ros.cli.sources import open_input
from ellipseg_ros.cli.tune_results import WINDOWS, Finished
from ellipseg_ros.config import CRITERIA
from ellipseg_ros.io.atomic_files import write_text
from ellipseg_ros.io.sources import SIMULATED, Source
from ellipseg_ros.records import Segmentation
from ellipseg_ros.segmenter import warm_up
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
from studies.paper.page import blocks, page

SIMULATIONS = [f"{SIMULATED}{name}" for name in ("industrial", "woodland", "roadway", "mixed")]
SHOWN = ("industrial", "woodland")  # the two of the paper's figures 5 and 6
PAGE, NUMBERS = "claims.md", "claims.json"
IMAGES, VECTOR, PICTURES = "images", "vector", "segmentations"
SIDES = ("points", "ellipsoids")
NAMES = (PAGE, NUMBERS, IMAGES, VECTOR, PICTURES)


def run(args: Namespace) -> int:
    """Tune every criterion on every scene, draw the figures, and write what holds."""
    settings = read_settings(args)
    search = Search() if args.count is None else Search(count=args.count)
    sources = {spec: open_input(spec, _own(spec, args)) for spec in [*SIMULATIONS, *args.sources]}
    folder = Path(args.output)
    for spec in sources:
        prepare(folder, spec, NAMES, (WINDOWS,))
    print_status("compiling kernels, which takes longer the first time ...", args)
    warm_up()
    study = Study(settings, search, folder, args)
    with progress_bar(len(sources), "scenes", args) as bar:
        for spec, source in sources.items():
            if bar.disable:  # no terminal: lines instead of a bar
                print_status(f"{source.name} ...", args)
            bar.set_description(source.name)
            study.take(spec, source)
            bar.update()
    facts = study.facts()
    write_summary(facts, folder / NUMBERS)
    write_text(folder / PAGE, page(facts))
    print_status(f"wrote {folder}/: {', '.join(n for n in NAMES if (folder / n).exists())}", args)
    _show(facts, args)
    return 0


class Study:
    """The scenes so far: curves for the figures, numbers for the page."""

    def __init__(self, settings: Settings, search: Search, folder: Path, args: Namespace) -> None:
        self._settings, self._search, self._args = settings, search, args
        self._folder, self._finished = folder, Finished(folder)
        self._scenes: list[Scene] = []
        self._facts: list[Facts] = []

    def take(self, spec: str, source: Source) -> None:
        """Tune on a source, and segment it at the minima."""
        config = self._settings.config
        cut = first_window(source, config)
        task = Task(cut, config, CRITERIA, self._search)
        curves = self._finished.get(task.key)
        if curves is None:
            curves = tune(task)
            self._finished.put(task.key, curves)
        scene = Scene(source.name, kind_of(spec), cut, curves)
        facts = scene_facts(scene)
        for name in CRITERIA:
            found = scene.at_minimum(name, config)
            facts["criteria"][name] = criterion_facts(curves[name], found, config)
            if scene.name in SHOWN and not self._args.no_pictures:
                self._picture(found, f"{scene.name}_{name}")
        self._scenes.append(scene)
        self._facts.append(facts)

    def facts(self) -> Facts:
        """All numbers, JSON-ready; draws the figures, if they are wanted."""
        defaults = Settings().flat()
        settings = self._settings.flat()
        return {
            "ellipseg": version("ellipseg_ros"),
            "settings": {n: value for n, value in settings.items() if value != defaults[n]},
            "scenes": self._facts,
            "shared": shared_facts(self._scenes),
            "figures": [] if self._args.no_pictures else self._draw(),
        }

    def _picture(self, found: Segmentation, name: str) -> None:
        """The points and the ellipsoids of figure 6."""
        from ellipseg_ros.plots import window as plots

        folder = self._folder / PICTURES
        folder.mkdir(exist_ok=True)
        plots.draw_segments(found, folder / f"{name}_points.png", plots.OBLIQUE)
        plots.draw_ellipsoids(found, folder / f"{name}_ellipsoids.png", plots.OBLIQUE)

    def _draw(self) -> list[str]:
        """Every figure as PNG, the charts as SVG too; returns their names."""
        from ellipseg_ros.plots.style import save
        from studies.paper import figures

        print_status("drawing ...", self._args)
        shown = [scene for scene in self._scenes if scene.name in SHOWN]
        charts = {
            "figure3": figures.figure3(),
            "figure4": figures.figure4(shown[0]),
            "figure5": figures.figure5(shown),
            "figure7": figures.figure7(self._scenes),
        }
        images, vector = self._folder / IMAGES, self._folder / VECTOR
        images.mkdir(exist_ok=True)
        vector.mkdir(exist_ok=True)
        for name, figure in charts.items():
            save(figure, images / f"paper_{name}.png")
            save(figure, vector / f"paper_{name}.svg")
        sheets = []
        for scene in shown:
            sheets.append(f"figure6_{scene.name}")
            pairs = [
                [self._folder / PICTURES / f"{scene.name}_{n}_{what}.png" for what in SIDES]
                for n in CRITERIA
            ]
            figures.contact_sheet(pairs, images / f"paper_{sheets[-1]}.png")
        return sorted([*charts, *sheets])


def _own(spec: str, args: Namespace) -> Namespace:
    """`args`, but without the options of simulated scenes for what is none."""
    if spec.startswith(SIMULATED):
        return args
    return Namespace(**vars(args) | {"seed": None, "duration": None})


def _show(facts: Facts, args: Namespace) -> None:
    if args.json:
        print(json.dumps(facts, indent=2))
    elif not args.quiet:
        print("\n".join(blocks(facts)))
