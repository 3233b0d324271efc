"""All pictures with their detections, and one picture undistorted, as a page shows them."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import dataclass

from markupsafe import Markup

from rcdn.calibration.by_hand import view_name
from rcdn.report.calibration import pictures
from rcdn.report.calibration.formats import counted, number, short
from rcdn.report.calibration.pictures import Framed, Pictures, Shot
from rcdn.report.calibration.svg import join, tag
from rcdn.types import BoardView, Calibration


@dataclass(frozen=True)
class ShownView:
    """A view: its `number` and that of its `board` in the picture (from 1), its corners and the `used` ones, its `rms`,
    px, why it was left out (`reason`), and the `option` of `rcdn calibrate` that leaves it out."""

    number: int
    name: str
    board: int
    used: int
    corners: int
    rms: float
    reason: str
    option: str


@dataclass(frozen=True)
class Thumbnail:
    """A picture with its views; `ratio` of its width to its height; `out`: no view of it was used."""

    name: str
    picture: Framed
    views: tuple[ShownView, ...]
    ratio: float
    out: bool


@dataclass(frozen=True)
class Gallery:
    """The pictures of a camera, of which `name` and `key`, a part of its anchors, tell where there are several:
    thumbnails of views left out and of used ones, all `views`, and the `numbers` of those in thumbnails. Of so many
    `pictures` so many are `shown`, of which `blank` ones lack their photograph; `note`: why photographs are missing."""

    name: str
    key: str
    marks: tuple[tuple[str, Markup], ...]
    pictures: int
    shown: int
    blank: int
    note: str
    left_out: list[Thumbnail]
    used: list[Thumbnail]
    views: list[ShownView]
    numbers: set[int]


@dataclass(frozen=True)
class Straight:
    """A picture `before` and `after` undistortion, None without a photograph; the largest distance of a corner from its
    line in both, px (`bow`); the horizontal field of view after it, degrees (`angle`); whether the camera has no
    distortion, and whether photographs were `requested`."""

    distortion_free: bool
    requested: bool
    before: Framed | None = None
    after: Framed | None = None
    bow: tuple[float, float] = (0.0, 0.0)
    angle: float = 0.0


def gallery(
    calibration: Calibration, show: Pictures | None, budget: int | None, key: str = "", name: str = ""
) -> Gallery:
    """The pictures, their photographs within `budget` bytes of the page; None: without photographs."""
    show, budget = (None, 0) if budget is None else (show, budget)
    every = pictures.shots(calibration)
    chosen = pictures.with_jpegs(pictures.worth_showing(every), show, budget)
    most = pictures.DOTS // max(len(chosen), 1)
    names = [v.name for v in calibration.views]
    views = [_view(k, v, names, key) for k, v in enumerate(calibration.views, start=1)]
    drawn = [_thumbnail(shot, views, most) for shot in chosen]
    return Gallery(
        name=name,
        key=key,
        marks=_marks(chosen),
        pictures=len(every),
        shown=len(chosen),
        blank=0 if show is None else sum(s.jpeg is None for s in chosen),
        note=getattr(show, "left_out", ""),
        left_out=[t for t in drawn if t.out],
        used=[t for t in drawn if not t.out],
        views=views,
        numbers={v.number for t in drawn for v in t.views},
    )


def _view(number: int, view: BoardView, names: Sequence[str], key: str) -> ShownView:
    option = "" if view.reason or key else leaving_out(names, number)
    used = int(view.used.sum())
    return ShownView(number, view.name, view.board + 1, used, len(view), view.rms, view.reason, option)


def leaving_out(names: Sequence[str], number: int) -> str:
    """The option of `rcdn calibrate` that leaves out view `number` (from 1) of pictures `names`."""
    return f"--leave-out {shlex.quote(view_name(names, number - 1))}"


def _marks(chosen: list[Shot]) -> tuple[tuple[str, Markup], ...]:
    """The legend of the kinds of corners that occur."""
    views = [v for s in chosen for _, v in s.views]
    outliers = any(not v.reason and not v.used.all() for v in views)
    kinds = (
        ("used corner", "u", "M9 7h0", 6.0, any(not v.reason for v in views)),
        ("outlier, not used", "o", "M5 3l8 8m0-8l-8 8", 2.0, outliers),
        ("corner of a view left out", "l", "M4 7a5 5 0 1 0 10 0a5 5 0 1 0-10 0", 2.0, any(v.reason for v in views)),
    )
    back = tag("rect", width=18, height=14, rx=3, fill="#2b3138")
    return tuple(
        (word, join(back, tag("path", class_=kind, fill="none", stroke_linecap="round", stroke_width=wide, d=d)))
        for word, kind, d, wide, there in kinds
        if there
    )


def _thumbnail(shot: Shot, views: Sequence[ShownView], most: int) -> Thumbnail:
    mine = tuple(views[k - 1] for k, _ in shot.views)
    name = short(shot.name)
    texts = []
    for view in mine:
        text = f"left out: {view.reason}" if view.reason else f"{view.used} of {counted(view.corners, 'corner')}"
        texts.append(f"board {view.board}: {text}" if len(mine) > 1 else text)
    overlay = pictures.corners_overlay(shot, most)
    picture = Framed(shot.size, shot.jpeg, overlay, f"{name}, {'; '.join(texts)}")
    return Thumbnail(name, picture, mine, shot.size[0] / shot.size[1], shot.out)


def straight(calibration: Calibration, show: Pictures | None) -> Straight:
    """One picture as taken and undistorted."""
    camera, found = calibration.camera, pictures.sample(calibration, show)
    plain = camera.model == "pinhole" and camera.correction is None
    if found is None:
        return Straight(plain, show is not None)
    titles = "as taken", f"undistorted, {number(found.angle, 3)}° across"
    before, after = (
        Framed(
            found.size,
            found.pair[k],
            pictures.chord_overlay(found.chords[k], found.corners[k]),
            f"View {found.number}, {title}, with straight lines along the board's edges",
        )
        for k, title in enumerate(titles)
    )
    return Straight(plain, True, before, after, found.bow, found.angle)
