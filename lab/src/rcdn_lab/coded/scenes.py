"""Rendered pictures of boards with codes: kinds (what is printed) × conditions (how it is seen), at VGA.

The board fills the frame as far as its roll and tilt allow, so that its squares have about 25 to 70 px; half of that
under `half resolution`.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import cv2
import numpy as np

from rcdn.synthetic import Background, Cover, Scene, Sensor
from rcdn.targets.puzzle import CODE_1, CODE_2
from rcdn.types import Array
from rcdn.types.target import AprilGrid, Charuco, PuzzleBoard, Target
from rcdn_lab.coded.drawings import Drawing, aprilgrid_drawing, charuco_drawing, marker_count, puzzleboard_drawing
from rcdn_lab.coded.score import TrueBoard
from rcdn_lab.coded.views import CodedTruth, drawing_truth, posed, render_drawing

FIRST = 8_400_000_000
"""No training and no other test uses this seed."""
BACKGROUNDS = ("noise", "shapes", "text")
BLACK, WHITE = 0.1, 0.87
"""reflectance of the print: 196 grey levels of contrast"""
LEFT = 0.72
"""share of the corners that remain visible beside a cut or a cover"""
Rng = np.random.Generator
Kind = Callable[[Rng, bool], tuple[Drawing, Target]]
"""random generator, and whether only a part of the board will be seen → a drawing and its target"""


@dataclass(frozen=True)
class Condition:
    """How a board is seen. `noise`: σ, grey levels; `blur`: σ, px; `tilt`: degrees from the line of sight, None: 0 to
    25 at random; `light`: share of the usual one; `cut`, `cover`: the frame, or an object in front of the board, leaves
    `LEFT` of its corners visible; `scale`: of the picture; `fisheye`: degrees across the picture, equidistant, 0: a
    pinhole. `goal`: the least recall required, None: no requirement."""

    noise: float = 2.0
    blur: float = 0.6
    tilt: float | None = None
    light: float = 1.0
    cut: bool = False
    cover: bool = False
    scale: float = 1.0
    fisheye: float = 0.0
    goal: float | None = None


CONDITIONS = {
    "plain": Condition(goal=0.98),
    "noise 20": Condition(noise=20, goal=0.98),
    "noise 40": Condition(noise=40, goal=0.95),
    "blur 2": Condition(blur=2, goal=0.95),
    "blur 3": Condition(blur=3, goal=0.8),
    "tilt 60": Condition(tilt=60, goal=0.98),
    "dark": Condition(light=0.2, goal=0.98),
    "cut": Condition(cut=True, goal=0.98),
    "cover": Condition(cover=True, goal=0.95),
    "half resolution": Condition(scale=0.5),
    "fisheye 150": Condition(fisheye=150),
}


@dataclass(frozen=True, eq=False)
class Made:
    """A picture (H, W) uint8, its board, and the scene; `pitch`: median distance between neighbouring corners, px."""

    image: Array
    board: TrueBoard
    scene: Scene
    pitch: float


def _charuco(rng: Rng, part: bool, names: tuple[str, ...]) -> tuple[Drawing, Target]:
    """5–11 × 4–9 squares, markers of .5–.85, some legacy, inverted, or with a first id other than 0.

    A first id other than 0 is never a multiple of the number of markers in two rows: such a board is indistinguishable
    from the bottom of a larger one. It is 0 for boards that are cut, because a part of a board with another first id
    may equally be another part of a larger one.
    """
    while True:
        columns, rows = int(rng.integers(5, 12)), int(rng.integers(4, 10))
        legacy, inverted = bool(rows % 2 == 0 and rng.random() < 0.3), bool(rng.random() < 0.15)
        first = int(rng.integers(1, 30)) if rng.random() < 0.12 else 0
        name = names[int(rng.integers(len(names)))]
        ratio = round(float(rng.uniform(0.5, 0.85)), 2)
        known = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))
        if first + marker_count(columns, rows, legacy) <= len(known.bytesList) and (not first or first % columns):
            first = 0 if part else first
            drawing = charuco_drawing(columns, rows, name, ratio, legacy, inverted, first)
            return drawing, Charuco(columns, rows, name, ratio, first, legacy, inverted)


def _aprilgrid(rng: Rng, _part: bool, family: str, border: int) -> tuple[Drawing, Target]:
    """3–6 × 3–5 tags, gaps of .2–.4."""
    columns, rows, gap = int(rng.integers(3, 7)), int(rng.integers(3, 6)), round(float(rng.uniform(0.2, 0.4)), 2)
    drawing = aprilgrid_drawing(columns, rows, f"DICT_APRILTAG_{family.removeprefix('tag')}", border, gap)
    return drawing, AprilGrid(columns, rows, family, gap, border)


def _puzzleboard(rng: Rng, _part: bool) -> tuple[Drawing, Target]:
    """8–13 × 6–10 corners anywhere on the code."""
    columns, rows, start = int(rng.integers(8, 14)), int(rng.integers(6, 11)), rng.integers(0, 501, 2)
    return puzzleboard_drawing(columns, rows, (int(start[0]), int(start[1])), (CODE_1, CODE_2)), PuzzleBoard()


def _sizes(side: str) -> tuple[str, ...]:
    return tuple(f"DICT_{side}_{size}" for size in (50, 100, 250, 1000))


KINDS: dict[str, Kind] = {
    **{f"charuco {side}": partial(_charuco, names=_sizes(side)) for side in ("4X4", "5X5", "6X6", "7X7")},
    **{
        f"charuco {name}": partial(_charuco, names=(f"DICT_{name}",))
        for name in (
            "ARUCO_ORIGINAL", "APRILTAG_16h5", "APRILTAG_25h9", "APRILTAG_36h10", "APRILTAG_36h11", "ARUCO_MIP_36h12",
        )
    },
    **{
        f"aprilgrid {f}": partial(_aprilgrid, family=f, border=2)
        for f in ("tag36h11", "tag36h10", "tag25h9", "tag16h5")
    },
    "aprilgrid tag36h11 border 1": partial(_aprilgrid, family="tag36h11", border=1),
    "puzzleboard": _puzzleboard,
}  # fmt: skip
"""what is printed → the function that draws it"""


def made(kind: str, condition: str, index: int) -> Made:
    """Picture `index` of a kind under a condition: the same board in the same pose under each condition, except for
    tilt and lens."""
    rng = np.random.default_rng([FIRST, zlib.crc32(kind.encode()), index])
    drawing, target = KINDS[kind](rng, CONDITIONS[condition].cut)
    scene = _scene(rng, drawing, CONDITIONS[condition], index)
    truth = drawing_truth(drawing, scene)
    board = TrueBoard(target, truth.ids, truth.xy, truth.visible)
    return Made(render_drawing(drawing, scene), board, scene, float(np.median(truth.pitch[truth.visible])))


def _scene(rng: Rng, drawing: Drawing, c: Condition, index: int) -> Scene:
    width, height = round(640 * c.scale), round(480 * c.scale)
    lens: dict[str, Any] = {"focal": float(rng.uniform(0.9, 1.2)) * width}
    if c.fisheye:
        lens = {"focal": width / float(np.deg2rad(c.fisheye)), "model": "fisheye", "distortion": (0.0,) * 4}
    drawn = float(rng.uniform(0, 25))
    tilt = np.deg2rad(drawn if c.tilt is None else c.tilt)
    axis, roll, way = rng.uniform(0, 2 * np.pi, 3)
    scene = Scene(
        width, height, centre=((width - 1) / 2, (height - 1) / 2),
        sensor=Sensor(blur=c.blur, noise=c.noise, gain=c.light), seed=int(rng.integers(2**31)),
        background=Background(BACKGROUNDS[index % 3], int(rng.integers(2**31))), **lens,
    )  # fmt: skip
    rim = 6.0 * c.scale
    spec = posed(
        drawing, scene.camera, (rim, rim, width - 1 - rim, height - 1 - rim), float(tilt), float(axis), float(roll)
    )
    scene = replace(scene, boards=(replace(spec, black=BLACK, white=WHITE),))
    if c.cut:
        return _until(drawing, scene, partial(_shifted, way=float(way)))
    return _until(drawing, scene, _cover(drawing, scene, rng)) if c.cover else scene


def _until(drawing: Drawing, scene: Scene, change: Callable[[Scene, float], Scene]) -> Scene:
    """The scene changed by as many px as leave `LEFT` of the corners visible."""
    low, high = 0.0, float(scene.width)
    for _ in range(20):
        between = (low + high) / 2
        left = drawing_truth(drawing, change(scene, between)).visible.mean()
        low, high = (between, high) if left > LEFT else (low, between)
    return change(scene, low)


def _shifted(scene: Scene, by: float, way: float) -> Scene:
    """The picture's frame moved by `by` px in a direction, as if it were a part of a larger picture."""
    x, y = scene.centre
    return replace(scene, centre=(x + by * float(np.cos(way)), y + by * float(np.sin(way))))


def _cover(drawing: Drawing, scene: Scene, rng: Rng) -> Callable[[Scene, float], Scene]:
    """A round or elongated object that grows over a random corner of the board."""
    truth: CodedTruth = drawing_truth(drawing, scene)
    x, y = truth.xy[int(rng.integers(len(truth.xy)))].tolist()
    turn, value, length = float(rng.uniform(0, np.pi)), float(rng.uniform(0.2, 0.8)), float(rng.uniform(0, 1.5))
    along = np.array([np.cos(turn), np.sin(turn)]) * length

    def grown(scene: Scene, radius: float) -> Scene:
        dx, dy = (along * radius).tolist()
        return replace(scene, covers=(Cover(x - dx, y - dy, x + dx, y + dy, radius, value),))

    return grown
