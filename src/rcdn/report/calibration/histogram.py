"""Residuals compared with their model: a histogram with the normal density."""

from __future__ import annotations

import numpy as np

from rcdn.report.calibration.charts import BOTTOM, HEIGHT, Axes, plot, ticks
from rcdn.report.calibration.formats import coordinate, counted, number, percent
from rcdn.report.calibration.svg import Drawing, polyline, tag
from rcdn.types import Array, Calibration

REACH, BINS = 5.0, 50
"""range of the histogram to each side, in standard deviations, and total number of bins"""
FAR, FAR_SHARE = 3.0, 0.0027
"""number of standard deviations, and the fraction of a normal distribution beyond it"""
HEAVY, CORE = 2.0, 0.85
"""multiple of FAR_SHARE above which tails are heavy; fraction of the model's quartile below which the centre is
narrow"""
QUARTILE = 0.6745
"""number of standard deviations that contains half of a normal distribution"""


def whitened(calibration: Calibration) -> Array:
    """Whitened residuals (2N,) of the used corners, both axes: divided by √(σ² + s²), with σ of the corner's detection
    and s the additional noise of the calibration."""
    parts = [np.zeros(0)]
    for view in calibration.used_views:
        residuals = view.residuals[view.used]
        scatter = np.sqrt(np.nan_to_num(view.sigma[view.used]) ** 2 + calibration.noise**2)
        parts.append((residuals / np.maximum(scatter, 1e-12)[:, None])[np.isfinite(residuals).all(axis=1)].ravel())
    return np.concatenate(parts)


def histogram(calibration: Calibration) -> Drawing:
    """A histogram of the whitened residuals with the standard normal density, which says how they differ."""
    values = whitened(calibration)
    width = 2 * REACH / BINS
    count = np.histogram(np.clip(values, -REACH, REACH), bins=BINS, range=(-REACH, REACH))[0]
    density = count / max(len(values), 1) / width
    t = np.linspace(-REACH, REACH, 121)
    curve = np.exp(-t * t / 2) / np.sqrt(2 * np.pi)
    axes = Axes(-REACH, REACH, 0.0, 1.08 * float(max(density.max(initial=0.0), curve.max())))
    sentence = _sentence(values)
    art = plot(
        f"Histogram of {counted(len(values), 'whitened residual')}, both axes, "
        f"beside a normal distribution. {sentence}",
        axes.rows("share of the residuals per standard deviation"),
        tag("path", class_="bar", d=_bars(axes, density, width)),
        tag("path", class_="mean", d=polyline(np.column_stack([axes.x(t), axes.y(curve)]))),
        axes.columns("residual ÷ its stated deviation", ticks(-REACH, REACH, 10)),
    )
    marks = (
        ("residuals", tag("path", class_="bar", d="M2 2h14v12h-14z")),
        ("what the model states", tag("path", class_="mean", d="M0 7h18")),
    )
    return Drawing(art, marks, sentence)


def _bars(axes: Axes, density: Array, width: float) -> str:
    base, out = HEIGHT - BOTTOM, []
    for k, value in enumerate(density):
        if value:
            left, right = (float(axes.x(-REACH + (k + e) * width)) for e in (0.06, 0.94))
            top = float(axes.y(value))
            out.append(f"M{coordinate(left)} {base}V{coordinate(top)}H{coordinate(right)}V{base}z")
    return "".join(out)


def _sentence(values: Array) -> str:
    """A sentence on how the residuals' distribution differs from a normal one: in its tails, at its centre, or not."""
    if not len(values):
        return "There are no residuals to look at."
    beyond, half = int((np.abs(values) > FAR).sum()), float(np.median(np.abs(values)))
    expected = FAR_SHARE * len(values)
    text = (
        f"{percent(beyond / len(values))} of the residuals are over {FAR:g} deviations ({percent(FAR_SHARE)} expected)"
    )
    text += f", half are within {number(half, 2)} ({number(QUARTILE, 2)} expected)."
    if beyond > HEAVY * expected and beyond > expected + 3 * np.sqrt(expected):
        return (
            f"{text} The tails are heavy: some corners or views err more than the rest and pull harder than they "
            "should; look at the worst views below, and at the averages over cells."
        )
    if half < CORE * QUARTILE:
        return (
            f"{text} The middle is narrow: a few views or places err more than the rest and widen the scatter of all."
        )
    return f"{text} Single corners err as the model says; whether they err together shows in the averages over cells."
