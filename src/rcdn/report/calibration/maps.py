"""Maps over the sensor: positions of corners, residual vectors, and projection uncertainty."""

from __future__ import annotations

from itertools import pairwise

import cv2
import numpy as np
from markupsafe import Markup

from rcdn.calibration.facts import Facts, cell_majority
from rcdn.calibration.residual_facts import Cells, used_residuals
from rcdn.report.calibration.charts import MOST_DOTS, WIDTH, nice, plot, thinned
from rcdn.report.calibration.formats import coordinate, counted, number, percent, pixels
from rcdn.report.calibration.svg import Drawing, dots, each, outline, segments, tag
from rcdn.types import Array, Calibration

TYPICAL = 20.0
"""drawn length of the 90th percentile of the vectors, units"""
BANDS, FEWEST_BANDS = 7, 3
STEPS = ((1, 2, 5), (1, 1.5, 2, 3, 4, 5, 7))
"""limits of bands, to be multiplied by powers of ten; the second set is used if the first gives too few"""
BROKEN = "the lens model has no ray here"


class Sensor:
    """The frame of `width` × `height` units, with `below` units for a scale bar."""

    def __init__(self, image_size: tuple[int, int], below: float = 0.0) -> None:
        across, down = image_size
        self.width = WIDTH * min(1.0, 1.1 * across / down)
        self.scale = self.width / across
        self.height = down * self.scale
        self.below = below

    def to(self, xy: Array) -> Array:
        """Pixel coordinates (…, 2) in drawing units; the outer edge of the first pixel is at 0."""
        return (np.asarray(xy, float) + 0.5) * self.scale

    def clipped(self, *children: object) -> Markup:
        """`children`, clipped to the frame."""
        return tag("svg", *children, width=self.width, height=self.height)

    def draw(self, label: str, *children: object) -> Markup:
        """The frame with `children` drawn on it."""
        frame = tag("rect", class_="sensor", x=0.5, y=0.5, width=self.width - 1, height=self.height - 1)
        most = f"{coordinate(self.width * 1.3, 0)}px" if self.width < WIDTH else None
        return plot(label, frame, *children, width=self.width, height=self.height + self.below, most=most)


def coverage_map(calibration: Calibration, facts: Facts) -> Drawing:
    """All used corners over the sensor; cells without a corner are hatched, cells outside the lens's
    field of view are grey."""
    sensor = Sensor(calibration.camera.image_size)
    rows, cols = facts.coverage.shape
    size = np.array([sensor.width / cols, sensor.height / rows])
    corner = np.stack(np.meshgrid(np.arange(cols), np.arange(rows)), axis=-1) * size
    empty, blind = facts.in_view & (facts.coverage == 0), ~facts.in_view
    broken = empty & cell_majority(facts.broken, (cols, rows))
    xy, _ = used_residuals(calibration)
    some = thinned(len(xy), MOST_DOTS)
    across = "".join(f"M{coordinate(x * size[0])} 0V{coordinate(sensor.height)}" for x in range(1, cols))
    down = "".join(f"M0 {coordinate(y * size[1])}H{coordinate(sensor.width)}" for y in range(1, rows))
    art = sensor.draw(
        f"{len(xy)} used corners over the sensor of {' × '.join(map(str, calibration.camera.image_size))} px; "
        f"{int(empty.sum())} of {int(facts.in_view.sum())} cells are empty.",
        tag("path", class_="blind", d=_boxes(corner[blind], size)),
        tag("path", class_="broken", d=_boxes(corner[broken], size)),
        tag("path", class_="grid", d=across + down),
        tag("path", class_="hatch", d=_hatching(corner[empty], size)),
        tag("path", class_="dot", stroke_width=3, stroke_opacity=0.75, d=dots(sensor.to(xy[some]))),
    )
    marks = [("used corner", tag("path", class_="dot", stroke_width=5, d="M9 7h0"))]
    if empty.any():
        hatched = _hatching(np.array([[1.0, 0]]), np.array([16.0, 14]))
        marks.append(("cell without a corner", tag("path", class_="hatch", d=hatched)))
    if broken.any():
        marks.append((BROKEN, tag("path", class_="broken", d="M1 0h16v14h-16z")))
    if blind.any():
        marks.append(("out of the lens’s sight", tag("path", class_="blind", d="M1 0h16v14h-16z")))
    return Drawing(art, tuple(marks), note=_thinning(len(xy), len(some)))


def _boxes(corner: Array, size: Array) -> str:
    w, h = coordinate(size[0]), coordinate(size[1])
    return "".join(f"M{coordinate(x)} {coordinate(y)}h{w}v{h}h-{w}z" for x, y in corner)


def _hatching(corner: Array, size: Array, gap: float = 7.0) -> str:
    """Diagonal hatching in boxes of `size` at `corner` (N, 2), continuous across adjacent boxes."""
    out = []
    w, h = size
    for x, y in corner:
        for c in np.arange(np.ceil((x + y) / gap), np.floor((x + y + w + h) / gap) + 1) * gap:
            start, end = max(x, c - y - h), min(x + w, c - y)
            if end - start > 0.5:
                out.append([[start, c - start], [end, c - end]])
    lines = np.array(out).reshape(-1, 2, 2)
    return segments(lines[:, 0], lines[:, 1])


def residual_map(calibration: Calibration) -> Drawing:
    """One line per corner, from the corner along its residual, strongly enlarged."""
    sensor = Sensor(calibration.camera.image_size, below=30)
    xy, residuals = used_residuals(calibration)
    longer = np.hypot(*residuals.T)
    stretch = TYPICAL / max(float(np.quantile(longer, 0.9)) if len(xy) else 1.0, 1e-9)
    some = thinned(len(xy), MOST_DOTS)
    start = sensor.to(xy[some])
    lines = segments(start, start + residuals[some] * stretch)
    art = sensor.draw(
        f"Residuals of {len(xy)} corners as lines over the sensor, enlarged {number(stretch / sensor.scale, 2)} times. "
        f"The longest is {number(longer.max(initial=0))} px.",
        sensor.clipped(tag("path", class_="line", stroke_width=1, stroke_opacity=0.8, d=lines)),
        tag("path", class_="dot", stroke_width=2.2, d=dots(start)),
        scale_bar(sensor, stretch, f"enlarged {number(stretch / sensor.scale, 2)} ×"),
    )
    return Drawing(art, note=_thinning(len(xy), len(some)))


def mean_map(calibration: Calibration, cells: Cells) -> Drawing:
    """Mean residuals in `cells` of the sensor as arrows, with statistically significant ones highlighted."""
    sensor = Sensor(calibration.camera.image_size, below=30)
    where, mean, systematic = cells.where, cells.mean, cells.systematic
    size = np.hypot(*mean.T)
    stretch = 1.6 * TYPICAL / max(float(size.max(initial=0.0)), 1e-9)
    start = sensor.to(where) - mean * stretch / 2
    end = start + mean * stretch
    sentence = _means(cells, size)
    drawn = [
        tag(
            "path",
            class_=f"line{' systematic' if red else ''}",
            stroke_width=2.2 if red else 1.3,
            d=arrows(start[pick], end[pick]),
        )
        for red, pick in ((False, ~systematic), (True, systematic))
        if pick.any()
    ]
    art = sensor.draw(
        f"Mean residual in each cell of the sensor. {sentence}",
        sensor.clipped(*drawn),
        scale_bar(sensor, stretch, f"enlarged {number(stretch / sensor.scale, 2)} ×"),
    )
    marks = (
        ("as chance would have it", tag("path", class_="line", stroke_width=1.3, d="M1 7h15m-4-4l4 4l-4 4")),
        ("systematic", tag("path", class_="line systematic", stroke_width=2.2, d="M1 7h15m-4-4l4 4l-4 4")),
    )
    return Drawing(art, marks, sentence)


def _means(cells: Cells, size: Array) -> str:
    """A sentence on the mean residuals in `cells`, which are `size` (N,) px long."""
    if not len(size):
        return "No cell was seen in enough views for a mean."
    many, odd = counted(len(size), "cell"), int(cells.systematic.sum())
    if not odd:
        return f"Nothing stands out from chance in {many}; the largest mean is {number(float(size.max()), 2)} px."
    return (
        f"{odd} of {many} stand{'s' if odd == 1 else ''} out from chance, the largest by "
        f"{number(cells.largest, 2)} px: there the lens model, or the board’s flatness, may not be quite right."
    )


def arrows(start: Array, end: Array) -> str:
    """Arrows from `start` to `end` (N, 2), units; the head has a fixed size, but at most half the length of the
    arrow."""
    along = end - start
    length = np.maximum(np.hypot(*along.T), 1e-9)[:, None]
    back = along / length * np.minimum(4.5, 0.5 * length)
    side = back[:, ::-1] * [-1, 1] * 0.7
    return segments(start, end) + segments(end - back + side, end) + segments(end - back - side, end)


def scale_bar(sensor: Sensor, stretch: float, words: str) -> Markup:
    """A scale bar below the frame for a residual of a round number of px, and `words`."""
    value = nice(45 / stretch)
    value = value if value * stretch < sensor.width / 3 else nice(18 / stretch)
    y, right = sensor.height + 19, 1 + value * stretch
    bar = tag("path", class_="mean", d=f"M1 {coordinate(y - 4)}v8m0-4H{coordinate(right)}m0-4v8")
    text = tag("text", f"{coordinate(value, 6)} px", class_="strong", x=right + 7, y=y + 4)
    return each([bar, text, tag("text", words, x=sensor.width, y=y + 4, text_anchor="end")])


def uncertainty_map(calibration: Calibration, facts: Facts) -> Drawing:
    """Bands of the projection uncertainty over the sensor, with values at the centre and in the corners, and the convex
    hull of the used corners."""
    sensor = Sensor(calibration.camera.image_size)
    field = facts.uncertainty
    levels = band_levels(field)
    band = np.where(np.isfinite(field), np.searchsorted(levels, np.nan_to_num(field)), np.where(facts.broken, -2, -1))
    step = np.array([sensor.width / field.shape[1], sensor.height / field.shape[0]])
    bands = [
        tag(
            "path",
            class_={-1: "blind", -2: "broken"}.get(int(b), "heat"),
            fill_opacity=None if b < 0 else shade(b, len(levels)),
            d=runs(band == b, step),
        )
        for b in np.unique(band)
    ]
    xy, _ = used_residuals(calibration)
    hull = cv2.convexHull(xy.astype(np.float32))[:, 0] if len(xy) > 2 else np.zeros((0, 2))
    rim = outline(sensor.to(hull))
    art = sensor.draw(
        f"Projection uncertainty over the sensor: median {pixels(facts.typical)}, "
        f"worst of the corners {pixels(facts.at_corners)}.",
        tag("g", each(bands), shape_rendering="crispEdges"),
        tag("path", class_="rule", fill="none", d=rim) if rim else None,
        _values(sensor, facts),
    )
    return Drawing(art, _marks(levels, int(band.min())))


def band_levels(field: Array) -> Array:
    """Round limits (1, 2, 5 × 10ⁿ, or more closely spaced ones if those are too few) inside the range of `field`, at
    most BANDS − 1; the largest are dropped first, since very large values at the rim need no finer distinction."""
    known = field[np.isfinite(field) & (field > 0)]
    if not len(known):
        return np.array([1.0])
    powers = range(int(np.floor(np.log10(known.min()))), int(np.ceil(np.log10(known.max()))) + 1)
    for steps in STEPS:
        inside = [m * 10.0**p for p in powers for m in steps if known.min() < m * 10.0**p < known.max()]
        if len(inside) >= FEWEST_BANDS:
            break
    return np.array(inside[: BANDS - 1] or [nice(float(known.max()))])


def shade(band: int, levels: int) -> str:
    """Opacity of band number `band` for `levels` limits."""
    return coordinate(0.04 + 0.78 * band / max(levels, 1), 2)


def runs(mask: Array, step: Array) -> str:
    """A path of boxes that cover the true cells of `mask`, one for each run in a row."""
    out = []
    edge = np.diff(np.pad(mask.astype(int), ((0, 0), (1, 1))), axis=1)
    tall = coordinate(step[1], 2)
    for row in range(len(mask)):
        for a, b in zip(np.flatnonzero(edge[row] == 1), np.flatnonzero(edge[row] == -1), strict=True):
            wide = coordinate((b - a) * step[0])
            out.append(f"M{coordinate(a * step[0])} {coordinate(row * step[1], 2)}h{wide}v{tall}h-{wide}z")
    return "".join(out)


def _values(sensor: Sensor, facts: Facts) -> Markup:
    """The values at the centre and in each corner."""
    w, h = sensor.width, sensor.height
    (a, b), (c, d) = facts.corners
    spots = [
        (a, 8, 18, "start"), (b, w - 8, 18, "end"), (c, 8, h - 9, "start"), (d, w - 8, h - 9, "end"),
        (facts.middle, w / 2, h / 2 + 4, "middle"),
    ]  # fmt: skip
    return each([
        tag("text", f"{number(v, 2)} px", class_="strong halo", x=float(x), y=float(y), text_anchor=anchor)
        for v, x, y, anchor in spots
        if np.isfinite(v)
    ])  # fmt: skip


def band_marks(levels: Array, unit: str = " px") -> list[tuple[str, Markup]]:
    """Legend entries, one for each band between `levels`."""
    edges = [coordinate(v, 9) for v in levels]
    words = [
        f"below {edges[0]}{unit}",
        *(f"{a}–{b}" for a, b in pairwise(edges)),
        f"above {edges[-1]}",
    ]
    box = "M1 0h16v14h-16z"
    return [(w, tag("path", class_="heat", fill_opacity=shade(k, len(levels)), d=box)) for k, w in enumerate(words)]


def _marks(levels: Array, least: int) -> tuple[tuple[str, Markup], ...]:
    box = "M1 0h16v14h-16z"
    marks = band_marks(levels)
    marks.append(("hull of the used corners", tag("path", class_="rule", fill="none", d="M0 7h18")))
    if least < 0:
        word, kind = (BROKEN, "broken") if least == -2 else ("out of the lens’s sight", "blind")
        marks.append((word, tag("path", class_=kind, d=box)))
    return tuple(marks)


def _thinning(many: int, shown: int) -> str:
    """A note if not all corners are drawn."""
    if shown == many:
        return ""
    return f"{shown:,} of {many:,} corners are drawn ({percent(shown / many)}), spread evenly."
