"""The posterior of a board's corners under a smoothness prior: a smooth sheet seen through a smooth lens.

A board is a homography plus smooth deviations (lens, bending) plus irregular ones (paper, print). All three get a
normal prior, whose widths are chosen for each board by marginal likelihood: on a flat board the deviations vanish and
the estimate of every corner uses all others; where corners are truly irregular, the third part dominates and they keep
their positions.
"""

from __future__ import annotations

import functools
import itertools
from dataclasses import dataclass

import numpy as np
from numpy.polynomial.legendre import legvander

from rcdn.corners.adaptive import nearest_pitch
from rcdn.geometry.homography import depths, homography
from rcdn.geometry.median import median
from rcdn.native import bind, constants
from rcdn.precision.lattice import HORIZON
from rcdn.types import Array
from rcdn.types.arrays import Bool, Int, Real

LEAST_CORNERS, LEAST_LINES = 16, 4
"""corners and lines of the smallest board from which its smoothness can be estimated"""
DEGREE, TOTAL = 9, 10
"""largest degrees of the polynomials of the deviation from the homography: along one axis, total"""
WIDTHS = (0.02, 0.06, 0.2, 0.6, 2.0, 6.0, 20.0, 60.0, 200.0)
"""candidate standard deviations of quadratic deviations, × the median uncertainty of a corner"""
DECAYS = (0.15, 0.35, 0.7, 1.0)
"""candidate factors by which they fall from degree to degree"""
ROUGH = (0.0, 0.3, 0.6, 1.0, 2.0, 4.0)
"""candidate standard deviations of irregular deviations, × the median uncertainty"""
FREE = 1e3
"""standard deviation of the homography's parameters, × the median uncertainty"""
MISFIT = 3.5
"""distance from the smooth board, in standard deviations, beyond which a corner is an outlier"""
UNLIKE = 0.1
"""largest share of outliers with which positions are predicted"""
FARTHEST = 0.5
"""largest distance of a prediction from the corner's own position, squares"""

HOMOGRAPHY = constants("smooth")["FREE"]
"""parameters of a homography"""
TILE = constants("smooth")["PANEL"]
"""kernels require a multiple of this many polynomials, and matrices with this many columns more"""
FEW = 24
"""number of polynomials, those of lowest degree, with which the coarse grid of widths is evaluated"""
CANDIDATES = 4
"""number of nodes of that grid, the likeliest ones, that are evaluated again with all polynomials"""

Spot = tuple[int, int, int]
STEPS = ((-1, 0, 0), (1, 0, 0), (0, -1, 0), (0, 1, 0), (0, 0, -1), (0, 0, 1))
"""offsets to the neighbours of a node of the grid of widths"""
CHUNK = constants("smooth")["CHUNK"]
"""corners whose posterior the kernel computes at once"""

_POWERS = np.cumprod([[1 / (decay * decay), *[decay] * TOTAL] for decay in DECAYS], axis=1)
_PRIORS = np.array(WIDTHS)[:, None] * _POWERS[:, None]
"""prior standard deviations of coefficients by decay, width and degree, × the median uncertainty"""

_tangent = bind("rcdn_smooth_tangent")
_normal = bind("rcdn_smooth_normal")
_evidence = bind("rcdn_smooth_evidence")
_settle = bind("rcdn_smooth_posterior")


@dataclass(frozen=True, eq=False)
class Sheet:
    """The linear model of a board's corners: `tangent` (N, 2, 8), the Jacobian with respect to the parameters of its
    homography, orthonormal columns × √N; and `bent` (N, T), used along x and along y, orthonormal polynomials of
    `degree` (T,), rising, of the labels. T is padded with zeros to a multiple of `TILE`. `off` (N, 2): the data, px
    from the homography; `cov` (N, 2, 2): covariances of their errors.
    """

    tangent: Array
    bent: Array
    degree: Array
    off: Array
    cov: Array


class Evidence:
    """Marginal likelihood of a sheet's data under the widths of the prior, whose unit is `scale` px. Results are
    cached."""

    def __init__(self, sheet: Sheet, scale: float) -> None:
        self.sheet, self.scale = sheet, scale
        self._known: dict[Spot, float] = {}
        self._normals: dict[int, tuple[Array, Array, float]] = {}
        terms = len(sheet.degree)
        self._work = np.empty(2 * (2 * terms + 2) * (2 * terms + TILE) + TILE)

    def normal(self, rough: int) -> tuple[Array, Array, float]:
        """Normal matrix (D + 1, D + 8) of all coefficients under errors and irregular deviations, on and above the
        diagonal, with the data in row and column D; its Schur complement without the homography; and the constant term
        of log likelihoods."""
        if rough not in self._normals:
            s, bent = self.sheet, 2 * len(self.sheet.degree)
            size = HOMOGRAPHY + bent
            gram, rest, fixed = np.empty((size + 1, size + TILE)), np.empty((bent + 2, bent + TILE)), np.empty(1)
            _normal(
                s.tangent, s.bent, s.off, s.cov, ROUGH[rough] * self.scale, FREE * self.scale,
                gram, rest, fixed,
            )  # fmt: skip
            if not np.isfinite(fixed[0]):
                raise np.linalg.LinAlgError("a corner's covariance is not positive definite")
            self._normals[rough] = gram, rest, float(fixed[0])
        return self._normals[rough]

    def log_likelihoods(self, spots: list[Spot]) -> list[float]:
        """Log marginal likelihoods of `spots`, up to a constant."""
        new = sorted(set(spots) - self._known.keys())
        self._known.update(zip(new, self.judge(new, len(self.sheet.degree)), strict=True))
        return [self._known[s] for s in spots]

    def judge(self, spots: list[Spot], terms: int) -> list[float]:
        """As `log_likelihoods`, for `spots` in rising order, with only the first `terms` polynomials."""
        known: list[float] = []
        for rough, group in itertools.groupby(spots, key=lambda s: s[0]):
            root = self._roots(list(group), terms)
            _, rest, fixed = self.normal(rough)
            out = np.empty(len(root))
            _evidence(rest, root, self._work, out)
            known += (out + fixed).tolist()
        return known

    def root(self, spot: Spot) -> Real[Array, " d"]:
        """Prior standard deviations (D,) of all coefficients, px."""
        return np.concatenate([np.full(HOMOGRAPHY, FREE * self.scale), self._roots([spot], len(self.sheet.degree))[0]])

    def _roots(self, spots: list[Spot], terms: int) -> Array:
        """Prior standard deviations (len(spots), 2 terms) of the polynomials' coefficients along x, along y."""
        degree = self.sheet.degree[:terms]
        by_degree = self.scale * _PRIORS[[s[1] for s in spots], [s[2] for s in spots]]
        return np.take(by_degree, np.concatenate([degree, degree]), axis=1)


def smooth(
    ij: Int[Array, "n 2"],
    xy: Real[Array, "n 2"],
    cov: Real[Array, "n 2 2"],
    trusted: Bool[Array, " n"],
    plane: Real[Array, "n 2"] | None = None,
    covered: Bool[Array, " n"] | None = None,
) -> tuple[Array, Array]:
    """Posterior positions (N, 2) px and covariances (N, 2, 2) px² of a board's corners.

    `ij` (N, 2) labels; `plane` (N, 2): positions of the corners on the board, squares (None: their labels); `xy` (N, 2)
    px with independent errors of covariance `cov` (N, 2, 2) px². Only `trusted` (N,) corners that are no outliers take
    part; all others keep their positions, and outliers get a larger covariance. But those that are `covered` (N,), None
    for none, get the position that the board predicts, where it is near and more certain, unless too many are outliers:
    then the board isn't smooth. If the board is too small, positions and covariances are returned unchanged. Raises
    LinAlgError where a covariance is not positive definite.
    """
    use, spread, moved = trusted.copy(), cov.copy(), xy.copy()
    for again in (True, False):
        lines = [len(set(ij[use, k].tolist())) for k in (0, 1)]
        if use.sum() < LEAST_CORNERS or min(lines) < LEAST_LINES:
            return xy, cov
        flat, known, off, beyond = _posterior(ij[use], xy[use], cov[use], None if plane is None else plane[use])
        alien = beyond > 2 * MISFIT * MISFIT
        if not alien.any() or not again:
            break
        out = np.flatnonzero(use)[alien]
        spread[out] += (np.linalg.norm(off[alien], axis=1) ** 2 / 4)[:, None, None] * np.eye(2)
        use[out] = False
    moved[use], spread[use] = flat, known
    if covered is not None and (trusted & ~use).sum() <= UNLIKE * trusted.sum():
        asked = covered & ~use
        if asked.any():
            _predict(ij, xy, cov, use, asked, plane, moved, spread)
    return moved, spread


def _predict(
    ij: Array, xy: Array, cov: Array, use: Array, asked: Array, plane: Array | None, moved: Array, spread: Array
) -> None:
    """Replace positions `moved` (N, 2) px and covariances `spread` (N, 2, 2) px², in place, of the corners `asked` (N,)
    by what the corners `use` (N,) predict, where that is more certain and less than half a square away."""
    flat = np.ascontiguousarray(ij if plane is None else plane, float)
    depth = depths(homography(flat[use], xy[use]), flat)
    depth = depth if depth[use][0] > 0 else -depth
    both = use | asked & (depth > HORIZON * depth[use].max())
    mine = asked[both]
    there, known, _, _ = _posterior(ij[both], xy[both], cov[both], None if plane is None else plane[both], use[both])
    rows = np.flatnonzero(both)[mine]
    near = np.linalg.norm(there[mine] - xy[rows], axis=1) < FARTHEST * nearest_pitch(xy)[rows]
    better = near & (_traces(known[mine]) < _traces(spread[rows]))
    moved[rows[better]], spread[rows[better]] = there[mine][better], known[mine][better]


def _traces(cov: Array) -> Real[Array, " n"]:
    return np.asarray(cov[:, 0, 0] + cov[:, 1, 1])


def _posterior(
    ij: Array, xy: Array, cov: Array, plane: Array | None, use: Array | None = None
) -> tuple[Array, Array, Array, Array]:
    """Posterior positions (N, 2) and covariances (N, 2, 2); the distances of the data from the smooth board, (N, 2) px,
    and their squared Mahalanobis lengths (N,). `use` (N,) bool, None for all: the positions of the others have no say,
    and both distances tell nothing of them."""
    known = slice(None) if use is None else use
    scale = float(np.sqrt(median(_traces(cov[known])) / 2))
    if use is not None:
        cov = np.where(use[:, None, None], cov, (FREE * scale) ** 2 * np.eye(2))
    base, sheet = sheet_of(ij, xy, cov, plane, use)
    full = Evidence(sheet, scale)
    best = likeliest(full)
    count, root = len(xy), full.root(best)
    work = np.empty(len(root) * (len(root) + TILE + 2 * CHUNK) + TILE)
    moved, spread, off, beyond = (np.empty((count, *tail)) for tail in ((2,), (2, 2), (2,), ()))
    _settle(
        sheet.tangent, sheet.bent, sheet.off, sheet.cov, ROUGH[best[0]] * full.scale, full.normal(best[0])[0],
        root, work, moved, spread, off, beyond,
    )  # fmt: skip
    return base + moved, spread, off, beyond


def sheet_of(
    ij: Array, xy: Array, cov: Array, plane: Array | None = None, use: Array | None = None
) -> tuple[Array, Sheet]:
    """Positions (N, 2) px by a homography, and the linear model of deviations from them. `plane`: as of `smooth`.

    `use` (N,) bool, None for all: the others neither determine the homography nor deviate from it.
    """
    base, tangent = np.empty((len(xy), 2)), np.empty((len(xy), 2, HOMOGRAPHY))
    flat = np.ascontiguousarray(ij if plane is None else plane, float)
    known = slice(None) if use is None else use
    _tangent(flat, homography(flat[known], xy[known]), base, tangent)
    at = ij - ij.min(axis=0)
    columns, rows = at.max(axis=0).tolist()
    along, down, degree = _pairs(min(DEGREE, columns), min(DEGREE, rows))
    if plane is None:
        one, two = _polynomials(columns + 1)[at[:, 0]], _polynomials(rows + 1)[at[:, 1]]
    else:
        one, two = (_orthonormal(p, min(DEGREE, n)) for p, n in zip(_scaled(plane), (columns, rows), strict=True))
    bent = np.take(one, along, axis=1) * np.take(two, down, axis=1)
    off = xy - base if use is None else np.where(use[:, None], xy - base, 0.0)
    return base, Sheet(tangent, bent, degree, off, np.ascontiguousarray(cov, float))


@functools.lru_cache(maxsize=32)
def _polynomials(size: int) -> Array:
    """Orthonormal polynomials (size, DEGREE + 2) at the labels 0 … size - 1; the last column is 0."""
    return _orthonormal(2 * np.arange(size) / max(size - 1, 1) - 1, min(DEGREE, size - 1))


def _scaled(plane: Array) -> Real[Array, "2 n"]:
    """Both coordinates (2, N) of positions (N, 2), scaled to −1 … 1."""
    low, high = plane.min(axis=0), plane.max(axis=0)
    return np.asarray((2 * (plane - low) / np.maximum(high - low, 1e-9) - 1).T)


def _orthonormal(at: Array, top: int) -> Array:
    """Orthonormal polynomials (len(at), DEGREE + 2) at numbers from −1 to 1; those beyond degree `top` are 0."""
    out = np.zeros((len(at), DEGREE + 2))
    out[:, : top + 1] = legvander(at, top) * np.sqrt(2 * np.arange(top + 1) + 1)
    return out


@functools.cache
def _pairs(columns: int, rows: int) -> tuple[Array, Array, Array]:
    """Degrees along both axes and total degree, (T,) each, of all polynomials up to degrees `columns` and `rows`, the
    lowest first; padded with polynomials that are 0."""
    every = itertools.product(range(columns + 1), range(rows + 1))
    pairs = sorted((a + b, a, b) for a, b in every if 2 <= a + b <= TOTAL)
    pairs += [(TOTAL, DEGREE + 1, DEGREE + 1)] * (-len(pairs) % TILE)
    degree, a, b = np.array(pairs).T
    return a, b, degree


def likeliest(full: Evidence) -> Spot:
    """The widths with the largest marginal likelihood: a search on a coarse grid, then repeated steps to the best
    neighbour.

    On the coarse grid, polynomials of low degree select the few nodes that are evaluated fully.
    """
    lengths = len(ROUGH), len(DECAYS), len(WIDTHS)
    a, b, c = (range(0, length, 2) for length in lengths)
    grid = list(itertools.product(a, b, c))
    first = full.judge(grid, min(FEW, len(full.sheet.degree)))
    near = sorted(grid, key=dict(zip(grid, first, strict=True)).__getitem__, reverse=True)[:CANDIDATES]
    best = near[int(np.argmax(full.log_likelihoods(near)))]
    while True:
        steps = [(best[0] + i, best[1] + j, best[2] + k) for i, j, k in STEPS]
        near = [best, *(s for s in steps if all(0 <= n < length for n, length in zip(s, lengths, strict=True)))]
        after = near[int(np.argmax(full.log_likelihoods(near)))]
        if after == best:
            return best
        best = after
