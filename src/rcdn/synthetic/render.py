"""Rendering of a scene and its exact ground truth. Analytic: each pixel's ray is intersected with the sheets."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rcdn.geometry import unproject
from rcdn.synthetic.background import paint
from rcdn.synthetic.degrade import coverage, expose, illuminate, signed_distance
from rcdn.synthetic.lattice import extent, labels, steps, upright
from rcdn.synthetic.pattern import F32, sheet
from rcdn.synthetic.scene import BoardSpec, BoardTruth, Scene
from rcdn.synthetic.surface import board_to_pixels, rays_to_board, viewing_cosine
from rcdn.types import Array
from rcdn.types.arrays import Real, Shaped

Window = tuple[int, int, int, int]
LEAST_PITCH = {"checker": 4.0, "deltille": 7.0}
"""px; corners with closer neighbours are ignored in the evaluation; six sectors need a larger distance than four"""


def render(
    scene: Scene, window: Window | None = None, samples: int = 4, images: Sequence[Array] = ()
) -> Shaped[Array, "h w"]:
    """The picture of a scene, (H, W) uint8.

    `window` (x, y, width, height) renders that part of the frame only; each pixel has `samples`² sub-samples, each
    low-pass filtered over its own footprint; `images`: grey pictures for backgrounds of kind `image`. The same
    arguments give the same bytes.

    A window differs slightly from the crop of the whole picture: its noise and its background (unless plain) are
    generated for its own size, blurs reflect at its border, and within a pixel of the border the footprints are
    one-sided differences. Boards, covers, light and ground truth are the same.
    """
    return expose(irradiance(scene, window, samples, images), scene.sensor, np.random.default_rng(scene.seed))


def irradiance(
    scene: Scene, window: Window | None = None, samples: int = 4, images: Sequence[Array] = ()
) -> Real[Array, "h w"]:
    """Irradiance at the sensor before optics and noise, (H, W) float32; arguments as in `render`."""
    x0, y0, width, height = window or (0, 0, scene.width, scene.height)
    x, y = np.meshgrid(np.arange(x0, x0 + width, dtype=float), np.arange(y0, y0 + height, dtype=float))
    image = paint(scene.background, width, height, images)
    if scene.boards:
        rays = unproject(scene.camera, np.stack([x, y], axis=-1))
        for spec in sorted(scene.boards, key=lambda b: -float(np.linalg.norm(b.tvec))):
            image = _composite(image, spec, rays, samples)
    xf, yf = x.astype(F32), y.astype(F32)
    for cover in scene.covers:
        share = coverage(cover, xf, yf)
        image = image * (1 - share) + F32(cover.value) * share
    return illuminate(image, scene.light, xf, yf, (scene.width, scene.height))


def _composite(image: Array, spec: BoardSpec, rays: Array, samples: int) -> Array:
    """Composite the sheet over `image`. Board coordinates are exact at pixel centres and linear within a pixel."""
    u, v = rays_to_board(spec, rays)
    m = spec.margin + 2
    with np.errstate(invalid="ignore"):
        (x, y), (cols, rows) = upright(spec, u, v), extent(spec)
        hit = (x > -1 - m) & (x < cols + m) & (y > -1 - m) & (y < rows + m)
    if not hit.any():
        return image
    lines, columns = np.flatnonzero(hit.any(axis=1)), np.flatnonzero(hit.any(axis=0))
    part = np.s_[lines[0] : lines[-1] + 1, columns[0] : columns[-1] + 1]
    if min(len(lines), len(columns)) < 2 or image[part].shape[0] < 2 or image[part].shape[1] < 2:
        return image
    u, v = u[part], v[part]
    (uy, ux), (vy, vx) = np.gradient(u), np.gradient(v)
    bad = ~np.isfinite(u + v + ux + uy + vx + vy)
    u, v, ux, uy, vx, vy = (np.where(bad, F32(-1e4), a).astype(F32) for a in (u, v, ux, uy, vx, vy))
    slopes = [(ux, uy), (vx, vy)] if spec.pattern == "checker" else [(ux, uy), (vx, vy), (ux + vx, uy + vy)]
    widths = [np.maximum(np.hypot(*slope) / F32(samples), F32(1e-6)) for slope in slopes]
    value, cover = np.zeros_like(u), np.zeros_like(u)
    for dy in (np.arange(samples) + 0.5) / samples - 0.5:
        for dx in (np.arange(samples) + 0.5) / samples - 0.5:
            dx32, dy32 = F32(dx), F32(dy)
            ink, alpha = sheet(spec, u + ux * dx32 + uy * dy32, v + vx * dx32 + vy * dy32, *widths)
            value += ink * alpha
            cover += alpha
    cover = np.where(bad, 0, cover / samples**2)
    value = np.where(bad, 0, value / samples**2)
    out = image.copy()
    out[part] = image[part] * (1 - cover) + value
    return out


def truth(scene: Scene) -> list[BoardTruth]:
    """Exact corners of every board of a scene, in the order of `scene.boards`."""
    return [_board_truth(scene, index) for index in range(len(scene.boards))]


def _board_truth(scene: Scene, index: int) -> BoardTruth:
    spec = scene.boards[index]
    ij = labels(spec)
    xy = board_to_pixels(spec, scene.camera, ij)
    with np.errstate(invalid="ignore"):
        cosine = viewing_cosine(spec, ij)
        near = ((xy > -4) & (xy < [scene.width + 3, scene.height + 3])).all(axis=1) & (cosine > 0)
        inside = ((xy >= 2) & (xy <= [scene.width - 3, scene.height - 3])).all(axis=1)
    near &= _seen_here(scene, spec, ij, xy)
    covered, touched = _hidden(scene, index, xy)
    pitch = _pitch(spec, scene, ij, xy)
    doubtful = touched | ~inside | (pitch < LEAST_PITCH[spec.pattern]) | (cosine < 0.17) | _painted(spec, ij)
    ignore = near & doubtful & ~covered
    return BoardTruth(xy, ij, near & ~doubtful & ~covered, ignore, pitch)


def _seen_here(scene: Scene, spec: BoardSpec, ij: Array, xy: Array) -> Array:
    """Whether a corner's pixel really shows it: false beyond the fold of the lens, or if the bent sheet hides it."""
    u, v = rays_to_board(spec, unproject(scene.camera, np.nan_to_num(xy, nan=-1e6)))
    with np.errstate(invalid="ignore"):
        return np.asarray(np.hypot(u - ij[:, 0], v - ij[:, 1]) < 1e-3)


def _pitch(spec: BoardSpec, scene: Scene, ij: Array, xy: Array) -> Array:
    """Shortest distance to the neighbours, px (squares may be longer along one axis)."""
    near = np.stack([np.linalg.norm(board_to_pixels(spec, scene.camera, ij + s) - xy, axis=1) for s in steps(spec)])
    return np.asarray(np.nan_to_num(near, nan=0.0).min(axis=0))


def _painted(spec: BoardSpec, ij: Array) -> Array:
    out = np.zeros(len(ij), bool)
    for i, j, _ in spec.painted:
        out |= (ij[:, 0] >= i - 1) & (ij[:, 0] <= i) & (ij[:, 1] >= j - 1) & (ij[:, 1] <= j)
    return out


def _hidden(scene: Scene, index: int, xy: Array) -> tuple[Array, Array]:
    """Masks (fully occluded, partly occluded) by covers and by nearer boards."""
    covered, touched = np.zeros(len(xy), bool), np.zeros(len(xy), bool)
    for cover in scene.covers:
        d = signed_distance(cover, xy[:, 0], xy[:, 1])
        covered |= d < -2
        touched |= (d >= -2) & (d < 4)
    own = float(np.linalg.norm(scene.boards[index].tvec))
    finite = np.nan_to_num(xy, nan=-1e6)
    for k, other in enumerate(scene.boards):
        distance = float(np.linalg.norm(other.tvec))
        if k == index or distance > own or (distance == own and k < index):
            continue
        u, v = rays_to_board(other, unproject(scene.camera, finite))
        m = other.margin
        with np.errstate(invalid="ignore"):
            (x, y), (cols, rows) = upright(other, u, v), extent(other)
            slack = np.minimum(np.minimum(x + 1 + m, cols + m - x), np.minimum(y + 1 + m, rows + m - y))
            covered |= slack > 0.3
            touched |= (slack > -0.3) & (slack <= 0.3)
    return covered, touched
