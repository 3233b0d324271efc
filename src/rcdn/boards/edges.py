"""Where board recovery looks at pixels: is there an edge between two corners, and do two edges cross where a corner should be?"""

from __future__ import annotations

import cv2
import numpy as np

from rcdn.types import Array

ALONG, ACROSS = 9, (0.08, 0.14, 0.2)
"""samples along a link, and offsets to its sides, shares of its length"""
SKIP = 0.15
"""share of the link left out at both ends, where blur mixes all four squares"""


def edge_contrast(grey: Array, start: Array, end: Array) -> Array:
    """What separates the two sides of each link, (L, 3) grey levels: one mean difference for each third of its length.

    `grey` (H, W); `start`, `end` (L, 2) px. Positive: the side at rising angle (clockwise on the screen) from the direction start → end
    is brighter. Offsets to the side stay between 1 and 5 px. Outside the image the border repeats.
    """
    if not len(start):
        return np.zeros((0, 3))
    step = end - start
    length = np.maximum(np.linalg.norm(step, axis=1), 1e-9)
    t = np.linspace(SKIP, 1 - SKIP, ALONG)
    middle = start[:, None] + t[None, :, None] * step[:, None]
    normal = np.stack([-step[:, 1], step[:, 0]], axis=1) / length[:, None]
    reach = np.clip(length[:, None] * np.array(ACROSS), 1, 5)
    shift = reach[:, None, :, None] * normal[:, None, None, :]
    near, far = (sample_grey(grey, middle[:, :, None] + s * shift).mean(axis=2) for s in (1, -1))
    return np.asarray((near - far).reshape(len(start), 3, ALONG // 3).mean(axis=2))


def edge_sharpness(grey: Array, start: Array, end: Array) -> float:
    """How sudden the edges of links are: the step within 0.2 of a link's length, share of that within 0.6; their median.

    `start`, `end` (L, 2) px. Near 1 for a printed edge in focus, 0.33 for a ramp, 0.38 where grey levels wave like a sine.
    """
    step = end - start
    normal = np.stack([-step[:, 1], step[:, 0]], axis=1)
    middle = start[:, None] + np.linspace(0.25, 0.75, ALONG)[None, :, None] * step[:, None]
    near, far = (
        (sample_grey(grey, middle + r * normal[:, None]) - sample_grey(grey, middle - r * normal[:, None])).mean(axis=1)
        for r in (0.1, 0.3)
    )
    share = near / np.where(np.abs(far) > 1e-6, far, np.inf)
    return float(np.median(share)) if len(share) else 0.0


def sample_grey(grey: Array, xy: Array) -> Array:
    """Bilinear grey levels at `xy` (..., 2)."""
    flat: Array = xy.reshape(-1, 2).astype(np.float32)
    columns = 1 << 14  # remap takes fewer than 32768 rows and columns
    pad = -len(flat) % columns
    flat = np.pad(flat, ((0, pad), (0, 0))).reshape(-1, min(columns, len(flat) + pad), 2)
    values = cv2.remap(grey, flat[..., 0], flat[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(values.reshape(-1)[: xy.size // 2].reshape(xy.shape[:-1]), np.float64)


ROWS = np.linspace(0.08, 0.36, 8)
"""where the sides of a crossing are sampled, squares from it"""
SPAN, STEPS = 0.34, 35
"""reach and samples of the profiles across an edge, squares to either side and in all"""
WIDTH = 0.05
"""smoothing of the profiles' slopes, squares"""
DARK = 6.0
"""grey levels added before the logarithm, so that noise in the dark doesn't count as contrast"""


def crossings(grey: Array, xy: Array, du: Array, dv: Array, colour: Array) -> tuple[Array, Array]:
    """Where a board's two edges cross near a spot that the board predicts, and how plainly they are seen.

    `grey` (H, W); `xy` (N, 2) px the spots; `du`, `dv` (N, 2) px the board's steps there; `colour` (N,) ±1: the square towards
    (+u, +v) is bright or dark. Returns offsets (N, 2) along u and v, squares, and strengths (N, 2): slopes of the logarithm of the
    grey level, a square, the weaker of an edge's two halves. An X-corner's edge changes its sign in the crossing: the edge of a
    shadow or of a cover doesn't, and is seen in neither half's company. The logarithm makes lit and shaded parts alike; the median
    along an edge leaves out where a shadow crosses it, and sees nothing where most of it is covered.
    """
    if not len(xy):
        return np.zeros((0, 2)), np.zeros((0, 2))
    across_u, seen_u = _edge_offset(grey, xy, du, dv, colour)
    across_v, seen_v = _edge_offset(grey, xy, dv, du, colour)
    return np.stack([across_u, across_v], axis=1), np.stack([seen_u, seen_v], axis=1)


def _edge_offset(grey: Array, xy: Array, across: Array, along: Array, colour: Array) -> tuple[Array, Array]:
    """Offset (N,) and strength (N,) of the edge that runs along `along`, searched along `across`."""
    t = np.linspace(-SPAN, SPAN, STEPS)
    halves = []
    for side in (1, -1):
        rows = xy[:, None] + side * ROWS[None, :, None] * along[:, None]
        where = rows[:, :, None] + t[None, None, :, None] * across[:, None, None]
        slope = _slope(np.log(sample_grey(grey, where) + DARK), t)
        halves.append(side * colour[:, None] * np.median(slope, axis=1))
    both = np.minimum(*halves)
    row, best = np.arange(len(xy)), both[:, 1:-1].argmax(axis=1) + 1
    before, peak, after = both[row, best - 1], both[row, best], both[row, best + 1]
    bend = before - 2 * peak + after
    shift = np.where(bend < 0, 0.5 * (before - after) / np.where(bend < 0, bend, 1), 0)
    return t[best] + np.clip(shift, -0.5, 0.5) * (t[1] - t[0]), peak


def _slope(profile: Array, t: Array) -> Array:
    """Smoothed slope (..., STEPS) of `profile` (..., STEPS) at `t`."""
    gap = (t[:, None] - t) / WIDTH
    kernel = -gap * np.exp(-0.5 * gap * gap)  # ends see less of it: edges there are another's
    return np.asarray(profile @ (kernel / np.abs(kernel).sum(axis=1).max()).T * (2 / WIDTH))
