"""Rendered pictures of flat drawings, and the ground truth of their corners; optics, light and covers as in
`rcdn.synthetic.render`.

A drawing lies in the plane of the scene's only board (`Scene.boards[0]`) and takes its pose and grey levels; its unit
is the board's square, and its centre is the middle of that board.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from rcdn.geometry import unproject
from rcdn.synthetic.background import paint
from rcdn.synthetic.degrade import coverage, expose, illuminate, signed_distance
from rcdn.synthetic.lattice import middle
from rcdn.synthetic.scene import BoardSpec, Scene
from rcdn.synthetic.surface import board_to_pixels, rays_to_board, viewing_cosine
from rcdn.types import Array, Camera
from rcdn.types.arrays import Real
from rcdn_lab.coded.drawings import Drawing

F32 = np.float32
FRAME = 4.0
"""px; corners closer to the picture's border than this are ignored in the evaluation"""


@dataclass(frozen=True, eq=False)
class CodedTruth:
    """Exact corners of a drawing in a picture: `ids` (N,), `xy` (N, 2) px (NaN where the lens can't see them),
    `visible` (N,): clearly visible in the picture, `pitch` (N,): distance to the nearest other corner, px. Corners that
    are not visible may lie outside the frame, under a cover, or at the border of either."""

    ids: Array
    xy: Array
    visible: Array
    pitch: Array


def render_drawing(drawing: Drawing, scene: Scene, samples: int = 4) -> Real[Array, "h w"]:
    """The picture (H, W) uint8 of a drawing in a scene, with `samples`² sub-samples per pixel; the same arguments give
    the same bytes."""
    x, y = np.meshgrid(np.arange(scene.width, dtype=F32), np.arange(scene.height, dtype=F32))
    image = _over(paint(scene.background, scene.width, scene.height), drawing, scene, samples)
    for cover in scene.covers:
        share = coverage(cover, x, y)
        image = image * (1 - share) + F32(cover.value) * share
    image = illuminate(image, scene.light, x, y, (scene.width, scene.height))
    return expose(image, scene.sensor, np.random.default_rng(scene.seed))


def _over(image: Array, drawing: Drawing, scene: Scene, samples: int) -> Array:
    """Composite the drawing over `image`. Positions on it are exact at pixel centres, and linear within a pixel."""
    spec = scene.boards[0]
    part = _window(drawing, scene)
    y, x = np.mgrid[part].astype(float)
    at = _on_drawing(drawing, spec, np.stack(rays_to_board(spec, unproject(scene.camera, np.stack([x, y], -1))), -1))
    along_y, along_x = np.gradient(at, axis=(0, 1))
    at, along_y, along_x = (np.nan_to_num(a, nan=-1e4).clip(-1e4, 2e4).astype(F32) for a in (at, along_y, along_x))
    ink = F32(spec.black) + F32(spec.white - spec.black) * drawing.image.astype(F32) / 255
    sheet = np.stack([ink, np.ones_like(ink)], axis=-1)
    seen, none = np.zeros((*x.shape, 2), F32), np.zeros(0, F32)
    steps = (np.arange(samples, dtype=F32) + F32(0.5)) / samples - F32(0.5)
    for dy in steps:
        for dx in steps:
            place = at + along_x * dx + along_y * dy
            seen += cv2.remap(sheet, place, none, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=(0, 0))
    seen /= samples**2
    out = image.copy()
    out[part] = image[part] * (1 - seen[..., 1]) + seen[..., 0]
    return out


def _window(drawing: Drawing, scene: Scene) -> tuple[slice, slice]:
    """Rows and columns of the picture that may show the drawing: the bounding box of its border plus a few px; the
    whole picture if the lens can't see all of the border."""
    spec = scene.boards[0]
    xy = board_to_pixels(spec, scene.camera, _rim(drawing, spec))
    if not np.isfinite(xy).all():
        return np.s_[: scene.height, : scene.width]
    low = np.clip(np.floor(xy.min(axis=0)) - 4, 0, [scene.width - 2, scene.height - 2]).astype(int)
    high = np.clip(np.ceil(xy.max(axis=0)) + 5, low + 2, [scene.width, scene.height]).astype(int)
    return np.s_[low[1] : high[1], low[0] : high[0]]


def _rim(drawing: Drawing, spec: BoardSpec) -> Real[Array, "n 2"]:
    """Board coordinates (N, 2) of points along the border of the sheet."""
    edge = np.linspace(-0.5, 0.5, 33)
    sides = [np.column_stack(p) for s in (-0.5, 0.5) for p in ((edge, 0 * edge + s), (0 * edge + s, edge))]
    height, width = drawing.image.shape
    return np.asarray(np.concatenate(sides) * [width, height] / drawing.unit + middle(spec))


def _on_drawing(drawing: Drawing, spec: BoardSpec, uv: Real[Array, "... 2"]) -> Real[Array, "... 2"]:
    """Pixels (..., 2) of the drawing at board coordinates `uv` (..., 2)."""
    height, width = drawing.image.shape
    return np.asarray((uv - middle(spec)) * drawing.unit + (np.array([width, height]) - 1) / 2)


def _on_board(drawing: Drawing, spec: BoardSpec, xy: Array) -> Array:
    """The inverse of `_on_drawing`."""
    height, width = drawing.image.shape
    return np.asarray((xy - (np.array([width, height]) - 1) / 2) / drawing.unit + middle(spec))


def drawing_truth(drawing: Drawing, scene: Scene) -> CodedTruth:
    """Ground truth: the corners of a drawing as seen by the scene's camera."""
    spec = scene.boards[0]
    uv = _on_board(drawing, spec, drawing.xy)
    xy = board_to_pixels(spec, scene.camera, uv)
    gap = np.linalg.norm(xy[:, None] - xy[None], axis=2) + np.where(np.eye(len(xy)), np.inf, 0)
    with np.errstate(invalid="ignore"):
        inside = ((xy >= FRAME) & (xy <= [scene.width - 1 - FRAME, scene.height - 1 - FRAME])).all(axis=1)
        inside &= viewing_cosine(spec, uv) > 0
        pitch = np.nanmin(np.where(np.isnan(gap), np.inf, gap), axis=1)
        for cover in scene.covers:
            inside &= ~(signed_distance(cover, xy[:, 0], xy[:, 1]) < np.maximum(FRAME, pitch / 4))
    return CodedTruth(drawing.ids, xy, inside, pitch)


def posed(
    drawing: Drawing,
    camera: Camera,
    box: tuple[float, float, float, float],
    tilt: float = 0.0,
    axis: float = 0.0,
    roll: float = 0.0,
) -> BoardSpec:
    """A board for `Scene.boards`, centred in the `box` (x0, y0, x1, y1) px and as close as possible with the whole
    sheet inside the box.

    It is rotated by `roll` about its normal, then by `tilt` about the direction `axis` in its plane, radians: the angle
    between its normal and the line of sight is `tilt`.
    """
    height, width = np.array(drawing.image.shape) / drawing.unit
    centre = np.array([(box[0] + box[2]) / 2, (box[1] + box[3]) / 2])
    ray = unproject(camera, centre)
    ray = ray / np.linalg.norm(ray)
    face = cv2.Rodrigues(np.arccos(ray[2]) * np.array([-ray[1], ray[0], 0]) / max(np.hypot(ray[0], ray[1]), 1e-12))[0]
    lean = cv2.Rodrigues(tilt * np.array([np.cos(axis), np.sin(axis), 0.0]))[0]
    R = face @ lean @ cv2.Rodrigues(np.array([0.0, 0.0, roll]))[0]
    rvec = cv2.Rodrigues(R)[0].ravel().tolist()
    blank = BoardSpec(max(2, round(width)), max(2, round(height)), (rvec[0], rvec[1], rvec[2]), (0, 0, 1))
    rim = _rim(drawing, blank)

    def at(distance: float) -> BoardSpec:
        t = (ray * distance - R @ np.array([*middle(blank), 0.0])).tolist()
        return replace(blank, tvec=(t[0], t[1], t[2]))

    near, far = 0.1, 1e4
    for _ in range(50):
        between = float(np.sqrt(near * far))
        xy = board_to_pixels(at(between), camera, rim)
        fits = bool(np.isfinite(xy).all() and (xy >= box[:2]).all() and (xy <= box[2:]).all())
        near, far = (near, between) if fits else (between, far)
    return at(far)
