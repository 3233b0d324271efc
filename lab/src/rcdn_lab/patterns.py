"""Regular patterns that are no boards: rendered stripes, meshes and dots, alone and behind a board.

A picture is a pattern in perspective, at any angle, blurred, with noise, half of them compressed. By itself it should
show no board; behind a board it should hide none of its corners and add none.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import astuple, dataclass
from typing import Any

import cv2
import numpy as np

from rcdn import Detector
from rcdn.config import DetectorConfig
from rcdn.geometry.near import nearest
from rcdn.types import Array
from rcdn.types.arrays import Real, Shaped
from rcdn_lab.share_out import share_out

SIZES = ((640, 480), (960, 720))
"""width and height of every other picture, px"""
SLANT = 0.6
"""largest change of scale from one side of the picture to the middle"""
CORNERS = (9, 6)
"""inner corners of the board, columns and rows"""
NEAR = 1.5
"""px: a corner of a found board that is so close to a true one is it"""
Task = tuple[str, int, bool]
"""kind, index of the picture, whether with a board"""
Plane = Real[Array, "h w"]


def _distance(t: Plane) -> Plane:
    """Distance from the nearest whole number."""
    return np.abs(t - np.round(t))


def _holes(u: Plane, v: Plane, row: float, radius: float) -> Plane:
    """Round holes, every other row of which is shifted by half their distance; `row`: distance of equal rows."""
    one, other = (np.hypot(_distance(u + by), row * _distance(v / row + by)) for by in (0, 0.5))
    return (np.minimum(one, other) < radius).astype(float)


def _stripes(u: Plane, v: Plane, rng: np.random.Generator) -> Plane:
    return (u % 1 < rng.uniform(0.35, 0.65)).astype(float)


def _corrugated(u: Plane, v: Plane, rng: np.random.Generator) -> Plane:
    return 0.5 + 0.5 * np.sin(2 * np.pi * u)


def _grating(u: Plane, v: Plane, rng: np.random.Generator) -> Plane:
    return np.clip(1.6 * _corrugated(u, v, rng) - rng.uniform(0, 0.3), 0, 1)


def _fence(u: Plane, v: Plane, rng: np.random.Generator) -> Plane:
    half = rng.uniform(0.04, 0.2)
    return ((_distance(u) > half) & (_distance(v) > half)).astype(float)


def _lattice(u: Plane, v: Plane, rng: np.random.Generator) -> Plane:
    a, b = rng.uniform(0.1, 0.4, 2)
    return ((_distance(u) > a) & (_distance(v) > b)).astype(float)


def _staggered(u: Plane, v: Plane, rng: np.random.Generator) -> Plane:
    return _holes(u, v, 1.0, rng.uniform(0.25, 0.45))


def _hexagonal(u: Plane, v: Plane, rng: np.random.Generator) -> Plane:
    return _holes(u, v, 3**0.5, rng.uniform(0.25, 0.45))


def _dots(u: Plane, v: Plane, rng: np.random.Generator) -> Plane:
    return (np.hypot(_distance(u), _distance(v)) < rng.uniform(0.15, 0.4)).astype(float)


KINDS: dict[str, tuple[Callable[[Plane, Plane, np.random.Generator], Plane], tuple[float, float]]] = {
    "stripes": (_stripes, (5, 60)),
    "corrugated": (_corrugated, (5, 60)),
    "grating": (_grating, (5, 60)),
    "fence": (_fence, (10, 70)),
    "lattice": (_lattice, (10, 70)),
    "staggered holes": (_staggered, (10, 70)),
    "hexagonal holes": (_hexagonal, (10, 70)),
    "dots": (_dots, (10, 70)),
}
"""the pattern in periods, 0..1, and the range of the period, px"""


@dataclass(frozen=True)
class Count:
    """Pictures of a pattern: `alone`, of which some have a `false` board and in some it was `told` that they show no
    board; `behind` a board, of which are `whole`, with the `wrong` corners of that board and false boards `beside`."""

    alone: int = 0
    false: int = 0
    told: int = 0
    behind: int = 0
    whole: int = 0
    wrong: int = 0
    beside: int = 0

    def __add__(self, other: Count) -> Count:
        return Count(*(a + b for a, b in zip(astuple(self), astuple(other), strict=True)))


_detector: list[Detector] = []
"""the detector of this process"""


def settings_of(count: int) -> dict[str, Any]:
    """Settings recorded with the figures."""
    return {
        "count": count, "preset": "auto", "sizes": [list(s) for s in SIZES], "slant": SLANT, "board": list(CORNERS),
        "periods": {name: list(period) for name, (_, period) in KINDS.items()}, "near": NEAR,
    }  # fmt: skip


def table(
    count: int = 50, workers: int = 1, progress: Callable[[int, int], None] | None = None
) -> list[dict[str, Any]]:
    """One row for each kind of pattern, of `count` pictures alone and as many behind a board, and a last one over all.

    `progress` is called with the number of pictures done and in total. The same count gives the same rows, whatever
    `workers`.
    """
    tasks = [(kind, k, board) for kind in KINDS for k in range(count) for board in (False, True)]
    found = dict.fromkeys(KINDS, Count())
    for (kind, _, _), part in zip(tasks, share_out(_one, tasks, workers, _load, (), progress), strict=True):
        found[kind] += part
    return [_row(kind, part) for kind, part in (found | {"all": sum(found.values(), Count())}).items()]


def _row(kind: str, count: Count) -> dict[str, Any]:
    names = ("alone", "false board", "told", "behind a board", "whole", "wrong corners", "false beside")
    return {"pattern": kind} | dict(zip(names, astuple(count), strict=True))


def _load() -> None:
    _detector[:] = [Detector(DetectorConfig(threads=1))]


def _one(task: Task) -> Count:
    kind, index, board = task
    image, truth = picture(kind, index, board)
    found = _detector[0].detect(image)
    if not board:
        told = any(warning.startswith("not supported: ") for warning in found.warnings)
        return Count(alone=1, false=int(bool(found.boards)), told=int(told))
    return behind([b.xy for b in found.boards], truth)


def behind(boards: Sequence[Array], truth: Real[Array, "n 2"]) -> Count:
    """The count of one picture from the corners (M, 2) of each found board, and those of the true one. A found board of
    which no corner is a true one is beside it."""
    off = [nearest(truth, xy, 1)[0][:, 0] > NEAR for xy in boards]
    own = [each for each in off if not each.all()]
    whole = any(len(each) == len(truth) and not each.any() for each in own)
    return Count(behind=1, whole=int(whole), wrong=sum(int(e.sum()) for e in own), beside=len(off) - len(own))


def picture(kind: str, index: int, board: bool) -> tuple[Shaped[Array, "h w"], Real[Array, "n 2"]]:
    """A picture of a pattern, and the corners (N, 2) px of the board before it; (0, 2) without one."""
    rng = np.random.default_rng([list(KINDS).index(kind), index])
    width, height = SIZES[index % len(SIZES)]
    low, high = rng.uniform(10, 80), rng.uniform(120, 250)
    grey: Array = low + (high - low) * _pattern(kind, (width, height), rng)
    if rng.uniform() < 0.5:
        grey = cv2.GaussianBlur(grey, (0, 0), rng.uniform(0.4, 1.5))
    truth = np.zeros((0, 2))
    if board:
        grey, truth = _with_board(grey, rng)
    grey = np.clip(grey + rng.normal(0, rng.uniform(0, 8), grey.shape), 0, 255).astype(np.uint8)
    if rng.uniform() < 0.5:
        quality = [cv2.IMWRITE_JPEG_QUALITY, int(rng.integers(40, 95))]
        grey = np.asarray(cv2.imdecode(cv2.imencode(".jpg", grey, quality)[1], cv2.IMREAD_GRAYSCALE))
    return grey, truth


def _pattern(kind: str, size: tuple[int, int], rng: np.random.Generator) -> Shaped[Array, "h w"]:
    """The pattern, 0..1: means of 2 × 2 samples a pixel."""
    draw, periods = KINDS[kind]
    width, height = size
    y, x = np.mgrid[: 2 * height, : 2 * width] / 2.0
    x, y = x - width / 2, y - height / 2
    depth = 1 + (rng.uniform(-SLANT, SLANT) * x + rng.uniform(-SLANT, SLANT) * y) / width
    period, angle = np.exp(rng.uniform(*np.log(periods))), rng.uniform(0, np.pi)
    u, v = np.cos(angle) * x + np.sin(angle) * y, np.cos(angle) * y - np.sin(angle) * x
    drawn = draw(u / depth / period, v / depth / period, rng)
    if draw not in (_stripes, _corrugated, _grating) and rng.uniform() < 0.4:
        drawn = 1 - drawn
    return np.asarray(cv2.resize(drawn, size, interpolation=cv2.INTER_AREA))


def _with_board(grey: Array, rng: np.random.Generator) -> tuple[Shaped[Array, "h w"], Real[Array, "n 2"]]:
    """A board with a margin of a square before the picture, in perspective, and its corners (N, 2) px."""
    height, width = grey.shape
    columns, rows = CORNERS
    side = 40
    squares = np.add.outer(np.arange(rows + 1), np.arange(columns + 1)) % 2 * 190.0 + 40
    print_ = np.pad(np.kron(squares, np.ones((side, side))), side, constant_values=230)
    size = np.array(print_.shape[::-1], float)
    ends = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * size
    scale, angle = rng.uniform(0.35, 0.8) * min([width, height] / size), rng.uniform(-0.6, 0.6)
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    at = (ends - size / 2) * scale @ turn * (1 + rng.uniform(-0.12, 0.12, (4, 1))) + [width / 2, height / 2]
    M = cv2.getPerspectiveTransform(ends.astype(np.float32), at.astype(np.float32))
    larger = np.diag([2.0, 2.0, 1.0]) @ M
    drawn, there = (
        cv2.resize(cv2.warpPerspective(a, larger, (2 * width, 2 * height)), (width, height), None, 0, 0, cv2.INTER_AREA)
        for a in (print_, np.ones_like(print_))
    )
    j, i = np.mgrid[1 : rows + 1, 1 : columns + 1]
    places = np.stack([(i + 1) * side, (j + 1) * side], axis=-1).reshape(1, -1, 2).astype(float)
    return grey * (1 - there) + drawn, cv2.perspectiveTransform(places, M)[0] - 0.5
