"""The paper's figures 3, 4, 5 and 7 as charts, and its figure 6 as sheets of pictures."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from PIL import Image

from ellipseg_ros.core.criteria import CRITERIA
from ellipseg_ros.io.atomic_files import replacing
from ellipseg_ros.io.colours import shape_colours
from ellipseg_ros.plots.style import save, title
from ellipseg_ros.plots.tuning import BLUE, GREEN, ORANGE, mark, threshold_label
from ellipseg_ros.plots.window import (
    BACKGROUND,
    INK,
    OBLIQUE,
    draw_ellipsoids,
    draw_segments,
)
from ellipseg_ros.records import Array, Segmentation
from ellipseg_ros.tuning.curve import Curve
from studies.paper.facts import KINDS, Scene
from studies.report.chart import COLOURS, Line, LinePanel, chart, common_legend

OF_CRITERION = dict(zip(CRITERIA, (BLUE, ORANGE, GREEN), strict=True))
CELL_PX = 640  # width of a picture on a sheet
STEPS = 400  # pixels of the shape spectrum
AICC = "AICc per point"


def draw_figures(
    shown: Sequence[Scene], scenes: Sequence[Scene], folder: Path, pictures: Path
) -> list[str]:
    """Write all figures into `folder`, and the charts as SVG into vector/; returns their names.

    shown: scenes of the figures on single scenes. pictures: folder of `draw_segmentation`.
    """
    charts = {
        "figure3": shape_spectrum(),
        "figure4": aicc_terms(shown[0]),
        "figure5": aicc_over_completion(shown),
        "figure7": aicc_over_threshold(scenes),
    }
    vector = folder / "vector"
    vector.mkdir(exist_ok=True)
    for name, figure in charts.items():
        save(figure, folder / f"paper_{name}.png")
        save(figure, vector / f"paper_{name}.svg")
    sheets = {f"figure6_{scene.name}": scene.name for scene in shown}
    for name, scene in sheets.items():
        rows = [
            [pictures / f"{scene}_{criterion}_{what}.png" for what in ("points", "ellipsoids")]
            for criterion in CRITERIA
        ]
        contact_sheet(rows, folder / f"paper_{name}.png")
    return sorted([*charts, *sheets])


def draw_segmentation(segmentation: Segmentation, folder: Path, name: str) -> None:
    """Write the pictures of points and ellipsoids that a sheet of figure 6 is made of."""
    folder.mkdir(exist_ok=True)
    draw_segments(segmentation, folder / f"{name}_points.png", OBLIQUE)
    draw_ellipsoids(segmentation, folder / f"{name}_ellipsoids.png", OBLIQUE)


def shape_spectrum() -> Figure:
    """Figure 3: every mixture of plane, cylinder and sphere in its colour."""
    return chart([_spectrum], 1, (8.0, 6.6))


def aicc_terms(scene: Scene) -> Figure:
    """Figure 4: AICc, variance and bias term over the threshold, a panel per criterion."""
    panels = [partial(_terms, curve=scene.curves[name], scene=scene.name) for name in CRITERIA]
    return chart(panels, len(CRITERIA), (6.0, 5.6))


def aicc_over_completion(scenes: Sequence[Scene]) -> Figure:
    """Figure 5: AICc over merge completion, a panel per scene, a line per criterion."""
    panels = []
    for scene in scenes:
        lines = []
        for name, colour in OF_CRITERION.items():
            curve = scene.curves[name]
            merged, best = 100.0 * curve.completion, curve.best
            label = f"{name}: {merged[best]:.1f} %, {curve.count[best]:,} ellipsoids"
            lines += _with_minimum(merged, curve, Line((), (), label, colour))
        text, across = f"AICc over merge completion, {scene.name}", "merges per point [%]"
        panels.append(LinePanel(text, across, AICC, lines, place="lower left"))
    return chart(panels, len(panels), (8.0, 6.0))


def aicc_over_threshold(scenes: Sequence[Scene]) -> Figure:
    """Figure 7: AICc over the threshold, a panel per criterion, a line per scene."""
    panels = []
    for name in CRITERIA:
        lines = []
        for number, scene in enumerate(scenes):
            colour, dash = COLOURS[number % len(COLOURS)], "-" if scene.kind == KINDS[0] else "--"
            curve = scene.curves[name]
            look = Line((), (), scene.name, colour, dash, width=1.7)
            lines += _with_minimum(curve.threshold, curve, look)
        text = f"{name}: the minima of all scenes"
        panels.append(LinePanel(text, threshold_label(name), AICC, lines, log_x=True))
    figure = chart(panels, len(CRITERIA), (6.0, 6.4))
    common_legend(figure, 9)
    return figure


def contact_sheet(rows: Sequence[Sequence[Path]], path: Path) -> None:
    """Write rows of two pictures each as one small PNG."""
    images = [[_small(picture) for picture in row] for row in rows]
    heights = [max(image.height for image in row) for row in images]
    whole = Image.new("RGB", (2 * CELL_PX, sum(heights)), BACKGROUND)
    top = 0
    for row, height in zip(images, heights, strict=True):
        for column, image in enumerate(row):
            whole.paste(image, (column * CELL_PX, top))
        top += height
    with replacing(path) as part:
        whole.quantize(128, dither=Image.Dither.NONE).save(part, "PNG", optimize=True)


def _spectrum(axes: Axes) -> None:
    x, y = np.meshgrid(np.linspace(0.0, 1.0, STEPS), np.linspace(0.0, 1.0, STEPS))
    plane, cylinder = 1.0 - x - 0.5 * y, x - 0.5 * y
    image = np.zeros((STEPS, STEPS, 4))
    colours = shape_colours(plane.ravel(), cylinder.ravel(), y.ravel())
    image[..., :3] = colours.reshape(STEPS, STEPS, 3)
    image[..., 3] = (plane >= 0.0) & (cylinder >= 0.0)
    axes.imshow(image, origin="lower", extent=(0.0, 1.0, 0.0, 1.0), aspect=0.87)
    corners = {"plane\np = 1": (0.0, -0.02), "cylinder\nc = 1": (1.0, -0.02)}
    for name, (across, up) in corners.items():
        axes.text(across, up, name, color=INK, ha="center", va="top", fontsize=12)
    axes.text(0.5, 1.02, "sphere\ns = 1", color=INK, ha="center", va="bottom", fontsize=12)
    axes.set_axis_off()
    axes.set_xlim(-0.12, 1.12)
    axes.set_ylim(-0.14, 1.16)
    title(axes, "Shape spectrum, RGB = √(c, s, p)")


def _terms(axes: Axes, curve: Curve, scene: str) -> None:
    points, best = max(1, curve.points), curve.best
    terms = (
        (curve.aicc, INK, "AICc"),
        (curve.variance, BLUE, "variance term"),
        (curve.bias, ORANGE, "bias term"),
    )
    lines = [Line(curve.threshold, values / points, text, c) for values, c, text in terms]
    name, across = f"{curve.criterion}, {scene}", threshold_label(curve.criterion)
    LinePanel(name, across, AICC, lines, log_x=True, place="best")(axes)
    text = f"τ = {curve.threshold[best]:.3g}, {curve.count[best]:,} ellipsoids"
    mark(axes, float(curve.threshold[best]), float(curve.aicc[best]) / points, text)


def _with_minimum(x: Array, curve: Curve, look: Line) -> list[Line]:
    """The AICc per point over x as a line, and a dot at its minimum."""
    aicc, best = curve.aicc / max(1, curve.points), [curve.best]
    dot = Line(x[best], aicc[best], "", look.colour, marker="o")
    return [replace(look, x=x, y=aicc), dot]


def _small(path: Path) -> Image.Image:
    with Image.open(path) as image:
        height = round(image.height * CELL_PX / image.width)
        return image.convert("RGB").resize((CELL_PX, height), Image.Resampling.LANCZOS)
