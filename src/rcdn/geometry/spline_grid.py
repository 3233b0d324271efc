"""Grids of lens corrections: construction of one that covers a camera's frame, folds, and bending energy."""

from __future__ import annotations

import numpy as np

from rcdn.errors import RcdnError
from rcdn.geometry.correction import bspline, point_of, stereographic, surface
from rcdn.geometry.inverse import unfolded
from rcdn.geometry.lens import project, unproject
from rcdn.geometry.models import fold
from rcdn.types import Array, Camera, LensCorrection
from rcdn.types.arrays import Real
from rcdn.types.correction import DEGREE

WIDEST = 120.0
"""degrees from the optical axis; rays beyond it don't enlarge the grid"""
ALONG = 65
"""grid points along each side of the frame at which its rays are evaluated"""


def zero_correction(
    camera: Camera, columns: int, margin: float = 0.03, pixels: Real[Array, "m 2"] | None = None
) -> LensCorrection:
    """A zero correction, `columns` control points wide, of square cells that cover the camera's frame, or `pixels` (M,
    2) if given, plus a margin of `margin` times their width on each side.

    The frame's extent is computed from the camera's rays; pixels without a ray, and rays over WIDEST degrees from the
    optical axis, are ignored. The number of rows follows from the extent. Raises RcdnError for fewer than four columns,
    or if no pixel has a ray.
    """
    if columns <= DEGREE:
        raise RcdnError(f"zero_correction: columns must be 4 or more, not {columns}")
    seen = frame_pixels(camera.image_size, ALONG) if pixels is None else np.asarray(pixels, float)
    u = stereographic(unproject(camera, seen.reshape(-1, 2)))
    u = u[np.hypot(u[:, 0], u[:, 1]) <= 2 * np.tan(np.radians(WIDEST) / 2)]
    if not len(u):
        raise RcdnError("zero_correction: no pixel of the camera has a ray; calibrate it first")
    half = np.maximum(np.abs(u).max(axis=0) * (1 + 2 * margin), 1e-9)
    side = 2 * half[0] / (columns - DEGREE)
    rows = max(int(np.ceil(2 * half[1] / side - 1e-9)), 1) + DEGREE
    return LensCorrection(np.zeros((rows, columns, 2)), np.array([half[0], side * (rows - DEGREE) / 2]))


def largest_shift(camera: Camera) -> float:
    """Largest displacement of a pixel of the frame by the camera's correction, px; 0 without a correction."""
    if camera.correction is None:
        return 0.0
    rays = unproject(camera, frame_pixels(camera.image_size, ALONG))
    shift = surface(camera.correction, stereographic(rays)) @ camera.K[:2, :2].T
    return float(np.max(np.hypot(shift[:, 0], shift[:, 1]), initial=0.0, where=np.isfinite(shift).all(axis=1)))


def folds(camera: Camera) -> bool:
    """Whether the camera's correction reverses the orientation of the map somewhere in the frame, so that several rays
    share a pixel.

    Checked on a grid of several points per cell, for the rays before the fold of the parametric model. False without a
    correction.
    """
    if camera.correction is None:
        return False
    end = 2 * np.tan(min(fold(camera), np.radians(WIDEST)) / 2) * (1 - 1e-9)
    half = np.minimum(camera.correction.extent, end)
    u = np.stack(np.meshgrid(*(np.linspace(-h, h, 6 * int(camera.correction.cells.max()) + 1) for h in half)), axis=-1)
    points = point_of(u[np.hypot(u[..., 0], u[..., 1]) < end])
    pixels = project(camera, points)
    inside = ((pixels >= -0.5) & (pixels <= np.array(camera.image_size) - 0.5)).all(axis=1)
    return not unfolded(camera, points[inside]).all()


def frame_pixels(image_size: tuple[int, int], along: int) -> Array:
    """Grid of (along², 2) pixels over the frame, its borders included."""
    width, height = image_size
    x, y = np.linspace(-0.5, width - 0.5, along), np.linspace(-0.5, height - 0.5, along)
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def roughness(correction: LensCorrection) -> Real[Array, "p p"]:
    """Matrix (P, P) of the bending energy of a thin plate, a quadratic form in the P flattened control points:
    ∬ S_uu² + 2·S_uv² + S_vv² du dv over the domain, summed over both axes of the displacement, in (focal lengths)² ÷
    u². It depends on the grid only, not on the values of the control points.

    Exact: the products of B-splines are integrated by Gaussian quadrature. Positive semidefinite, and zero only for
    displacements that are affine in u. The energy of a surface doesn't depend on the grid that represents it.
    """
    return np.kron(bending(correction), np.eye(2))


def bending(correction: LensCorrection) -> Array:
    """The matrix of `roughness` for one axis of the displacement, (rows·columns, rows·columns)."""
    x, y = (_products(int(n), float(h)) for n, h in zip(correction.cells, correction.sides, strict=True))
    return np.asarray(np.kron(y[0], x[2]) + 2 * np.kron(y[1], x[1]) + np.kron(y[2], x[0]))


def _products(cells: int, side: float) -> list[Array]:
    """The integrals ∫ B_i B_j, ∫ B_i′ B_j′ and ∫ B_i″ B_j″, each (n, n), of the n = `cells` + 3 cubic B-splines on a
    line of cells."""
    nodes, share = np.polynomial.legendre.leggauss(DEGREE + 1)
    out = []
    for derivative in (0, 1, 2):
        v, whole = bspline((nodes + 1) / 2, derivative) / side**derivative, np.zeros((cells + DEGREE, cells + DEGREE))
        one = (v * share / 2 * side) @ v.T
        for k in range(cells):
            whole[k : k + 4, k : k + 4] += one
        out.append(whole)
    return out
