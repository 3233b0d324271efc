"""Charts as SVG: bars of each view, residuals against the radius. A chart is WIDTH user units wide."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from markupsafe import Markup

from rcdn.calibration.residual_facts import used_residuals
from rcdn.calibration.sight import off_axis
from rcdn.report.calibration.formats import coordinate, number, pixels
from rcdn.report.calibration.svg import Drawing, crosses, dots, each, join, outline, polyline, tag
from rcdn.types import Array, Calibration

WIDTH, HEIGHT = 440, 280
LEFT, RIGHT, TOP, BOTTOM = 46, 8, 24, 40
MOST_DOTS = 6000
"""largest number of dots in a drawing; more are thinned evenly"""
WORSE = 1.5
"""multiple of the overall RMS above which a view's bar is highlighted"""
BAND, FEWEST = 18, 8
"""number of bins of the radius, and smallest number of corners in a bin for a mean"""


def plot(
    label: str,
    *children: object,
    height: float = HEIGHT,
    width: float = WIDTH,
    most: str | None = None,
    projection: str | None = None,
) -> Markup:
    """An SVG of `width` × `height` units with `label` as its description for screen readers; `most`: its maximum CSS
    width; `projection`: the numbers that the page's script needs to rotate it."""
    return tag(
        "svg",
        *children,
        class_="plot" if projection is None else "plot space",
        data_look=projection,
        viewBox=f"0 0 {coordinate(width)} {coordinate(height)}",
        role="img",
        aria_label=label,
        style=f"max-width:{most}" if most else None,
    )


def ticks(low: float, high: float, most: int) -> Array:
    """Round tick values from `low` to `high`, in about `most` steps of 1, 2 or 5 times a power of ten."""
    step = nice((high - low) / most)
    return np.arange(np.ceil(low / step - 1e-9), np.floor(high / step + 1e-9) + 1) * step


def nice(value: float) -> float:
    """The smallest of 1, 2, 5 × 10ⁿ that isn't below `value`; 1 if `value` isn't positive and finite."""
    if not np.isfinite(value) or value <= 0:
        return 1.0
    power = 10.0 ** np.floor(np.log10(value))
    return float(next(m * power for m in (1, 2, 5, 10) if m * power >= value * (1 - 1e-9)))


@dataclass(frozen=True)
class Axes:
    """The mapping from data to drawing units: x in `left`..`right`, y in `low`..`high`."""

    left: float
    right: float
    low: float
    high: float

    def x(self, value: Array | float) -> Array:
        """Horizontal position in units."""
        return LEFT + (np.asarray(value) - self.left) / (self.right - self.left) * (WIDTH - LEFT - RIGHT)

    def y(self, value: Array | float) -> Array:
        """Vertical position in units, downwards."""
        return HEIGHT - BOTTOM - (np.asarray(value) - self.low) / (self.high - self.low) * (HEIGHT - TOP - BOTTOM)

    def rows(self, name: str) -> Markup:
        """Horizontal grid lines with numbers, and the axis' name above."""
        out = [tag("text", name, x=0, y=11)]
        for value in ticks(self.low, self.high, 5):
            y = float(self.y(value))
            out.append(tag("path", class_="grid", d=f"M{LEFT} {coordinate(y)}H{WIDTH - RIGHT}"))
            label = coordinate(value, 4).replace("-", "−")
            out.append(tag("text", label, x=LEFT - 6, y=y + 4, text_anchor="end"))
        return each(out)

    def columns(self, name: str, values: Array) -> Markup:
        """The horizontal axis with numbers at `values`, and the axis' name below them."""
        y = HEIGHT - BOTTOM
        out = [tag("path", class_="axis", d=f"M{LEFT} {y}H{WIDTH - RIGHT}")]
        out += [
            tag("text", coordinate(v).replace("-", "−"), x=float(self.x(v)), y=y + 15, text_anchor="middle")
            for v in values
        ]
        out.append(tag("text", name, x=WIDTH - RIGHT, y=HEIGHT - 6, text_anchor="end"))
        return each(out)


@dataclass(frozen=True)
class Bar:
    """The bar of a view: its `value` (NaN: no bar), whether the view was left `out`, its `tooltip`, and the
    anchor of its link."""

    value: float
    out: bool
    tooltip: str
    leads_to: str


def view_bars(calibration: Calibration, key: str = "") -> Drawing:
    """RMS of each view in the order of the input; views left out are dashed and crossed. Each bar links to its picture,
    whose anchor contains `key`."""
    bars = []
    for k, view in enumerate(calibration.views, start=1):
        tooltip = f"view {k}: {view.name}, {pixels(view.rms)}" + (f", left out: {view.reason}" if view.reason else "")
        bars.append(Bar(view.rms, bool(view.reason), tooltip, f"#view-{key}{k}"))
    return bar_chart(bars, calibration.rms, "RMS, px", "view")


def bar_chart(bars: list[Bar], overall: float, name: str, what: str) -> Drawing:
    """Bars in the given order, with a dashed line at `overall`; `name` of the values; `what` a bar represents. Bars of
    views left out don't extend the axis: they are cut off at its top with a mark."""
    values = np.array([b.value for b in bars], float)
    within = values[[np.isfinite(b.value) and not b.out for b in bars]] if bars else values
    top = 1.15 * float(within.max() if len(within) else np.nanmax(values, initial=0.0)) or 1.0
    axes = Axes(0.5, len(bars) + 0.5, 0.0, top)
    slot = (WIDTH - LEFT - RIGHT) / max(len(bars), 1)
    drawn = each([_bar(axes, k, bar, overall, min(0.76 * slot, 26)) for k, bar in enumerate(bars, start=1)])
    rule = None
    if np.isfinite(overall) and overall <= top:
        rule = tag("path", class_="rule", d=f"M{LEFT} {coordinate(float(axes.y(overall)))}H{WIDTH - RIGHT}")
    label = (
        f"{name.split(',')[0]} of each of {len(bars)} {what}s, in the order of the input. "
        f"All used together: {pixels(overall)}."
    )
    art = plot(label, axes.rows(name), drawn, rule, axes.columns(what, _bar_names(len(bars), slot)))
    return Drawing(art, _bar_marks(bars, overall))


def _bar_marks(bars: list[Bar], overall: float) -> tuple[tuple[str, Markup], ...]:
    """The legend of the kinds of bars that occur."""
    box = "M2 2h14v12h-14z"
    marks = [("used", tag("path", class_="bar", d=box))]
    if any(not b.out and b.value > WORSE * overall for b in bars):
        marks.append((f"over {WORSE:g} × the dashed line", tag("path", class_="bar worse", d=box)))
    if any(b.out for b in bars):
        crossed = tag("path", class_="cross", d="M6 5l6 6m0-6l-6 6")
        marks.append(("left out", join(tag("path", class_="bar out", d=box), crossed)))
    return tuple(marks)


def _bar_names(many: int, slot: float) -> Array:
    """The numbers shown below the bars, as many as there is room for."""
    room = 36 / slot
    every = next(s for s in (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 10**9) if s >= room)
    return np.array([k for k in range(1, many + 1) if k == 1 or (k % every == 0 and k - 1 >= room)], float)


def _bar(axes: Axes, k: int, bar: Bar, overall: float, wide: float) -> Markup:
    x, base = float(axes.x(k)), HEIGHT - BOTTOM
    y = float(axes.y(min(bar.value, axes.high))) if np.isfinite(bar.value) else base
    kind = "bar out" if bar.out else "bar worse" if bar.value > WORSE * overall else "bar"
    marks = [tag("rect", class_=kind, x=x - wide / 2, y=y, width=wide, height=max(base - y, 0.0))]
    if bar.out:
        h = min(max(wide / 2, 2.0), 5.0)
        marks.append(tag("path", class_="cross", d=crosses(np.array([[x, base - 9]]), h)))
    if np.isfinite(bar.value) and bar.value > axes.high:  # cut off at the top of the chart
        marks.append(tag("path", class_="cross", d=f"M{coordinate(x - 3)} {TOP - 1}l3-4 3 4"))
    return tag("a", tag("title", bar.tooltip), *marks, href=bar.leads_to, tabindex="-1")


def radius_chart(calibration: Calibration) -> Drawing:
    """The radial component of the residuals against the distance from the principal point."""
    _, outward, radius = _outward(calibration)
    camera = calibration.camera
    width, height = camera.image_size
    ends = np.array([[0, 0], [width, 0], [0, height], [width, height]]) - camera.K[:2, 2]
    far = float(np.hypot(*ends.T).max())
    marks = (
        ("corner", tag("path", class_="dot", stroke_width=5, d="M9 7h0")),
        ("running mean", tag("path", class_="mean", d="M0 7h18")),
        ("± one standard deviation", tag("path", class_="band", d="M0 1h18v12h-18z")),
    )
    return replace(_against(radius, outward, far, "radius", "distance from the principal point, px"), marks=marks)


def angle_chart(calibration: Calibration) -> Drawing:
    """As `radius_chart`, against the angle between the corner's ray and the optical axis, the variable of the lens
    models; up to the largest angle of a corner."""
    xy, outward, _ = _outward(calibration)
    angle = off_axis(calibration.camera, xy)
    seen = np.isfinite(angle)
    far = 1.05 * float(angle[seen].max(initial=1.0))
    return _against(angle[seen], outward[seen], far, "angle off the axis", "angle off the axis, degrees")


def _outward(calibration: Calibration) -> tuple[Array, Array, Array]:
    """Used corners (N, 2), the component (N,) of their residuals away from the principal point, and their distance (N,)
    from it, px."""
    xy, residuals = used_residuals(calibration)
    away = xy - calibration.camera.K[:2, 2]
    radius = np.hypot(*away.T)
    return xy, (residuals * away).sum(axis=1) / np.maximum(radius, 1e-9), radius


def _against(position: Array, outward: Array, far: float, what: str, name: str) -> Drawing:
    """A scatter plot of `outward` (N,) over `position` (N,) up to `far`, with the running mean; `what` the position is,
    `name` of its axis."""
    reach = float(np.quantile(np.abs(outward), 0.995)) * 1.15 if len(outward) else 1.0
    axes = Axes(0.0, far, -reach or -1.0, reach or 1.0)
    some = thinned(len(position), MOST_DOTS)
    shown = np.stack([axes.x(position[some]), axes.y(np.clip(outward[some], axes.low, axes.high))], axis=-1)
    middle, mean, spread = _running(position, outward, far)
    sentence = ""
    if len(middle):
        worst = int(np.argmax(np.abs(mean)))
        scatter = number(float(np.std(outward)), 2)
        sentence = (
            f"The running mean stays within ±{number(abs(mean[worst]), 2)} px; "
            f"single residuals scatter by {scatter} px (one standard deviation)."
        )
    art = plot(
        f"Residuals against the {what}, {len(position)} corners. {sentence}",
        axes.rows("outward part of the residual, px"),
        tag("path", class_="dot", stroke_width=2.6, stroke_opacity=0.35, d=dots(shown)),
        _ribbon(axes, middle, mean, spread),
        axes.columns(name, ticks(0, far, 5)),
    )
    return Drawing(art, caption=sentence)


def _running(radius: Array, values: Array, far: float) -> tuple[Array, Array, Array]:
    """Mean radius, mean and standard deviation of the values in each bin of the radius with enough corners."""
    band = np.minimum((radius / far * BAND).astype(int), BAND - 1)
    rows = [
        (radius[band == b].mean(), values[band == b].mean(), values[band == b].std())
        for b in range(BAND)
        if (band == b).sum() >= FEWEST
    ]
    table = np.array(rows).reshape(-1, 3)
    return table[:, 0], table[:, 1], table[:, 2]


def _ribbon(axes: Axes, middle: Array, mean: Array, spread: Array) -> Markup | None:
    if len(middle) < 2:
        return None
    top, bottom, line = (
        np.column_stack([axes.x(middle), axes.y(np.clip(v, axes.low, axes.high))])
        for v in (mean + spread, mean - spread, mean)
    )
    area = tag("path", class_="band", d=outline(np.concatenate([top, bottom[::-1]])))
    return each([area, tag("path", class_="mean", d=polyline(line))])


def thinned(many: int, most: int) -> Array:
    """Indices of at most `most` of `many` rows, evenly spaced and deterministic."""
    return np.arange(many) if many <= most else np.linspace(0, many - 1, most).astype(int)
