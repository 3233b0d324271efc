"""Sub-pixel refinement: the paper's methods and the adaptive one (paper section 3.3, Eq. 4, and section 4.3)."""

from __future__ import annotations

from typing import assert_never

import cv2
import numpy as np

from rcdn.config import Refine
from rcdn.corners.adaptive import adaptive_fit
from rcdn.corners.patches import chunks, gather_zero
from rcdn.corners.saddle import rochade, surface_fit
from rcdn.errors import RcdnError
from rcdn.types import Array, Status
from rcdn.types.arrays import Real, Shaped

FLOOR = 0.01
"""Least value used for a neighbour, share of the peak: a ReLU response is often exactly 0, which has no logarithm."""
DISAGREEMENT = 1.0
"""Distance, px, between the two estimates of `mixed` above which only the estimate from the response is used."""
EDGE_HALF = 4
"""Half window of cornerSubPix, px (9×9, paper section 4.3)."""


def refine(
    grey: Shaped[Array, "h w"],
    response: Array,
    xy: Shaped[Array, "n 2"],
    rule: Refine,
    pitch: Real[Array, " n"] | None = None,
    careful: Array | None = None,
) -> tuple[Array, Array]:
    """Sub-pixel positions of corners, and whether refinement succeeded.

    `grey` (H, W) uint8 or float, 0..255; `response` (H, W); `xy` (N, 2) response peaks, px, integers; `pitch` (N,) px,
    distance to the nearest neighbouring corner (None: measured among `xy`), used only if `rule.half` is None;
    `careful` (N,) bool: corners that get the last step of that method (None: all).
    Returns `xy` (N, 2) float and `status` (N,) uint8: `Status.REFINED`, or `Status.SEED` where the method failed; the
    position is then the seed, unchanged. A window that extends beyond the image never raises.
    """
    if grey.ndim != 2 or grey.shape != response.shape:
        raise RcdnError(f"grey and response must be (H, W) arrays of one shape, not {grey.shape} and {response.shape}")
    seeds = np.array(xy, dtype=np.float64).reshape(-1, 2)
    if not len(seeds):
        return seeds, np.zeros(0, np.uint8)
    fine = _positions(grey, response, np.rint(seeds).astype(np.int64), rule, pitch, careful)
    status = np.full(len(fine), int(Status.REFINED), np.uint8)
    failed = np.isnan(fine[:, 0]) | np.isnan(fine[:, 1])
    if failed.any():
        fine[failed], status[failed] = seeds[failed], int(Status.SEED)
    return fine, status


def _positions(
    grey: Array, response: Array, peaks: Array, rule: Refine, pitch: Array | None, careful: Array | None
) -> Real[Array, "n 2"]:
    """Positions (N, 2) by `rule.method`, NaN where it failed."""
    match rule.method:
        case "peak":
            return peaks + peak_offset(response, peaks)
        case "com":
            return peaks + com_offset(response, peaks)
        case "parabola":
            return peaks + parabola_offset(response, peaks)
        case "edge":
            return edge_position(grey, peaks)
        case "saddle":
            return saddle_position(grey, peaks, rule.half, pitch, careful)
        case "mixed":
            by_peak = peaks + peak_offset(response, peaks)
            return mix(by_peak, saddle_position(grey, peaks, rule.half, pitch))
        case unknown:
            assert_never(unknown)


def mix(by_peak: Array, by_saddle: Array) -> Real[Array, "n 2"]:
    """The paper's mixed refinement: the mean of two estimates (N, 2), px.

    Paper section 3.3, which does not define failures. Here, where one estimate is NaN, the result is the other; where
    they are more than `DISAGREEMENT` apart, it is the response peak alone. NaN where both are.
    """
    mean = (by_peak + by_saddle) / 2
    far = np.linalg.norm(by_peak - by_saddle, axis=1) > DISAGREEMENT
    alone = (far | np.isnan(by_saddle).any(axis=1))[:, None]
    lost = np.isnan(by_peak).any(axis=1, keepdims=True)
    return np.where(lost, by_saddle, np.where(alone, by_peak, mean))


def saddle_position(
    grey: Array, peaks: Array, half: int | None, pitch: Array | None = None, careful: Array | None = None
) -> Real[Array, "n 2"]:
    """Saddles (N, 2) px of the grey surface: the paper's fit over (2 half + 1)² px; if `half` is None, windows from the
    pitch.

    NaN where there is none; see `surface_fit` and `adaptive_fit`.
    """
    return adaptive_fit(grey, peaks, pitch, careful) if half is None else surface_fit(grey, peaks, rochade(half))


def _three(response: Array, peaks: Array) -> tuple[Array, Array, Array]:
    """Response before, at and after each peak along x and y, (N, 2) each; NaN where a peak is no maximum.

    No maximum: not positive, exceeded by one of its four neighbours, equal to both on an axis, or at the border.
    """
    window = gather_zero(np.asarray(response, np.float64), peaks, 1)
    middle = np.repeat(window[:, 1, 1, None], 2, axis=1)
    before = np.stack((window[:, 1, 0], window[:, 0, 1]), axis=1)
    after = np.stack((window[:, 1, 2], window[:, 2, 1]), axis=1)
    inside = (peaks > 0) & (peaks < np.array(response.shape[::-1]) - 1)
    peak = (middle > 0) & (middle >= before) & (middle >= after) & (middle + middle > before + after) & inside
    return before, np.where(peak.all(axis=1, keepdims=True), middle, np.nan), after


def peak_offset(response: Real[Array, "h w"], peaks: Shaped[Array, "n 2"]) -> Array:
    """Sub-pixel offset of response peaks by a three-point Gaussian fit.

    Paper section 3.3, Eq. (4). `response` (H, W), `peaks` (N, 2) integer (x, y). Returns (N, 2) offsets (dx, dy), px,
    within ±0.5. A neighbour below 1 % of the peak is raised to 1 %: its logarithm must exist, and a tiny value would
    push the offset to ±0.5. NaN where the pixel is no local maximum or touches the border.
    """
    before, middle, after = _three(response, peaks)
    before, after = (np.log(np.maximum(side, FLOOR * middle)) for side in (before, after))
    return 0.5 * (before - after) / (before - 2 * np.log(middle) + after)


def parabola_offset(response: Array, peaks: Array) -> Array:
    """Sub-pixel offset of response peaks by a three-point parabola along each axis (paper section 4.3).

    Arguments, result and failures as for `peak_offset`; no floor is needed.
    """
    before, middle, after = _three(response, peaks)
    return 0.5 * (before - after) / (before - 2 * middle + after)


def com_offset(response: Array, peaks: Shaped[Array, "n 2"], half: int = 4) -> Real[Array, "n 2"]:
    """Offset (N, 2), px, from `peaks` (N, 2) to the centre of mass of the response over (2 half + 1)² pixels.

    Paper section 4.3: 9×9. Negative responses and pixels outside the image have weight 0; NaN if the total weight is 0.
    """
    out = np.full((len(peaks), 2), np.nan)
    reach = np.arange(-half, half + 1.0)
    for part in chunks(len(peaks), (2 * half + 1) ** 2):
        weight = np.maximum(gather_zero(response, peaks[part], half), 0).astype(np.float64)
        total = weight.sum(axis=(1, 2))
        total[~(total > 0)] = np.nan
        out[part] = np.stack((weight.sum(axis=1) @ reach, weight.sum(axis=2) @ reach), axis=1) / total[:, None]
    return out


def edge_position(grey: Array, peaks: Array) -> Real[Array, "n 2"]:
    """Positions (N, 2) px by OpenCV's cornerSubPix: gradients are orthogonal to the line from the corner to their
    pixel.

    Paper section 4.3: 9×9 window; at most 40 iterations, until a step is below 1e-3 px. OpenCV returns the initial
    guess where it finds no corner or ends outside the window: a point that did not move is tried again from ¼ px away,
    and is NaN if it does not move from there either.
    """
    pad = EDGE_HALF + 3
    image = cv2.copyMakeBorder(np.asarray(grey, np.float32), pad, pad, pad, pad, cv2.BORDER_REPLICATE)
    start = np.clip(peaks, 0, np.array(grey.shape[::-1]) - 1).astype(np.float32)
    xy = _corner_sub_pix(image, start + pad) - pad
    still = np.nonzero((xy == start).all(axis=1))[0]
    nudged = start[still] + np.float32(0.25)
    if len(still):
        again = _corner_sub_pix(image, nudged + pad) - pad
        xy[still[(again == nudged).all(axis=1)]] = np.nan
    return xy.astype(np.float64)


def _corner_sub_pix(image: Array, start: Array) -> Array:
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 40, 1e-3)
    points = np.ascontiguousarray(start.reshape(-1, 1, 2))
    return np.asarray(cv2.cornerSubPix(image, points, (EDGE_HALF, EDGE_HALF), (-1, -1), criteria)).reshape(-1, 2)
