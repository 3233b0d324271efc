"""Videos of a board that moves before a known camera, rendered fast: every pixel asks what point
of the board it sees."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from rcdn.geometry import rotation, unproject
from rcdn.types import Camera

SIZE, SPACING = (9, 6), 0.025
"""inner corners; m"""
IMAGE = (1280, 720)
CAMERA = Camera(
    np.array([[980.0, 0, 652.0], [0, 980, 347.0], [0, 0, 1]]), np.array([-0.24, 0.08, 0.0006, -0.0008]), IMAGE
)
FINE = 48
"""px of a square of the drawing that is looked up"""


def drawing():
    """The board's sheet, one square of margin around, and a wooden-grey frame."""
    cols, rows = SIZE
    squares = np.indices((rows + 1, cols + 1)).sum(axis=0) % 2 * 215 + 20
    sheet = np.kron(squares, np.ones((FINE, FINE)))
    sheet = np.pad(sheet, FINE // 2, constant_values=235)
    return cv2.GaussianBlur(np.pad(sheet, 2, constant_values=120).astype(np.float32), (0, 0), 0.8)


def room(seed=3):
    """A calm background, (H, W) float32."""
    rng = np.random.default_rng(seed)
    width, height = IMAGE
    picture = np.full((height, width), 118, np.float32) + np.linspace(-25, 25, width, dtype=np.float32)
    for _ in range(14):
        x, y = rng.integers(0, width), rng.integers(0, height)
        box = (int(x), int(y)), (int(x + rng.integers(60, 330)), int(y + rng.integers(60, 330)))
        cv2.rectangle(picture, *box, float(rng.uniform(70, 170)), -1)
    return cv2.GaussianBlur(picture, (0, 0), 4)


@dataclass
class Renderer:
    """Frames (H, W) uint8 of a `camera`, 2 × 2 samples a pixel; `seed` of the room and the noise."""

    noise: float = 1.5
    camera: Camera = CAMERA
    seed: int = 1

    def __post_init__(self):
        width, height = IMAGE
        x, y = np.meshgrid(np.arange(2 * width) / 2 - 0.25, np.arange(2 * height) / 2 - 0.25)
        self._rays = unproject(self.camera, np.stack([x, y], axis=-1)).astype(np.float32)
        self._sheet, self._room = drawing(), room(self.seed + 2)
        self._rng = np.random.default_rng(self.seed)

    def frame(self, T=None, motion=0.0, coarse=False):
        """The board at T_cam_board (4, 4), m, or none; `motion`: px of blur along the rows;
        `coarse`: one sample a pixel, for frames between."""
        picture = self._room.copy()
        if T is not None:
            inverse = np.linalg.inv(T)
            rays = self._rays[::2, ::2] if coarse else self._rays
            away = rays @ inverse[:3, :3].T.astype(np.float32)
            depth = -inverse[2, 3] / np.where(away[..., 2] == 0, np.float32(1e-12), away[..., 2])
            plane = (away[..., :2] * depth[..., None] + inverse[:2, 3].astype(np.float32)) / SPACING
            at = ((plane + 1.5) * FINE + 2 - 0.5).astype(np.float32)
            fine = cv2.remap(self._sheet, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderValue=-1)
            fine[depth <= 0] = -1
            behind = picture if coarse else np.repeat(np.repeat(picture, 2, 0), 2, 1)
            sheet = np.where(fine < 0, behind, fine)
            picture = sheet.astype(np.float32)
            if not coarse:
                picture = cv2.resize(picture, IMAGE, interpolation=cv2.INTER_AREA)
        if motion:
            picture = cv2.blur(picture, (round(motion), 1))
        picture = picture + self._rng.normal(0, self.noise, picture.shape).astype(np.float32)
        return np.clip(picture + 0.5, 0, 255).astype(np.uint8)


def pose(x, y, z, across=0.0, along=0.0, turn=0.0):
    """T_cam_board with the board's middle at (x, y, z) m; tilted `across` and `along` the picture,
    and turned in it by `turn`, °."""
    R = rotation(np.radians([along, 0, 0])) @ rotation(np.radians([0, across, 0])) @ rotation(np.radians([0, 0, turn]))
    T = np.eye(4)
    T[:3, :3] = R
    T[:3, 3] = np.array([x, y, z]) - R @ [*((np.array(SIZE) - 1) * SPACING / 2), 0]
    return T


def between(first, second, share):
    """The pose at a `share` of the way from one to another."""
    from scipy.spatial.transform import Rotation, Slerp

    turn = Slerp([0, 1], Rotation.from_matrix([first[:3, :3], second[:3, :3]]))(share)
    middle = np.array([*((np.array(SIZE) - 1) * SPACING / 2), 0])
    at = [T[:3, :3] @ middle + T[:3, 3] for T in (first, second)]
    T = np.eye(4)
    T[:3, :3] = turn.as_matrix()
    T[:3, 3] = (1 - share) * at[0] + share * at[1] - T[:3, :3] @ middle
    return T


def journey(poses, rate=15, hold=1.1, move=0.7):
    """(pose, whether it moves), frame by frame: each of `poses` held for `hold` s, `move` s from one to the next."""
    for here, there in zip(poses, [*poses[1:], poses[0]], strict=True):
        yield from [(here, False)] * round(hold * rate)
        for k in range(round(move * rate)):
            share = (k + 1) / (round(move * rate) + 1)
            yield between(here, there, share * share * (3 - 2 * share)), True


def towards(outline, camera=CAMERA):
    """T_cam_board of the `camera` at which the board's outermost corners are nearest to an `outline`
    (4, 2) px, in order around."""
    cols, rows = (np.array(SIZE) - 1) * SPACING
    corners = np.array([[0.0, 0, 0], [cols, 0, 0], [cols, rows, 0], [0, rows, 0]])
    flat = cv2.undistortPoints(np.asarray(outline, float)[:, None], camera.K, camera.distortion)[:, 0]
    best = None
    for shift in range(4):
        for order in (1, -1):
            ring = np.roll(flat[::order], shift, axis=0)
            found = cv2.solvePnPGeneric(corners, ring, np.eye(3), None, flags=cv2.SOLVEPNP_IPPE)
            for rvec, tvec, error in zip(found[1], found[2], found[3].ravel(), strict=True):
                T = np.eye(4)
                T[:3, :3], T[:3, 3] = rotation(rvec.ravel()), tvec.ravel()
                facing = T[2, 2] > 0 and T[2, 3] > 0 and T[0, 0] > -0.3
                if facing and (best is None or error < best[0] - 1e-9):
                    best = (float(error), T)
    return best[1]


def write_video(path, poses, renderer=None, motion=0.0, **timing):
    """A video as Chromium's fake camera plays it (JPEGs, one after the other), in a loop."""
    renderer = renderer or Renderer(noise=4)
    last, data = None, b""
    with open(path, "wb") as file:
        for T, moves in journey(poses, **timing):
            if moves or last is None or T is not last:
                picture = renderer.frame(T, motion, coarse=moves)
                data = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, 93])[1].tobytes()
            last = T
            file.write(data)
    return path
