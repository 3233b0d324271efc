"""The report of one calibration: a single HTML file that can be read in a minute."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from rcdn.calibration.board_points import plane_of
from rcdn.calibration.facts import Facts, measure
from rcdn.calibration.limits import LIMITS
from rcdn.calibration.next_view import next_view
from rcdn.calibration.verdict import judge
from rcdn.io import write_text
from rcdn.provenance import provenance
from rcdn.report.calibration import gallery, histogram, next_pose, sections, space, style, verdict
from rcdn.report.calibration import pictures as shown
from rcdn.report.calibration.markup import Html, counted, each, join, tag
from rcdn.report.calibration.pictures import Pictures
from rcdn.types import Calibration

LARGEST = 6_000_000
"""maximum size of the page, bytes; thumbnails may use what the other parts leave, less SPARE"""
SPARE = 100_000

WORDS = (
    (
        "Residual",
        "Observed minus projected position of a corner, px. Pixel (0, 0) is the centre of the top-left pixel.",
    ),
    (
        "RMS",
        "Reprojection error: the root of the mean squared length of the used corners’ residuals, px (both axes together).",
    ),
    (
        "Held-out pictures",
        "The pictures are split into groups; the camera is calibrated without a group, then only the poses of that group’s boards are solved. "
        "The RMS of their residuals, as a multiple of the calibration’s on the same corners, tells what to expect in new pictures.",
    ),
    (
        "Standard deviation",
        "Square roots of the covariance’s diagonal: how far a parameter would move if such pictures were taken again.",
    ),
    (
        "Projection uncertainty",
        "Standard deviation, px, of where the camera sees a fixed, far point, while the boards hold still; the root mean square of both axes. "
        "Correlated errors of the parameters that make up for one another don’t count twice.",
    ),
    (
        "Coverage",
        "Share of the cells (eight along the longer side) in which at least one used corner lies. "
        "What a fisheye sees beyond 90° off its axis doesn’t count.",
    ),
    (
        "Field of view",
        "Angles between the rays at the frame’s edges through the principal point, and between opposite corners.",
    ),
    (
        "Left out",
        "A view or a corner that disagrees with all others by more than chance allows. It is shown, but the camera doesn’t rest on it.",
    ),
    ("Warp", "How far the board’s middle stands out from the plane of its rim, along its columns and its rows."),
)
"""how each figure is defined"""


def write_report(
    path: str | Path, calibration: Calibration, pictures: Pictures | None = None, title: str = "Camera calibration"
) -> None:
    """Write the report of `calibration` to `path`: one HTML file that needs no network and no script.

    `pictures(name)` returns the photograph (H, W) of a view by its name, or None; it is called once for each picture
    that is shown, and again for the sample. Without it there are only drawings. The page stays below 6 MB for a hundred
    views: thumbnails are reduced in size, and pictures that don't fit are left out with a note. Written whole or not at
    all; the same input gives the same bytes except for the date. Raises OutputError if it can't be written.
    """
    write_text(path, report(calibration, pictures, title))


def report(calibration: Calibration, pictures: Pictures | None = None, title: str = "Camera calibration") -> str:
    """The text of the page that `write_report` writes."""
    facts = measure(calibration)
    found = calibration.verdict if calibration.verdict.judged else judge(calibration, facts)
    why = verdict.reasons(
        found, calibration.advice, list(LIMITS.values()), verdict.limits_hint(calibration.camera.image_size)
    )
    head = join(
        verdict.banner(found, sections.summary_of(calibration, facts)),
        sections.figures_of(calibration, facts),
        section("why", "The reasons", why),
    )
    sample = shown.sample(calibration, pictures)
    parts = [
        ("numbers", "The numbers", sections.numbers(calibration)),
        ("sensor", "Over the sensor", pair(*sections.sensor_figures(calibration, facts))),
        *pose_part(calibration),
        (
            "residuals",
            "Residuals",
            join(
                pair(*sections.residual_figures(calibration, facts)),
                pair(*sections.chart_figures(calibration)),
                pair(*histogram.model_figures(calibration)),
            ),
        ),
        ("straight", "Straight lines", gallery.before_after(sample, calibration.camera, pictures is not None)),
    ]
    meaning = ("meaning", "What the figures mean", sections.definitions(WORDS))
    rest = sum(len(html.encode()) for _, _, html in [*parts, meaning]) + len(head.encode()) + len(style.SHEET)
    views = gallery.gallery(calibration, pictures, 0)  # without photographs, for the size of the overlays
    budget = max(LARGEST - SPARE - rest - len(views.encode()), 0)
    views = gallery.gallery(calibration, pictures, budget)
    parts += [("views", "Every picture", views), meaning]
    return page(title, subtitle(calibration), head, parts, told(calibration, facts))


def pose_part(calibration: Calibration) -> list[tuple[str, str, Html]]:
    """The part on poses: the suggested next pose of the board, and its poses so far; empty if there are none."""
    found = next_view(calibration)
    suggested = None
    if found is not None:
        suggested = space.rectangle(
            found.pose, np.array([-1, -1]), np.array(found.size), calibration.spacing, plane_of(calibration)
        )
    drawn = [] if found is None else [next_pose.next_figure(calibration, found)]
    where = space.space_figure(calibration, suggested)
    drawn += [] if where is None else [where]
    return [("poses", "Poses of the board", pair(*drawn))] if drawn else []


def subtitle(calibration: Calibration) -> str:
    """The camera and the number of boards and pictures, in a line."""
    names = {v.name for v in calibration.views}
    width, height = calibration.camera.image_size
    return (
        f"{calibration.camera.model} camera, {width} × {height} px, from {counted(len(calibration.used_views), 'board')} "
        f"of {len(calibration.views)} in {counted(len(names), 'picture')}"
    )


def told(calibration: Calibration, facts: Facts) -> str:
    """The numbers of pictures, boards and corners of the input, for the footer."""
    names = {v.name for v in calibration.views}
    return f"From {counted(len(names), 'picture')} with {counted(len(calibration.views), 'board')} and {counted(facts.seen, 'corner')}."


def pair(*children: Html) -> Html:
    """`children` side by side on a wide screen."""
    return tag("div", each(list(children)), class_="two")


def section(key: str, title: str, content: Html, lead: str = "") -> Html:
    """A section of the page with its heading."""
    return tag(
        "section",
        tag("h2", title, id=key),
        tag("p", lead, class_="lead") if lead else None,
        content,
        aria_labelledby=key,
    )


def page(title: str, line: str, head: Html, parts: Sequence[tuple[str, str, Html]], told: str) -> str:
    """The complete HTML document."""
    links = each([tag("li", tag("a", name, href=f"#{key}")) for key, name, _ in parts])
    body = join(
        tag(
            "header",
            tag("h1", title),
            tag("p", line, class_="soft"),
            tag("nav", tag("ul", links), aria_label="Parts of the page"),
        ),
        tag("main", head, each([section(*part) for part in parts])),
        sections.footer(provenance(), told),
    )
    metas = each([
        tag("meta", charset="utf-8"),
        tag("meta", http_equiv="Content-Security-Policy", content=style.POLICY),
        tag("meta", name="viewport", content="width=device-width, initial-scale=1"),
        tag("meta", name="generator", content="rcdn"),
        tag("meta", name="color-scheme", content="light dark"),
        tag("link", rel="icon", href="data:,"),
        tag("title", title),
        tag("style", Html(style.SHEET)),
    ])  # fmt: skip
    script = tag("script", Html(style.SCRIPT))
    return f'<!DOCTYPE html>\n<html lang="en">\n<head>\n{metas}\n</head>\n<body>\n{body}\n{script}\n</body>\n</html>\n'
