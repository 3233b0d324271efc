"""What a square with a marker looks like, and what its modules are: size of the marker, blur, log-likelihood ratios of white to black."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.special import erf

from rcdn.types import Array

RATIOS = np.arange(0.40, 0.971, 0.02)
"""sides of a marker, squares"""
BLURS = np.array([0.008, 0.02, 0.035, 0.05, 0.07, 0.1, 0.14, 0.19])
"""standard deviations of the blur, squares"""
CAP = 4.0
"""largest log-likelihood ratio of a module: one in fifty is wrong for reasons that the model doesn't know"""
LEAST_SIGMA = 0.08
"""standard deviation of a module of the sharpest picture, black to white: prints and lenses aren't perfect"""
STIFF = 0.02
"""pull of the modules towards black where the blur leaves too little to tell"""


@dataclass(frozen=True)
class Appearance:
    """Side of the markers (`ratio`) and `blur`, squares; `white`: grey levels over the dark squares, below 0 if the colours are inverted."""

    ratio: float
    blur: float
    white: float


@dataclass(frozen=True)
class Frame:
    """How a marker stands in its square: `border`, bits of black around its own; `filling`: it fills the square, which touches dark squares at its
    corners and white gaps at its sides (AprilGrid). Else there is white around it, and dark squares at its sides (ChArUco)."""

    border: int = 1
    filling: bool = False


def appearance(mean: Array, side: int, frame: Frame) -> Appearance | None:
    """The marker's size and the blur that explain best the mean `mean` (S, S) of squares with markers of `side`² bits; dark squares are at 0.

    None if no marker explains it.
    """
    if not np.isfinite(mean).all():
        return None
    basis, settings, inverse = _templates(len(mean), side, frame)
    even = sum(np.rot90(m, k) for m in (mean, mean.T) for k in range(4)).ravel() / 8
    right = basis @ even
    weights = np.einsum("kab,kb->ka", inverse, right)
    share = weights[:, 1] / np.where(weights[:, 0] == 0, np.nan, weights[:, 0])  # of white in the marker's inside
    explained = np.where((share > 0) & (share < 1), (weights * right).sum(axis=1), -np.inf)
    best = int(np.argmax(explained))
    if not np.isfinite(explained[best]):
        return None
    return Appearance(*map(float, settings[best]), float(weights[best, 0]))


@lru_cache
def _templates(samples: int, side: int, frame: Frame) -> tuple[Array, Array, Array]:
    """For each of K sizes and blurs: the square around a marker and the marker's inside (K, 2, samples²), both white; (size, blur) (K, 2); and the
    inverse Gram matrices (K, 2, 2)."""
    x = _middles(samples)
    ratio, blur = (a.ravel() for a in np.meshgrid([1.0] if frame.filling else RATIOS, BLURS, indexing="ij"))
    inside = _box(x, ratio[:, None] * side / (side + 2 * frame.border), blur[:, None])
    basis = np.stack([_around(x, ratio, blur, frame), inside[:, :, None] * inside[:, None, :]], axis=1).reshape(len(ratio), 2, -1)
    inverse = np.linalg.inv(np.einsum("kap,kbp->kab", basis, basis) + 1e-9 * np.eye(2))
    return basis, np.stack([ratio, blur], axis=1), inverse


def modules(squares: Array, look: Appearance, side: int, frame: Frame) -> Array:
    """Values (K, n, n) of the modules, n = `side` + 2 borders, of `squares` (K, S, S): black 0, white 1, the blur taken out; NaN where unseen."""
    x = _middles(squares.shape[-1])
    count = side + 2 * frame.border
    edges = 0.5 + look.ratio * (np.arange(count + 1) / count - 0.5)
    steps = 0.5 * erf((x[:, None] - edges) / (np.sqrt(2.0) * look.blur))
    mixing = steps[:, :-1] - steps[:, 1:]  # (S, n): what each module gives to each place
    near = np.abs(x - 0.5) < look.ratio / 2 + look.blur
    mixing = mixing[near]
    solve = np.linalg.solve(mixing.T @ mixing + STIFF * np.eye(count), mixing.T)
    around = _around(x, np.array([look.ratio]), np.array([look.blur]), frame)[0]
    left = (squares / look.white - around)[:, near][:, :, near]
    seen = np.isfinite(left)
    out = solve @ np.where(seen, left, 0.0) @ solve.T
    unseen = np.abs(solve) @ (~seen).astype(float) @ np.abs(solve).T
    return np.where(unseen > 1e-3, np.nan, out)


def evidence(values: Array, border: int) -> Array:
    """Log-likelihood ratios (K, n, n) of white to black of modules at `values`; 0 of what isn't seen.

    The noise is that of the frames, which are black, and of the distances to the nearer of black and white.
    """
    inside = inner_modules(values.shape[-1], border)
    off, own = values[:, ~inside], values[:, inside]
    if not np.isfinite(off).any() or not np.isfinite(own).any():
        return np.zeros_like(values)
    frames = np.sqrt(np.nanmedian(off**2) / 0.455)  # 0.455: median of χ² with one degree of freedom
    nearer = np.sqrt(np.nanmean(np.minimum(np.minimum(own**2, (1 - own) ** 2), 0.25)))
    sigma = max(float(frames), float(nearer), LEAST_SIGMA)
    return np.clip(np.nan_to_num((2 * values - 1) / (2 * sigma**2)), -CAP, CAP)


def inner_modules(count: int, border: int) -> Array:
    """(count, count) bool: which modules of a marker are inside its border."""
    inside = np.zeros((count, count), bool)
    inside[border:-border, border:-border] = True
    return inside


def _middles(samples: int) -> Array:
    return np.asarray((np.arange(samples) + 0.5) / samples)


def _box(x: Array, width: Array | float, blur: Array) -> Array:
    """A box of height 1 and `width` in the middle of 0..1, blurred, at `x`."""
    s = np.sqrt(2.0) * blur
    return np.asarray(0.5 * (erf((x - 0.5 + width / 2) / s) - erf((x - 0.5 - width / 2) / s)))


def _around(x: Array, ratio: Array, blur: Array, frame: Frame) -> Array:
    """The white around black markers of sides `ratio` (K,) under `blur` (K,), (K, S, S)."""
    own = _box(x, 1.0, blur[:, None])
    square = lambda a: a[:, :, None] * a[:, None, :]  # noqa: E731
    if frame.filling:
        across = own[:, :, None] * (1 - own)[:, None, :]
        return np.asarray(across + across.swapaxes(1, 2))
    return np.asarray(square(own) + square(1 - own) - square(_box(x, ratio[:, None], blur[:, None])))
