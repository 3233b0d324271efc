"""The shape of a real board: printed a little unevenly and not quite flat, the same in all of its views.

A corner lies off its place on the perfect plane by a smooth function of that place, polynomials to the fourth degree along the board's x and
y and along its normal. They are unknowns of the calibration (as in Strobl and Hirzinger, More accurate pinhole camera calibration with
imperfect planar target, 2011), with a Gaussian prior whose spreads, within the board and out of its plane, are those under which the
corners are most likely (expectation–maximisation of the restricted likelihood). Higher degrees are held to be smaller.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial.legendre import legvander

from rcdn.calibration.bundle import Prior, State
from rcdn.types import Array, BoardShape

Size = tuple[int, int]
DEGREE, DECAY = 4, 2.0
"""of the polynomials; the prior standard deviation of a function falls with its degree to that power"""
PLANE, DEPTH = 0.001, 0.003
"""spreads of the first degree to start from, in squares"""
LEAST = 1e-7
"""squares; a spread below is none"""
FUNCTIONS = tuple((i, j) for i in range(DEGREE + 1) for j in range(DEGREE + 1 - i) if i + j)
"""degrees in x and y of each function; a constant would only move the board"""
FALLING = np.array([float(i + j) ** -DECAY for i, j in FUNCTIONS])[:, None]
"""(B, 1) prior standard deviation of each function as a share of the first degree's"""
FEWEST_SHAPED = 5
"""views of the whole board, below which it is taken as perfect"""


def shape_basis(ij: Array, size: Size) -> Array:
    """(N, B) the functions at the places `ij` (N, 2) of a board of `size` (columns, rows): products of Legendre polynomials that run over
    −1 to 1 from the first to the last corner, scaled to a mean square of 1 over the board."""
    places = np.stack(np.meshgrid(np.arange(size[0]), np.arange(size[1])), axis=-1).reshape(-1, 2)
    root = np.sqrt((_products(places, size) ** 2).mean(axis=0))
    return np.asarray(_products(np.asarray(ij, float), size) / np.maximum(root, 1e-12))


def _products(ij: Array, size: Size) -> Array:
    x, y = (2 * ij[:, k] / max(size[k] - 1, 1) - 1 for k in (0, 1))
    across, down = legvander(x, DEGREE), legvander(y, DEGREE)
    return np.stack([across[:, i] * down[:, j] for i, j in FUNCTIONS], axis=1)


@dataclass(frozen=True)
class Spread:
    """Prior standard deviations of a shape's coefficients of the first degree, m: within the `plane` of the board and out of it, in `depth`."""

    plane: float
    depth: float

    @classmethod
    def first(cls, spacing: float) -> Spread:
        """To start from."""
        return cls(PLANE * spacing, DEPTH * spacing)

    def near(self, other: Spread, share: float) -> bool:
        """Whether both spreads differ from the `other`'s by less than a `share` of them, or are none."""
        pairs = ((self.plane, other.plane), (self.depth, other.depth))
        return all(abs(a - b) <= share * max(a, b) for a, b in pairs)


def with_spread(state: State, spread: Spread) -> State:
    """`state` with a prior of these spreads on its shape, beside that of its lenses."""
    lens = state.beforehand
    each = 1 / (FALLING * [spread.plane, spread.plane, spread.depth]) ** 2
    at = len(lens.mean) - state.shape.size
    precision = lens.precision.copy()
    precision[range(at, len(lens.mean)), range(at, len(lens.mean))] = each.ravel()
    return State(state.cameras, state.poses, state.rig, state.shape, Prior(lens.mean, precision))


def likelier(state: State, covariance: Array, spacing: float) -> Spread:
    """The spreads after one step of expectation–maximisation. `covariance` (3 B, 3 B) of the shape given the corners, m²."""
    square = (state.shape**2 + np.diag(covariance).reshape(-1, 3)) / FALLING**2
    plane, depth = float(np.sqrt(square[:, :2].mean())), float(np.sqrt(square[:, 2].mean()))
    return Spread(max(plane, LEAST * spacing), max(depth, LEAST * spacing))


def board_shape(coefficients: Array, size: Size) -> BoardShape:
    """The shape of `coefficients` (B, 3) m at all corners of a board of `size`."""
    ij = np.stack(np.meshgrid(np.arange(size[0]), np.arange(size[1])), axis=-1).reshape(-1, 2)
    return BoardShape((shape_basis(ij, size) @ coefficients).reshape(size[1], size[0], 3))


KNOWN = np.array([[0.0, 0.0, 1.0]])
"""(1, 3) the shape of a state whose board is known: one function, the corners' height, taken once"""


def on_shape(nominal: Array, ij: Array, shape: BoardShape | None) -> tuple[Array, Array]:
    """Where corners are on a board of known `shape` (None: perfect): `board` (N, 2) m from their `nominal` places (N, 2) m and labels `ij`
    (N, 2), and the `basis` (N, 1) of a state with the shape KNOWN."""
    offsets = np.zeros((len(ij), 3)) if shape is None else shape.at(ij)
    return nominal + offsets[:, :2], offsets[:, 2:]
