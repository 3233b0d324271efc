"""The sections of the page as HTML."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np

from rcdn.calibration.facts import Facts, multiple
from rcdn.geometry.spline_grid import largest_shift
from rcdn.report.calibration import charts, maps
from rcdn.report.calibration.markup import (
    Html,
    counted,
    each,
    escape,
    join,
    number,
    percent,
    pixels,
    tag,
    value_and_std,
)
from rcdn.types import Calibration, Camera

MODEL_NAMES = {
    "pinhole": "pinhole (no distortion)",
    "brown": "Brown–Conrady",
    "rational": "rational (8 numbers)",
    "fisheye": "fisheye (Kannala–Brandt)",
    "division": "division (one number)",
}


def summary_of(calibration: Calibration, facts: Facts) -> str:
    """The measurements in a sentence or two."""
    used, names = calibration.used_views, {v.name for v in calibration.used_views}
    boards = counted(len(used), "board")
    where = f"in {counted(len(names), 'picture')}" if len(names) != len(used) else "each in its own picture"
    text = f"{boards}, {where}, are explained to {pixels(calibration.rms)} (RMS)"
    ratio = facts.held_ratio
    text += f", boards in held-out pictures to {number(ratio)} times that. " if np.isfinite(ratio) else ". "
    text += f"Over half of the picture, projections are known to {number(facts.typical, 2)} px or better"
    if not np.isfinite(facts.at_corners):
        return f"{text}; in its corners nothing is known."
    where = "in the worst corner of the picture" if np.isfinite(facts.corners).any() else "at the rim"
    return f"{text}; {where} to {number(facts.at_corners, 2)} px."


def key_figures(pairs: Sequence[tuple[str, str, str]]) -> Html:
    """A list of key figures: (name, figure, small annotation)."""
    return tag(
        "dl",
        each([tag("div", tag("dt", n), tag("dd", v, " ", tag("small", s) if s else None)) for n, v, s in pairs]),
        class_="key",
    )


def figures_of(calibration: Calibration, facts: Facts) -> Html:
    """The key figures of a calibration."""
    K, fov = calibration.camera.K, facts.fov
    return key_figures([
        ("RMS", pixels(calibration.rms), "reprojection error"),
        ("Held-out pictures", f"{number(facts.held_ratio)} ×" if np.isfinite(facts.held_ratio) else "–", "the RMS"),
        ("Focal length", f"{number(float(np.sqrt(K[0, 0] * K[1, 1])), 5)} px", f"± {percent(facts.focal_std)}"),
        ("Field of view", *field_of_view(fov)),
        ("Lens model", calibration.camera.model, "{} × {} px".format(*calibration.camera.image_size)),
        ("Corners used", f"{facts.used:,}", f"of {facts.seen:,}"),
    ])  # fmt: skip


def field_of_view(fov: tuple[float, float, float]) -> tuple[str, str]:
    """The horizontal × vertical field of view, and the diagonal one, as text."""
    if not np.isfinite(fov[:2]).all():
        return "unknown", "the lens model ends inside the frame"
    return f"{number(fov[0])}° × {number(fov[1])}°", f"{number(fov[2])}° diagonal" if np.isfinite(fov[2]) else ""


def numbers(calibration: Calibration, key: str = "") -> Html:
    """The parameters, a block of code to copy, the comparison of lens models, and the board."""
    left = tag("div", tag("div", parameters(calibration), class_="card wide"), _models(calibration), class_="column")
    copy = tag("div", copyable_camera(calibration.camera, key), class_="card")
    return tag("div", left, tag("div", copy, _board(calibration), class_="column"), class_="two loose")


def parameters(calibration: Calibration) -> Html:
    """A table of all parameters with their standard deviations."""
    camera = calibration.camera
    rows = []
    every = zip(camera.parameter_names, camera.parameters, calibration.std, strict=True)
    for name, value, std in list(every)[: camera.coefficients]:
        shown, spread = value_and_std(float(value), float(std))
        unit = "px" if name in ("fx", "fy", "cx", "cy") else ""
        rows.append(
            tag(
                "tr",
                tag("th", tag("code", name), scope="row"),
                *(tag("td", t, class_="n") for t in (shown, spread)),
                tag("td", unit),
            )
        )
    if camera.correction is not None:
        most = tag("td", f"≤ {number(largest_shift(camera), 3)}", class_="n")
        rows.append(
            tag("tr", tag("th", "smooth correction", scope="row"), most, tag("td", "–", class_="n"), tag("td", "px"))
        )
    if camera.K[0, 1]:
        rows.append(
            tag(
                "tr",
                tag("th", "skew", scope="row"),
                tag("td", number(camera.K[0, 1], 5), class_="n"),
                tag("td", "–", class_="n"),
                tag("td", "px"),
            )
        )
    head = tag(
        "tr",
        *(
            tag("th", w, scope="col", class_="n" if w in ("value", "± std") else None)
            for w in ("parameter", "value", "± std", "unit")
        ),
    )
    caption = tag(
        "caption", f"Camera matrix and distortion, {MODEL_NAMES[camera.model]}, with standard deviations (one sigma)"
    )
    return tag("table", caption, tag("thead", head), tag("tbody", each(rows)))


def copyable_camera(camera: Camera, key: str) -> Html:
    """The camera as a block of code."""
    K = "[" + ",\n     ".join("[" + ", ".join(f"{v:.10g}" for v in row) + "]" for row in camera.K) + "]"
    lens = [f"{v:.10g}" for v in camera.distortion]
    rows = "".join(f"\n    {', '.join(lens[k : k + 2])}," for k in range(0, len(lens), 2))
    names = f"  # {' '.join(camera.parameter_names[4 : camera.coefficients])}" if lens else ""
    size = "image_size = ({}, {})".format(*camera.image_size)
    more = ""
    if (correction := camera.correction) is not None:
        high, columns, _ = correction.control.shape
        more = f"\n# and a smooth correction of {columns} × {high} control points: see the files .json and .cameramodel"
    block = f'model = "{camera.model}"\n{size}\nK = {K}\ndistortion = [{names}{rows}{chr(10) if lens else ""}]{more}'
    return copyable("To copy", block, f"copy-camera{key}")


def copyable(title: str, text: str, key: str) -> Html:
    """Lines of numbers with a button that copies them."""
    button = tag("button", "Copy", type="button", data_copy=key, hidden=True)
    lines = Html("\n".join(escape(line) for line in text.split("\n")))  # line breaks are kept here
    return join(
        tag("div", tag("h3", title), button, class_="copyhead"),
        tag("pre", lines, id=key, tabindex="0", aria_label="Numbers to copy"),
    )


def _models(calibration: Calibration) -> Html | None:
    """The RMS of the lens models as multiples of that of the chosen one: they were compared on the same set of corners,
    some of which the final calibration may leave out."""
    if not calibration.models:
        return None
    chosen = calibration.models[0].rms
    rows = []
    for k, score in enumerate(calibration.models):
        name = tag("th", score.model, " ", tag("span", "chosen", class_="tag") if k == 0 else None, scope="row")
        ratios = (f"{number(multiple(v, chosen))} ×" if np.isfinite(v) else "–" for v in (score.rms, score.held_out))
        rows.append(tag("tr", name, *(tag("td", r, class_="n") for r in ratios), class_="chosen" if k == 0 else None))
    head = tag(
        "tr",
        tag("th", "model", scope="col"),
        tag("th", "all pictures", scope="col", class_="n"),
        tag("th", "held out", scope="col", class_="n"),
    )
    caption = tag(
        "caption",
        "Lens models compared, as multiples of the chosen one’s RMS, all on the same corners: the simplest that predicts held-out pictures "
        "about as well as the best; one that can’t beat a simpler one isn’t held out",
    )
    return tag("div", tag("table", caption, tag("thead", head), tag("tbody", each(rows))), class_="card wide")


def _board(calibration: Calibration) -> Html:
    size = "{} × {} inner corners".format(*calibration.size) if calibration.size else "not settled by the pictures"
    turn = {
        "unique": "one way up only",
        "ambiguous_180": "looks the same after half a turn",
        "ambiguous_90": "looks the same after quarter turns",
    }
    rows: list[tuple[str, str]] = [("size", size), _side(calibration)]
    rows += [("target", _shown_targets(calibration))] if calibration.target is not None else []
    if calibration.orientation:
        rows.append(("orientation", turn[calibration.orientation]))
    if calibration.shape is None:
        rows.append(("shape", "taken as perfect"))
    else:
        rows.append(
            ("corners off their places in the plane (RMS)", f"{number(1000 * calibration.shape.print_error, 2)} mm")
        )
        rows.append(("bend, from the lowest corner to the highest", f"{number(1000 * calibration.shape.bend, 2)} mm"))
    rows += [("scatter of corners beyond their own sigma", f"{number(calibration.noise, 2)} px along an axis")]
    body = each([tag("tr", tag("th", n, scope="row"), tag("td", v)) for n, v in rows])
    return tag("div", tag("table", tag("caption", "The board"), tag("tbody", body)), class_="card wide")


def _side(calibration: Calibration) -> tuple[str, str]:
    name = "side of a tag" if calibration.target is not None and calibration.target.kind == "aprilgrid" else "spacing"
    return name, f"{number(1000 * calibration.spacing, 4)} mm"


def _shown_targets(calibration: Calibration) -> str:
    """The targets of the used views, each with the number of views that show it."""
    shown = Counter(str(v.target or "no codes read") for v in calibration.used_views)
    return "; ".join(f"{name}, {counted(n, 'view')}" for name, n in shown.most_common())


def figure(title: str, art: Html, text: str) -> Html:
    """A drawing with its title above and its explanation below."""
    return tag("figure", tag("h3", title), art, tag("figcaption", text), class_="card")


def sensor_figures(calibration: Calibration, facts: Facts, whose: str = "") -> tuple[Html, Html]:
    """Coverage, and projection uncertainty; `whose` is appended to the titles."""
    guess = "Where there is none, the lens is only extrapolated."
    covered = figure(
        f"Where corners were seen{whose}", maps.coverage_map(calibration, facts),
        f"{percent(facts.covered)} of the cells hold a used corner. {guess if facts.covered < 1 else ''}",
    )  # fmt: skip
    firm = figure(
        f"How firm a projection is{whose}", maps.uncertainty_map(calibration, facts),
        "Standard deviation of where a far point appears, if the same calibration were repeated. A lens that the model can’t follow shows in "
        "the residuals instead.",
    )  # fmt: skip
    return covered, firm


def residual_figures(calibration: Calibration, facts: Facts, whose: str = "") -> tuple[Html, Html]:
    """Residual vectors, and their means in cells."""
    vectors = figure(
        f"Corner by corner{whose}", maps.residual_map(calibration),
        "From each corner (dot) towards where it was seen, observed − projected. They should look like noise: short, in all directions.",
    )  # fmt: skip
    art, sentence = maps.mean_map(calibration, facts.residuals.cells)
    return vectors, figure(
        f"Averaged over cells{whose}", art, f"{sentence} Arrows that turn together show a lens model that doesn’t fit."
    )


def chart_figures(calibration: Calibration, key: str = "", whose: str = "") -> tuple[Html, Html]:
    """Bars of the views, and residuals against the radius."""
    out = calibration.left_out
    told = f"{counted(len(out), 'view was', 'views were')} left out. " if out else "No view was left out. "
    bars = tag(
        "figure", tag("h3", f"Each view{whose}"), charts.view_bars(calibration, key),
        tag("figcaption", told, f"The dashed line is the RMS of all used views, {pixels(calibration.rms)}."),
        _left_out(calibration, key), class_="card",
    )  # fmt: skip
    art, sentence = charts.radius_chart(calibration)
    marks = charts.legend(
        ("corner", tag("path", class_="dot", stroke_width=5, d="M9 7h0")),
        ("running mean", tag("path", class_="mean", d="M0 7h18")),
        ("± one standard deviation", tag("path", class_="band", d="M0 1h18v12h-18z")),
    )
    text = f"{sentence} A mean that leaves zero towards the right is a lens model that runs out."
    return bars, figure(f"Residuals against the radius{whose}", join(art, marks), text)


def _left_out(calibration: Calibration, key: str) -> Html | None:
    rows = [
        tag(
            "li",
            tag("a", f"View {k}", href=f"#view-{key}{k}"),
            ", ",
            tag("bdi", short(v.name)),
            ": ",
            tag("span", v.reason, class_="why"),
        )
        for k, v in enumerate(calibration.views, start=1)
        if v.reason
    ]
    if not rows:
        return None
    first, more = rows[:6], rows[6:]
    rest = tag("details", tag("summary", f"{len(more)} more"), tag("ul", each(more), class_="advice")) if more else None
    return join(tag("ul", each(first), class_="advice"), rest)


def short(name: str) -> str:
    """The name of a file without its folder."""
    return name.replace("\\", "/").rstrip("/").rsplit("/", 1)[-1] or name


def definitions(words: Sequence[tuple[str, str]]) -> Html:
    """A list of terms and their definitions."""
    return tag("dl", each([join(tag("dt", n), tag("dd", t)) for n, t in words]), class_="words")


def footer(provenance: dict[str, Any], told: str) -> Html:
    """The footer with the origin of the page."""
    commit = str(provenance.get("commit", "unknown"))
    source = f", commit {commit[:12]}{'+' if commit.endswith('+') else ''}" if commit != "unknown" else ""
    text = f"Made by rcdn {provenance['rcdn']}{source} on {provenance['date'][:16].replace('T', ' ')} UTC. {told}"
    return tag(
        "footer",
        tag("p", text),
        tag("p", "The page is one file: it loads nothing from the network and needs no script."),
    )
