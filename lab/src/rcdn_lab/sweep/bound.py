"""The best possible accuracy of a corner: the one-corner Cramér–Rao bound of a rendered picture."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.special import ellipe

from rcdn.geometry import unproject
from rcdn.synthetic import BoardSpec, Scene, truth
from rcdn.synthetic.degrade import focus
from rcdn.synthetic.render import irradiance
from rcdn.synthetic.surface import board_to_pixels, rays_to_board
from rcdn.types import Array

QUANTISED = 0.29
"""σ of rounding to whole grey levels, 1/√12"""
STEP = 0.02
"""px by which the scene is shifted for numerical derivatives"""


def closed_form(noise: float, contrast: float, arm: float, blur: float) -> float:
    """σ of one coordinate of a corner with four edges of `arm` px, each `contrast` grey levels high and `blur` (σ) px
    wide.

    An edge contributes the information C² ∫ (Gaussian of σ_b)² = C² / (2 √π σ_b) per px of its length, and two of the
    four arms constrain x: σ_x = noise ÷ √(C² L / (√π σ_b)).
    """
    return float(noise / np.sqrt(contrast**2 * arm / (np.sqrt(np.pi) * blur)))


def mean_length(covariance: Array) -> Array:
    """Expected length (N,) of normal errors with covariance (N, 2, 2): σ √(π/2) if both axes have σ; inf where it is
    inf."""
    out = np.full(len(covariance), np.inf)
    good = np.isfinite(covariance).all(axis=(1, 2))
    small, large = np.linalg.eigvalsh(covariance[good]).T
    out[good] = np.sqrt(2 / np.pi * large) * ellipe(1 - small / large)
    return out


def bounds(scene: Scene) -> list[Array]:
    """For each board of a scene the mean error (cols·rows,), px, of an efficient estimator of each corner by itself.

    From the Fisher matrix Σ ∇I ∇Iᵀ ÷ σ², over the pixels within half a square of the corner along the board's axes, of
    the exposure before noise; ∇I is the derivative with respect to a shift of the boards, so that covers contribute
    nothing. σ² is that of the noise and of rounding. JPEG and clipping of the noise are neglected. Infinite without
    information. Source: Kay, Fundamentals of Statistical Signal Processing I, 3.9.
    """
    if not scene.boards:
        return []
    window = _window(scene)
    (cx, cy), sensor = scene.centre, scene.sensor
    moved = [replace(scene, centre=c) for c in ((cx, cy), (cx + STEP, cy), (cx, cy + STEP))]
    still, right, down = (focus(irradiance(m, window), sensor).astype(float) for m in moved)
    gx, gy = (right - still) / STEP, (down - still) / STEP
    variance = sensor.noise**2 + QUANTISED**2
    x0, y0, width, height = window
    pixels = np.stack(np.meshgrid(np.arange(x0, x0 + width), np.arange(y0, y0 + height)), axis=-1).astype(float)
    rays = unproject(scene.camera, pixels)
    terms = [gx * gx / variance, gx * gy / variance, gy * gy / variance]
    return [mean_length(_covariance(terms, _owner(spec, rays), spec.cols * spec.rows)) for spec in scene.boards]


def _window(scene: Scene) -> tuple[int, int, int, int]:
    """The part (x, y, width, height) of the frame that contains the boards, with a margin for blur."""
    corners = [np.array([(-1, -1), (s.cols, -1), (-1, s.rows), (s.cols, s.rows)], float) for s in scene.boards]
    known = [board_to_pixels(s, scene.camera, c) for s, c in zip(scene.boards, corners, strict=True)]
    xy = np.concatenate([*known, *(t.xy for t in truth(scene))])
    reach = 8 + 4 * scene.sensor.blur + scene.sensor.disk + scene.sensor.motion
    frame = np.array([scene.width, scene.height])
    low = np.clip(np.floor(np.nanmin(xy, axis=0) - reach), 0, frame - 2).astype(int)
    high = np.clip(np.ceil(np.nanmax(xy, axis=0) + reach), low + 2, frame).astype(int)
    return int(low[0]), int(low[1]), int(high[0] - low[0]), int(high[1] - low[1])


def _owner(spec: BoardSpec, rays: Array) -> Array:
    """Number of the corner nearest to each ray's point on the board, −1 for none, in the rays' shape."""
    u, v = (np.rint(np.nan_to_num(w, nan=-9.0)) for w in rays_to_board(spec, rays))
    mine = (u >= 0) & (u < spec.cols) & (v >= 0) & (v < spec.rows)
    return np.where(mine, v * spec.cols + u, -1).astype(int)


def _covariance(terms: list[Array], owner: Array, count: int) -> Array:
    """Inverse (count, 2, 2) of the Fisher matrices; inf where they are singular."""
    mine = owner >= 0
    a, b, c = (np.bincount(owner[mine], t[mine], count) for t in terms)
    det = a * c - b * b
    good = det > 1e-9 * np.maximum(a, c) ** 2
    out = np.full((count, 2, 2), np.inf)
    inverse = np.stack([np.stack([c, -b], axis=-1), np.stack([-b, a], axis=-1)], axis=-2)
    out[good] = inverse[good] / det[good, None, None]
    return out
