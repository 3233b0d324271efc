"""The shape of a real board: printed slightly unevenly and not quite flat, the same in all of its views.

The displacement of a corner from its position on the perfect plane is a smooth function of that position: polynomials
up to the fourth degree, along the board's x and y and along its normal. Their coefficients are unknowns of the
calibration (as in Strobl and Hirzinger, More accurate pinhole camera calibration with imperfect planar target, 2011),
with a Gaussian prior whose spreads, within the board and out of its plane, maximise the restricted likelihood of the
corners (by expectation–maximisation). Higher degrees have smaller prior spreads. Displacements that a motion of the
board or its size would explain are not shape: the prior holds them at zero.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.polynomial.legendre import legvander

from rcdn.calibration.bundle import Prior, State
from rcdn.types import SQUARES, Array, BoardShape, Plane
from rcdn.types.arrays import Real

Size = tuple[int, int]
DEGREE, DECAY = 4, 2.0
"""largest degree of the polynomials; the prior standard deviation of a function is its degree to the power −`DECAY`,
relative to degree 1"""
PLANE, DEPTH = 0.001, 0.003
"""initial spreads of the first degree, within the board and out of its plane, in squares"""
LEAST_SPREAD, MOST_SPREAD = 1e-6, 0.1
"""bounds of a spread, in squares: the lower one stands for none, and no real board exceeds the upper one"""
FUNCTIONS = tuple((d - j, j) for d in range(1, DEGREE + 1) for j in range(d + 1))
"""degrees in x and y of each function, the first two being x and y themselves; a constant would only translate the
board"""
FALLING = np.array([float(i + j) ** -DECAY for i, j in FUNCTIONS])[:, None]
"""(B, 1) prior standard deviation of each function relative to that of the first degree"""
HELD = 1e3
"""ratio of the prior's standard deviations to those of displacements that a motion or the size would explain"""
CONVERGED, MOST_STEPS = 0.005, 200
"""relative change of the spreads in a step of expectation–maximisation below which they have converged; most steps"""
FEWEST_SHAPED = 5
"""least number of views in which it is known which corner is which, for the shape to be estimated; with fewer the board
is taken as perfect"""


def shape_basis(ij: Real[Array, "n 2"], size: Size, plane: Plane = SQUARES) -> Real[Array, "n b"]:
    """(N, B) values of the functions at the labels `ij` (N, 2) of a board of `size` (columns, rows) on its `plane`:
    polynomials that are orthogonal to each other and to a constant over the board's corners, with mean square 1 there
    (0 if the corners are too few for such a function).

    The two of the first degree have the same slope along x and along y, and a mean square of 1 together.
    """
    far = np.maximum(plane.points(np.array(size) - 1), 1)
    every = plane.points(all_labels(size))
    whole, here = _products(every, far), _products(plane.points(ij), far)
    for k in range(len(FUNCTIONS) + 1):  # Gram–Schmidt
        length = np.sqrt((whole[:, k] ** 2).mean())
        for values in (whole, here):
            values[:, k] *= 1 / length if length > 1e-9 else 0.0
        share = whole[:, k] @ whole[:, k + 1 :] / len(whole)
        for values in (whole, here):
            values[:, k + 1 :] -= np.outer(values[:, k], share)
    spread = every.var(axis=0)
    here[:, 1:3] *= np.sqrt(spread / spread.mean())
    return here[:, 1:]


def all_labels(size: Size) -> Array:
    """(columns × rows, 2) labels of a whole board, row by row."""
    return np.stack(np.meshgrid(np.arange(size[0]), np.arange(size[1])), axis=-1).reshape(-1, 2)


def _products(places: Array, far: Real[Array, " 2"]) -> Array:
    """(N, 1 + B) products of Legendre polynomials whose argument runs from −1 to 1 between the first corner and the
    last, at `far` (2,); the constant is the first."""
    x, y = (2 * places / far - 1).T
    across, down = legvander(x, DEGREE), legvander(y, DEGREE)
    return np.stack([across[:, i] * down[:, j] for i, j in ((0, 0), *FUNCTIONS)], axis=1)


def _motions() -> Array:
    """(4, 3 B) unit coefficients of a larger size, a rotation within the plane, and both tilts."""
    of = np.zeros((4, len(FUNCTIONS), 3))
    of[0, [0, 1], [0, 1]] = np.sqrt(0.5)
    of[1, [0, 1], [1, 0]] = np.sqrt(0.5) * np.array([1, -1])
    of[2, 0, 2] = of[3, 1, 2] = 1.0
    return of.reshape(4, -1)


@dataclass(frozen=True)
class Spread:
    """Prior standard deviations of a shape's coefficients of the first degree, m: within the `plane` of the board and
    out of it, in `depth`."""

    plane: float
    depth: float

    @classmethod
    def first(cls, spacing: float) -> Spread:
        """The initial spreads."""
        return cls(PLANE * spacing, DEPTH * spacing)

    def near(self, other: Spread, share: float) -> bool:
        """Whether each spread differs from the `other`'s by at most the relative difference `share`."""
        pairs = ((self.plane, other.plane), (self.depth, other.depth))
        return all(abs(a - b) <= share * max(a, b) for a, b in pairs)


def with_spread(state: State, spread: Spread) -> State:
    """`state` with a prior of these spreads on its shape, in addition to that of its lenses."""
    lens = state.beforehand
    at = len(lens.mean) - state.shape.size
    precision = lens.precision.copy()
    precision[at:, at:] = _precision(spread)
    return replace(state, prior=Prior(lens.mean, precision))


def _precision(spread: Spread) -> Real[Array, "k k"]:
    """(3 B, 3 B) the prior's precision, 1 / m²."""
    each = 1 / (FALLING * [spread.plane, spread.plane, spread.depth]) ** 2
    held = HELD**2 * np.array([spread.plane, spread.plane, spread.depth, spread.depth]) ** -2.0
    return np.asarray(np.diag(each.ravel()) + _motions().T * held @ _motions())


def likeliest(shape: Real[Array, "b 3"], covariance: Real[Array, "k k"], spread: Spread, spacing: float) -> Spread:
    """The spreads at which expectation–maximisation converges (relative change below CONVERGED). `shape` (B, 3) m and
    `covariance` (3 B, 3 B) m² of its coefficients given the corners, estimated under `spread`.

    The corners stay linearised: under another prior the estimate is a product of Gaussians.
    """
    before, now = _precision(spread), (shape, covariance)
    for _ in range(MOST_STEPS):
        former, spread = spread, _likelier(*now, spacing)
        if spread.near(former, CONVERGED):
            break
        change = np.eye(shape.size) + covariance @ (_precision(spread) - before)
        both = np.linalg.solve(change, np.column_stack([shape.ravel(), covariance]))
        now = both[:, 0].reshape(-1, 3), both[:, 1:]
    return spread


def _likelier(shape: Array, covariance: Array, spacing: float) -> Spread:
    """The spreads after one step of expectation–maximisation."""
    square = ((shape**2 + np.diag(covariance).reshape(-1, 3)) / FALLING**2).sum(axis=0)
    many = len(FUNCTIONS)  # two of the coefficients are held at zero within the plane, and two out of it
    plane, depth = np.sqrt((square[0] + square[1]) / (2 * many - 2)), np.sqrt(square[2] / (many - 2))
    return Spread(*(float(np.clip(value, LEAST_SPREAD * spacing, MOST_SPREAD * spacing)) for value in (plane, depth)))


def board_shape(coefficients: Real[Array, "b 3"], size: Size, plane: Plane = SQUARES) -> BoardShape:
    """The shape with `coefficients` (B, 3) m at all corners of a board of `size`."""
    return BoardShape((shape_basis(all_labels(size), size, plane) @ coefficients).reshape(size[1], size[0], 3))


KNOWN = np.array([[0.0, 0.0, 1.0]])
"""(1, 3) the shape of a state whose board is known: one function, the corners' height, with coefficient 1 along the
normal"""


def on_shape(nominal: Array, ij: Array, shape: BoardShape | None) -> tuple[Array, Array]:
    """Positions of corners on a board of known `shape` (None: perfect): `board` (N, 2) m from their `nominal` positions
    (N, 2) m and labels `ij` (N, 2), and the `basis` (N, 1) of a state with the shape KNOWN."""
    offsets = np.zeros((len(ij), 3)) if shape is None else shape.at(ij)
    return nominal + offsets[:, :2], offsets[:, 2:]
