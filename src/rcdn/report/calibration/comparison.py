"""The report of a comparison of two cameras: the difference over the frame, also relative to their uncertainty."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rcdn.calibration.comparison import Comparison
from rcdn.errors import present
from rcdn.io import write_text
from rcdn.report.calibration import sections, verdict
from rcdn.report.calibration.charts import legend
from rcdn.report.calibration.maps import Sensor, arrows, band_levels, band_marks, runs, scale_bar, shade
from rcdn.report.calibration.markup import (
    Html,
    coordinate,
    counted,
    each,
    join,
    number,
    percent,
    pixels,
    tag,
    value_and_std,
)
from rcdn.report.calibration.page import page, pair
from rcdn.types import Array, Calibration, Camera

LONGEST = 26.0
"""drawn length of the 95th percentile of the vectors, units"""
EVERY = 5
"""spacing of the arrows, in grid points"""
WORDS = (
    (
        "Difference",
        "Each pixel of A has a ray. The rays are rotated together, then projected by B: the vector leads from the pixel to where B sees its ray. "
        "One rotation for all pixels, which makes the sum of squared lengths over the area least; it is no difference of the lenses, for a "
        "camera’s axes are a matter of convention.",
    ),
    (
        "Area",
        "Inside the convex hulls of the used corners of every calibration given; without corners, or if asked for, wherever both cameras have rays.",
    ),
    (
        "Difference ÷ stated",
        "√(vᵀ C⁻¹ v ÷ 2) of the vector v with the covariance C that both calibrations’ covariances give it, as if they had no picture in common; "
        "the rotation is fitted in it, too. Its mean square is 1 by chance alone.",
    ),
)
"""how each figure is defined"""


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
    width, height = found.cameras[0].image_size
    first, second = (sections.short(n) for n in names)
    line = f"A: {first} ({found.cameras[0].model}) and B: {second} ({found.cameras[1].model}), {width} × {height} px"
    head = join(_banner(found), sections.key_figures(_key(found)))
    maps = [_difference_figure(found)]
    if found.agreement is not None:
        maps.append(_ratio_figure(found))
    parts = [
        ("frame", "Over the frame", pair(*maps)),
        ("numbers", "The numbers", pair(_figures_table(found), _parameters_table(found.cameras, sources))),
        ("meaning", "What the figures mean", sections.definitions(WORDS)),
    ]
    write_text(path, page(title, line, head, parts, f"A: {names[0]}; B: {names[1]}."))


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


def figures(found: Comparison) -> list[tuple[str, str]]:
    """(name, value) of each figure, those over the area first."""
    values = statistics(found)
    area = found.over_area
    x, y = area.points[int(np.argmax(area.lengths))]
    (a, b), (c, d) = np.linalg.norm(found.ends, axis=2)
    turn = [coordinate(v, 3) for v in np.degrees(found.found.rotation)]
    return [
        ("RMS", pixels(values["rms"])),
        ("median", pixels(values["median"])),
        ("largest", f"{pixels(values['largest'])} at ({x:.0f}, {y:.0f})"),
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
    ratio = f"difference ÷ stated {number(stated.rms, 2)} (RMS; 1 is expected, {number(stated.expected, 2)} in one of 100 cases)"
    words = "They agree within their uncertainty" if stated.agree else "They differ by more than they state"
    out = [f"{words}: {ratio}."]
    if found.shared:
        both = counted(found.shared, "view has", "views have")
        out.append(
            f"{both} the same corners in both: they are not independent, and closer than two sets of pictures would be."
        )
    return out


def _banner(found: Comparison) -> Html:
    """The result of the comparison as a heading and sentences."""
    stated = found.agreement
    told = judgement(found)
    level = "" if stated is None else "good" if stated.agree else "fair"
    title = told[0].split(":")[0] if told else f"{pixels(found.over_area.rms)} apart"
    text = f"Over {area_of(found)}, B sees what A sees {pixels(found.over_area.rms)} away (RMS), after a rotation by {found.found.angle:.3f}°. "
    rest = [_sentence(told[0].partition(": ")[2]), *told[1:]] if told else []
    if not told:
        rest = ["Give two calibrations (written by rcdn calibrate --json) to set it against what they state."]
    words = tag("div", tag("h2", title, id="verdict"), tag("p", text))
    return tag(
        "section",
        tag("div", verdict.sign(level) if level else None, words, class_="top"),
        tag("p", " ".join(rest), class_="summary"),
        class_=f"card {'verdict ' if level else ''}{level}".strip(),
        aria_labelledby="verdict",
    )


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:]


def _key(found: Comparison) -> list[tuple[str, str, str]]:
    values = statistics(found)
    out = [
        ("RMS", pixels(values["rms"]), "over the area"),
        ("Median", pixels(values["median"]), ""),
        ("Largest", pixels(values["largest"]), "over the area"),
        ("Rotation", f"{values['angle']:.3f}°", "taken out"),
        ("Area", percent(values["share"]), "of the frame"),
    ]
    if found.agreement is not None:
        stated = found.agreement
        out.append(("Difference ÷ stated", number(stated.rms, 3), f"up to {number(stated.expected, 2)} by chance"))
    return out


def _difference_figure(found: Comparison) -> Html:
    sensor = Sensor(found.cameras[0].image_size, below=30)
    field, step, grid = _field(found, found.found.lengths, sensor)
    vectors, stretch = _vectors(found, sensor, grid)
    levels = band_levels(field)
    art = sensor.draw(
        f"Length of the difference over the frame: {pixels(found.over_area.rms)} RMS over the area, at most {pixels(float(np.nanmax(field)))}.",
        _bands(field, levels, step),
        _outlines(found, sensor),
        sensor.clipped(vectors),
        scale_bar(sensor, stretch, f"enlarged {number(stretch / sensor.scale, 2)} ×"),
    )
    marks = [*band_marks(levels), ("where B sees it", tag("path", class_="mean", d="M1 7h15m-4-4l4 4l-4 4"))]
    if found.outlines:
        marks.append(("hull of a calibration’s corners", tag("path", class_="rule", fill="none", d="M0 7h18")))
    text = "Arrows lead from a pixel of A to where B sees its ray. Arrows that all point inwards or outwards are a focal length or a distortion."
    return sections.figure("Where B sees what A sees", each([art, legend(*marks)]), text)


def _ratio_figure(found: Comparison) -> Html:
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
    text = (
        f"1 is expected by chance; an RMS over {number(agreement.expected, 2)} has a probability of 1 %. Neighbours move together, so a large "
        "patch over 2 is no rarity."
    )
    return sections.figure("Difference ÷ what both state", each([art, legend(*band_marks(levels, ""))]), text)


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


def _bands(field: Array, levels: Array, step: Array) -> Html:
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


def _vectors(found: Comparison, sensor: Sensor, grid: Array) -> tuple[Html, float]:
    """Arrows at every EVERY-th point, and their scale in units per px."""
    lengths = found.found.lengths
    stretch = LONGEST / max(float(np.nanquantile(lengths, 0.95)), 1e-12)
    some = ((grid % EVERY) == EVERY // 2).all(axis=1) & np.isfinite(lengths)
    start = sensor.to(found.found.points[some])
    return tag("path", class_="mean", d=arrows(start, start + stretch * found.found.vectors[some])), stretch


def _outlines(found: Comparison, sensor: Sensor) -> Html:
    drawn = []
    for hull in found.outlines:
        outline = "L".join(f"{coordinate(x)} {coordinate(y)}" for x, y in sensor.to(hull))
        drawn.append(tag("path", class_="rule", fill="none", d=f"M{outline}z"))
    return each(drawn)


def _figures_table(found: Comparison) -> Html:
    rows = [tag("tr", tag("th", name, scope="row"), tag("td", value)) for name, value in figures(found)]
    caption = tag("caption", f"The difference over {area_of(found)}")
    return tag("div", tag("table", caption, tag("tbody", each(rows))), class_="card wide")


def _parameters_table(
    cameras: tuple[Camera, Camera], sources: tuple[Camera | Calibration, Camera | Calibration] | None
) -> Html:
    """The parameters of both cameras by name, with standard deviations if known."""
    columns = []
    for camera, source in zip(cameras, sources or cameras, strict=True):
        std = source.std if isinstance(source, Calibration) else np.full(len(camera.parameters), np.nan)
        shown = [value_and_std(float(v), float(s)) for v, s in zip(camera.parameters, std, strict=True)]
        columns.append(
            dict(zip(camera.parameter_names, (v if s == "–" else f"{v} ± {s}" for v, s in shown), strict=True))
        )
    names = list(dict.fromkeys(n for column in columns for n in column))
    rows = [
        tag("tr", tag("th", tag("code", n), scope="row"), *(tag("td", c.get(n, "–"), class_="n") for c in columns))
        for n in names
    ]
    head = tag("tr", *(tag("th", w, scope="col", class_=c) for w, c in (("parameter", None), ("A", "n"), ("B", "n"))))
    caption = tag("caption", "Parameters, which alone don’t tell how far two cameras differ")
    return tag("div", tag("table", caption, tag("thead", head), tag("tbody", each(rows))), class_="card wide")
