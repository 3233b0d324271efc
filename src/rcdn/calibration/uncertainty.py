"""Uncertainty of a camera: covariances, the uncertainty of its projections, and the coverage of the sensor by
corners."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from rcdn.calibration.arguments import check_calibration
from rcdn.calibration.arrow import Arrow
from rcdn.calibration.bundle import Corners3, State
from rcdn.calibration.motions import by_motion
from rcdn.calibration.solver import Linear, without_pose
from rcdn.errors import ConfigError, shown
from rcdn.geometry import project_with_jacobian, unproject
from rcdn.geometry.rigid import unit
from rcdn.types import Array, Calibration, Camera
from rcdn.types.arrays import Real
from rcdn.types.ranges import BOX, two_integers

FEWEST_CLUSTERS = 3
REACHED = 2.0
"""see `pose_covariance`"""
JACKKNIFE, UNBIASED, LEAST_LEFT = 1.0, 0.5, 0.1
"""powers of 1 − leverage, see `clustered`; least eigenvalue of 1 − leverage, which limits the correction"""
STEADY = 20.0
"""number of clusters as which the covariance from the noise of corners, inflated by one factor, counts"""


@dataclass(frozen=True, eq=False)
class Clustered:
    """The covariance of K shared parameters from the scatter of whole views: `covariance` (K, K), and its ratio to that
    from the noise of single corners, `inflation` (mean over the directions that determine the cameras)."""

    covariance: Array
    inflation: float


def clustered(
    state: State,
    corners: Corners3,
    weight: Array,
    free: Array,
    arrow: Arrow,
    scale: float,
    cluster: Real[Array, " f"] | None = None,
    power: float = JACKKNIFE,
) -> Clustered:
    """The covariance of the `free` parameters if errors of corners of one cluster may be correlated in any way, and
    clusters are independent.

    An infinitesimal jackknife over clusters of frames (the sandwich H⁻¹ (Σ u uᵀ) H⁻¹ of the clusters' scores u), poses
    eliminated. A cluster draws the solution towards itself by its leverage A = I H⁻¹, which makes its score too small:
    it is divided by 1 − A, which is the jackknife (CR3: Bell and McCaffrey 2002; conservative). The scatter of the
    prior's mean is added. `cluster` (F,) numbers; default: each frame by itself. `scale`: mean square of the whitened
    residuals. With fewer than three clusters their scatter is not used: the result is the covariance from the noise of
    corners.

    The sum over G clusters has rank G at most, and with few of them it is a poor estimate of a covariance: it is shrunk
    towards the covariance from the noise of corners times the inflation, the more the fewer clusters there are (a
    Wishart prior of `STEADY` clusters). The inflation uses scores divided by the square root of 1 − A, which is
    unbiased if errors of corners are independent (CR2). `power`: that of 1 − A for the sum itself; UNBIASED for a rig,
    in which a few moments may contain most of the information on a camera's pose and CR3 would overestimate by up to 1
    ÷ √(1 − A).
    """
    number = np.arange(len(state.poses)) if cluster is None else cluster
    rim = arrow.rim  # in its coordinates the whole information is the unit matrix
    held = rim.T @ state.beforehand.precision[np.ix_(free, free)] @ rim
    many, meat, unbiased = 0, held, held
    for info, pull in _by_cluster(state, corners, weight, free, number):
        many, (more, fair) = many + 1, _pulled(rim.T @ info @ rim, pull @ rim, (power, UNBIASED))
        meat, unbiased = meat + np.outer(more, more), unbiased + np.outer(fair, fair)
    if many < FEWEST_CLUSTERS:
        return Clustered(np.asarray(scale * arrow.covariance), 1.0)
    inflation = _inflation(unbiased, rim[: len(rim) - int(free[len(free) - state.shape.size :].sum())], scale)
    share = STEADY / (STEADY + many)
    meat = (1 - share) * meat + share * inflation * scale * np.eye(len(meat))
    return Clustered(np.asarray(rim @ meat @ rim.T), inflation)


def _inflation(meat: Real[Array, "k k"], rows: Real[Array, "p k"], scale: float) -> float:
    """Mean of the scatter `meat` (K, K) over the directions that determine the parameters of `rows` (P, K), ÷ `scale`;
    at least 1."""
    if not len(rows):
        return 1.0
    directions, _ = np.linalg.qr(rows.T)
    return max(float(np.trace(directions.T @ meat @ directions)) / len(rows) / max(scale, 1e-300), 1.0)


def _pulled(leverage: Array, score: Array, powers: Sequence[float]) -> list[Array]:
    """(1 − leverage)^−power score (K,) for each power, of a cluster's symmetric `leverage` (K, K) and `score` (K,)."""
    values, vectors = np.linalg.eigh((leverage + leverage.T) / 2)
    along, left = vectors.T @ score, np.maximum(1 - values, LEAST_LEFT)
    return [vectors @ (along * left**-power) for power in powers]


def _by_cluster(
    state: State, corners: Corners3, weight: Array, free: Array, cluster: Array
) -> Iterator[tuple[Array, Array]]:
    """Information (K, K) and score (K,) of each cluster that has corners, poses eliminated."""
    number = np.unique(cluster, return_inverse=True)[1][corners.frame]
    for g in range(int(number.max()) + 1):
        some = np.flatnonzero((number == g) & (weight > 0))
        here = Linear.of(state, corners.take(some), weight[some], free)
        mine = np.flatnonzero(np.abs(here.by_frame).sum(axis=(1, 2)) > 0)
        if not len(mine):
            continue
        part = np.zeros((here.shared.shape[2], here.shared.shape[2]))
        pull = np.zeros(len(part))
        for f in np.unique(here.frame[mine]):
            of = mine[here.frame[mine] == f]
            relevant = np.flatnonzero(np.abs(here.shared[of]).sum(axis=(0, 1)) > 0)  # of a rig: of its seers only
            S, e = without_pose(here.by_frame[of], here.shared[of][:, :, relevant], here.gaps[of])
            part[np.ix_(relevant, relevant)] += S.T @ S
            pull[relevant] += S.T @ e
        yield part, pull


def covariance(arrow: Arrow, frames: Real[Array, " f"], scale: float, honest: Clustered) -> Array:
    """Covariance (K + 6, K + 6) of the K shared parameters and of the mean motion of the poses `frames` (F,) that were
    used.

    `scale`: mean square of the whitened residuals. The independent part of the poses' errors is inflated, relative to
    the noise of corners, by the same factor as the parameters' errors.
    """
    many = len(frames)
    shared = honest.covariance
    reach = arrow.reach[frames].mean(axis=0)
    own = scale * honest.inflation * np.einsum("fab,fcb->ac", arrow.own[frames], arrow.own[frames]) / many**2
    cross = -shared @ reach.T
    return np.asarray(np.block([[shared, cross], [cross.T, own + reach @ shared @ reach.T]]))


def with_held(cov: Array, free: Array) -> Array:
    """`cov` of the `free` ones of K shared parameters and of the poses' mean motion,
    with zeros for what was held: (K + 6, K + 6)."""
    if free.all():
        return cov
    at = np.flatnonzero(np.append(free, np.ones(6, bool)))
    out = np.zeros((len(free) + 6, len(free) + 6))
    out[np.ix_(at, at)] = cov
    return out


def pose_covariance(state: State, corners: Corners3, weight: Array, arrow: Arrow, scale: float) -> Real[Array, "6 6"]:
    """Covariance (6, 6) of the small motion of one board's pose under a known camera, with correlated errors of
    neighbouring corners.

    A sandwich estimate whose middle sums products of the corners' gradients with a weight that falls linearly to 0 at
    half of the board's longer side (Conley, GMM estimation with cross sectional dependence, 1999): bending of paper and
    errors of the lens displace whole regions. The pose absorbs a part of them, so that residuals are too small: the
    middle is multiplied by REACHED. Never less than the covariance from the noise of single corners, whose mean square
    is `scale`.
    """
    here = Linear.of(state, corners, weight, np.zeros(len(state.values), bool))
    used = np.flatnonzero(weight > 0)
    gradient = np.einsum("nia,ni->na", here.by_frame[used], here.gaps[used])
    places = corners.board[used]
    distance = np.linalg.norm(places[:, None] - places[None], axis=2)
    kernel = np.maximum(1 - distance / max(float(np.ptp(places, axis=0).max()) / 2, 1e-12), 0.0)
    bread = arrow.own[0] @ arrow.own[0].T
    single = scale * bread
    meat = gradient.T @ kernel @ gradient
    root = np.linalg.inv(arrow.own[0])  # in its coordinates the covariance from the noise of corners is the unit matrix
    middle = REACHED * root @ bread @ meat @ bread @ root.T / max(scale, 1e-300)
    values, vectors = np.linalg.eigh((middle + middle.T) / 2)
    wide = (vectors * np.maximum(values, 1.0)) @ vectors.T
    return np.asarray(arrow.own[0] @ wide @ arrow.own[0].T * scale) if np.isfinite(wide).all() else np.asarray(single)


def projection_uncertainty(calibration: Calibration, pixels: Array, distance: float = np.inf) -> Array:
    """Standard deviation, px, of the projection of a fixed point that the camera sees at `pixels` (N, 2): root mean
    square of both axes.

    The point is `distance` m away, fixed with respect to the boards: camera and boards were estimated together, and a
    rotation of all boards that compensates a shift of the principal point is no error (mrcal's projection uncertainty,
    mean-pcam). NaN where the lens model has no ray. The estimate is based on the disagreement of the views; an error
    that is the same in all views is not included. Raises ConfigError for a wrong argument.
    """
    check_calibration(calibration)
    try:
        pixels = np.atleast_2d(np.asarray(pixels, float))
    except (TypeError, ValueError) as error:
        raise ConfigError(f"pixels must hold numbers in rows of two (x, y), not {shown(pixels)}") from error
    if pixels.ndim != 2 or pixels.shape[1] != 2:
        raise ConfigError(f"pixels must have shape (N, 2), not {pixels.shape}")
    far = np.asarray(distance)
    if far.ndim or far.dtype.kind not in "iuf" or not far > 0:
        raise ConfigError(f"distance must be positive, in metres, or infinite, not {shown(distance)}")
    rays = unit(unproject(calibration.camera, pixels))
    seen = np.isfinite(rays).all(axis=1)
    _, by_camera, by_motion = pixel_jacobians(calibration.camera, rays[seen], distance)
    jacobian = np.concatenate([by_camera, by_motion], axis=2)
    variance = np.einsum("nia,ab,nib->n", jacobian, calibration.cov, jacobian, optimize=True) / 2
    out = np.full(len(pixels), np.nan)
    out[seen] = np.sqrt(variance)
    return out


def pixel_jacobians(camera: Camera, points: Real[Array, "n 3"], distance: float = 1.0) -> tuple[Array, Array, Array]:
    """Derivatives of the projections of `points` (N, 3), camera coordinates: with respect to the points (N, 2, 3), to
    `camera.parameters` (N, 2, P), and to a small motion of what they belong to (N, 2, 6), rotation before shift;
    `distance` m that one unit of the points stands for, infinite for directions."""
    _, by_point, by_camera = project_with_jacobian(camera, points)
    moved = by_motion(by_point, points)
    moved[:, :, 3:] /= distance
    return by_point, by_camera, moved


def unrotated_jacobian(camera: Camera, pixels: Real[Array, "n 2"]) -> tuple[Array, Array]:
    """Derivatives (N, 2, P) with respect to the camera's parameters of the projections of the directions that it sees
    at `pixels` (N, 2), without the part that a rotation of all directions compensates; NaN where it has no ray; and
    (N,) bool where it has one."""
    pixels = np.atleast_2d(np.asarray(pixels, float))
    rays = unit(unproject(camera, pixels))
    seen = np.isfinite(rays).all(axis=1)
    _, by_camera, by_motion = pixel_jacobians(camera, rays[seen])
    turn = by_motion[:, :, :3].reshape(-1, 3)
    flat = by_camera.reshape(len(turn), -1)
    flat = flat - turn @ np.linalg.lstsq(turn, flat, rcond=None)[0]
    out = np.full((len(pixels), *by_camera.shape[1:]), np.nan)
    out[seen] = flat.reshape(by_camera.shape)
    return out, np.asarray(seen)


def coverage(calibration: Calibration, cells: tuple[int, int] = (12, 9)) -> Array:
    """(rows, columns) number of used corners in each of `cells` (columns, rows) equal parts of the sensor.
    Raises ConfigError for anything but a Calibration, and for `cells` that aren't two whole numbers from 1 on."""
    check_calibration(calibration)
    parts = two_integers(cells)
    if parts is None or min(parts) < 1 or parts[0] * parts[1] > BOX:
        raise ConfigError(
            f"cells must be (columns, rows), whole numbers from 1 on and {BOX} in all at most, not {shown(cells)}"
        )
    width, height = calibration.camera.image_size
    corners = np.concatenate([v.xy[v.used] for v in calibration.used_views] or [np.zeros((0, 2))])
    edges = np.linspace(-0.5, height - 0.5, parts[1] + 1), np.linspace(-0.5, width - 0.5, parts[0] + 1)
    return np.asarray(np.histogram2d(corners[:, 1], corners[:, 0], bins=edges)[0].astype(int))
