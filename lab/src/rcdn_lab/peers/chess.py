"""ChESS corners without boards, our implementation after Bennett and Lasenby 2014 (docs/peers.md)."""

from __future__ import annotations

import cv2
import numpy as np

from rcdn import __version__
from rcdn.corners.patches import gather_zero
from rcdn.corners.refine import com_offset
from rcdn.errors import ConfigError
from rcdn.types import Array
from rcdn_lab.peers.base import Find, Grid, Peer
from rcdn_lab.peers.maxima import local_maxima

_HALF_RING = np.array([(0, -5), (2, -5), (3, -3), (5, -2), (5, 0), (5, 2), (3, 3), (2, 5)])
RING = np.concatenate([_HALF_RING, -_HALF_RING])
"""(16, 2) offsets (x, y) of the samples at radius 5, px; clockwise on the screen, from above the centre"""
CROSS = ((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1))
RADII = (5, 10)
ROWS = 32
"""Rows that are computed together: their data fit into a core's cache."""
BINOMIAL = np.array([1, 4, 6, 4, 1], np.float32) / 16
WINDOW = 2
"""half side of the window of suppression and of the centre of mass, px"""
THRESHOLD = 0.45
"""The peer's threshold as a share of the largest response; the RCDN paper's value for its GoPro pictures"""


def _ring(radius: int) -> Array:
    if radius not in RADII:
        raise ConfigError(f"radius must be one of {RADII}, not {radius!r}")
    return RING * (radius // 5)


def chess_response(grey: Array, radius: int = 5, blur: bool = False) -> Array:
    """Response of each pixel of `grey` (H, W; uint8 or float) as the centre of an X-corner: (H, W) float32, ≥ 0.

    R = SR − DR − 16 MR of 16 samples on a ring: the sum response Σ |(Iₙ + Iₙ₊₈) − (Iₙ₊₄ + Iₙ₊₁₂)|, n = 0..3, minus the
    difference response Σ |Iₙ − Iₙ₊₈|, n = 0..7, minus 16 times the difference of the means of ring and centre (five
    pixels). Zero where that is not positive, and within `radius` px of the border, where the ring is incomplete. For 8
    bits R ≤ 2040. `radius`: 5, or 10 for strong blur (all offsets of the ring doubled); `blur`: smooth by [1 4 6 4
    1]/16 first. Raises ConfigError for another radius.
    """
    ring = _ring(radius)
    image = np.ascontiguousarray(grey, np.float32)
    if blur:
        image = np.asarray(
            cv2.sepFilter2D(image, cv2.CV_32F, BINOMIAL, BINOMIAL, borderType=cv2.BORDER_REFLECT_101), np.float32
        )
    out = np.zeros(image.shape, np.float32)
    height, width = image.shape
    if min(height, width) <= 2 * radius:
        return out
    for top in range(radius, height - radius, ROWS):
        rows = min(ROWS, height - radius - top)
        out[top : top + rows, radius : width - radius] = _band(image, ring, radius, top, rows)
    return out


def _band(image: Array, ring: Array, radius: int, top: int, rows: int) -> Array:
    """The response of `rows` rows from `top`, without the columns at the border."""
    width = image.shape[1]

    def at(x: int, y: int) -> Array:
        return image[top + y : top + y + rows, radius + x : width - radius + x]

    samples = [at(x, y) for x, y in ring.tolist()]
    pairs = [samples[n] + samples[n + 8] for n in range(8)]
    out = np.zeros_like(pairs[0])
    for n in range(4):
        out += np.abs(pairs[n] - pairs[n + 4])
    for n in range(8):
        out -= np.abs(samples[n] - samples[n + 8])
    centre = sum(at(x, y) for x, y in CROSS)
    out -= np.abs(sum(pairs) - np.float32(16 / len(CROSS)) * centre)
    return np.maximum(out, 0)


def chess_corners(grey: Array, threshold: float = 0.0, radius: int = 5, blur: bool = False) -> tuple[Array, Array]:
    """Corners `xy` (N, 2) px and responses (N,), the strongest first.

    `threshold`: share of the largest response below which a pixel is no corner, in [0, 1); 0 keeps all positive ones.
    The maximum of 5 × 5 responses is kept, unless none of its eight neighbours is positive; its position is the centre
    of mass of 5 × 5 responses.
    """
    if not 0 <= threshold < 1:
        raise ConfigError(f"threshold must be a share of the largest response, in [0, 1), not {threshold!r}")
    response = chess_response(grey, radius, blur)
    peaks = local_maxima(response, WINDOW, threshold * float(response.max(initial=0)))
    alone = (gather_zero(response, peaks, 1) > 0).sum(axis=(1, 2)) == 1
    peaks = peaks[~alone]
    score = response[peaks[:, 1], peaks[:, 0]]
    order = np.argsort(-score, kind="stable")
    return (peaks + com_offset(response, peaks, WINDOW))[order], score[order]


def chess_orientation(grey: Array, peaks: Array, radius: int = 5) -> Array:
    """Direction of the bright squares at `peaks` (N, 2) integer (x, y): (N,) steps of 22.5° in 0..7, clockwise from the
    y axis.

    The step n of the largest Mₙ₋₁ + Mₙ + Mₙ₊₁, where Mₙ = (Iₙ + Iₙ₊₈) − (Iₙ₊₄ + Iₙ₊₁₂). With the magnitude of that sum,
    n and n + 4 would always tie, because Mₙ₊₄ = −Mₙ: its sign distinguishes bright squares from dark ones.
    """
    ring = _ring(radius)
    window = gather_zero(np.asarray(grey, np.float32), np.asarray(peaks).reshape(-1, 2), radius)
    samples = window[:, ring[:, 1] + radius, ring[:, 0] + radius]
    pairs = samples[:, :8] + samples[:, 8:]
    m = pairs - np.roll(pairs, -4, axis=1)
    return np.asarray((np.roll(m, 1, axis=1) + m + np.roll(m, -1, axis=1)).argmax(axis=1))


def _find(image: Array, _size: tuple[int, int]) -> list[Grid]:
    xy, _ = chess_corners(image, THRESHOLD)
    return [Grid(xy)] if len(xy) else []


def _load() -> Find:
    cv2.setNumThreads(1)
    return _find


CHESS = Peer("chess", "free", lambda: None, lambda: __version__, _load, raw=True)
