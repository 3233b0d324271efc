"""The appearance of a square with a marker (size of the marker, blur), and the log-likelihood ratios of its modules,
white to black."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from rcdn.geometry.elementary import erf
from rcdn.types import Array
from rcdn.types.arrays import Bool, Real

RATIOS = np.arange(0.40, 0.971, 0.02)
"""candidate sides of a marker, squares"""
BLURS = np.array([0.008, 0.02, 0.035, 0.05, 0.07, 0.1, 0.14, 0.19])
"""candidate standard deviations of the blur, squares"""
COARSE = 16
"""samples along a square's side for the estimate of size and blur"""
CAP = 4.0
"""largest log-likelihood ratio of a module: one in fifty is wrong for reasons that are not in the model"""
LEAST_SIGMA = 0.08
"""least standard deviation of a module, in units of black to white: prints and lenses aren't perfect"""
ASPECTS = 0.04
"""quantisation step of the logarithm of the squares' aspect ratio, by which the blurs along both axes differ; the blur
itself is known to a third of its value"""
PRIOR = 1.0
"""weight of a prior from the gaps on the level of white, for tags that fill their squares: around sharp tags a square
has no white"""
STIFF = 0.02
"""regularisation of the modules towards black, which matters where the blur leaves too little information"""


@dataclass(frozen=True)
class Appearance:
    """Side of the markers (`ratio`) and `blur` along x and along y, squares; `white`: level of white above that of the
    dark squares, grey levels, negative if the colours are inverted."""

    ratio: float
    blur: tuple[float, float]
    white: float


@dataclass(frozen=True)
class Frame:
    """The placement of a marker in its square: `border`: width of its black border, bits; `filling`: it fills the
    square, which touches dark squares at its corners and white gaps at its sides (AprilGrid). Otherwise there is white
    around it, and dark squares at the square's sides (ChArUco)."""

    border: int = 1
    filling: bool = False


class _Part(NamedTuple):
    """`sign` × a separable picture (K, S, S): the product of one profile along `x` and one along `y`, (K, S) each."""

    sign: float
    x: Array
    y: Array


def _dot(one: list[_Part], two: list[_Part]) -> Real[Array, " k"]:
    """Inner products (K,) of two sums of separable pictures."""
    products = [a.sign * b.sign * (a.x * b.x).sum(axis=1) * (a.y * b.y).sum(axis=1) for a in one for b in two]
    return np.asarray(np.sum(products, axis=0))


@dataclass(frozen=True, eq=False)
class _Models:
    """Models of a square with a marker: sides `ratio` of the marker and blurs (K,); `parts`: the white around it, and
    its inside, as sums of separable pictures; `gram`: inner products (K,) of the first with itself, of both, of the
    second with itself."""

    ratio: Array
    along_x: Array
    along_y: Array
    parts: tuple[list[_Part], list[_Part]]
    gram: tuple[Array, Array, Array]


@lru_cache(maxsize=64)
def _models(side: int, frame: Frame, aspect: int) -> _Models:
    """Models for all sizes and blurs of markers with `side`² bits; `aspect`: logarithm of the squares' aspect ratio, in
    steps of `ASPECTS`."""
    x, stretch = _middles(COARSE), float(np.exp(aspect * ASPECTS))
    ratio, blur = (a.ravel() for a in np.meshgrid([1.0] if frame.filling else RATIOS, BLURS, indexing="ij"))
    along_x, along_y = blur / np.sqrt(stretch), blur * np.sqrt(stretch)
    inner = ratio * side / (side + 2 * frame.border)
    around = _around_parts(x, ratio, along_x, along_y, frame)
    inside = [_Part(1.0, _box(x, inner, along_x), _box(x, inner, along_y))]
    gram = _dot(around, around), _dot(around, inside), _dot(inside, inside)
    return _Models(ratio, along_x, along_y, (around, inside), gram)


def appearance(mean: Real[Array, "s s"], side: int, frame: Frame, aspect: float) -> Appearance | None:
    """The size of the marker and the blur that best explain the mean `mean` (S, S) of squares with markers of `side`²
    bits; the level of dark squares is 0. `aspect`: width ÷ height of the squares in the picture, in which the blur is
    isotropic.

    None if no marker explains it.
    """
    if not np.isfinite(mean).all():
        return None
    coarse = mean.reshape(COARSE, len(mean) // COARSE, COARSE, -1).mean(axis=(1, 3))
    even = (coarse + coarse[::-1] + coarse[:, ::-1] + coarse[::-1, ::-1]) / 4
    models = _models(side, frame, round(float(np.log(aspect)) / ASPECTS))
    ratio, along_x, along_y, gram = models.ratio, models.along_x, models.along_y, list(models.gram)
    right = [
        sum((p.sign * ((p.y @ even) * p.x).sum(axis=1) for p in parts), np.zeros(len(ratio))) for parts in models.parts
    ]
    if frame.filling:  # the share of white inside is unknown, but the level of the white gaps is 1
        gram[0], right[0] = gram[0] + PRIOR, right[0] + PRIOR
    determinant = gram[0] * gram[2] - gram[1] ** 2 + 1e-12
    white = (gram[2] * right[0] - gram[1] * right[1]) / determinant
    middle = (gram[0] * right[1] - gram[1] * right[0]) / determinant
    share = middle / np.where(white == 0, np.nan, white)  # share of white inside the marker
    explained = np.where((share > 0) & (share < 1), white * right[0] + middle * right[1], -np.inf)
    best = int(np.argmax(explained))
    if not np.isfinite(explained[best]):
        return None
    return Appearance(float(ratio[best]), (float(along_x[best]), float(along_y[best])), float(white[best]))


def modules(
    squares: Real[Array, "k s s"],
    appearance: Appearance,
    side: int,
    frame: Frame,
    open_sides: Bool[Array, "k 4"] | None = None,
) -> Real[Array, "k n n"]:
    """Values (K, n, n) of the modules, n = `side` + 2 borders, of `squares` (K, S, S): black 0, white 1, deblurred; NaN
    where not visible.

    `open_sides` (K, 4) bool: beyond the left, right, upper, lower side of a square the board may end, and be followed
    by white; that is assumed where it makes the values of the marker's border closer to black.
    """
    unblurred, beyond = _unblurring(squares.shape[-1], appearance.ratio, appearance.blur, side, frame)
    values = unblurred(squares / appearance.white)
    if open_sides is None or not open_sides.any():
        return values
    ends = open_sides.any(axis=1)
    other = unblurred(squares[ends] / appearance.white - np.tensordot(open_sides[ends].astype(float), beyond, axes=1))
    border = ~inner_modules(values.shape[-1], frame.border)
    with np.errstate(invalid="ignore"):
        better = np.nan_to_num(np.abs(other[:, border])).sum(axis=1) < np.nan_to_num(
            np.abs(values[ends][:, border])
        ).sum(axis=1)
    values[np.flatnonzero(ends)[better]] = other[better]
    return values


@lru_cache(maxsize=256)
def _unblurring(
    samples: int, ratio: float, blurs: tuple[float, float], side: int, frame: Frame
) -> tuple[Callable[[Array], Array], Array]:
    """A function from squares (K, S, S), black 0 and white 1, to their modules (K, n, n); and the contribution
    (4, S, S) of white beyond each of a square's four sides, if it is white there."""
    x = _middles(samples)
    (near_x, solve_x), (near_y, solve_y) = (_unmixing(x, ratio, blur, side + 2 * frame.border) for blur in blurs)
    along_x, along_y = (np.array([blur]) for blur in blurs)
    around = _around(x, np.array([ratio]), along_x, along_y, frame)
    across, down = _box(x, 1.0, along_x)[0], _box(x, 1.0, along_y)[0]
    beyond = []
    for axis, (blur, other) in enumerate(zip(blurs, (down, across), strict=True)):
        for last in (0, 1):
            outside = 0.5 * (1 - erf((1 - x if last else x) / (np.sqrt(2.0) * blur)))
            beyond.append(np.outer(other, outside) if axis == 0 else np.outer(outside, other))

    def unblurred(squares: Array) -> Array:
        left = (squares - around)[:, near_y][:, :, near_x]
        seen = np.isfinite(left)
        out = solve_y @ np.where(seen, left, 0.0) @ solve_x.T
        if seen.all():
            return np.asarray(out)
        missing = np.abs(solve_y) @ (~seen).astype(float) @ np.abs(solve_x).T
        return np.where(missing > 1e-3, np.nan, out)

    return unblurred, np.array(beyond)


def _unmixing(x: Real[Array, " s"], ratio: float, blur: float, count: int) -> tuple[Array, Array]:
    """Along one axis: which samples `x` (S,) of a square depend on its `count` modules, (S,) bool; and the matrix
    (count, ·) from these samples to the modules."""
    edges = 0.5 + ratio * (np.arange(count + 1) / count - 0.5)
    steps = 0.5 * erf((x[:, None] - edges) / (np.sqrt(2.0) * blur))
    near = np.abs(x - 0.5) < ratio / 2 + blur
    mixing = (steps[:, :-1] - steps[:, 1:])[near]  # weight of each module in each sample
    return near, np.linalg.solve(mixing.T @ mixing + STIFF * np.eye(count), mixing.T)


def evidence(values: Array, border: int, trusted: Bool[Array, " k"] | None = None) -> Real[Array, "k n n"]:
    """Log-likelihood ratios (K, n, n), white to black, of modules with `values`; 0 for modules that aren't visible.

    The noise is estimated from the borders, which are black, and from the distances of bits to the nearer of black and
    white, in the squares that are `trusted` (K,) to show markers (None: all).
    """
    inside = inner_modules(values.shape[-1], border)
    sample = values if trusted is None else values[trusted]
    off, own = sample[:, ~inside], sample[:, inside]
    if not np.isfinite(off).any() or not np.isfinite(own).any():
        return np.zeros_like(values)
    frames = np.sqrt(np.nanmedian(off**2) / 0.455)  # 0.455: median of χ² with one degree of freedom
    nearer = np.sqrt(np.nanmean(np.minimum(np.minimum(own**2, (1 - own) ** 2), 0.25)))
    sigma = max(float(frames), float(nearer), LEAST_SIGMA)
    return np.clip(np.nan_to_num((2 * values - 1) / (2 * sigma**2)), -CAP, CAP)


def inner_modules(count: int, border: int) -> Array:
    """(count, count) bool: the modules of a marker inside its border."""
    inside = np.zeros((count, count), bool)
    inside[border:-border, border:-border] = True
    return inside


def _middles(samples: int) -> Array:
    return np.asarray((np.arange(samples) + 0.5) / samples)


def _box(x: Real[Array, " s"], width: Array | float, blur: Real[Array, " k"]) -> Array:
    """Box functions (K, S) of height 1 and `width` (K, or one number), centred in 0..1 and blurred by `blur` (K,), at
    `x` (S,), which is symmetric about the centre."""
    s, half = (np.sqrt(2.0) * blur)[:, None], np.broadcast_to(width, blur.shape)[:, None] / 2
    step = erf((x - 0.5 + half) / s)
    return np.asarray(0.5 * (step + step[:, ::-1]))


def _around_parts(x: Array, ratio: Real[Array, " k"], along_x: Array, along_y: Array, frame: Frame) -> list[_Part]:
    """The white around black markers of sides `ratio` (K,) with blurs (K,), as a sum of separable pictures."""
    across, down = _box(x, 1.0, along_x), _box(x, 1.0, along_y)
    if frame.filling:
        return [_Part(1.0, across, 1 - down), _Part(1.0, 1 - across, down)]
    marker = _Part(-1.0, _box(x, ratio, along_x), _box(x, ratio, along_y))
    return [_Part(1.0, across, down), _Part(1.0, 1 - across, 1 - down), marker]


def _around(x: Array, ratio: Array, along_x: Array, along_y: Array, frame: Frame) -> Real[Array, "k s s"]:
    """`_around_parts` as pictures (K, S, S)."""
    parts = _around_parts(x, ratio, along_x, along_y, frame)
    return np.asarray(np.sum([p.sign * p.y[:, :, None] * p.x[:, None, :] for p in parts], axis=0))
