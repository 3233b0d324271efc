"""Board coordinates of the pixels around a corner, from the labelled corners near it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from rcdn.geometry.homography import homography, in_front
from rcdn.geometry.matrices import affine, inverse
from rcdn.geometry.median import median
from rcdn.native import bind, constants
from rcdn.types import Array
from rcdn.types.arrays import Int, Real

_neighbours = bind("rcdn_lattice_neighbours")
_lattice = bind("rcdn_lattice")

REACH = 2
"""neighbours up to this many squares away determine a corner's map"""
FAR = 0.05
"""weight of neighbours two squares away, relative to adjacent ones"""
TERMS = constants("lattice")["TERMS"]
"""of a quadratic in two variables"""
STIFF = np.array([1e-9, 1e-9, 1e-9, 1e-3, 1e-3, 1e-3])
"""regularisation of the terms towards 0; it determines the quadratic ones where neighbours are missing on one side"""
RING = np.array([(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1)])
"""offsets to a corner's neighbours and itself, in the order of `neighbours`"""
HORIZON = 0.1
"""least ratio of the smallest to the largest depth on the board with which its homography is used"""


class Maps(NamedTuple):
    """A `Lattice` as an argument of kernels."""

    flat: Array
    origin: Array
    terms: Array


_map, _pixels = bind("rcdn_lattice_map", Maps), bind("rcdn_lattice_pixels", Maps)


@dataclass(frozen=True, eq=False)
class Lattice:
    """Local maps from pixels to board coordinates around each of N corners.

    A homography of the whole board removes perspective; on top of it each corner has a quadratic map of its own, for
    lens distortion and bending. `flat` (3, 3): pixels → rectified squares; `origin` (N, 2): the rectified corners;
    `terms` (N, 6, 2).
    """

    flat: Array
    origin: Array
    terms: Array

    def __call__(self, which: Array, xy: Array) -> Array:
        """Board coordinates (K, ..., 2), squares from corner `which` (K,), of pixels `xy` (K, ..., 2)."""
        return self.with_jacobian(which, xy)[0]

    @property
    def maps(self) -> Maps:
        """The arrays as an argument of kernels."""
        return Maps(*(np.ascontiguousarray(a, np.float64) for a in (self.flat, self.origin, self.terms)))

    def with_jacobian(self, which: Array, xy: Array) -> tuple[Array, Array]:
        """As a call, and the Jacobian (K, ..., 2, 2) with respect to pixels: [..., 0, 1] is du / dy."""
        uv, jacobian = np.empty(xy.shape), np.empty((*xy.shape, 2))
        which, xy = np.ascontiguousarray(which, np.int64), np.ascontiguousarray(xy, float)
        each = (len(which), xy[..., 0].size // max(len(which), 1), 2)
        _map(self.maps, which, xy.reshape(each), uv.reshape(each), jacobian.reshape(*each, 2))
        return uv, jacobian

    def pixels(
        self, which: Int[Array, " k"], uv: Real[Array, "k 2"], start: Real[Array, "k 2"], repeats: int = 4
    ) -> Real[Array, "k 2"]:
        """Pixels (K, 2) of board coordinates `uv` (K, 2) of corners `which` (K,), by Newton's method from `start`
        (K, 2) px.

        Raises LinAlgError where a map is singular.
        """
        xy = np.array(start, float, order="C")
        which, uv = np.ascontiguousarray(which, np.int64), np.ascontiguousarray(uv, float)
        if not _pixels(self.maps, which, uv, repeats, xy):
            raise np.linalg.LinAlgError("a map folds")
        return xy


def lattice(
    ij: Int[Array, "n 2"], xy: Real[Array, "n 2"], own: float = 1.0, plane: Real[Array, "n 2"] | None = None
) -> Lattice:
    """The maps of a board with labels `ij` (N, 2) at `xy` (N, 2) px.

    `own`: weight of a corner in its own map. `plane` (N, 2): positions of the corners on the board, squares; None:
    their labels. Raises LinAlgError for positions that aren't finite, which result from fits of a collinear board:
    LAPACK would print a message about them.
    """
    xy = np.ascontiguousarray(xy, float)
    if not np.isfinite(xy).all():
        raise np.linalg.LinAlgError("positions are not finite")
    plane = np.ascontiguousarray(ij if plane is None else plane, float)
    flat, near = _rectifier(plane, xy), neighbours(ij)
    origin, terms = np.empty((len(xy), 2)), np.empty((len(xy), TERMS, 2))
    _lattice(plane, xy, flat, REACH, near, own, FAR, STIFF, origin, terms)
    return Lattice(flat, origin, terms)


def misfit(maps: Lattice, ij: Array, xy: Array, noise: float, plane: Array | None = None) -> float:
    """Misfit of the maps to their neighbours, median RMS along an axis, squares: distortion that the maps can't
    represent.

    From corners with all eight neighbours, less the part that `noise` (variance of positions, squares²) explains; 0 if
    there are no such corners.
    """
    near = neighbours(ij, 1)
    inner = np.flatnonzero(near.min(axis=1) >= 0)
    if not len(inner):
        return 0.0
    step = RING if plane is None else plane[near[inner]] - plane[inner][:, None]
    off = maps(inner, xy[near[inner]]) - step
    left = (off**2).sum(axis=(1, 2)) / (2 * (len(RING) - TERMS))
    return float(np.sqrt(max(median(left) - noise, 0.0)))


def _rectifier(plane: Array, xy: Array) -> Array:
    """Homography from pixels to squares; an affine map if the horizon of the homography crosses or nearly touches the
    board."""
    try:
        flat = inverse(homography(plane, xy))
        if in_front(flat, xy, HORIZON):
            return flat
    except np.linalg.LinAlgError:
        pass
    return np.ascontiguousarray(np.vstack([affine(xy, plane), [0, 0, 1]]))


def neighbours(ij: Array, reach: int = REACH) -> Int[Array, "n k"]:
    """Indices (N, K) int32 of the corners within `reach` squares of each, itself included, column by column; -1 for
    none."""
    ij = np.ascontiguousarray(ij - ij.min(axis=0), np.int64)
    grid = np.empty(ij.max(axis=0) + 1 + 2 * reach, np.int32)
    near = np.empty((len(ij), (2 * reach + 1) ** 2), np.int32)
    _neighbours(ij, reach, grid, near)
    return near
