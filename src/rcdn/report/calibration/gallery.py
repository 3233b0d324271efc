"""All pictures with their detections, and one picture undistorted."""

from __future__ import annotations

import shlex
from collections.abc import Sequence

import numpy as np

from rcdn.calibration.by_hand import view_name
from rcdn.report.calibration import charts, pictures
from rcdn.report.calibration.markup import Html, counted, each, join, number, pixels, tag
from rcdn.report.calibration.pictures import Pictures, Sample, Shot
from rcdn.report.calibration.sections import figure, short
from rcdn.types import Calibration, Camera


def gallery(calibration: Calibration, show: Pictures | None, budget: int, key: str = "", level: int = 3) -> Html:
    """Thumbnails with detections: views left out first, then used ones; and a sentence on pictures that aren't
    shown."""
    every = pictures.shots(calibration)
    chosen = pictures.with_jpegs(pictures.worth_showing(every), show, budget)
    most = pictures.DOTS // max(len(chosen), 1)
    names = [v.name for v in calibration.views]
    parts: list[Html | None] = [_gallery_legend(chosen), _gallery_words(every, chosen, show)]
    for title, group in (("Left out", [s for s in chosen if s.out]), ("Used", [s for s in chosen if not s.out])):
        if group:
            parts.append(tag(f"h{level}", f"{title} ({len(group)})"))
            parts.append(tag("div", each([_thumbnail(s, names, most, key) for s in group]), class_="shots"))
    parts.append(_table(calibration, key, {k for s in chosen for k, _ in s.views}))
    return tag("div", *parts, class_="views")


def _gallery_words(every: list[Shot], chosen: list[Shot], show: Pictures | None) -> Html | None:
    words = []
    if len(chosen) < len(every):
        words.append(
            f"{len(chosen)} of {len(every)} pictures are shown, to keep the page small: those with left-out views and the worst first."
        )
    if show is not None and (blank := sum(s.jpeg is None for s in chosen)):
        words.append(f"{counted(blank, 'photograph')} couldn’t be shown; the corners are drawn alone.")
    if left_out := getattr(show, "left_out", ""):
        words.append(left_out)
    return tag("p", " ".join(words), class_="soft") if words else None


def _gallery_legend(chosen: list[Shot]) -> Html:
    views = [v for s in chosen for _, v in s.views]
    kinds = [("used corner", "u", "M9 7h0", 6.0, any(not v.reason for v in views))]
    kinds.append(
        ("outlier, not used", "o", "M5 3l8 8m0-8l-8 8", 2.0, any(not v.reason and not v.used.all() for v in views))
    )
    kinds.append(
        ("corner of a view left out", "l", "M4 7a5 5 0 1 0 10 0a5 5 0 1 0-10 0", 2.0, any(v.reason for v in views))
    )
    back = tag("rect", width=18, height=14, rx=3, fill="#2b3138")
    return charts.legend(*[
        (word, join(back, tag("path", class_=kind, fill="none", stroke_linecap="round", stroke_width=wide, d=d)))
        for word, kind, d, wide, there in kinds
        if there
    ])  # fmt: skip


def _thumbnail(shot: Shot, names: Sequence[str], most: int, key: str) -> Html:
    lines, told = [], []
    for k, view in shot.views:
        used = f"{int(view.used.sum())} of {counted(len(view), 'corner')}"
        text = f"left out: {view.reason}" if view.reason else used
        told.append(f"board {view.board + 1}: {text}" if len(shot.views) > 1 else text)
        rms = tag("span", pixels(view.rms) if np.isfinite(view.rms) else "")
        lines.append(tag("div", tag("strong", f"#{k}"), rms, id=f"view-{key}{k}"))
        lines.append(
            tag("div", tag("span", f"Left out: {view.reason}", class_="why") if view.reason else tag("span", used))
        )
        if not (view.reason or key):
            lines.append(tag("div", tag("span", "To solve without it: ", leaving_out(names, k)), class_="more"))
    number = shot.views[0][0]
    name = short(shot.name)
    alt = f"{name}, {'; '.join(told)}"
    wide, high = shot.size
    return tag(
        "figure",
        tag(
            "a",
            pictures.framed(shot, pictures.corners_overlay(shot, most), alt),
            class_="large",
            href=f"#shot-{key}{number}",
            aria_label=f"Enlarge {name}",
        ),
        tag("figcaption", tag("bdi", name), *lines),
        tag("p", tag("a", "Back to all pictures", href=f"#view-{key}{number}"), class_="back"),
        class_="shot out" if shot.out else "shot",
        id=f"shot-{key}{number}",
        style=f"--ratio:{wide / high:.4f}",
    )


def _table(calibration: Calibration, key: str, shown: set[int]) -> Html:
    """A table of all views; those whose numbers aren't `shown` in thumbnails have their anchors here."""
    rows = []
    every = [v.name for v in calibration.views]
    for k, v in enumerate(calibration.views, start=1):
        here = k not in shown
        first = tag("th", k if here else tag("a", k, href=f"#view-{key}{k}"), scope="row", class_="n")
        used = f"{int(v.used.sum()) if not v.reason else 0} / {len(v)}"
        cells = (tag("td", t, class_="n") for t in (v.board + 1, used, pixels(v.rms).removesuffix(" px")))
        state = tag("span", v.reason, class_="why") if v.reason else "used"
        option = None if v.reason or key else leaving_out(every, k)
        row = tag(
            "tr",
            first,
            tag("td", tag("bdi", v.name)),
            *cells,
            tag("td", state),
            option and tag("td", option),
            id=f"view-{key}{k}" if here else None,
        )
        rows.append(row)
    names = [("#", "n"), ("picture", None), ("board", "n"), ("corners used", "n"), ("RMS, px", "n"), ("", None)]
    names += [] if key else [("to solve without it, add", None)]
    head = tag("tr", *(tag("th", n or tag("span", "state", class_="sr"), scope="col", class_=c) for n, c in names))
    table = tag(
        "table", tag("caption", "Every view, in the order of the input"), tag("thead", head), tag("tbody", each(rows))
    )
    return tag(
        "details", tag("summary", f"All {counted(len(rows), 'view')} as a table"), tag("div", table, class_="wide")
    )


def leaving_out(names: Sequence[str], number: int) -> Html:
    """The option of `rcdn calibrate` that leaves out view `number` (from 1) of pictures `names`."""
    return tag("code", f"--leave-out {shlex.quote(view_name(names, number - 1))}")


def before_after(found: Sample | None, camera: Camera, asked: bool) -> Html:
    """One picture as taken and undistorted."""
    if found is None:
        if camera.model == "pinhole" and camera.correction is None:
            return tag("p", "The pinhole model has no distortion to undo.", class_="soft")
        return tag(
            "p", "There is no photograph to show it on." if asked else "Drawn without the photographs.", class_="soft"
        )
    shots: list[Html] = []
    titles = ("As taken", f"Undistorted, {number(found.angle, 3)}° across")
    texts = (
        f"The board’s outer lines bow away from straight ones by up to {number(found.bow[0], 2)} px.",
        f"The same corners lie on straight lines to {number(found.bow[1], 2)} px (pixels of the full-size picture).",
    )
    for k, (title, text) in enumerate(zip(titles, texts, strict=True)):
        shot = Shot(found.name, (), found.size, found.pair[k])
        overlay = pictures.chord_overlay(found.chords[k], found.corners[k])
        art = pictures.framed(
            shot,
            overlay,
            f"View {found.number}, {title.lower()}, with straight lines along the board's edges",
            lazy=False,
        )
        shots.append(figure(title, art, text))
    return tag("div", *shots, class_="two")
