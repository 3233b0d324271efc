"""The printed sheet: reflectance and coverage at board coordinates, low-passed over each sample's footprint."""

from __future__ import annotations

import numpy as np

from rcdn.synthetic.scene import BoardSpec
from rcdn.types import Array

F32 = np.float32


def _pulse(u: Array, width: Array, duty: float) -> Array:
    """Share of [u − w/2, u + w/2] inside the pulses [2n + (1−duty)/2, 2n + (1+duty)/2], n any integer."""
    start = F32((1 - duty) / 2)

    def integral(x: Array) -> Array:
        x = x - start
        n = np.floor(x * F32(0.5))
        return np.asarray(n * F32(duty) + np.clip(x - 2 * n, 0, F32(duty)))

    return np.asarray((integral(u + width * F32(0.5)) - integral(u - width * F32(0.5))) / width)


def _inside(u: Array, width: Array, low: float, high: float) -> Array:
    """Share of [u − w/2, u + w/2] inside [low, high]."""
    a = np.maximum(u - width * F32(0.5), F32(low))
    b = np.minimum(u + width * F32(0.5), F32(high))
    return np.asarray(np.maximum(b - a, 0) / width)


def sheet(spec: BoardSpec, u: Array, v: Array, wu: Array, wv: Array) -> tuple[Array, Array]:
    """Reflectance and coverage (0..1) of the sheet.

    `u`, `v`, `wu`, `wv`: float32 of one shape, coordinates and footprints, squares.
    """
    duty = 1 - 2 * spec.bleed
    odd_u, odd_v = _pulse(u, wu, duty), _pulse(v, wv, duty)
    even_u, even_v = _pulse(u + 1, wu, duty), _pulse(v + 1, wv, duty)
    dark = np.clip(odd_u * odd_v + even_u * even_v, 0, 1)
    if spec.swap:
        dark = np.clip(odd_u * even_v + even_u * odd_v, 0, 1)
    value = F32(spec.white) + F32(spec.black - spec.white) * dark
    if spec.coded:
        value = _markers(spec, value, u, v, dark)
    for i, j, paint in spec.painted:
        cover = _inside(u, wu, i - 1, i) * _inside(v, wv, j - 1, j)
        value = value * (1 - cover) + F32(paint) * cover
    printed = _inside(u, wu, -1, spec.cols) * _inside(v, wv, -1, spec.rows)
    value = value * printed + F32(spec.margin_value) * (1 - printed)
    m = spec.margin
    return value, _inside(u, wu, -1 - m, spec.cols + m) * _inside(v, wv, -1 - m, spec.rows + m)


def _markers(spec: BoardSpec, value: Array, u: Array, v: Array, dark: Array) -> Array:
    """A random code inside each white square, with a black frame, as ChArUco boards have them."""
    n = spec.coded + 2
    fu, fv = u - np.floor(u), v - np.floor(v)
    bu, bv = np.floor((fu - 0.15) / 0.7 * n).astype(np.int64), np.floor((fv - 0.15) / 0.7 * n).astype(np.int64)
    inside = (bu >= 0) & (bu < n) & (bv >= 0) & (bv < n) & (dark < 0.5)
    frame = (bu == 0) | (bu == n - 1) | (bv == 0) | (bv == n - 1)
    iu, iv = np.floor(u).astype(np.int64), np.floor(v).astype(np.int64)
    key = (iu * 73856093) ^ (iv * 19349663) ^ (bu * 83492791) ^ (bv * 49979693)
    bit = ((key * 2654435761) >> 13) & 1
    ink = inside & (frame | (bit == 0))
    return np.where(ink, F32(spec.black), value)
