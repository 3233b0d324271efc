"""The factor of normal equations with arrow structure: one 6 × 6 block for each frame, and a border for the parameters
that all frames share. The frames are eliminated by the Schur complement (Triggs et al., Bundle Adjustment, 2000,
section 6.1)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rcdn.native import bind, constants
from rcdn.types import Array
from rcdn.types.arrays import Real

RIDGE = 1e-10
"""× the largest diagonal element of a block: keeps the factorisation defined where nothing determines a parameter,
whose variance is then huge"""
ROUNDING = 1e-13
"""× a diagonal element: what the elimination of other unknowns may leave of it by rounding"""

_LARGEST = constants("normal")["LARGEST"]
_inverse_factors = bind("rcdn_inverse_factors")


@dataclass(frozen=True, eq=False)
class Arrow:
    """Inverse Cholesky factor of the normal matrix, as blocks: x_frame = `own` y_frame − `reach` x_shared, x_shared =
    `rim` y_shared.

    `own` (F, 6, 6), `reach` (F, 6, K), `rim` (K, K); with unit noise the covariance of x is the factor times its
    transpose.
    """

    own: Array
    reach: Array
    rim: Array

    @classmethod
    def of(cls, blocks: Array, whole: Real[Array, "k k"], damping: float = 0.0) -> Arrow:
        """From the normal matrix: `blocks` (F, 6, 6 + K) of each frame, with itself and with the shared parameters, and
        `whole` (K, K) of the shared parameters, the prior's precision included. `damping`: relative increase of the
        diagonal."""
        own = _inverse_factor(_damped(blocks[:, :, :6], damping))
        reach = own @ (own.transpose(0, 2, 1) @ blocks[:, :, 6:])
        whole = _damped(whole[None], damping)[0]
        flat = 6 * len(blocks), len(whole)
        rim = whole - blocks[:, :, 6:].reshape(flat).T @ reach.reshape(flat)
        return cls(own, reach, _inverse_factor(rim[None], np.diag(whole))[0])

    @property
    def covariance(self) -> Real[Array, "k k"]:
        """(K, K) covariance of the shared parameters at unit noise."""
        return np.asarray(self.rim @ self.rim.T)

    def solve(self, by_frame: Real[Array, "f 6"], shared: Real[Array, " k"]) -> tuple[Array, Array]:
        """(F, 6) and (K,): the inverse of the normal matrix times a gradient with the parts `by_frame` (F, 6) and
        `shared` (K,)."""
        rest = shared - by_frame.ravel() @ self.reach.reshape(by_frame.size, len(shared))
        x = self.rim @ (self.rim.T @ rest)
        own = (self.own @ (self.own.transpose(0, 2, 1) @ by_frame[:, :, None]))[..., 0]
        return own - self.reach @ x, x


def _damped(blocks: Real[Array, "f n n"], damping: float) -> Array:
    """`blocks` (F, n, n) with their diagonals increased by the share `damping`."""
    if not damping:
        return blocks
    out, n = blocks.copy(), np.arange(blocks.shape[-1])
    out[:, n, n] *= 1 + damping
    return out


def _inverse_factor(blocks: Real[Array, "f n n"], whole: Real[Array, " n"] | None = None) -> Array:
    """Inverse of the upper Cholesky factor of symmetric `blocks` (F, n, n), with a ridge where they are singular.

    `whole` (n,): the diagonal before other unknowns were eliminated; what remains of it may be rounding error only.
    Parameters that no corner depends on get zeros, so that they do not move.
    """
    if not blocks.size:
        return blocks
    diagonal = np.einsum("fii->fi", blocks)
    before = diagonal if whole is None else whole[None]
    if blocks.shape[1] <= _LARGEST:
        out = np.empty(blocks.shape)
        each = np.ascontiguousarray(blocks), np.ascontiguousarray(before)
        if _inverse_factors(*each, ROUNDING, 1 / RIDGE, out) == len(blocks):
            return out
    floor = ROUNDING * before
    determined = floor > 0
    unit = np.sqrt(np.where(determined, np.maximum(diagonal, floor), 1.0))
    scaled = blocks / (unit[:, :, None] * unit[:, None, :])
    scaled = (scaled + scaled.transpose(0, 2, 1)) / 2
    scaled[~determined, np.nonzero(~determined)[1]] = 1.0
    inverse = _inverse_root(scaled) / unit[:, :, None]
    return np.asarray(inverse * determined[:, :, None] * determined[:, None, :])


def _inverse_root(blocks: Real[Array, "f n n"]) -> Array:
    """Upper triangular U (F, n, n) with U Uᵀ the inverse of symmetric `blocks`, whose eigenvalues below RIDGE count as
    RIDGE."""
    try:
        inverse = np.tril(np.linalg.inv(np.linalg.cholesky(blocks)))
        if (inverse**2).sum(axis=(1, 2)).max() < 1 / RIDGE:  # the trace of the inverse: no eigenvalue is below RIDGE
            return np.asarray(inverse.transpose(0, 2, 1))
    except np.linalg.LinAlgError:  # not positive definite
        pass
    values, vectors = np.linalg.eigh(blocks)
    root = np.sqrt(np.maximum(values, RIDGE))[:, :, None] * vectors.transpose(0, 2, 1)
    return np.linalg.inv(np.linalg.qr(root, mode="r"))
