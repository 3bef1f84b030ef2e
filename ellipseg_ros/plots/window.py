"""Pictures of a window: points by segment or object, and ellipsoids; from above or obliquely.

matplotlib needs no display and draws the same picture on every machine. Its object interface is
used because pyplot keeps global state.
"""

from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection
from matplotlib.figure import Figure
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
    picture = _Picture(result, view)
    picture.draw_points(picture.panels[0], id_colours(result.point_ids) / 255.0)
    picture.save(path, "Segments", "one colour per segment, grey: none")


def draw_ellipsoids(result: Segmentation, path: Path, view: View = BIRDSEYE) -> None:
    """Write a PNG of the segments as ellipsoids of 2 sigma, coloured by shape (paper, figure 3).

    Segments of fewer than 12 points appear as grey points.
    """
    picture = _Picture(result, view)
    big = result.ellipsoids.count >= MIN_COUNT
    outlined = np.append(big, False)[np.maximum(result.labels, -1)]
    grey = np.full((len(outlined), 3), NO_SEGMENT) / 255.0
    picture.draw_points(picture.panels[0], grey, ~outlined)
    picture.draw_outlines(picture.panels[0], np.flatnonzero(big))
    picture.draw_shape_key()
    note = f"{int(big.sum()):,} of {MIN_COUNT} points or more drawn at {SIGMAS:g} sigma"
    picture.save(path, "Ellipsoids", note)


def draw_levels(result: Segmentation, path: Path, view: View = UPRIGHT) -> None:
    """Write a PNG of the points by segment, by object and by ground truth, side by side.

    The ground truth is taken from the input fields `instance` (0: none), `class` or `coarse`.
    """
    panels = {f"{len(result.ellipsoids):,} ellipsoids": result.point_ids}
    if result.objects is not None:
        panels[f"{len(result.objects):,} objects"] = result.point_object_ids
    truth = _truth(result.fields)
    if truth is not None:
        panels["truth"] = truth
    picture = _Picture(result, view, len(panels))
    for axes, (title, ids) in zip(picture.panels, panels.items(), strict=True):
        picture.draw_points(axes, id_colours(ids) / 255.0)
        axes.set_title(title, color=INK, size=13)
    picture.save(path, "Ellipsoids, and objects", "one colour per group, grey: none")


def _truth(fields: Array | None) -> Array | None:
    """(n,) ground truth of the points: instance numbers, else classes; None if not known."""
    if fields is None:
        return None
    names = [name for name in ("class", "coarse", "instance") if name in fields.dtype.names or ()]
    groups = {name: np.maximum(fields[name].astype(np.int64), 0) for name in names}
    classes = groups.get("class", groups.get("coarse"))
    instances = groups.get("instance")
    if instances is None:
        return classes
    classes = np.zeros_like(instances) if classes is None else classes
    return np.where(instances > 0, classes.max(initial=0) + instances, classes)


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


class _Picture:
    """A window as seen from a view: a header, the data at equal scales, a footer; all dark.

    panels: number of axes for the data, side by side. Row i of `flat` (n, 2), m to the right and
    up in the picture, and of `depth` (n,), m towards the viewer, is point i of the window.
    """

    def __init__(self, result: Segmentation, view: View, panels: int = 1) -> None:
        self.result = result
        self.shown = result.labels >= ISOLATED  # thinned points would hide segmented ones
        points = result.points[self.shown]
        self.centre = np.median(points, axis=0) if len(points) else np.zeros(3)  # of the picture
        self.directions = _view_axes(points - self.centre, view)
        seen = np.zeros((len(self.shown), 3))
        seen[self.shown] = (points - self.centre) @ self.directions.T
        self.flat, self.depth = seen[:, :2], seen[:, 2]

        low, high = _limits(self.flat[self.shown])
        span = high - low
        wide = (WIDTH - (panels + 1) * MARGIN) // panels
        tallest = MAX_HEIGHT if panels == 1 else MAX_PANEL_HEIGHT
        tall = round(wide * float(np.clip(span[1] / span[0], MIN_HEIGHT, tallest)))
        self.height = tall + (0 if panels == 1 else MARGIN) + HEADER + FOOTER
        self.figure = Figure((WIDTH / DPI, self.height / DPI), dpi=DPI, facecolor=BACKGROUND)
        self.page = self.figure.add_axes((0.0, 0.0, 1.0, 1.0))  # in pixels
        self.page.set(xlim=(0, WIDTH), ylim=(0, self.height), autoscale_on=False)
        self.page.set_axis_off()
        self.panels = [
            self._axes(MARGIN + k * (wide + MARGIN), FOOTER, wide, tall) for k in range(panels)
        ]
        self.pixel = max(span[0] / wide, span[1] / tall)  # m
        middle, half = 0.5 * (low + high), 0.5 * self.pixel * np.array([wide, tall])
        self.low, self.high = middle - half, middle + half
        limits = {"xlim": (self.low[0], self.high[0]), "ylim": (self.low[1], self.high[1])}
        for axes in self.panels:
            axes.set(**limits)
        pixels = np.clip(0.6 * np.sqrt(wide * tall / max(1, len(points))), 1.4, 4.0)
        self.dot_size = float(pixels * 72.0 / DPI) ** 2  # square points; larger for few dots

    def draw_points(self, axes: Axes, colours: Array, rows: Array | None = None) -> None:
        """Draw points, distant ones first, darker; colours: (n, 3) in 0...1, rows: (n,) bool."""
        inside = ((self.flat >= self.low) & (self.flat <= self.high)).all(axis=1)
        drawn = np.flatnonzero(self.shown & inside & (True if rows is None else rows))
        if not len(drawn):
            return
        drawn = drawn[np.argsort(self.depth[drawn], kind="stable")]
        far, near = np.percentile(self.depth[drawn], [2, 98])
        share = np.clip((self.depth[drawn] - far) / max(near - far, 1e-9), 0.0, 1.0)
        tints = colours[drawn] * (0.62 + 0.38 * share)[:, None]
        x, y = self.flat[drawn].T
        axes.scatter(x, y, c=tints, s=self.dot_size, linewidths=0)

    def draw_outlines(self, axes: Axes, rows: Array) -> None:
        """Draw the ellipsoids in `rows` at 2 sigma, distant ones first, with light from above."""
        ellipsoids = self.result.ellipsoids
        centres = (ellipsoids.mean - self.centre) @ self.directions.T
        rows = rows[np.argsort(centres[rows, 2], kind="stable")]
        flat = self.directions[:2] @ ellipsoids.covariance[rows] @ self.directions[:2].T
        spread, turn = np.linalg.eigh(flat)
        half = SIGMAS * np.sqrt(np.maximum(spread, 1e-6))
        shares = (ellipsoids.planarity, ellipsoids.cylindricality, ellipsoids.sphericity)
        colours = shape_colours(*(share[rows] for share in shares))
        angle = np.degrees(np.arctan2(turn[:, 1, 1], turn[:, 0, 1]))
        # Several ellipses each, smaller, brighter and nearer to the light, make it look round.
        light = turn @ (half * np.einsum("sij,i->sj", turn, [-0.5, 0.85]))[:, :, None]
        shrink, shade = np.linspace(1.0, 0.25, 6), np.linspace(0.55, 1.0, 6)
        sizes = 2.0 * half[:, None, :] * shrink[:, None]
        tints = colours[:, None, :] * shade[:, None]
        offsets = centres[rows, None, :2] + 0.22 * light[:, None, :, 0] * (1.0 - shrink)[:, None]
        widths, heights = sizes[:, :, 1].ravel(), sizes[:, :, 0].ravel()
        angles = np.repeat(angle, len(shrink))
        place: Any = {"offsets": offsets.reshape(-1, 2), "offset_transform": axes.transData}
        fill: Any = {"facecolors": tints.reshape(-1, 3), "linewidths": 0.0}
        ellipses = EllipseCollection(widths, heights, angles, units="xy", **place, **fill)
        axes.add_collection(ellipses)

    def draw_shape_key(self) -> None:
        """Draw the triangle of shapes, the key of the colours."""
        wide, tall = 92, 80
        left = WIDTH - MARGIN - 190
        x, y = np.meshgrid(np.linspace(0.0, 1.0, wide), np.linspace(0.0, 1.0, tall))
        flat, long, ball = 1.0 - x - 0.5 * y, x - 0.5 * y, y  # shares, 1 in the corners
        colours = shape_colours(flat.ravel(), long.ravel(), ball.ravel()).reshape(tall, wide, 3)
        image = np.dstack([colours, (flat >= 0.0) & (long >= 0.0)])
        self._axes(left, 24, wide, tall).imshow(image, origin="lower", aspect="auto")
        self._text(left + wide / 2 + 14, 24 + tall - 8, "sphere")
        self._text(left - 6, 28, "plane", ha="right")
        self._text(left + wide + 6, 28, "cylinder")

    def save(self, path: Path, title: str, note: str) -> None:
        """Add header and footer, and write the PNG with a palette: a third of the size."""
        self._header(title, note)
        self._footer()
        drawn = BytesIO()
        self.figure.savefig(drawn, format="png", pil_kwargs={"compress_level": 1})
        with Image.open(drawn) as image:
            full = image.convert("RGB")
        dithered = full.quantize(palette=full.quantize(256))
        with replacing(path) as part:
            dithered.save(part, "PNG", optimize=True)

    def _header(self, title: str, note: str) -> None:
        """Write the title, and the numbers of the model."""
        self._text(MARGIN, self.height - 34, title, size=19, weight="bold")
        result, counts = self.result, self.result.counts
        thinned = f" of {len(result.labels):,}, thinned" if counts.thinned else ""
        per_point = result.aicc / max(1, counts.segmented)
        facts = (
            f"{counts.segmented + counts.isolated:,} points{thinned}",
            f"{len(result.ellipsoids):,} segments",
            f"criterion {result.criterion}, threshold {result.threshold:g}",
            f"AICc {result.aicc:,.0f} ({per_point:.2f} per point)",
            note,
        )
        self._text(MARGIN, self.height - 66, "   ·   ".join(facts), size=12, color=FAINT)

    def _footer(self) -> None:
        """Draw a scale bar, and the directions of the axes of the frame."""
        length = _round_down(0.2 * (self.high[0] - self.low[0]) * len(self.panels) ** 0.5)
        end = MARGIN + length / self.pixel
        bar: Any = {"linewidth": 2, "marker": "|", "markersize": 9, "markeredgewidth": 2}
        self.page.plot((MARGIN, end), (44, 44), color=INK, **bar)
        self._text(0.5 * (MARGIN + end), 20, f"{length:g} m", ha="center")
        for k, colour in enumerate(("#ff6b6b", "#51cf66", "#6aa9ff")):
            arm = 38.0 * self.directions[:2, k]
            if np.linalg.norm(arm) >= 4.0:  # else it points at the viewer
                x, y = end + 110.0, 44.0
                self.page.plot((x, x + arm[0]), (y, y + arm[1]), color=colour, linewidth=2)
                x, y = x + 1.38 * arm[0], y + 1.38 * arm[1]
                self._text(x, y, "xyz"[k], color=colour, ha="center")

    def _axes(self, left: float, bottom: float, wide: float, tall: float) -> Axes:
        """Axes without lines and labels at a place in pixels."""
        page = self.page
        axes = page.inset_axes((left, bottom, wide, tall), transform=page.transData)
        axes.set_axis_off()
        return axes

    def _text(self, x: float, y: float, text: str, **style: Any) -> None:
        usual: dict[str, Any] = {"color": INK, "size": 12, "va": "center"}
        self.page.text(x, y, text, **(usual | style))


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
