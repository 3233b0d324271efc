"""The printed sheet: reflectance and coverage at board coordinates, low-pass filtered over each sample's footprint."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rcdn.native import bind
from rcdn.synthetic.lattice import extent, upright
from rcdn.synthetic.scene import BoardSpec
from rcdn.types import Array

F32 = np.float32


class _Sheet(NamedTuple):
    """The kernel's group of arguments."""

    black: float
    white: float
    beyond: float
    duty: float
    columns: float
    rows: float
    margin: float
    swap: int
    coded: int

    @classmethod
    def of(cls, spec: BoardSpec) -> _Sheet:
        duty = 1 - 2 * spec.bleed
        size = spec.cols, spec.rows, spec.margin
        return cls(spec.black, spec.white, spec.margin_value, duty, *size, int(spec.swap), spec.coded)


_sheet = bind("rcdn_sheet", _Sheet)


def _inside(u: Array, width: Array, low: float, high: float) -> Array:
    """Share of [u − w/2, u + w/2] inside [low, high]."""
    a = np.maximum(u - width * F32(0.5), F32(low))
    b = np.minimum(u + width * F32(0.5), F32(high))
    return np.asarray(np.maximum(b - a, 0) / width)


def sheet(spec: BoardSpec, u: Array, v: Array, wu: Array, wv: Array, ws: Array | None = None) -> tuple[Array, Array]:
    """Reflectance and coverage (0..1) of the sheet.

    `u`, `v`, `wu`, `wv`: float32 of one shape, coordinates and widths of the footprints, squares; `ws`: width of the
    footprint along u + v, for a deltille.
    """
    if spec.pattern == "deltille":
        return _triangles(spec, u, v, wu, wv, wu if ws is None else ws)
    value, cover = np.empty(u.shape, F32), np.empty(u.shape, F32)
    flat = (np.ascontiguousarray(a).ravel() for a in (u, v, wu, wv))
    painted = np.array(spec.painted, float).reshape(-1, 3)
    _sheet(_Sheet.of(spec), painted, *flat, value.reshape(-1), cover.reshape(-1))
    return value, cover


def _triangles(spec: BoardSpec, u: Array, v: Array, wu: Array, wv: Array, ws: Array) -> tuple[Array, Array]:
    """`sheet` for a deltille: u, v and u + v are integers along its three families of edges."""
    # with fractional parts {·}, {u} + {v} − {u + v} is 0 in one kind of triangle, 1 in the other
    dark = np.clip(1 - (_fraction(u, wu) + _fraction(v, wv) - _fraction(u + v, ws)), 0, 1)
    if spec.bleed:
        dark = _shrunk(u, v, wu, spec.bleed)
    if spec.swap:
        dark = 1 - dark
    value = F32(spec.white) + F32(spec.black - spec.white) * dark
    for i, j, paint in spec.painted:
        cover = _inside(u, wu, i - 1, i) * _inside(v, wv, j - 1, j)
        value = value * (1 - cover) + F32(paint) * cover
    value = np.where(_printed(spec, u, v), value, F32(spec.margin_value))
    (x, y), (cols, rows), m = upright(spec, u, v), extent(spec), spec.margin
    return value, _inside(x, wu, -1 - m, cols + m) * _inside(y, wv, -1 - m, rows + m)


def _fraction(u: Array, width: Array) -> Array:
    """Mean of u − ⌊u⌋ over [u − w/2, u + w/2]."""

    def integral(x: Array) -> Array:
        n = np.floor(x)
        return np.asarray(n * F32(0.5) + F32(0.5) * (x - n) ** 2)

    return np.asarray((integral(u + width * F32(0.5)) - integral(u - width * F32(0.5))) / width)


def _shrunk(u: Array, v: Array, width: Array, bleed: float) -> Array:
    """Darkness if every dark triangle is eroded by `bleed` times its height (dilated if negative)."""
    fu, fv = u - np.floor(u), v - np.floor(v)
    depth = np.minimum(np.minimum(fu, fv), 1 - fu - fv)  # in a dark triangle
    beyond = np.minimum(np.minimum(1 - fu, 1 - fv), fu + fv - 1)  # in a bright one
    return np.asarray(np.clip(F32(0.5) + (np.where(fu + fv < 1, depth, -beyond) - F32(bleed)) / width, 0, 1))


def _printed(spec: BoardSpec, u: Array, v: Array) -> Array:
    """Whether the triangle at (u, v) has an inner corner, so that it is printed."""
    i, j = np.floor(u).astype(np.int64), np.floor(v).astype(np.int64)

    def held(i: Array, j: Array) -> Array:
        k = i + (j >> 1)
        return (j >= 0) & (j < spec.rows) & (k >= 0) & (k < spec.cols)

    tip = np.where(u - i + v - j < 1, held(i, j), held(i + 1, j + 1))
    return np.asarray(tip | held(i + 1, j) | held(i, j + 1))
