"""Two rendered cameras on one frame, like the paper's head-mounted eye tracker (section 4.4), with exact truth.

Both see the whole board in every view: near and far, tilted, with varying sharpness, noise and illumination. The same
seed gives the same pictures.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from rcdn.errors import ConfigError
from rcdn.geometry import rotation
from rcdn.synthetic import Background, BoardSpec, Light, Scene, Sensor, truth
from rcdn.synthetic.sample import shade
from rcdn.synthetic.surface import board_to_pixels
from rcdn.types import Array, Camera
from rcdn_lab.sweep.pictures import KINDS, TRIES, placed

FIRST = 8_500_000_000
"""No training and no other test uses this seed."""
IMAGE_SIZE = (1280, 720)
SIZE, SPACING = (9, 6), 0.025
"""columns and rows of inner corners; side of a square, m"""
SIDES = ("left", "right")
LENSES = {
    "left": (905.0, (641.3, 355.2), (-0.172, 0.063, 0.0007, -0.0004, -0.011)),
    "right": (911.5, (633.8, 364.9), (-0.168, 0.058, -0.0003, 0.0006, -0.009)),
}
"""focal length, px; principal point; k1 k2 p1 p2 k3: 70° across the picture, barrel distortion of a tenth in the
corners"""
TURN, CENTRE = (0.004, 0.055, -0.006), (0.064, 0.0006, -0.0012)
"""of the right camera: rotation vector, rad (3° towards the left one), and its centre in left coordinates, m"""
PITCH, TILT = (17.0, 62.0), (5.0, 58.0)
"""px of a square that faces the left camera; degrees"""
RIM = 3.0
"""px between the outer squares and the frame"""
Rng = np.random.Generator


@dataclass(frozen=True, eq=False)
class View:
    """One moment: the `scenes` of both cameras (left, right), the true corners `xy` (2, M, 2) px, row by row, and the
    true poses `T` (2, 4, 4), T_cam_board in squares."""

    scenes: tuple[Scene, Scene]
    xy: Array
    T: Array


def camera_of(side: str) -> Camera:
    """The true camera, `left` or `right`."""
    focal, (cx, cy), distortion = LENSES[side]
    return Camera(np.array([[focal, 0, cx], [0, focal, cy], [0, 0, 1]]), np.array(distortion), IMAGE_SIZE, "brown")


def right_from_left(unit: float = 1.0) -> Array:
    """(4, 4) T_right_left, lengths in `unit` metres."""
    T = np.eye(4)
    T[:3, :3] = rotation(np.array(TURN))
    T[:3, 3] = -T[:3, :3] @ np.array(CENTRE) / unit
    return T


def views(count: int, seed: int = 0) -> list[View]:
    """`count` views; the first ones are independent of the count. Raises ConfigError if no position is found for a
    board."""
    return [_view(np.random.default_rng([FIRST, seed, k]), k) for k in range(count)]


def pictures(made: Sequence[View], folder: Path) -> list[tuple[Scene, Path]]:
    """The scenes to render, and the files `left0000.png`, `right0000.png`, … in `folder` in which to keep them."""
    return [
        (scene, folder / f"{side}{k:04d}.png")
        for k, view in enumerate(made)
        for side, scene in zip(SIDES, view.scenes, strict=True)
    ]


def _view(rng: Rng, index: int) -> View:
    left = _board(rng)
    T_left = left.pose.T_cam_board
    right = _moved(left, right_from_left(SPACING) @ T_left)
    noise, blur = np.exp(rng.uniform(np.log([1.5, 0.5]), np.log([9.0, 1.6])))
    motion = float(rng.uniform(1, 4)) if rng.random() < 0.2 else 0.0
    sensor = Sensor(
        blur=float(blur), noise=float(noise), motion=motion, motion_angle=float(rng.uniform(0, np.pi)), gamma=0.8
    )
    scenes = tuple(_scene(rng, side, spec, sensor, index) for side, spec in zip(SIDES, (left, right), strict=True))
    known = [truth(scene)[0] for scene in scenes]
    T = np.stack([T_left, right.pose.T_cam_board])
    return View((scenes[0], scenes[1]), np.stack([k.xy for k in known]), T)


def _board(rng: Rng) -> BoardSpec:
    """A board in the left camera's frame, drawn repeatedly until both cameras see all its squares."""
    black = float(rng.uniform(0.04, 0.15))
    white = black + float(rng.uniform(0.3, 0.7))
    blank = BoardSpec(*SIZE, (0, 0, 0), (0, 0, 1), black=black, white=white, margin=0.4, margin_value=white)
    left, T = camera_of("left"), right_from_left(SPACING)
    pitch, tilt = float(np.exp(rng.uniform(*np.log(PITCH)))), float(np.deg2rad(rng.uniform(*TILT)))
    for _ in range(TRIES):
        at, axis, roll = rng.uniform((0, 0), IMAGE_SIZE), rng.uniform(0, 2 * np.pi), rng.normal(0, np.deg2rad(35))
        spec = placed(blank, left, at, pitch, tilt, float(axis), float(roll))
        if spec is None or not _is_whole(spec, left):
            continue
        if _is_whole(_moved(spec, T @ spec.pose.T_cam_board), camera_of("right")):
            return spec
    raise ConfigError(f"stereo pair: no place for a board in {TRIES} tries")


def _moved(spec: BoardSpec, T: Array) -> BoardSpec:
    """The board at T_cam_board `T` (4, 4), squares."""
    r, t = cv2.Rodrigues(T[:3, :3])[0].ravel(), T[:3, 3]
    return replace(spec, rvec=(float(r[0]), float(r[1]), float(r[2])), tvec=(float(t[0]), float(t[1]), float(t[2])))


def _is_whole(spec: BoardSpec, camera: Camera) -> bool:
    """Whether all squares are in the picture, seen from the front."""
    ij = np.stack(np.meshgrid(np.arange(-1, spec.cols + 1), np.arange(-1, spec.rows + 1)), axis=-1).reshape(-1, 2)
    xy = board_to_pixels(spec, camera, ij)
    if not (np.isfinite(xy).all() and (xy > RIM).all() and (xy < np.array(camera.image_size) - 1 - RIM).all()):
        return False
    scene = Scene(
        *camera.image_size, float(camera.K[0, 0]), (float(camera.K[0, 2]), float(camera.K[1, 2])), camera.model,
        tuple(camera.distortion.tolist()), (spec,),
    )  # fmt: skip
    return bool(truth(scene)[0].visible.all())


def _scene(rng: Rng, side: str, spec: BoardSpec, sensor: Sensor, index: int) -> Scene:
    focal, centre, distortion = LENSES[side]
    gx, gy, wave = rng.uniform((-0.7, -0.7, 0), (0.7, 0.7, 0.3))
    middle = board_to_pixels(spec, camera_of(side), rng.uniform((0, 0), np.array([SIZE]) - 1.0))[0]
    far = 2.0 * IMAGE_SIZE[0]
    edge = shade((middle[0], middle[1]), float(rng.uniform(0, 2 * np.pi)), far, far, float(rng.uniform(0.4, 0.8)), 12.0)
    shadows = (edge,) if rng.random() < 0.2 else ()
    light = Light(float(gx), float(gy), float(wave), int(rng.integers(2**31)), shadows)
    background = Background(KINDS[index % len(KINDS)], int(rng.integers(2**31)))
    return Scene(
        *IMAGE_SIZE, focal, centre, "brown", distortion, (spec,), light=light, sensor=sensor, background=background,
        seed=int(rng.integers(2**31)),
    )  # fmt: skip
