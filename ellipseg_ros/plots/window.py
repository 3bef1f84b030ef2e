"""Pictures of a window: points by segment or object, and ellipsoids; from above or obliquely.

matplotlib needs no display and draws the same picture on every machine. Its object interface is
used because pyplot keeps global state.
"""

from dataclasses import dataclass, replace
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from PIL import Image

from ellipseg_ros.config import NodeConfig
from ellipseg_ros.io.atomic_files import replacing
from ellipseg_ros.io.colours import NO_SEGMENT, id_colours, shape_colours
from ellipseg_ros.records import ISOLATED, Array, Segmentation

WIDTH, DPI = 1600, 100  # px, px/inch
HEADER, FOOTER, MARGIN = 84, 120, 24  # px
MAX_HEIGHT, MIN_HEIGHT = 0.9, 0.3  # of the part with the data, relative to its width
MAX_PANEL_HEIGHT = 2.0  # relative to its width, if there are several side by side
BACKGROUND, INK, FAINT = "#0d1117", "#e6edf3", "#8b949e"
SIGMAS = 2.0  # half axes of an ellipsoid, in standard deviations
MIN_COUNT = NodeConfig().marker_min_count  # points of an ellipsoid that is drawn, as in RViz

Box = tuple[float, float, float, float]  # left, bottom, width, height: relative to the figure


@dataclass(frozen=True)
class View:
    """Direction of view; the longest side of the window is horizontal in the picture."""

    turn: float  # deg about the vertical
    elevation: float  # deg above the horizon


BIRDSEYE = View(0.0, 90.0)
OBLIQUE = View(24.0, 32.0)
UPRIGHT = View(-90.0, 90.0)  # from above, the longest side vertical


def draw_segments(result: Segmentation, path: Path, view: View = BIRDSEYE) -> None:
    """Write a PNG of the points in the colours of their segments, grey for none."""
    projection = _project(result, view)
    picture = _Picture(projection.flat[projection.shown])
    colours = id_colours(result.point_ids[projection.shown])
    _draw_points(picture, picture.axes, projection, colours / 255.0)
    picture.header("Segments", result, "one colour per segment, grey: none")
    picture.footer(projection.axes)
    picture.save(path)


def draw_ellipsoids(result: Segmentation, path: Path, view: View = BIRDSEYE) -> None:
    """Write a PNG of the segments as ellipsoids of 2 sigma, coloured by shape (paper, figure 3).

    Segments of fewer than 12 points appear as grey points.
    """
    projection = _project(result, view)
    picture = _Picture(projection.flat[projection.shown])
    big = result.ellipsoids.count >= MIN_COUNT
    rows = np.append(big, False)[np.maximum(result.labels, -1)]
    small = replace(projection, shown=projection.shown & ~rows)
    grey = np.full((int(small.shown.sum()), 3), NO_SEGMENT) / 255.0
    _draw_points(picture, picture.axes, small, grey)
    _draw_outlines(picture.axes, result, projection, big)
    note = f"{int(big.sum()):,} of {MIN_COUNT} points or more drawn at {SIGMAS:g} sigma"
    picture.header("Ellipsoids", result, note)
    picture.footer(projection.axes)
    picture.shape_key()
    picture.save(path)


def draw_levels(result: Segmentation, path: Path, view: View = UPRIGHT) -> None:
    """Write a PNG of the points by segment, by object and by ground truth, side by side.

    The ground truth is taken from the input fields `instance` (0: none), `class` or `coarse`.
    """
    projection = _project(result, view)
    panels = {f"{len(result.ellipsoids):,} ellipsoids": result.point_ids}
    if result.objects is not None:
        panels[f"{len(result.objects):,} objects"] = result.point_object_ids
    truth = _truth(result.fields)
    if truth is not None:
        panels["truth"] = truth
    picture = _Picture(projection.flat[projection.shown], len(panels))
    for axes, (title, ids) in zip(picture.panels, panels.items(), strict=True):
        _draw_points(picture, axes, projection, id_colours(ids[projection.shown]) / 255.0)
        axes.set_title(title, color=INK, size=13)
    picture.header("Ellipsoids, and objects", result, "one colour per group, grey: none")
    picture.footer(projection.axes)
    picture.save(path)


def _truth(fields: Array | None) -> Array | None:
    """(n,) ground truth of the points: instance numbers, else classes; None if not known."""
    names = () if fields is None else fields.dtype.names or ()
    groups = None
    for name in ("class", "coarse"):
        if fields is not None and name in names and groups is None:
            groups = np.maximum(fields[name].astype(np.int64), 0)
    if fields is not None and "instance" in names:
        instances = np.maximum(fields["instance"].astype(np.int64), 0)
        classes = np.zeros_like(instances) if groups is None else groups
        groups = np.where(instances > 0, classes.max(initial=0) + instances, classes)
    return groups


@dataclass(frozen=True)
class _Projection:
    """The points as seen; row i is point i of the window."""

    flat: Array  # (n, 2) m: to the right and up in the picture
    depth: Array  # (n,) m: towards the viewer
    axes: Array  # (3, 3): rows right, up, towards the viewer, in the world
    centre: Array  # (3,) m: the middle of the picture
    shown: Array  # (n,) bool: all but rejected and thinned points


def _project(result: Segmentation, view: View) -> _Projection:
    """Project the points of the window as seen from the view."""
    shown = result.labels >= ISOLATED  # thinned points would hide segmented ones
    points = result.points[shown]
    centre = np.median(points, axis=0) if len(points) else np.zeros(3)
    seen = np.zeros((len(shown), 3))
    axes = _view_axes(points - centre, view)
    seen[shown] = (points - centre) @ axes.T
    return _Projection(seen[:, :2], seen[:, 2], axes, centre, shown)


def _view_axes(points: Array, view: View) -> Array:
    """Rows right, up, towards the viewer; the longest horizontal direction is to the right."""
    long = np.array([1.0, 0.0])
    if len(points) > 1:
        inner = np.clip(points[:, :2], *np.percentile(points[:, :2], [2, 98], axis=0))
        long = np.linalg.eigh(np.cov(inner.T))[1][:, 1]
        long *= 1.0 if long[np.argmax(np.abs(long))] > 0.0 else -1.0
    turn = np.arctan2(long[1], long[0]) + np.radians(view.turn)
    lift = np.radians(view.elevation)
    right = np.array([np.cos(turn), np.sin(turn), 0.0])
    eye = np.array([np.sin(turn) * np.cos(lift), -np.cos(turn) * np.cos(lift), np.sin(lift)])
    return np.array([right, np.cross(eye, right), eye])


def _draw_points(picture: "_Picture", axes: Axes, projection: _Projection, colours: Array) -> None:
    """Draw the shown points, distant ones first and darker. colours: (shown, 3) in 0...1."""
    flat, depth = projection.flat[projection.shown], projection.depth[projection.shown]
    inside = picture.holds(flat)
    flat, depth, colours = flat[inside], depth[inside], colours[inside]
    if not len(flat):
        return
    far, near = np.percentile(depth, [2, 98])
    light = 0.62 + 0.38 * np.clip((depth - far) / max(near - far, 1e-9), 0.0, 1.0)
    order = np.argsort(depth, kind="stable")
    axes.scatter(
        flat[order, 0],
        flat[order, 1],
        c=(colours * light[:, None])[order],
        s=picture.dot_size,
        linewidths=0,
        rasterized=True,
    )


def _draw_outlines(axes: Axes, result: Segmentation, projection: _Projection, big: Array) -> None:
    """Draw the ellipsoids of 2 sigma, distant ones first, with light from above."""
    ellipsoids = result.ellipsoids
    depth = (ellipsoids.mean[big] - projection.centre) @ projection.axes[2]
    rows = np.flatnonzero(big)[np.argsort(depth, kind="stable")]
    flat = (ellipsoids.mean[rows] - projection.centre) @ projection.axes[:2].T
    shape = ellipsoids.covariance[rows]
    spread, turn = np.linalg.eigh(projection.axes[:2] @ shape @ projection.axes[:2].T)
    half = SIGMAS * np.sqrt(np.maximum(spread, 1e-6))
    shares = (ellipsoids.planarity, ellipsoids.cylindricality, ellipsoids.sphericity)
    colours = shape_colours(*(share[rows] for share in shares))
    angle = np.degrees(np.arctan2(turn[:, 1, 1], turn[:, 0, 1]))
    # Several ellipses each, smaller, brighter and nearer to the light, make it look round.
    light = turn @ (half * np.einsum("sij,i->sj", turn, [-0.5, 0.85]))[:, :, None]
    shrink, shade = np.linspace(1.0, 0.25, 6), np.linspace(0.55, 1.0, 6)
    sizes = 2.0 * half[:, None, :] * shrink[:, None]
    tints = colours[:, None, :] * shade[:, None]
    centres = flat[:, None, :] + 0.22 * light[:, :, 0][:, None, :] * (1.0 - shrink)[:, None]
    axes.add_collection(
        EllipseCollection(
            sizes[:, :, 1].ravel(),
            sizes[:, :, 0].ravel(),
            np.repeat(angle, len(shrink)),
            units="xy",
            offsets=centres.reshape(-1, 2),
            offset_transform=axes.transData,
            facecolors=tints.reshape(-1, 3),
            linewidths=0.0,
            rasterized=True,
        )
    )


class _Picture:
    """A dark figure: a header, the data at equal scales, a footer.

    panels: number of axes for the data, side by side.
    """

    def __init__(self, flat: Array, panels: int = 1) -> None:
        low, high = _limits(flat)
        span = high - low
        self._count = max(1, len(flat))
        wide = (WIDTH - (panels + 1) * MARGIN) // panels
        tallest = MAX_HEIGHT if panels == 1 else MAX_PANEL_HEIGHT
        tall = round(wide * float(np.clip(span[1] / span[0], MIN_HEIGHT, tallest)))
        self._area = wide * tall
        titles = 0 if panels == 1 else MARGIN
        self.height = tall + titles + HEADER + FOOTER
        self.figure = Figure((WIDTH / DPI, self.height / DPI), dpi=DPI, facecolor=BACKGROUND)
        self.panels = [
            self.figure.add_axes(self._relative(MARGIN + k * (wide + MARGIN), FOOTER, wide, tall))
            for k in range(panels)
        ]
        self.axes = self.panels[0]
        self._pixel = max(span[0] / wide, span[1] / tall)  # m
        middle, half = 0.5 * (low + high), 0.5 * self._pixel * np.array([wide, tall])
        self.low, self.high = middle - half, middle + half
        for axes in self.panels:
            axes.set_axis_off()
            axes.set_xlim(self.low[0], self.high[0])
            axes.set_ylim(self.low[1], self.high[1])

    def holds(self, flat: Array) -> Array:
        """(n,) bool: which positions are within the picture."""
        return np.asarray(((flat >= self.low) & (flat <= self.high)).all(axis=1))

    @property
    def dot_size(self) -> float:
        """Area of a dot in square points; larger if there are few."""
        pixels = float(np.clip(0.6 * np.sqrt(self._area / self._count), 1.4, 4.0))
        return (pixels * 72.0 / DPI) ** 2

    def header(self, title: str, result: Segmentation, note: str) -> None:
        """Write the title, and the numbers of the model."""
        self._text(MARGIN, self.height - 34, title, size=19, weight="bold")
        counts = result.counts
        points = max(1, counts.segmented)
        thinned = f" of {len(result.labels):,}, thinned" if counts.thinned else ""
        facts = (
            f"{counts.segmented + counts.isolated:,} points{thinned}",
            f"{len(result.ellipsoids):,} segments",
            f"criterion {result.criterion}, threshold {result.threshold:g}",
            f"AICc {result.aicc:,.0f} ({result.aicc / points:.2f} per point)",
            note,
        )
        self._text(MARGIN, self.height - 66, "   ·   ".join(facts), size=12, color=FAINT)

    def footer(self, axes: Array) -> None:
        """Draw a scale bar, and the directions of the axes of the frame."""
        length = _round_down(0.2 * (self.high[0] - self.low[0]) * len(self.panels) ** 0.5)
        pixels = length / self._pixel
        self._line((MARGIN, 44), (MARGIN + pixels, 44), INK)
        for x in (MARGIN, MARGIN + pixels):
            self._line((x, 38), (x, 50), INK)
        self._text(MARGIN + 0.5 * pixels, 20, f"{length:g} m", ha="center")
        middle = np.array([MARGIN + pixels + 110.0, 44.0])
        for k, colour in enumerate(("#ff6b6b", "#51cf66", "#6aa9ff")):
            arm = 38.0 * axes[:2, k]
            if np.linalg.norm(arm) < 4.0:
                continue  # it points at the viewer
            self._line(tuple(middle), tuple(middle + arm), colour)
            x, y = middle + 1.38 * arm
            self._text(x, y, "xyz"[k], color=colour, ha="center", va="center")

    def shape_key(self) -> None:
        """Draw the triangle of shapes, the key of the colours."""
        wide, tall = 92, 80
        left = WIDTH - MARGIN - 190
        axes = self.figure.add_axes(self._relative(left, 24, wide, tall))
        axes.set_axis_off()
        x, y = np.meshgrid(np.linspace(0.0, 1.0, wide), np.linspace(0.0, 1.0, tall))
        flat, long, ball = 1.0 - x - 0.5 * y, x - 0.5 * y, y  # shares, 1 in the corners
        image = np.zeros((tall, wide, 4))
        image[..., :3] = shape_colours(flat.ravel(), long.ravel(), ball.ravel()).reshape(
            tall, wide, 3
        )
        image[..., 3] = (flat >= 0.0) & (long >= 0.0)
        axes.imshow(image, origin="lower", aspect="auto")
        self._text(left + wide / 2 + 14, 24 + tall - 8, "sphere")
        self._text(left - 6, 28, "plane", ha="right")
        self._text(left + wide + 6, 28, "cylinder")

    def save(self, path: Path) -> None:
        """Write the PNG with a palette: a third of the size, and hardly a difference."""
        drawn = BytesIO()
        self.figure.savefig(drawn, format="png", pil_kwargs={"compress_level": 1})
        with Image.open(drawn) as image:
            full = image.convert("RGB")
        dithered = full.quantize(palette=full.quantize(256))
        with replacing(path) as part:
            dithered.save(part, "PNG", optimize=True)

    def _relative(self, x: float, y: float, wide: float, tall: float) -> Box:
        return x / WIDTH, y / self.height, wide / WIDTH, tall / self.height

    def _text(self, x: float, y: float, text: str, **style: Any) -> None:
        usual: dict[str, Any] = {"color": INK, "size": 12, "va": "center"}
        self.figure.text(x / WIDTH, y / self.height, text, **(usual | style))

    def _line(self, start: tuple[float, float], end: tuple[float, float], colour: str) -> None:
        x, y = zip(start, end, strict=True)
        line = Line2D(np.array(x) / WIDTH, np.array(y) / self.height, color=colour, linewidth=2)
        self.figure.add_artist(line)


def _limits(flat: Array) -> tuple[Array, Array]:
    """Lower and upper limits (2,) m of nearly all points (n, 2), without few distant ones."""
    if not len(flat):
        return np.full(2, -1.0), np.full(2, 1.0)
    lowest, low, high, highest = np.percentile(flat, [0.1, 1.0, 99.0, 99.9], axis=0)
    reach = 0.4 * (high - low)
    low, high = np.maximum(lowest, low - reach), np.minimum(highest, high + reach)
    margin = 0.03 * (high - low) + 0.5
    return low - margin, high + margin


def _round_down(length: float) -> float:
    """The largest of 1, 2 and 5 times a power of ten that is at most `length`."""
    power = 10.0 ** np.floor(np.log10(length))
    return float(max(step for step in (1.0, 2.0, 5.0) if step * power <= length) * power)
