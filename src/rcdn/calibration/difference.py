"""Difference of two cameras: displacement of projections after the best rotation, and its significance against both
covariances.

Two calibrations of one camera never agree in every parameter: a shift of the principal point and a rotation of the
camera have nearly the same effect on a picture, and only the ray of a pixel is meaningful. Therefore the rays of one
camera are first rotated onto those of the other, as in mrcal's `show-projection-diff` (D. Kogan, mrcal documentation,
"Projection differencing").
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rcdn.calibration.sight import cell_centres, out_of_sight
from rcdn.errors import CalibrationError, ConfigError, RcdnError
from rcdn.geometry import cross_matrix, project, project_with_jacobian, rotation, unproject
from rcdn.geometry.rigid import nearest_rotation, rotation_vector, unit
from rcdn.types import Array, Calibration, Camera
from rcdn.types.arrays import Real

GRID = 60
"""points along the longer side of the frame at which cameras are compared by default"""
FEWEST = 3
"""least number of pixels with rays of both cameras for the estimate of a rotation"""
SAME_RAY = 1e-6
"""rad: if the ray of the projected pixel deviates by more, the projected ray lies beyond a fold of the lens model"""
ROUNDED = 1e-9
"""largest share by which rounding makes an eigenvalue of a correlation matrix negative, for each parameter"""
CHANCE = 0.01
"""significance level: two calibrations disagree if the probability of their difference by chance is smaller"""


@dataclass(frozen=True, eq=False)
class Difference:
    """`rotation` (3,) rad, the rotation vector that was removed, from axes of the first camera to those of the second;
    `vectors` (N, 2) px at the pixels `points` (N, 2): projection by the second camera of what the first sees there,
    minus the point; NaN where either has no ray."""

    rotation: Array
    vectors: Array
    points: Array

    def __repr__(self) -> str:
        return f"<Difference: rms {self.rms:.3g} px at {len(self.points)} points, turned by {self.angle:.3g}°>"

    @property
    def lengths(self) -> Real[Array, " n"]:
        """(N,) lengths of the vectors, px."""
        return np.asarray(np.linalg.norm(self.vectors, axis=1))

    @property
    def rms(self) -> float:
        """Root mean squared length of the finite vectors, px; NaN if there are none."""
        known = self.lengths[np.isfinite(self.lengths)]
        return float(np.sqrt((known**2).mean())) if len(known) else float("nan")

    @property
    def angle(self) -> float:
        """Angle of the rotation, degrees."""
        return float(np.degrees(np.linalg.norm(self.rotation)))


@dataclass(frozen=True, eq=False)
class Agreement:
    """A difference relative to the covariances of two independent calibrations.

    `deviation` (N,) predicted standard deviation, px, root mean square of both axes, at the points of the difference;
    `ratio` (N,): length of the vector relative to the covariance, √(vᵀ C⁻¹ v ÷ 2), whose expected mean square is 1.
    `rms` of `ratio`; `expected`: 99 % quantile of `rms` by chance; `probability` of an `rms` at least as large.
    """

    deviation: Array
    ratio: Array
    rms: float
    expected: float
    probability: float

    @property
    def agree(self) -> bool:
        """Whether the calibrations agree within their covariances."""
        return self.probability >= CHANCE


def difference(a: Camera, b: Camera, pixels: Array) -> tuple[Array, Array]:
    """Displacement (N, 2) px of `pixels` (N, 2) of camera `a` in camera `b`, and the rotation vector (3,), rad, that
    was removed.

    The rotation takes the axes of `a` to those of `b` and minimises the sum of squared lengths of the vectors:
    unweighted least squares over all pixels. NaN where either camera has no ray. Raises RcdnError if the frames differ
    in size or if fewer than three of the pixels have rays in both cameras.
    """
    pixels = _checked(a, b, pixels)
    rays = unit(unproject(a, pixels))
    theirs = unit(unproject(b, pixels))
    common = np.isfinite(rays).all(axis=1) & np.isfinite(theirs).all(axis=1)
    if common.sum() < FEWEST:
        raise RcdnError(
            f"the cameras have rays in common at {int(common.sum())} of {len(pixels)} pixels; "
            f"a rotation takes {FEWEST} at least"
        )
    turn = _rotation_between(rays[common], theirs[common])
    common &= np.isfinite(displacement(a, b, turn, pixels)).all(axis=1)
    if common.sum() < FEWEST:
        raise RcdnError("the cameras look at different directions wherever both have rays: are they of the same lens?")
    turn = _least_squares(b, rays[common], pixels[common], turn)
    return displacement(a, b, turn, pixels), turn


def displacement(a: Camera, b: Camera, turn: Real[Array, " 3"], pixels: Real[Array, "n 2"]) -> Real[Array, "n 2"]:
    """(N, 2) px: projection by `b` of the rays of `a` at `pixels` (N, 2), rotated by the vector `turn` (3,), minus
    `pixels`; NaN without a ray."""
    rays = unit(unproject(a, pixels)) @ rotation(turn).T
    seen = project(b, rays)
    back = unit(unproject(b, np.where(np.isfinite(seen), seen, np.nan)))
    same = np.linalg.norm(back - rays, axis=1) < SAME_RAY
    return np.asarray(np.where(same[:, None], seen - pixels, np.nan))


def camera_difference(
    a: Camera, b: Camera, points: Real[Array, "n 2"] | None = None, fit: Real[Array, "m 2"] | None = None
) -> Difference:
    """The difference of two cameras at `points` (N, 2) px, by default a grid over the part of the frame visible to both
    lenses.

    The rotation is that of `difference` over the pixels `fit` (M, 2), by default `points`.
    """
    points = common_grid(a, b) if points is None else np.atleast_2d(np.asarray(points, float))
    vectors, turn = difference(a, b, points if fit is None else fit)
    return Difference(turn, vectors if fit is None else displacement(a, b, turn, points), points)


def common_grid(a: Camera, b: Camera, longer: int = GRID) -> Real[Array, "n 2"]:
    """(N, 2) px: centres of nearly square cells over the frame, `longer` along its longer side, where both lenses have
    rays."""
    width, height = a.image_size
    side = max(width, height) / longer
    cells = max(round(width / side), 1), max(round(height / side), 1)
    points = cell_centres(a.image_size, cells).reshape(-1, 2)
    hidden = [np.logical_or(*out_of_sight(camera, points)) for camera in (a, b)]
    return np.asarray(points[~(hidden[0] | hidden[1])])


def agreement(a: Calibration, b: Calibration, found: Difference, inside: Real[Array, " n"] | None = None) -> Agreement:
    """The difference `found` of `a.camera` and `b.camera`, relative to both covariances, assuming that the calibrations
    share no pictures.

    Both covariances are propagated to first order through the projection and through the rotation, which was fitted
    over the points of `found` that are `inside` (N,) bool (default: all); `rms` and the values derived from it are over
    those, too. The mean square of the ratio is a weighted sum of χ² variables; its quantile is Satterthwaite's: that of
    χ² with the degrees of freedom that give the same variance (Biometrics Bulletin 2, 1946).
    """
    from scipy.special import chdtrc, chdtri  # here: calibrations import this module for other functions

    inside = np.ones(len(found.points), bool) if inside is None else inside
    jacobian = _difference_jacobian(a.camera, b.camera, found.rotation, found.points, found.points[inside])
    half = [_half(c.cov[:-6, :-6]) for c in (a, b)]
    root = np.concatenate([s @ h for s, h in zip(jacobian, half, strict=True)], axis=2)
    known = np.isfinite(root).all(axis=(1, 2)) & np.isfinite(found.vectors).all(axis=1)
    cov = root[known] @ root[known].transpose(0, 2, 1)
    white = np.linalg.inv(np.linalg.cholesky(cov))
    ratio, deviation = np.full(len(root), np.nan), np.full(len(root), np.nan)
    ratio[known] = np.sqrt(((white @ found.vectors[known, :, None])[..., 0] ** 2).sum(axis=1) / 2)
    deviation[known] = np.sqrt(np.trace(cov, axis1=1, axis2=2) / 2)
    judged = inside[known]
    freedom = _freedom((white @ root[known])[judged].reshape(-1, root.shape[2]))
    square = float((ratio[known][judged] ** 2).mean())
    limit = float(np.sqrt(chdtri(freedom, CHANCE) / freedom))
    return Agreement(deviation, ratio, float(np.sqrt(square)), limit, float(chdtrc(freedom, freedom * square)))


def _freedom(rows: Real[Array, "m p"]) -> float:
    """Degrees of freedom of the mean square of `rows` (M, P) times P independent standard normal variables."""
    weights = np.linalg.eigvalsh(rows.T @ rows)
    return float(weights.sum() ** 2 / (weights**2).sum())


def _checked(a: Camera, b: Camera, pixels: Array) -> Array:
    for camera, name in ((a, "a"), (b, "b")):
        if not isinstance(camera, Camera):
            raise ConfigError(f"{name} must be a Camera, not {type(camera).__name__}")
    if tuple(a.image_size) != tuple(b.image_size):
        (w, h), (cols, rows) = a.image_size, b.image_size
        raise RcdnError(
            f"the cameras' frames differ in size ({w}×{h} and {cols}×{rows} px): compare cameras of one resolution"
        )
    pixels = np.atleast_2d(np.asarray(pixels, float))
    if pixels.ndim != 2 or pixels.shape[1] != 2:
        raise RcdnError(f"pixels must have shape (N, 2), not {pixels.shape}")
    return pixels


def _rotation_between(rays: Real[Array, "n 3"], theirs: Array) -> Array:
    """The rotation vector that best takes unit `rays` (N, 3) to `theirs`."""
    return rotation_vector(nearest_rotation(theirs.T @ rays))


def _least_squares(camera: Camera, rays: Real[Array, "n 3"], pixels: Real[Array, "n 2"], start: Array) -> Array:
    """The rotation vector near `start` that minimises the distances between the projections of `rays` (N, 3) by
    `camera` and `pixels` (N, 2).

    Parametrised as a small rotation after `start`, with central differences, which are available for every lens model.
    """
    from scipy.optimize import least_squares

    turned = rays @ rotation(start).T

    def gaps(v: Array) -> Array:
        return np.nan_to_num(project(camera, turned @ rotation(v).T) - pixels).ravel()

    step = least_squares(gaps, np.zeros(3), jac="3-point", x_scale=1e-3, xtol=1e-14, ftol=1e-14).x
    return _rotation_between(np.eye(3), (rotation(step) @ rotation(start)).T)


def _difference_jacobian(a: Camera, b: Camera, turn: Array, points: Array, fit: Array) -> tuple[Array, Array]:
    """Derivatives (N, 2, P) of the difference's vectors at `points` with respect to the parameters of `a` and of `b`,
    including the change of the fitted rotation."""
    *by_cameras, by_turn = _fixed_jacobian(a, b, turn, fit)
    seen = np.isfinite(by_turn).all(axis=(1, 2)) & np.isfinite(by_cameras[0]).all(axis=(1, 2))
    rows = by_turn[seen].reshape(-1, 3)
    solve = np.linalg.pinv(rows)
    follows = [-solve @ s[seen].reshape(len(rows), -1) for s in by_cameras]
    of_a, of_b, by_turn = _fixed_jacobian(a, b, turn, points)
    return of_a + by_turn @ follows[0], of_b + by_turn @ follows[1]


def _fixed_jacobian(a: Camera, b: Camera, turn: Array, pixels: Array) -> tuple[Array, Array, Array]:
    """Derivatives of the vectors at `pixels` with respect to the parameters of `a` and of `b`, (N, 2, P), and to a
    small rotation (N, 2, 3)."""
    rays = unit(unproject(a, pixels))
    _, by_ray, by_a = project_with_jacobian(a, rays)
    R = rotation(turn)
    _, by_turned, by_b = project_with_jacobian(b, rays @ R.T)
    # a change of a's parameters moves the ray of a fixed pixel perpendicularly to it: by_ray·δray = −by_a·δparameters
    gram = by_ray @ by_ray.transpose(0, 2, 1)
    seen = np.isfinite(gram).all(axis=(1, 2))
    moves = np.full((len(pixels), 3, by_a.shape[2]), np.nan)
    moves[seen] = -by_ray[seen].transpose(0, 2, 1) @ np.linalg.solve(gram[seen], by_a[seen])
    return by_turned @ R @ moves, by_b, -by_turned @ cross_matrix(rays @ R.T)


def _half(cov: Array) -> Array:
    """A matrix H with H Hᵀ = `cov`, a covariance up to rounding: smooth corrections have hundreds of parameters, some
    of which are nearly functions of others."""
    wrong = CalibrationError("the covariance of a calibration has negative or infinite variances: calibrate again")
    if not (np.isfinite(cov).all() and (np.diag(cov) >= 0).all()):
        raise wrong
    size = np.sqrt(np.diag(cov))
    size[size == 0] = 1  # held parameters
    variance, directions = np.linalg.eigh(cov / size[:, None] / size)
    if not variance[0] >= -ROUNDED * len(cov):
        raise wrong
    return np.asarray(size[:, None] * directions * np.sqrt(np.maximum(variance, 0)))
