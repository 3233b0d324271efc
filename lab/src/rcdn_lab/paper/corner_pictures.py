"""Pictures of one corner: the paper's synthetic images of sections 4.2 and 4.3, with the exact position of the corner.

Four squares of 64 and 191. The paper does not specify how a rotated or tilted corner is sampled; here every pixel is
the exact mean of the pattern over its area, so that no sampling grid shifts the corner. The transition line of 128
belongs to the pattern: one px wide, it is rotated and tilted with it (and gets narrower). Tilt is seen from far away
(no perspective), about an axis at 45° to the squares' edges: about an edge, the crossing would remain a right angle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from rcdn.types import Array

DARK, BRIGHT, BETWEEN = 64.0, 191.0, 128.0
TAPS = np.exp(-(np.arange(-1, 2) ** 2) / (2 * 0.675))
"""of the 3×3 pre-blur, "roughly corresponding to a 0.675 variance", before normalisation to sum 1"""
LEVEL = 1e-8
"""slope below which an edge is treated as parallel to the pixels' rows or columns"""


@dataclass(frozen=True)
class View:
    """View of the corner: `rotation`, `tilt`, degrees; `x`, `y`: px from the picture's centre; `gap`: width of the line
    of 128, px."""

    rotation: float = 0.0
    tilt: float = 0.0
    x: float = 0.0
    y: float = 0.0
    gap: float = 0.0


def pattern_axes(view: View) -> Array:
    """(2, 2): px from the corner → pattern coordinates u, v, px before tilt. The edges are u = 0 and v = 0 and cross at
    2 atan(cos tilt)."""
    turn = np.deg2rad(view.rotation)
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    short = np.cos(np.deg2rad(view.tilt))
    lean = 0.5 * np.array([[1 + short, 1 - short], [1 - short, 1 + short]])
    return np.asarray(np.linalg.inv(rotation @ lean))


def crossing_angle(tilt: float) -> float:
    """Angle between the edges, degrees."""
    return float(np.rad2deg(2 * np.arctan(np.cos(np.deg2rad(tilt)))))


def corner_xy(view: View, size: int) -> tuple[float, float]:
    """Position of the corner in a picture of `size`² px, px; pixel (0, 0) is the centre of the top-left one."""
    return (size - 1) / 2 + view.x, (size - 1) / 2 + view.y


def exposure(view: View, size: int) -> Array:
    """Grey levels (size, size) float64: the mean of the pattern over each pixel, before blur, noise and rounding."""
    x, y = corner_xy(view, size)
    reach = np.arange(size, dtype=float)
    px, py = np.meshgrid(reach - x, reach - y)
    u, v = pattern_axes(view)
    half = view.gap / 2
    levels = (half, -half) if half else (0.0,)
    by_u, by_v = ([_Edge(axis, level, px, py) for level in levels] for axis in (u, v))
    both = [[_wedge(a, b, px, py) for b in by_v] for a in by_u]
    # with a gap the sign of u is [u > half] + [u > -half] - 1, its size [u > half] + 1 - [u > -half]; the same for v
    (au, bu), (av, bv) = ((edges[0].share, edges[-1].share) for edges in (by_u, by_v))
    corners = both[0][0], both[0][-1], both[-1][0], both[-1][-1]
    product = sum(corners) - au - bu - av - bv + 1
    inside = corners[0] - corners[1] - corners[2] + corners[3] + au - bu + av - bv + 1
    middle = (DARK + BRIGHT) / 2
    return np.asarray(BETWEEN + (middle - BETWEEN) * inside + (BRIGHT - DARK) / 2 * product)


class _Edge:
    """A straight edge, `axis` · p = `level`, and the share of each pixel's area beyond it."""

    def __init__(self, axis: Array, level: float, px: Array, py: Array) -> None:
        length = float(np.hypot(*axis))
        self.nx, self.ny, self.level = axis[0] / length, axis[1] / length, level / length
        a, b = sorted((max(abs(self.nx), LEVEL), max(abs(self.ny), LEVEL)))
        d = self.nx * px + self.ny * py - self.level
        rise = [np.maximum(d + s, 0) ** 2 for s in ((a + b) / 2, (b - a) / 2, (a - b) / 2, -(a + b) / 2)]
        # the integral of the density of a pixel's points along the normal, a trapezoid of sides a and b
        share = (rise[0] - rise[1] - rise[2] + rise[3]) / (2 * a * b)
        self.share = np.where(d >= (a + b) / 2, 1.0, np.where(d <= -(a + b) / 2, 0.0, share))


def _wedge(one: _Edge, two: _Edge, px: Array, py: Array) -> Array:
    """Share of each pixel's area beyond both edges."""
    out = one.share * two.share
    split = (out > 0) & (one.share < 1) & (two.share < 1)
    for row, column in np.argwhere(split):
        x, y = float(px[row, column]), float(py[row, column])
        square = [(x + dx, y + dy) for dx, dy in ((-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5))]
        out[row, column] = _area(_clip(_clip(square, one), two))
    return out


def _clip(polygon: Sequence[tuple[float, float]], edge: _Edge) -> list[tuple[float, float]]:
    """The part of a convex polygon beyond an edge."""
    depth = [edge.nx * x + edge.ny * y - edge.level for x, y in polygon]
    out = []
    for k, (here, there) in enumerate(zip(polygon, [*polygon[1:], *polygon[:1]], strict=True)):
        now, then = depth[k], depth[(k + 1) % len(polygon)]
        if now > 0:
            out.append(here)
        if (now > 0) != (then > 0):
            share = now / (now - then)
            out.append((here[0] + share * (there[0] - here[0]), here[1] + share * (there[1] - here[1])))
    return out


def _area(polygon: Sequence[tuple[float, float]]) -> float:
    after = [*polygon[1:], *polygon[:1]]
    return abs(sum(x0 * y1 - x1 * y0 for (x0, y0), (x1, y1) in zip(polygon, after, strict=True))) / 2


def pre_blurred(grey: Array) -> Array:
    """`grey` (H, W) after the 3×3 Gaussian of section 4.2, float64; the border is reflected."""
    taps = TAPS / TAPS.sum()
    return np.asarray(cv2.sepFilter2D(grey, cv2.CV_64F, taps, taps, borderType=cv2.BORDER_REFLECT_101))


def defocused(view: View, size: int, sigma: float) -> Array:
    """`exposure` blurred by a Gaussian of `sigma` px, (size, size) float64; the pattern continues beyond the
    picture."""
    half = int(np.ceil(4 * sigma))
    if not half:
        return exposure(view, size)
    taps = np.exp(-0.5 * (np.arange(-half, half + 1) / sigma) ** 2)
    taps /= taps.sum()
    wide = cv2.sepFilter2D(exposure(view, size + 2 * half), cv2.CV_64F, taps, taps)
    return np.asarray(wide[half:-half, half:-half])


def noisy(grey: Array, sigma: float, rng: np.random.Generator) -> Array:
    """`grey` (H, W) with Gaussian noise of `sigma` grey levels, rounded and clipped to 0..255, uint8."""
    noise = sigma * rng.standard_normal(grey.shape) if sigma else 0.0
    return np.asarray(np.clip(np.rint(grey + noise), 0, 255), np.uint8)
