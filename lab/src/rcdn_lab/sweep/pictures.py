"""Renders pictures from settings: seeded scenes with the difficulty that the setting specifies, and no other."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from rcdn.errors import ConfigError
from rcdn.geometry import project, unproject
from rcdn.synthetic import Background, Bend, BoardSpec, BoardTruth, Cover, Light, Scene, Sensor, render, truth
from rcdn.synthetic.sample import shade
from rcdn.synthetic.surface import board_to_pixels
from rcdn.types import Array, Camera
from rcdn_lab.sweep.settings import Setting

FIRST = 8_000_000_000
"""No training and no other test uses this seed."""
KINDS = ("noise", "shapes", "text")
CONTRAST = 170.0
"""grey levels from black to white before the sensor's gain"""
TRIES = 1000
FAR = 4000.0
"""px; beyond every frame"""
Rng = np.random.Generator
Fits = Callable[[BoardSpec], bool]


@dataclass(frozen=True, eq=False)
class Picture:
    """A picture (H, W) uint8, the exact corners of its boards, and what it was made from."""

    image: Array
    boards: list[BoardTruth]
    scene: Scene


def seed_of(factor: str, level: str, index: int) -> list[int]:
    """Seeds of one picture, different from those of any other level."""
    return [FIRST, zlib.crc32(factor.encode()), zlib.crc32(level.encode()), index]


def picture(setting: Setting, seed: list[int], size: tuple[int, int] = (9, 6)) -> Picture:
    """The picture of `seed`; its boards have `size` (columns, rows) of inner corners."""
    made = scene(setting, seed, size)
    return Picture(render(made), truth(made), made)


def scene(setting: Setting, seed: list[int], size: tuple[int, int] = (9, 6)) -> Scene:
    """The scene of `seed`: the same seed gives the same scene. Raises ConfigError if the boards do not fit the
    frame."""
    rng = np.random.default_rng(seed)
    made = _empty(rng, setting, seed[-1])
    for cell in _cells(setting.boards, made.width, made.height):
        made = replace(made, boards=(*made.boards, _board(rng, setting, made, size, cell)))
    if setting.cover:
        made = replace(made, covers=(_cover(rng, setting, made, seed[-1]),))
    if setting.shadow < 1:
        at = board_to_pixels(made.boards[0], made.camera, np.array([_middle(made.boards[0])]))[0]
        turn = float(rng.uniform(0, 2 * np.pi))
        half_plane = shade((at[0], at[1]), turn, FAR, FAR, setting.shadow, setting.penumbra)
        made = replace(made, light=replace(made.light, shadows=(half_plane,)))
    return made


def _empty(rng: Rng, s: Setting, index: int) -> Scene:
    """Frame, lens, illumination, sensor and background."""
    scale = 2 if s.square > 30 else 1
    width, height = 640 * scale, 480 * scale
    lens: dict[str, Any] = {"focal": float(rng.uniform(0.8, 1.2)) * width}
    if s.barrel:
        lens = {"focal": float(width), "model": "division", "distortion": (-s.barrel,)}
    if s.fisheye:
        lens = {"focal": width / float(np.deg2rad(s.fisheye)), "model": "fisheye", "distortion": (0.0,) * 4}
    turn, fall = rng.uniform(0, 2 * np.pi), np.log(s.falloff)
    gain = s.contrast / CONTRAST / np.sqrt(s.falloff)  # the brightest point is no brighter than without falloff
    middle = float(rng.uniform(-1, 1)) * 10 / 255 + 0.5
    sensor = Sensor(
        blur=s.blur, noise=s.noise, motion=s.motion, motion_angle=float(rng.uniform(0, np.pi)), jpeg=s.jpeg,
        gain=gain, offset=(1 - gain) * middle if s.falloff == 1 else 0.0,
    )  # fmt: skip
    return Scene(
        width, height, centre=((width - 1) / 2, (height - 1) / 2), sensor=sensor,
        light=Light(gx=float(fall * np.cos(turn)), gy=float(fall * np.sin(turn))),
        background=Background(s.clutter or KINDS[index % len(KINDS)], int(rng.integers(2**31))),
        seed=int(rng.integers(2**31)), **lens,
    )  # fmt: skip


def _cells(count: int, width: int, height: int) -> list[tuple[float, float, float, float]]:
    """`count` parts (x0, y0, x1, y1) of the frame, one for each board."""
    columns = {1: 1, 2: 2, 3: 3, 4: 2, 6: 3}.get(count, 1)
    rows = count // columns
    if not count:
        return []
    w, h = width / columns, height / rows
    return [(c * w, r * h, (c + 1) * w, (r + 1) * h) for r in range(rows) for c in range(columns)]


def _board(
    rng: Rng, s: Setting, frame: Scene, size: tuple[int, int], cell: tuple[float, float, float, float]
) -> BoardSpec:
    """A board with random position and roll in its cell, drawn repeatedly until it fits: all of it, or the share that
    is not cut."""
    dark = (255 - CONTRAST) / 510 + float(rng.uniform(-8, 8)) / 255
    bright = dark + CONTRAST / 255
    blank = BoardSpec(
        *size, (0, 0, 0), (0, 0, 1), black=dark, white=bright, margin=0.5, margin_value=bright,
        swap=bool(rng.random() < 0.5), bend=_bend(rng, s.bend),
    )  # fmt: skip
    x0, y0, x1, y1 = cell
    slack = 0.3 if s.cut else 0.0
    low, high = np.array([(x0, y0), (x1, y1)]) + slack * np.array([(x0 - x1, y0 - y1), (x1 - x0, y1 - y0)])
    pitch = s.square
    if s.boards > 1:  # so that the board fits its cell in any rotation
        pitch = min(pitch, 0.92 * min(x1 - x0, y1 - y0) / float(np.hypot(size[0] + 1, size[1] + 1)))
    for _ in range(TRIES):
        at = rng.uniform(low, high)
        tilt = float(rng.uniform(0, 20)) if s.tilt is None else s.tilt
        axis, roll = rng.uniform(0, 2 * np.pi, 2)
        spec = placed(blank, frame.camera, at, pitch, np.deg2rad(tilt), float(axis), float(roll))
        if spec is not None and (_is_cut(spec, frame, s.cut) if s.cut else _is_whole(spec, frame, cell)):
            return spec
    raise ConfigError(f"sweep: no board of {size} corners fits the frame as {s} wants it")


def placed(
    spec: BoardSpec, camera: Camera, at: Array, pitch: float, tilt: float, axis: float, roll: float
) -> BoardSpec | None:
    """`spec` with its centre at pixel `at` (2,), and squares of `pitch` px if it faced the camera there.

    Rolled by `roll`, then tilted by `tilt` about a direction `axis` of its plane, radians. The angle between the normal
    and the line of sight to the centre is `tilt`. None where the lens has no ray at that pixel.
    """
    ray = unproject(camera, at)
    if not np.isfinite(ray).all():
        return None
    ray = ray / np.linalg.norm(ray)
    face = Rotation.align_vectors(ray[None], [[0, 0, 1]])[0].as_matrix()
    lean = cv2.Rodrigues(tilt * np.array([np.cos(axis), np.sin(axis), 0]))[0]
    R = face @ lean @ cv2.Rodrigues(np.array([0, 0, roll]))[0]
    step = 1e-4
    jacobian = (project(camera, ray + step * face[:, :2].T) - project(camera, ray - step * face[:, :2].T)) / (2 * step)
    scale = np.sqrt(abs(np.linalg.det(jacobian)))  # px per radian
    if not np.isfinite(scale):
        return None
    t = ray * scale / pitch - R @ np.array([*_middle(spec), 0])
    r = cv2.Rodrigues(R)[0].ravel()
    return replace(spec, rvec=(float(r[0]), float(r[1]), float(r[2])), tvec=(float(t[0]), float(t[1]), float(t[2])))


def _middle(spec: BoardSpec) -> tuple[float, float]:
    return (spec.cols - 1) / 2, (spec.rows - 1) / 2


def _grid(spec: BoardSpec, rim: int) -> Array:
    """(column, row) of the corners, and of `rim` more on each side."""
    axes = np.arange(-rim, spec.cols + rim), np.arange(-rim, spec.rows + rim)
    return np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)


def _is_whole(spec: BoardSpec, frame: Scene, cell: tuple[float, float, float, float]) -> bool:
    """Whether all squares are at least 3 px inside the cell, none of them hidden by the board's bending or without a
    projection."""
    xy = board_to_pixels(spec, frame.camera, _grid(spec, 1))
    if not np.isfinite(xy).all() or (xy < np.array(cell[:2]) + 3).any() or (xy > np.array(cell[2:]) - 4).any():
        return False
    if spec.bend is None and frame.model == "pinhole":
        return True
    known = truth(replace(frame, boards=(spec,)))[0]
    return bool(known.visible.all())


def _is_cut(spec: BoardSpec, frame: Scene, share: float) -> bool:
    """Whether the frame cuts off about `share` of the corners, and leaves at least three columns and rows."""
    ij = _grid(spec, 0)
    xy = board_to_pixels(spec, frame.camera, ij)
    inside = (
        np.isfinite(xy).all(axis=1) & (xy >= 2).all(axis=1) & (xy <= [frame.width - 3, frame.height - 3]).all(axis=1)
    )
    if abs(1 - share - inside.mean()) > 0.06:
        return False
    return min(len(np.unique(ij[inside, k])) for k in (0, 1)) >= 3


def _bend(rng: Rng, name: str) -> Bend | None:
    if not name:
        return None
    kind, size = name.split()
    sign, angle = float(rng.choice([-1, 1])), float(rng.uniform(0, np.pi))
    if kind == "cylinder":
        return Bend(curvature=sign / float(size), angle=angle)
    return Bend(amplitude=sign * float(size), period=8.0, phase=float(rng.uniform(0, 2 * np.pi)), angle=angle)


def _cover(rng: Rng, s: Setting, made: Scene, index: int) -> Cover:
    """A grey object over a quadrant of the first board, each in turn, or a bar across it at any angle."""
    spec = made.boards[0]
    value = float(rng.uniform(0.25, 0.75))
    u, v = _middle(spec)
    if s.cover == "quadrant":  # from the centre, between two corners, to beyond the quiet zone
        u, v = float(np.floor(u)) + 0.5, float(np.floor(v)) + 0.5
        du, dv = (1 - 2 * (index % 2)) * (spec.cols / 2 + 2), (1 - 2 * (index // 2 % 2)) * (spec.rows / 2 + 2)
        ends = np.array([(u, v + dv / 2), (u + du, v + dv / 2), (u, v), (u, v + dv)])
        p, q, low, high = board_to_pixels(spec, made.camera, ends)
        radius = float(np.linalg.norm(high - low)) / 2
    else:
        u, v = np.array([u, v]) + rng.uniform(-0.15, 0.15, 2) * [spec.cols, spec.rows]
        at, turn = board_to_pixels(spec, made.camera, np.array([(u, v)]))[0], rng.uniform(0, np.pi)
        along = 2000 * np.array([np.cos(turn), np.sin(turn)])
        p, q, radius = at - along, at + along, s.bar * s.square / 2
    return Cover(float(p[0]), float(p[1]), float(q[0]), float(q[1]), radius, value, square=True)
