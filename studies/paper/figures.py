"""The paper's figures 3, 4, 5 and 7 as charts, and sheets of pictures for figure 6.

matplotlib, for the reasons that plots.py gives.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from PIL import Image

from ellipseg_ros.config import CRITERIA
from ellipseg_ros.io.atomic_files import replacing
from ellipseg_ros.io.colours import shape_colours
from ellipseg_ros.plots.style import legend, sheet, style, title
from ellipseg_ros.plots.tuning import BLUE, GREEN, ORANGE, PURPLE, UNITS, YELLOW, mark
from ellipseg_ros.plots.window import BACKGROUND, INK
from ellipseg_ros.records import Array
from ellipseg_ros.tuning.curve import Curve
from studies.paper.facts import KINDS, Scene

# Of Okabe & Ito (2008), the darkest made lighter, as the ground is dark.
COLOURS = (BLUE, ORANGE, GREEN, PURPLE, YELLOW, "#4d9bd6", "#e8743b", "#e6edf3")
OF_CRITERION = dict(zip(CRITERIA, (BLUE, ORANGE, GREEN), strict=True))
CELL = 640  # px, width of a picture on a sheet
STEPS = 400  # of the triangle of shapes


def figure3() -> Figure:
    """The shape spectrum: every mixture of plane, cylinder and sphere, in its colour."""
    figure = sheet(8.0, 6.6)
    axes = figure.subplots()
    style(axes)
    x, y = np.meshgrid(np.linspace(0.0, 1.0, STEPS), np.linspace(0.0, 1.0, STEPS))
    plane, cylinder = 1.0 - x - 0.5 * y, x - 0.5 * y
    image = np.zeros((STEPS, STEPS, 4))
    image[..., :3] = shape_colours(plane.ravel(), cylinder.ravel(), y.ravel()).reshape(
        STEPS, STEPS, 3
    )
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
    return figure


def figure4(scene: Scene) -> Figure:
    """AICc, variance and bias term over the threshold, a panel a criterion."""
    figure = sheet(18.0, 5.6)
    for axes, name in zip(figure.subplots(1, len(CRITERIA)), CRITERIA, strict=True):
        style(axes)
        _terms(axes, scene.curves[name])
        title(axes, f"{name}, {scene.name}", _tau(name), "AICc per point")
        legend(axes)
    return figure


def figure5(scenes: Sequence[Scene]) -> Figure:
    """AICc over merge completion, a panel a scene, a line a criterion."""
    figure = sheet(8.0 * len(scenes), 6.0)
    for axes, scene in zip(np.ravel(figure.subplots(1, len(scenes))), scenes, strict=True):
        style(axes)
        for name, colour in OF_CRITERION.items():
            curve = scene.curves[name]
            merged, aicc = 100.0 * curve.completion, _per_point(curve)
            label = f"{name}: {merged[curve.best]:.1f} %, {curve.count[curve.best]:,} ellipsoids"
            axes.plot(merged, aicc, color=colour, linewidth=2, label=label)
            axes.plot(merged[curve.best], aicc[curve.best], "o", color=colour, markersize=8)
        below = "merge completion: merges per point [%]"
        title(axes, f"AICc over merge completion, {scene.name}", below, "AICc per point")
        legend(axes, loc="lower left")
    return figure


def figure7(scenes: Sequence[Scene]) -> Figure:
    """AICc over the threshold, a panel a criterion, a line a scene."""
    figure = sheet(18.0, 6.4)
    panels = figure.subplots(1, len(CRITERIA))
    for axes, name in zip(panels, CRITERIA, strict=True):
        style(axes)
        for number, scene in enumerate(scenes):
            curve, colour = scene.curves[name], COLOURS[number % len(COLOURS)]
            line = "-" if scene.kind == KINDS[0] else "--"
            aicc, best = _per_point(curve), curve.best
            axes.plot(curve.threshold, aicc, line, color=colour, linewidth=1.7, label=scene.name)
            axes.plot(curve.threshold[best], aicc[best], "o", color=colour, markersize=6)
        axes.set_xscale("log")
        title(axes, f"{name}: the minima of all scenes", _tau(name), "AICc per point")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(
        handles,
        labels,
        loc="outside lower center",
        ncols=5,
        facecolor=BACKGROUND,
        edgecolor=BACKGROUND,
        labelcolor=INK,
        fontsize=10,
    )
    return figure


def contact_sheet(pictures: Sequence[Sequence[Path]], path: Path) -> None:
    """Write pictures of files as one small PNG, two beside one another."""
    rows = [[_small(one) for one in pair] for pair in pictures]
    heights = [max(image.height for image in row) for row in rows]
    whole = Image.new("RGB", (2 * CELL, sum(heights)), BACKGROUND)
    top = 0
    for row, height in zip(rows, heights, strict=True):
        for column, image in enumerate(row):
            whole.paste(image, (column * CELL, top))
        top += height
    with replacing(path) as part:
        whole.quantize(128, dither=Image.Dither.NONE).save(part, "PNG", optimize=True)


def _small(path: Path) -> Image.Image:
    with Image.open(path) as image:
        height = round(image.height * CELL / image.width)
        return image.convert("RGB").resize((CELL, height), Image.Resampling.LANCZOS)


def _terms(axes: Axes, curve: Curve) -> None:
    points = max(1, curve.points)
    for values, colour, label in (
        (curve.aicc, INK, "AICc"),
        (curve.variance, BLUE, "variance term"),
        (curve.bias, ORANGE, "bias term"),
    ):
        axes.plot(curve.threshold, values / points, color=colour, linewidth=2, label=label)
    axes.set_xscale("log")
    best = curve.best
    text = f"τ = {curve.threshold[best]:.3g}, {curve.count[best]:,} ellipsoids"
    mark(axes, float(curve.threshold[best]), float(curve.aicc[best]) / points, text)


def _per_point(curve: Curve) -> Array:
    return np.asarray(curve.aicc / max(1, curve.points))


def _tau(criterion: str) -> str:
    return f"threshold τ{UNITS[criterion]}"
