"""The report of a pair of cameras."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rcdn.calibration.epipolar import both_used
from rcdn.calibration.facts import Facts, measure
from rcdn.calibration.limits import LIMITS, STEREO_LIMITS
from rcdn.calibration.stereo_verdict import baseline_std, judge_stereo
from rcdn.errors import present
from rcdn.geometry import unproject
from rcdn.io import as_grey, write_text
from rcdn.report.calibration import charts, gallery, page, pictures, rig, sections, style, verdict
from rcdn.report.calibration.markup import (
    Html,
    counted,
    each,
    join,
    number,
    pixels,
    tag,
    value_and_std,
)
from rcdn.report.calibration.pictures import Pictures, Shot
from rcdn.types import Array, BoardView, Calibration, Camera, StereoCalibration

LINES = 7
"""rows drawn across the rectified pictures"""

WORDS = (
    (
        "Distance from epipolar lines",
        "A corner in one picture pins its partner in the other to a line. The distance of the partner from that line, px, root mean square over both "
        "pictures; it doesn’t depend on the board’s shape.",
    ),
    (
        "Row difference",
        "The same for one pair of pictures, measured between matching corners after rectification "
        "(columns, where the cameras stand above each other).",
    ),
    ("Baseline", "Distance of the two cameras’ centres. It is as right as the spacing that was given."),
    (
        "T_right_left",
        "Takes points in the left camera’s coordinates, m, to the right camera’s. Camera axes: x right, y down, z forward.",
    ),
    *page.WORDS,
)


def write_stereo_report(
    path: str | Path,
    stereo: StereoCalibration,
    left_pictures: Pictures | None = None,
    right_pictures: Pictures | None = None,
    title: str = "Stereo calibration",
) -> None:
    """Write the report of a pair of cameras to `path`: as `write_report`, with the pictures of both cameras by the
    names of their views."""
    write_text(path, report(stereo, left_pictures, right_pictures, title))


def report(stereo: StereoCalibration, left: Pictures | None, right: Pictures | None, title: str) -> str:
    """The text of the page that `write_stereo_report` writes."""
    both = ("Left", stereo.left, measure(stereo.left)), ("Right", stereo.right, measure(stereo.right))
    std = baseline_std(stereo)
    found = stereo.verdict if stereo.verdict.judged else judge_stereo(stereo)
    hint = verdict.limits_hint(stereo.left.camera.image_size)
    limits = [*STEREO_LIMITS.values(), *LIMITS.values()]
    gaps = row_gaps(stereo)
    head = join(
        verdict.banner(found, _summary(stereo, std)),
        _key_figures(stereo, std, both[0][2]),
        page.section("why", "The reasons", verdict.reasons(found, _advice(stereo), limits, hint)),
    )
    parts = [
        ("rig", "Where the cameras stand", rig.section(stereo)),
        ("pairs", "Pair by pair", _pairs(stereo, gaps)),
        ("rectified", "Rectified", _rectified(stereo, gaps, left, right)),
        ("numbers", "Each camera", _cameras(stereo)),
        ("sensor", "Over the sensors", _columns([sections.sensor_figures(c, f, f", {n.lower()}") for n, c, f in both])),
        ("residuals", "Residuals", _columns([_residuals(c, f, n) for n, c, f in both])),
    ]
    meaning = ("meaning", "What the figures mean", sections.definitions(WORDS))
    bare = _galleries(stereo, None, None, 0)
    rest = sum(len(h.encode()) for h in (head, bare, *(p[2] for p in [*parts, meaning]))) + len(style.SHEET)
    budget = max(page.LARGEST - page.SPARE - rest, 0)
    parts += [("views", "Every picture", _galleries(stereo, left, right, budget // 2)), meaning]
    names = {v.name for v in stereo.left.views} | {v.name for v in stereo.right.views}
    told = f"From {counted(len(names), 'picture')} in {counted(len(stereo.left.views), 'pair')}."
    return page.page(title, _subtitle(stereo), head, parts, told)


def _subtitle(stereo: StereoCalibration) -> str:
    cameras = " and ".join(
        "{} {} × {} px".format(c.camera.model, *c.camera.image_size) for c in (stereo.left, stereo.right)
    )
    return f"{cameras}, from {counted(len(stereo.left.views), 'pair')} of boards"


def _summary(stereo: StereoCalibration, std: float) -> str:
    length, spread = value_and_std(1000 * stereo.baseline, 1000 * std)
    rows = f"matching corners lie within {pixels(stereo.epipolar)} of each other’s epipolar lines"
    if np.isnan(stereo.epipolar):
        rows = "no corner was seen by both"
    return f"The cameras stand {length} mm apart (± {spread} mm). Corners are explained to {pixels(stereo.rms)} (RMS, both cameras), and {rows}."


def _key_figures(stereo: StereoCalibration, std: float, facts: Facts) -> Html:
    length, spread = value_and_std(1000 * stereo.baseline, 1000 * std)
    used = sum(not a.reason and not b.reason for a, b in zip(stereo.left.views, stereo.right.views, strict=True))
    return sections.key_figures([
        ("RMS, both cameras", pixels(stereo.rms), ""),
        ("Epipolar distance", "–" if np.isnan(stereo.epipolar) else pixels(stereo.epipolar), ""),
        ("Baseline", f"{length} mm", f"± {spread} mm"),
        ("Angle between the cameras", f"{number(rig.turn_angle(stereo))}°", ""),
        ("Field of view, left", *sections.field_of_view(facts.fov)),
        ("Pairs used", f"{used}", f"of {len(stereo.left.views)}"),
    ])  # fmt: skip


def rectify(camera: Camera, R: Array, P: Array, xy: Array) -> Array:
    """Positions (N, 2) of pixels `xy` of `camera` in its rectified picture; NaN where the lens model has no ray."""
    rays = unproject(camera, xy) @ (P[:, :3] @ R).T
    return np.asarray(np.where(rays[:, 2:] > 0, rays[:, :2] / np.where(rays[:, 2:] > 0, rays[:, 2:], 1.0), np.nan))


def row_gaps(stereo: StereoCalibration) -> Array:
    """RMS difference (pairs,) of matching corners perpendicular to the epipolar lines after rectification, px; NaN
    without matches."""
    axis = 1 if _beside(stereo) else 0
    out = []
    for a, b in zip(stereo.left.views, stereo.right.views, strict=True):
        ka, kb = both_used(a, b)
        left = rectify(stereo.left.camera, stereo.R_left, stereo.P_left, a.xy[ka])
        right = rectify(stereo.right.camera, stereo.R_right, stereo.P_right, b.xy[kb])
        gap = (left - right)[:, axis]
        gap = gap[np.isfinite(gap)]
        out.append(float(np.sqrt((gap**2).mean())) if len(gap) else float("nan"))
    return np.array(out)


def _beside(stereo: StereoCalibration) -> bool:
    """Whether the cameras are side by side rather than above each other."""
    return abs(stereo.P_right[0, 3]) >= abs(stereo.P_right[1, 3])


def _pairs(stereo: StereoCalibration, gaps: Array) -> Html:
    views = list(zip(stereo.left.views, stereo.right.views, strict=True))
    bars = [
        charts.Bar(
            float(gap), bool(a.reason or b.reason), f"pair {k}: {a.name}, {b.name}, {pixels(gap)}", f"#view-L{k}"
        )
        for k, ((a, b), gap) in enumerate(zip(views, gaps, strict=True), start=1)
    ]
    what = "row" if _beside(stereo) else "column"
    rows = []
    for k, ((a, b), gap) in enumerate(zip(views, gaps, strict=True), start=1):
        reason = "; ".join(dict.fromkeys(r for r in (a.reason, b.reason) if r))
        cells = [tag("td", pixels(v).removesuffix(" px"), class_="n") for v in (a.rms, b.rms, gap)]
        state = tag("span", reason, class_="why") if reason else "used"
        names = join(tag("bdi", sections.short(a.name)), ", ", tag("bdi", sections.short(b.name)))
        rows.append(tag("tr", tag("th", k, scope="row", class_="n"), tag("td", names), *cells, tag("td", state)))
    heads = (
        ("#", "n"),
        ("pictures", None),
        ("left, px", "n"),
        ("right, px", "n"),
        (f"{what}s, px", "n"),
        ("state", None),
    )
    head = tag("tr", *(tag("th", n, scope="col", class_=c) for n, c in heads))
    table = tag(
        "table",
        tag("caption", f"RMS of each view, and the {what} difference of the pair"),
        tag("thead", head),
        tag("tbody", each(rows)),
    )
    chart = sections.figure(
        f"{what.capitalize()} difference after rectification", charts.bar_chart(bars, _used_gap(gaps, views), f"{what} difference (RMS), px", "pair"),
        "Between matching corners. The dashed line is the root mean square of the used pairs. A pair that stands out was moved, "
        "or not taken at one moment.",
    )  # fmt: skip
    return page.pair(chart, tag("div", table, class_="card wide tall"))


def _used_gap(gaps: Array, views: list[tuple[BoardView, BoardView]]) -> float:
    used = gaps[[not a.reason and not b.reason for a, b in views]]
    used = used[np.isfinite(used)]
    return float(np.sqrt((used**2).mean())) if len(used) else float("nan")


def _rectified(stereo: StereoCalibration, gaps: Array, left: Pictures | None, right: Pictures | None) -> Html:
    """Both rectified pictures of the used pair with the most matching corners, with lines through matching corners."""
    none = tag("p", "There are no photographs to show it on.", class_="soft")
    if left is None or right is None:
        return none
    views = list(zip(stereo.left.views, stereo.right.views, strict=True))
    order = sorted(
        (k for k, (a, b) in enumerate(views) if not a.reason and not b.reason),
        key=lambda k: -len(both_used(*views[k])[0]),
    )
    for k in order[: pictures.TRIES]:
        a, b = views[k]
        found = left(a.name), right(b.name)
        sizes = stereo.left.camera.image_size, stereo.right.camera.image_size
        if all(p is not None and p.shape[:2] == s[::-1] for p, s in zip(found, sizes, strict=True)):
            return _rectified_pair(stereo, k, a, b, found, float(gaps[k]))
    return none


def _rectified_pair(
    stereo: StereoCalibration, k: int, a: BoardView, b: BoardView, found: tuple[Array | None, Array | None], gap: float
) -> Html:
    ka, kb = both_used(a, b)
    axis = 1 if _beside(stereo) else 0
    across = np.argsort(rectify(stereo.left.camera, stereo.R_left, stereo.P_left, a.xy[ka])[:, axis], kind="stable")
    pick = across[np.unique(np.linspace(0, len(ka) - 1, LINES).astype(int))] if len(ka) else across
    out: list[Html] = []
    level = None
    sides = ((stereo.left, stereo.R_left, stereo.P_left, a, ka), (stereo.right, stereo.R_right, stereo.P_right, b, kb))
    for name, (calibration, R, P, view, rows), picture in zip(("Left", "Right"), sides, found, strict=True):
        camera = calibration.camera
        factor = min(1.0, pictures.SAMPLE_WIDTH / max(camera.image_size))
        size = round(camera.image_size[0] * factor), round(camera.image_size[1] * factor)
        small = pictures.shrunk(as_grey(present(picture, "a picture")), size)
        flat = Camera(P[:, :3], np.zeros(0), camera.image_size, "pinhole")
        image = pictures.undistort(small, pictures.resized(camera, size), pictures.resized(flat, size), R)
        ratio = np.array(size) / np.array(camera.image_size)
        spots = (rectify(camera, R, P, view.xy[rows]) + 0.5) * ratio - 0.5
        level = spots[pick][:, axis] if level is None else level  # both pictures have the rows of the left one
        ends = [[[-1, y], [size[0], y]] if axis else [[y, -1], [y, size[1]]] for y in level[np.isfinite(level)]]
        overlay = pictures.chord_overlay(np.array(ends).reshape(-1, 2, 2), spots[pick])
        shot = Shot(view.name, (), size, pictures.jpeg(image, pictures.SAMPLE_QUALITY))
        art = pictures.framed(
            shot, overlay, f"{name} picture of pair {k + 1}, rectified, with lines through matching corners", lazy=False
        )
        text = (
            f"Lines through corners of the left picture meet the same corners in the right one, to {number(gap, 2)} px (RMS)."
            if out
            else f"Pair {k + 1}."
        )
        out.append(sections.figure(f"{name}, rectified", art, text))
    return page.pair(*out)


def _cameras(stereo: StereoCalibration) -> Html:
    sides = (("Left", stereo.left, "L"), ("Right", stereo.right, "R"))
    return page.pair(*(
        tag("div", tag("h3", f"{name} camera"), tag("div", sections.parameters(c), class_="card wide"),
            tag("div", sections.copyable_camera(c.camera, key), class_="card"), class_="column")
        for name, c, key in sides
    ))  # fmt: skip


def _advice(stereo: StereoCalibration) -> list[str]:
    """The advice for the pair, and the further advice for each camera."""
    of_cameras = (f"{n}: {line}" for n, c in (("Left", stereo.left), ("Right", stereo.right)) for line in c.advice)
    return list(dict.fromkeys([*stereo.advice, *of_cameras]))


def _columns(made: list[tuple[Html, ...]]) -> Html:
    """Corresponding drawings of both cameras side by side, row by row."""
    return each([page.pair(*row) for row in zip(*made, strict=True)])


def _residuals(calibration: Calibration, facts: Facts, name: str) -> tuple[Html, ...]:
    whose = f", {name.lower()}"
    return *sections.residual_figures(calibration, facts, whose), *sections.chart_figures(calibration, name[0], whose)


def _galleries(stereo: StereoCalibration, left: Pictures | None, right: Pictures | None, budget: int) -> Html:
    sides = (("Left", stereo.left, left, "L"), ("Right", stereo.right, right, "R"))
    return each([join(tag("h3", f"{name} camera"), gallery.gallery(c, p, budget, key, 4)) for name, c, p, key in sides])
