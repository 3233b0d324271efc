"""The smooth correction of a lens: a bicubic B-spline over the stereographic plane, its basis and its Jacobian."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from rcdn.types import Array, LensCorrection
from rcdn.types.arrays import Real


def stereographic(points: Array) -> Real[Array, "... 2"]:
    """Stereographic points u (..., 2) = 2·(x, y) ÷ (|p| + z) of camera points p (..., 3): |u| = 2·tan(θ/2) at the angle
    θ from the optical axis."""
    points = np.asarray(points, float)
    z, r2 = points[..., 2], (points[..., :2] ** 2).sum(axis=-1)
    length = np.sqrt(r2 + z * z)
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = np.where(
            z > 0, length + z, r2 / (length - z)
        )  # equal to |p| + z, without cancellation behind the camera
        return np.asarray(2 * points[..., :2] / np.maximum(depth, 1e-12 * length)[..., None])


def stereographic_jacobian(points: Array) -> Real[Array, "... 2 3"]:
    """Jacobian ∂u/∂point (..., 2, 3) of `stereographic`."""
    points = np.asarray(points, float)
    u = stereographic(points)
    length = np.linalg.norm(points, axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        # depth = |p| + z = 8·|p| ÷ (4 + |u|²), and its gradient with respect to p is p ÷ |p| + (0, 0, 1)
        depth = 8 * length / (4 + (u * u).sum(axis=-1))
        towards = points / length[..., None] + np.array([0.0, 0.0, 1.0])
        out = -u[..., :, None] * (towards / depth[..., None])[..., None, :]
        out[..., [0, 1], [0, 1]] += (2 / depth)[..., None]
    return np.asarray(out)


def point_of(u: Array) -> Real[Array, "... 3"]:
    """Camera points p (..., 3) in the directions of stereographic points u (..., 2), scaled to |p| = 1 + |u|²/4."""
    return np.concatenate([u, (1 - (u * u).sum(axis=-1) / 4)[..., None]], axis=-1)


def surface(correction: LensCorrection, u: Array) -> Real[Array, "... 2"]:
    """Displacement (..., 2) of the correction, in focal lengths, at stereographic points (..., 2)."""
    first, inside, _ = _cell(correction, u)
    x, y = bspline(inside[..., 0]), bspline(inside[..., 1])
    out = np.empty(np.shape(u))
    for axis in (0, 1):
        out[..., axis] = sum(w * _row(x, c) for w, c in zip(y, _control(correction, first, axis), strict=True))
    return out


def surface_jacobian(correction: LensCorrection, u: Array) -> tuple[Array, Array]:
    """`surface` and its Jacobian (..., 2, 2) with respect to u: [..., k, l] is the derivative of axis k of the
    displacement with respect to axis l of u."""
    first, inside, within = _cell(correction, u)
    x, y = bspline(inside[..., 0]), bspline(inside[..., 1])
    dx, dy = (bspline(inside[..., k], 1) / correction.sides[k] for k in (0, 1))
    total, by_u = np.empty(np.shape(u)), np.zeros((*np.shape(u), 2))
    for axis in (0, 1):
        rows = list(_control(correction, first, axis))
        along = [_row(x, c) for c in rows]
        total[..., axis] = _row(y, along)
        by_u[..., axis, 0] = sum(w * _row(dx, c) for w, c in zip(y, rows, strict=True))
        by_u[..., axis, 1] = _row(dy, along)
    return total, by_u @ _border_jacobian(correction, u) if not within.all() else by_u


def _control(correction: LensCorrection, first: Real[Array, "... 2"], axis: int) -> Iterator[list[Array]]:
    """The four rows of four control points (...) of the cells that begin at `first` (..., 2), for one axis of the
    displacement."""
    width, flat = correction.control.shape[1], correction.control[..., axis].ravel()
    at = first[..., 1] * width + first[..., 0]
    for row in range(4):
        yield [flat.take(at + (row * width + column)) for column in range(4)]


def _row(weights: Array, values: list[Array]) -> Array:
    """Weighted sum Σ weights · values of four terms."""
    return np.asarray(weights[0] * values[0] + weights[1] * values[1] + weights[2] * values[2] + weights[3] * values[3])


def basis(correction: LensCorrection, points: Array) -> tuple[Array, Array]:
    """The B-spline basis at camera points (N, 3): `columns` (N, 16), the numbers of the control points that act there,
    counted row by row, and their `weights` (N, 16), which sum to 1. The displacement is Σ weights · control[columns];
    the weights are NaN for a point that has no pixel."""
    return basis_at(correction, stereographic(points))


def basis_at(correction: LensCorrection, u: Array) -> tuple[Array, Array]:
    """`basis` at stereographic points (N, 2)."""
    first, inside, _ = _cell(correction, u)
    weights, steps = bspline(inside), np.arange(4)
    rows = (first[:, 1, None] + steps) * correction.control.shape[1]
    columns = rows[:, :, None] + (first[:, 0, None] + steps)[:, None, :]
    both = np.einsum("rn,cn->nrc", weights[:, :, 1], weights[:, :, 0])
    return columns.reshape(-1, 16), both.reshape(-1, 16)


def _cell(correction: LensCorrection, u: Array) -> tuple[Array, Array, Array]:
    """First control point (..., 2) of the cell of u along x and y, the position (..., 2) in [0, 1] within the cell, and
    whether u is in the domain.

    A point beyond the domain is replaced by the point where the line from the centre to it leaves the domain.
    """
    extent, cells = correction.extent, correction.cells
    share = (np.abs(u) / extent).max(axis=-1)
    within = ~(share > 1)
    inner = u if within.all() else u / np.maximum(share, 1)[..., None]
    at = (inner + extent) / correction.sides
    first = np.clip(np.floor(np.nan_to_num(at)), 0, cells - 1).astype(np.intp)
    return first, at - first, within


def _border_jacobian(correction: LensCorrection, u: Array) -> Array:
    """Jacobian (..., 2, 2) with respect to u of the point where the line from the centre to u leaves the domain; the
    identity inside the domain."""
    ratio = np.abs(u) / correction.extent
    share = np.maximum(ratio.max(axis=-1), 1)
    axis = ratio.argmax(axis=-1)[..., None] == np.arange(2)
    beyond = np.where((share > 1)[..., None] & axis, u, np.inf)
    with np.errstate(invalid="ignore"):
        pull = u[..., :, None] / beyond[..., None, :]
    return np.asarray((np.eye(2) - pull) / share[..., None, None])


def bspline(t: Array, derivative: int = 0) -> Real[Array, "4 ..."]:
    """The four uniform cubic B-splines (4, ...) that are non-zero at t in [0, 1] of a cell, or their `derivative` (0, 1
    or 2) with respect to t."""
    s = 1 - t
    if derivative == 0:
        return np.stack([s * s * s, 4 + t * t * (3 * t - 6), 4 + s * s * (3 * s - 6), t * t * t]) / 6
    if derivative == 1:
        return np.stack([-s * s, t * (3 * t - 4), s * (4 - 3 * s), t * t]) / 2
    return np.stack([s, 3 * t - 2, 3 * s - 2, t])
