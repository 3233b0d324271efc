"""The report of a comparison of two cameras: the difference over the frame, also relative to their uncertainty."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from markupsafe import Markup

from rcdn.calibration.comparison import Comparison
from rcdn.errors import present
from rcdn.io import write_text
from rcdn.report.calibration.formats import DASH, coordinate, counted, number, percent, pixels, value_and_std
from rcdn.report.calibration.maps import Sensor, arrows, band_levels, band_marks, runs, scale_bar, shade
from rcdn.report.calibration.page import filled
from rcdn.report.calibration.svg import Drawing, each, outline, tag
from rcdn.types import Array, Calibration, Camera

LONGEST = 26.0
"""drawn length of the 95th percentile of the vectors, units"""
EVERY = 5
"""spacing of the arrows, in grid points"""


@dataclass(frozen=True)
class Compared:
    """The figures of the page: names, models and image size of A and B; statistics of the difference over the `area`,
    px, at `points`; the fraction of the frame that it is (`share`), and the rotation, degrees (`angle`); the `level` of
    the result, if there is one, and the `sentences` about it, its title first."""

    names: tuple[str, str]
    models: tuple[str, str]
    size: tuple[int, int]
    area: str
    points: str
    rms: float
    median: float
    largest: float
    share: float
    angle: float
    level: str
    sentences: list[str]


def write_comparison_report(
    path: str | Path,
    found: Comparison,
    names: tuple[str, str] = ("A", "B"),
    sources: tuple[Camera | Calibration, Camera | Calibration] | None = None,
    title: str = "Two cameras compared",
) -> None:
    """Write the page of `found` to `path`: one HTML file that needs no network and no script.

    `names` of the two cameras, such as those of their files; `sources`: the compared cameras or calibrations, for their
    standard deviations. Raises OutputError if it can't be written.
    """
    stated = found.agreement
    payload = {
        "title": title,
        "compared": Compared(
            names=names,
            models=(found.cameras[0].model, found.cameras[1].model),
            size=found.cameras[0].image_size,
            area=area_of(found),
            points=points_of(found),
            **statistics(found),
            level="" if stated is None else "good" if stated.agree else "fair",
            sentences=_sentences(found),
        ),
        "difference": _difference(found),
        "ratio": stated and {"drawing": _ratio(found), "rms": stated.rms, "expected": stated.expected},
        "figures": figures(found),
        "parameters": _parameters(found.cameras, sources),
    }
    write_text(path, filled("comparison", payload))


def statistics(found: Comparison) -> dict[str, float]:
    """RMS, median and largest length of the difference over the area, px; the fraction of the frame's points in the
    area; the angle of the rotation, degrees."""
    lengths = found.over_area.lengths
    return {
        "rms": found.over_area.rms,
        "median": float(np.median(lengths)),
        "largest": float(lengths.max()),
        "share": float(found.inside.mean()),
        "angle": found.found.angle,
    }


def area_of(found: Comparison) -> str:
    """The area in words."""
    share = percent(float(found.inside.mean()))
    if found.where == "frame":
        return "the frame" if found.inside.all() else f"the {share} of the frame where both have rays"
    whose = "both calibrations" if len(found.outlines) > 1 else "the calibration"
    return f"the {share} of the frame that the corners of {whose} cover"


def points_of(found: Comparison) -> str:
    """The points that the statistics are of, in words: middles of cells, so that the frame's corners are none of
    them."""
    return f"{counted(int(found.inside.sum()), 'point')} over {area_of(found)}"


def figures(found: Comparison) -> list[tuple[str, str]]:
    """(name, value) of each figure, the statistics of the area's points first."""
    values = statistics(found)
    area = found.over_area
    x, y = area.points[int(np.argmax(area.lengths))]
    (a, b), (c, d) = np.linalg.norm(found.ends, axis=2)
    turn = [coordinate(v, 3) for v in np.degrees(found.found.rotation)]
    return [
        ("RMS", pixels(values["rms"])),
        ("median", pixels(values["median"])),
        ("largest of these", f"{pixels(values['largest'])} at ({x:.0f}, {y:.0f})"),
        ("in the middle of the frame", pixels(float(np.linalg.norm(found.middle)))),
        ("in its upper corners", f"{pixels(a)} left, {pixels(b)} right"),
        ("in its lower corners", f"{pixels(c)} left, {pixels(d)} right"),
        (
            "rotation taken out",
            f"{values['angle']:.3f}° (about x {turn[0]}°, y {turn[1]}°, z {turn[2]}°)",
        ),
    ]


def judgement(found: Comparison) -> list[str]:
    """Sentences on whether the cameras agree within their stated uncertainty; none unless both have one."""
    stated = found.agreement
    if stated is None:
        return []
    by_chance = f"1 is expected, {number(stated.expected, 2)} in one of 100 cases"
    ratio = f"difference ÷ stated {number(stated.rms, 2)} (RMS; {by_chance})"
    words = "They agree within their uncertainty" if stated.agree else "They differ by more than they state"
    out = [f"{words}: {ratio}."]
    if found.shared:
        both = counted(found.shared, "view has", "views have")
        out.append(
            f"{both} the same corners in both: they are not independent, and closer than two sets of pictures would be."
        )
    return out


def _sentences(found: Comparison) -> list[str]:
    """The judgement with its first sentence in two: a title, and the figures behind it."""
    sentences = judgement(found)
    if not sentences:
        return []
    title, _, why = sentences[0].partition(": ")
    return [title, why[:1].upper() + why[1:], *sentences[1:]]


def _difference(found: Comparison) -> Drawing:
    """The length of the difference over the frame, and its vectors."""
    sensor = Sensor(found.cameras[0].image_size, below=30)
    field, step, grid = _field(found, found.found.lengths, sensor)
    vectors, stretch = _vectors(found, sensor, grid)
    levels = band_levels(field)
    art = sensor.draw(
        f"Length of the difference over the frame: {pixels(found.over_area.rms)} RMS over the area, "
        f"at most {pixels(float(np.nanmax(field)))}.",
        _bands(field, levels, step),
        _outlines(found, sensor),
        sensor.clipped(vectors),
        scale_bar(sensor, stretch, f"enlarged {number(stretch / sensor.scale, 2)} ×"),
    )
    marks = [*band_marks(levels), ("where B sees it", tag("path", class_="mean", d="M1 7h15m-4-4l4 4l-4 4"))]
    if found.outlines:
        marks.append(("hull of a calibration’s corners", tag("path", class_="rule", fill="none", d="M0 7h18")))
    return Drawing(art, tuple(marks))


def _ratio(found: Comparison) -> Drawing:
    """The difference over the frame, divided by what both state."""
    agreement = present(found.agreement, "Comparison.agreement")
    sensor = Sensor(found.cameras[0].image_size)
    field, step, _ = _field(found, agreement.ratio, sensor)
    levels = np.array([0.5, 1, 1.5, 2, 3, 5])
    levels = levels[: max(int(np.searchsorted(levels, np.nanmax(field))), 2)]
    art = sensor.draw(
        f"Difference divided by what both calibrations state: {number(agreement.rms, 2)} RMS over the area.",
        _bands(field, levels, step),
        _outlines(found, sensor),
    )
    return Drawing(art, tuple(band_marks(levels, "")))


def _field(found: Comparison, values: Array, sensor: Sensor) -> tuple[Array, Array, Array]:
    """`values` (N,) of the grid's points as an array (rows, cols), NaN where there is no point; the size of a cell in
    units; and the (row, column) of each point."""
    points = found.found.points
    pitch = float(np.min(np.diff(np.unique(points[:, 0])))) if len(np.unique(points[:, 0])) > 1 else 1.0
    width, height = found.cameras[0].image_size
    cols, rows = max(round(width / pitch), 1), max(round(height / pitch), 1)
    size = np.array([width / cols, height / rows])
    at = np.floor((points + 0.5) / size).astype(int).clip(0, [cols - 1, rows - 1])
    field = np.full((rows, cols), np.nan)
    field[at[:, 1], at[:, 0]] = values
    return field, size * sensor.scale, at[:, ::-1]


def _bands(field: Array, levels: Array, step: Array) -> Markup:
    band = np.where(np.isfinite(field), np.searchsorted(levels, np.nan_to_num(field)), -1)
    drawn = [
        tag(
            "path",
            class_="blind" if b < 0 else "heat",
            fill_opacity=None if b < 0 else shade(int(b), len(levels)),
            d=runs(band == b, step),
        )
        for b in np.unique(band)
    ]
    return tag("g", each(drawn), shape_rendering="crispEdges")


def _vectors(found: Comparison, sensor: Sensor, grid: Array) -> tuple[Markup, float]:
    """Arrows at every EVERY-th point, and their scale in units per px."""
    lengths = found.found.lengths
    stretch = LONGEST / max(float(np.nanquantile(lengths, 0.95)), 1e-12)
    some = ((grid % EVERY) == EVERY // 2).all(axis=1) & np.isfinite(lengths)
    start = sensor.to(found.found.points[some])
    return tag("path", class_="mean", d=arrows(start, start + stretch * found.found.vectors[some])), stretch


def _outlines(found: Comparison, sensor: Sensor) -> Markup:
    return each([tag("path", class_="rule", fill="none", d=outline(sensor.to(hull))) for hull in found.outlines])


def _parameters(
    cameras: tuple[Camera, Camera], sources: tuple[Camera | Calibration, Camera | Calibration] | None
) -> list[tuple[str, str, str]]:
    """The parameters of both cameras by name, with standard deviations if known."""
    columns: list[dict[str, str]] = []
    for camera, source in zip(cameras, sources or cameras, strict=True):
        std = source.std if isinstance(source, Calibration) else np.full(len(camera.parameters), np.nan)
        shown = [value_and_std(float(v), float(s)) for v, s in zip(camera.parameters, std, strict=True)]
        columns.append(
            dict(zip(camera.parameter_names, (v if s == DASH else f"{v} ± {s}" for v, s in shown), strict=True))
        )
    a, b = columns
    return [(name, a.get(name, DASH), b.get(name, DASH)) for name in dict.fromkeys([*a, *b])]
