"""Thumbnails of all pictures with their detections, and one undistorted picture, in a page of bounded size."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import cv2
import numpy as np
from markupsafe import Markup

from rcdn.errors import present
from rcdn.geometry import project, unproject
from rcdn.geometry.undistort import undistorted_camera, undistortion_maps
from rcdn.io import as_grey
from rcdn.report.calibration.charts import thinned
from rcdn.report.calibration.svg import crosses, dots, each, rings, segments, tag
from rcdn.types import Array, BoardView, Calibration, Camera

Pictures = Callable[[str], Array | None]
"""Returns the photograph (H, W) of a view by its name, or None. Its attribute `left_out`, if any, is a sentence for the
page on photographs that aren't shown."""

WIDTHS = (960, 760, 560, 480, 400, 320, 240, 180, 128)
"""possible widths of thumbnails, px; the largest that fits is used"""
MOST_PICTURES = 120
"""largest number of pictures that are shown"""
DOTS = 40_000
"""largest number of corners drawn in all thumbnails together"""
THUMB_QUALITY, SAMPLE_QUALITY, SAMPLE_WIDTH = 70, 80, 760
TRIES = 5
"""largest number of pictures tried for the sample until one can be read"""


@dataclass(frozen=True, eq=False)
class Shot:
    """One picture: its `views` with their numbers (from 1), its `size` (width, height) px, and a small JPEG if it is
    shown."""

    name: str
    views: tuple[tuple[int, BoardView], ...]
    size: tuple[int, int]
    jpeg: bytes | None = None

    @property
    def out(self) -> bool:
        """Whether no board of this picture was used."""
        return all(v.reason for _, v in self.views)


@dataclass(frozen=True, eq=False)
class Framed:
    """A photograph, or a grey rectangle of its shape, with an SVG over it in its pixel coordinates (pixel centres at
    integers): `size` (width, height) px, its `jpeg`, the `overlay`, and what it shows in words (`alt`)."""

    size: tuple[int, int]
    jpeg: bytes | None
    overlay: Markup
    alt: str


def shots(calibration: Calibration) -> list[Shot]:
    """The pictures in the order of the input, without JPEGs."""
    views: dict[str, list[tuple[int, BoardView]]] = {}
    for k, view in enumerate(calibration.views, start=1):
        views.setdefault(view.name, []).append((k, view))
    return [Shot(name, tuple(found), calibration.camera.image_size) for name, found in views.items()]


def worth_showing(every: list[Shot], most: int = MOST_PICTURES) -> list[Shot]:
    """At most `most` of the pictures: first those with views left out, then those with the largest RMS, then an even
    selection of the others; in the order of the input."""
    if len(every) <= most:
        return every
    out = [k for k, s in enumerate(every) if any(v.reason for _, v in s.views)][: most // 2]
    rest = [k for k in range(len(every)) if k not in set(out)]
    worst = sorted(rest, key=lambda k: -max((v.rms for _, v in every[k].views if v.rms == v.rms), default=0.0))[
        : most // 4
    ]
    rest = [k for k in rest if k not in set(worst)]
    even = [rest[i] for i in thinned(len(rest), most - len(out) - len(worst))]
    return [every[k] for k in sorted({*out, *worst, *even})]


def with_jpegs(chosen: list[Shot], pictures: Pictures | None, budget: int) -> list[Shot]:
    """The shots with JPEGs of one width, the largest whose data fit into `budget` bytes of the page; if even the
    smallest don't fit, the last shots have no JPEG."""
    if pictures is None or not chosen:
        return chosen
    read = [(shot, _small(pictures(shot.name), WIDTHS[0])) for shot in chosen]
    for width in WIDTHS:
        few = [_with_jpeg(shot, picture, width) for shot, picture in read[:: max(len(read) // 8, 1)]]
        if width > WIDTHS[-1] and sum(map(_in_page, few)) * len(read) / len(few) > 1.5 * budget:
            continue  # certainly too large
        done = [_with_jpeg(shot, picture, width) for shot, picture in read]
        if sum(_in_page(s) for s in done) <= budget:
            return done
    room = np.cumsum([_in_page(s) for s in done]) <= budget
    return [s if fits else replace(s, jpeg=None) for s, fits in zip(done, room, strict=True)]


def _small(picture: Array | None, width: int) -> tuple[Array, tuple[int, int]] | None:
    """A picture reduced to at most `width` px (8 bits), and its full size (width, height)."""
    if picture is None:
        return None
    grey = as_grey(picture)
    high, wide = grey.shape
    factor = min(1.0, width / max(wide, high))
    size = max(round(wide * factor), 1), max(round(high * factor), 1)
    return shrunk(grey, size), (wide, high)


def shrunk(grey: Array, size: tuple[int, int]) -> Array:
    """A grey picture reduced to `size` (width, height); 8 bits."""
    small = grey if size == grey.shape[::-1] else cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
    return np.asarray(np.clip(small, 0, 255).astype(np.uint8))


def _with_jpeg(shot: Shot, read: tuple[Array, tuple[int, int]] | None, width: int) -> Shot:
    if read is None:
        return shot
    small = present(_small(read[0], width), "a picture")
    return replace(shot, size=read[1], jpeg=jpeg(small[0], THUMB_QUALITY))


def jpeg(grey: Array, quality: int) -> bytes:
    """A grey picture as JPEG."""
    return cv2.imencode(".jpg", grey, [cv2.IMWRITE_JPEG_QUALITY, quality])[1].tobytes()


def _in_page(shot: Shot) -> int:
    return 0 if shot.jpeg is None else 4 * len(shot.jpeg) // 3 + 4


def corners_overlay(shot: Shot, most: int) -> Markup:
    """Marks of the corners, at most `most`, with a dark edge: dots (used), crosses (outliers), rings (views left
    out)."""
    views = [v for _, v in shot.views]
    decimals = 0 if max(shot.size) > 1500 else 1
    size = max(shot.size) / 110
    groups = {
        "u": [v.xy[v.used] for v in views if not v.reason],
        "o": [v.xy[~v.used] for v in views if not v.reason],
        "l": [v.xy for v in views if v.reason],
    }
    total = sum(len(v) for v in views)
    out = []
    for kind, parts in groups.items():
        xy = np.concatenate(parts or [np.zeros((0, 2))])
        xy = xy[thinned(len(xy), max(most * len(xy) // max(total, 1), 1))] if total > most else xy
        if not len(xy):
            continue
        d = (
            dots(xy, decimals)
            if kind == "u"
            else crosses(xy, size, decimals)
            if kind == "o"
            else rings(xy, size, decimals)
        )
        wide = _dot(xy, shot.size[0]) if kind == "u" else 1.8
        out += [
            tag("path", class_=c, stroke_width=w, d=d)
            for c, w in (("halo2", wide + min(1.6, 0.5 * wide)), (kind, wide))
        ]
    return each(out)


def _dot(xy: Array, width: int) -> float:
    """Diameter of a corner's dot, screen px, in a thumbnail of usual width; smaller if corners are close together."""
    pitch = float(np.sqrt(np.prod(np.ptp(xy, axis=0) + 1) / len(xy))) * 240 / width
    return float(np.clip(0.28 * pitch, 1.6, 4.5))


@dataclass(frozen=True, eq=False)
class Sample:
    """One picture before and after undistortion: JPEGs of `size` px; the board's outer lines (L, 2, 2) as chords in
    their pixels; the largest distance of a corner from its chord, px, before and after (`bow`); the horizontal field of
    view of the undistorted picture, degrees (`angle`)."""

    number: int
    name: str
    size: tuple[int, int]
    pair: tuple[bytes, bytes]
    chords: tuple[Array, Array]
    corners: tuple[Array, Array]
    bow: tuple[float, float]
    angle: float


def sample(calibration: Calibration, pictures: Pictures | None) -> Sample | None:
    """The picture, before and after undistortion, of the used view in which the lens bends the board's lines most; None
    if no picture can be read."""
    camera = calibration.camera
    if pictures is None or (camera.model == "pinhole" and camera.correction is None):
        return None
    numbered = [(k, v) for k, v in enumerate(calibration.views, start=1) if not v.reason]
    flat = undistorted_camera(camera)
    bent = sorted(
        numbered, key=lambda item: (-_inside(item[1], camera, flat), -_bow(item[1].xy, _outer_lines(item[1])))
    )
    for number, view in bent[:TRIES]:
        picture = pictures(view.name)
        if picture is not None and picture.shape[:2] == camera.image_size[::-1]:
            return _sample(number, view, camera, as_grey(picture))
    return None


def _inside(view: BoardView, camera: Camera, flat: Camera) -> bool:
    """Whether nearly all corners lie inside the undistorted picture."""
    xy = project(flat, unproject(camera, view.xy))
    return float(((xy > 0) & (xy < np.array(flat.image_size) - 1)).all(axis=1).mean()) > 0.95


def _sample(number: int, view: BoardView, camera: Camera, grey: Array) -> Sample:
    flat = undistorted_camera(camera)
    factor = min(1.0, SAMPLE_WIDTH / max(camera.image_size))
    size = round(camera.image_size[0] * factor), round(camera.image_size[1] * factor)
    before = shrunk(grey, size)
    after = undistort(before, camera.resized(size), flat.resized(size))
    straight = project(flat, unproject(camera, view.xy))
    lines = _outer_lines(view)
    ratio = np.array(size) / np.array(camera.image_size)
    chords, corners = [], []
    for xy in (view.xy, straight):
        shown = (xy + 0.5) * ratio - 0.5
        chords.append(np.array([[shown[line[0]], shown[line[-1]]] for line in lines]).reshape(-1, 2, 2))
        on = np.array(sorted({i for line in lines for i in line}), int)
        corners.append(shown[on])
    angle = 2 * np.degrees(np.arctan(camera.image_size[0] / 2 / flat.K[0, 0]))
    bow = _bow(view.xy, lines), _bow(straight, lines)
    pair = jpeg(before, SAMPLE_QUALITY), jpeg(after, SAMPLE_QUALITY)
    return Sample(number, view.name, size, pair, (chords[0], chords[1]), (corners[0], corners[1]), bow, float(angle))


def undistort(picture: Array, camera: Camera, flat: Camera, R: Array | None = None) -> Array:
    """`picture` of `camera` resampled to the camera `flat`, rotated by `R` (transforms camera axes to those of `flat`);
    grey outside the original picture."""
    x, y = undistortion_maps(camera, flat, R)
    return cv2.remap(picture, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=96)


def _outer_lines(view: BoardView) -> list[list[int]]:
    """Indices of the used corners along the board's first and last row and column, in order; only lines of at least
    three."""
    lines = []
    used = np.flatnonzero(view.used)
    for axis in (0, 1):
        label = view.ij[used, axis]
        for value in (label.min(), label.max()) if len(used) else ():
            line = used[label == value]
            if len(line) >= 3:
                lines.append([int(i) for i in line[np.argsort(view.ij[line, 1 - axis])]])
    return lines


def _bow(xy: Array, lines: list[list[int]]) -> float:
    """The largest distance of a corner from the chord of its line, px; 0 without lines."""
    worst = 0.0
    for line in lines:
        a, b = xy[line[0]], xy[line[-1]]
        along = (b - a) / max(float(np.hypot(*(b - a))), 1e-9)
        away = xy[line] - a
        gap = np.abs(away[:, 0] * along[1] - away[:, 1] * along[0])
        worst = max(worst, float(np.nanmax(gap, initial=0.0)))
    return worst


def chord_overlay(chords: Array, corners: Array) -> Markup:
    """Chords of the board's outer lines, and the corners on those lines."""
    line, points = segments(chords[:, 0], chords[:, 1]), dots(corners[np.isfinite(corners).all(axis=1)])
    return each([
        tag("path", class_="halo2", stroke_width=3.2, d=line),
        tag("path", class_="h", stroke_width=1.6, d=line),
        tag("path", class_="halo2", stroke_width=6, d=points),
        tag("path", class_="c", stroke_width=4, d=points),
    ])  # fmt: skip
