"""Corner detection by Geiger et al., ICRA 2012: likelihood, edge directions, refinement, score (docs/peers.md)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from rcdn.corners.histogram import edge_directions
from rcdn.corners.patches import chunks, gather
from rcdn.types import Array
from rcdn_lab.peers.maxima import local_maxima

RADII = (4, 8, 12)
"""px; radii of the prototypes"""
PROTOTYPES = ((0.0, np.pi / 2), (np.pi / 4, 3 * np.pi / 4))
"""Edge directions of the two prototypes, radians."""
NEAR_EDGE = 0.1
"""px; prototypes exclude the pixels on their edges"""
SUPPRESSION = 3
"""half side of the window of non-maximum suppression, px"""
LEAST_LIKELIHOOD = 0.02
"""least likelihood of a corner, with the picture's grey levels scaled to 0..1"""
LEAST_SCORE = 0.02
MOST_CORNERS = 3000
"""Most corners, those with the largest likelihood, that are processed further: this limits the time on texture."""
APART = 0.3
"""radians between the two edge directions, at least"""
ALONG = 0.25
"""Largest |cos| of the angle between a gradient and the edge that it belongs to."""
REACH = 10
"""half side of the window in which edge directions are refined, px"""
POSITION = 5
"""half side of the window of 11 × 11 in which positions are refined, px"""
REPEATS = 3
LARGEST_STEP = 4.0
"""px; a position that moves further is rejected"""
THIN = 0.01
"""smallest eigenvalue ratio of a solvable structure tensor"""
LINE = 1.5
"""px; distance from an edge within which the score expects gradients"""


@dataclass(frozen=True, eq=False)
class GeigerCorners:
    """Corners in the order of decreasing score: `xy` (N, 2) px, `angles` (N, 2) edge directions a < b, radians in [0,
    π), `score` (N,)."""

    xy: Array
    angles: Array
    score: Array


def geiger_corners(grey: Array) -> GeigerCorners:
    """Corners of `grey` (H, W; uint8 or float), whose contrast is stretched to 0..1 first. A flat picture has none."""
    image = _stretched(grey)
    likelihood = corner_likelihood(image)
    peaks = local_maxima(likelihood, SUPPRESSION, LEAST_LIKELIHOOD)
    strength = likelihood[peaks[:, 1], peaks[:, 0]]
    peaks = peaks[np.argsort(-strength, kind="stable")[:MOST_CORNERS]]
    gx, gy = _gradient(image)
    angles, count = edge_directions(grey, peaks)
    angles = np.sort(angles[:, :2], axis=1)
    use = (count >= 2) & _apart(angles)
    peaks, angles = peaks[use], _refined_angles(gx, gy, peaks[use], angles[use])
    xy = _refined_positions(gx, gy, peaks)
    use = _apart(angles) & np.isfinite(xy).all(axis=1)
    xy, angles = xy[use], angles[use]
    score = np.max([_score(image, np.hypot(gx, gy), xy, angles, r) for r in RADII], axis=0)
    order = np.lexsort((xy[:, 1], xy[:, 0], -score))
    order = order[score[order] >= LEAST_SCORE]
    return GeigerCorners(xy[order], angles[order], score[order])


def corner_likelihood(image: Array) -> Array:
    """Likelihood (H, W) float32, ≥ 0, that a pixel of `image` (H, W) float32 in 0..1 is a corner; the largest over
    prototypes and radii.

    Each prototype weights its four sectors A, B (opposite) and C, D by Gaussians. With μ the mean of the four sums, the
    likelihood is min(A − μ, B − μ, μ − C, μ − D), or that with the pairs exchanged, whichever is larger.
    """
    out = np.zeros(image.shape, np.float32)
    for radius in RADII:
        for kernels in _kernels(radius):
            a, b, c, d = (cv2.filter2D(image, cv2.CV_32F, k, borderType=cv2.BORDER_REFLECT_101) for k in kernels)
            mean = (a + b + c + d) / 4
            low, high = np.minimum(a, b), np.maximum(a, b)
            bright = np.minimum(low - mean, mean - np.maximum(c, d))
            dark = np.minimum(mean - high, np.minimum(c, d) - mean)
            np.maximum(out, np.maximum(bright, dark), out=out)
    return out


@lru_cache(maxsize=8)
def _kernels(radius: int) -> list[Array]:
    """For each prototype the kernels (4, 2 radius + 1, 2 radius + 1) of its sectors A, B, C, D, each with sum 1."""
    weights = [_sectors(_offsets(np.zeros((1, 2)), radius), np.array([angles]), radius) for angles in PROTOTYPES]
    return [w.reshape(4, 2 * radius + 1, 2 * radius + 1).astype(np.float32) for w in weights]


def _sectors(offsets: Array, angles: Array, radius: int) -> Array:
    """Weights (N, 4, P) of pixels at `offsets` (N, P, 2) px from corners with edge `angles` (N, 2), for the sectors A,
    B, C, D.

    A Gaussian of standard deviation radius / 2; A and B, C and D are opposite. Each sums to 1, or to 0 without pixels.
    """
    side = [offsets[..., 1] * np.cos(a) - offsets[..., 0] * np.sin(a) for a in angles.T[:, :, None]]
    left, right = side[0] <= -NEAR_EDGE, side[0] >= NEAR_EDGE
    over, under = side[1] <= -NEAR_EDGE, side[1] >= NEAR_EDGE
    inside = np.stack((left & under, right & over, left & over, right & under), axis=1)
    weight = inside * np.exp(-0.5 * (offsets**2).sum(axis=-1) / (radius / 2) ** 2)[:, None]
    return np.asarray(weight / np.maximum(weight.sum(axis=2, keepdims=True), 1e-9))


def _stretched(grey: Array) -> Array:
    low, high = float(grey.min()), float(grey.max())
    return ((grey.astype(np.float32) - low) / max(high - low, 1e-6)).astype(np.float32)


def _gradient(image: Array) -> tuple[Array, Array]:
    gx, gy = (cv2.Sobel(image, cv2.CV_32F, *d, borderType=cv2.BORDER_REFLECT_101) for d in ((1, 0), (0, 1)))
    return gx, gy


def _apart(angles: Array) -> Array:
    """(N,) bool: whether the two directions of `angles` (N, 2), a < b < a + π, differ enough; False for NaN."""
    gap = angles[:, 1] - angles[:, 0]
    return np.asarray((gap >= APART) & (gap <= np.pi - APART))


def _refined_angles(gx: Array, gy: Array, peaks: Array, angles: Array) -> Array:
    """Edge directions (N, 2), sorted: each is the direction most nearly perpendicular to the gradients that belong to
    it."""
    out = np.array(angles)
    for part in chunks(len(peaks), (2 * REACH + 1) ** 2):
        wx, wy = (gather(g, peaks[part], REACH).reshape(len(peaks[part]), -1) for g in (gx, gy))
        for k in (0, 1):
            cos, sin = np.cos(angles[part, k, None]), np.sin(angles[part, k, None])
            across = np.abs(wx * cos + wy * sin) < ALONG * np.hypot(wx, wy)
            xx, xy, yy = (np.where(across, p, 0).sum(axis=1) for p in (wx * wx, wx * wy, wy * wy))
            normal = 0.5 * np.arctan2(2 * xy, xx - yy)
            out[part, k] = np.where(xx + yy > 0, (normal + np.pi / 2) % np.pi, angles[part, k])
    return np.sort(out, axis=1)


def _refined_positions(gx: Array, gy: Array, peaks: Array) -> Array:
    """Positions (N, 2) px, most nearly perpendicular to all gradients around them (Eq. 3); NaN where that does not
    determine one.

    Least squares in 11 × 11 px. The window moves to the nearest pixel, at most 3 times.
    """
    xy = peaks.astype(float)
    for part in chunks(len(peaks), (2 * POSITION + 1) ** 2):
        for _ in range(REPEATS):
            xy[part] = _position_step(gx, gy, xy[part])
    xy[~(np.abs(xy - peaks) <= LARGEST_STEP).all(axis=1)] = np.nan
    return xy


def _position_step(gx: Array, gy: Array, start: Array) -> Array:
    known = np.asarray(np.isfinite(start).all(axis=1))
    centre = np.rint(np.where(known[:, None], start, 0)).astype(int)
    g = np.stack([gather(g, centre, POSITION).reshape(len(start), -1).astype(float) for g in (gx, gy)], axis=-1)
    offset = _offsets(start - centre, POSITION)
    H = np.einsum("npi,npj->nij", g, g)
    right = np.einsum("npi,np->ni", g, (g * offset).sum(axis=-1))
    trace, det = H[:, 0, 0] + H[:, 1, 1], np.linalg.det(H)
    ok = known & (det > THIN * (trace / 2) ** 2)
    step = np.linalg.solve(np.where(ok[:, None, None], H, np.eye(2)), right[..., None])[..., 0]
    return np.where(ok[:, None], start + step, np.nan)


def _offsets(shift: Array, half: int) -> Array:
    """Offsets (N, P, 2) of the pixels of windows from points at `shift` (N, 2) px from the windows' central pixel."""
    y, x = np.mgrid[-half : half + 1, -half : half + 1].reshape(2, -1).astype(float)
    return np.asarray(np.stack((x, y), axis=-1) - shift[:, None])


def _score(image: Array, size: Array, xy: Array, angles: Array, radius: int) -> Array:
    """Score (N,) of corners in windows of half side `radius`: correlation of gradients with the edges × likelihood with
    the corner's own edges."""
    centre = np.rint(xy).astype(int)
    out = np.zeros(len(xy))
    for part in chunks(len(xy), 8 * (2 * radius + 1) ** 2):
        offset = _offsets(xy[part] - centre[part], radius)
        steep, grey = (gather(a, centre[part], radius).reshape(offset.shape[:2]).astype(float) for a in (size, image))
        out[part] = _edge_correlation(steep, offset, angles[part]) * _own_likelihood(grey, offset, angles[part], radius)
    return out


def _edge_correlation(steep: Array, offset: Array, angles: Array) -> Array:
    """Correlation (N,), ≥ 0, of gradient lengths (N, P) with the pixels on the two edges."""
    side = [np.abs(offset[..., 1] * np.cos(a) - offset[..., 0] * np.sin(a)) for a in angles.T[:, :, None]]
    model = np.where((side[0] <= LINE) | (side[1] <= LINE), 1.0, -1.0)
    model -= model.mean(axis=1, keepdims=True)
    steep = steep - steep.mean(axis=1, keepdims=True)
    norm = np.sqrt((model**2).sum(axis=1) * (steep**2).sum(axis=1))
    return np.maximum((model * steep).sum(axis=1) / np.maximum(norm, 1e-9), 0)


def _own_likelihood(grey: Array, offset: Array, angles: Array, radius: int) -> Array:
    """As `corner_likelihood`, with a prototype that has the corner's own edges: (N,), ≥ 0."""
    a, b, c, d = np.einsum("nsp,np->sn", _sectors(offset, angles, radius), grey)
    mean = (a + b + c + d) / 4
    bright = np.min([a - mean, b - mean, mean - c, mean - d], axis=0)
    dark = np.min([mean - a, mean - b, c - mean, d - mean], axis=0)
    return np.asarray(np.maximum(np.maximum(bright, dark), 0))
