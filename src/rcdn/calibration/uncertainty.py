"""How far a camera is to be trusted: covariances, where projections go astray, where corners were."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from rcdn.calibration.bundle import Corners3, State
from rcdn.calibration.solver import Arrow, Linear, without_pose
from rcdn.errors import RcdnError
from rcdn.geometry import cross_matrix, project_with_slopes, unproject
from rcdn.types import Array, Calibration, Camera

FEWEST_CLUSTERS = 3
REACHED = 2.0
"""see `pose_covariance`"""
JACKKNIFE, UNBIASED, LEAST_LEFT = 1.0, 0.5, 0.1
"""powers of the leverage, see `clustered`; share that other clusters tell of a direction, below which a cluster isn't weighed up further"""
STEADY = 20.0
"""clusters that the covariance by the noise of corners, inflated as a whole, counts as"""


@dataclass(frozen=True, eq=False)
class Clustered:
    """The covariance of K shared parameters by the scatter of whole views: `covariance` (K, K), and how many times larger than by the noise
    of single corners it is, `inflation` (mean over the directions that cameras are told in)."""

    covariance: Array
    inflation: float


def clustered(
    state: State,
    corners: Corners3,
    weight: Array,
    free: Array,
    arrow: Arrow,
    scale: float,
    cluster: Array | None = None,
    power: float = JACKKNIFE,
) -> Clustered:
    """The covariance of the `free` parameters if corners of one cluster may err together in any way and clusters don't.

    An infinitesimal jackknife over clusters of frames (the sandwich H⁻¹ (Σ u uᵀ) H⁻¹ of the clusters' scores u), poses eliminated. A
    cluster pulls the solution to itself, by its leverage A = I H⁻¹, so that its score is too small: it is divided by 1 − A, which is the
    jackknife (CR3: Bell and McCaffrey 2002; on the safe side). The scatter of the prior's mean adds to it. `cluster` (F,) numbers;
    default: each frame by itself. `scale`: mean square of the whitened residuals. With fewer than three clusters the scatter tells nothing:
    the covariance by the noise of corners.

    The sum over G clusters has at most rank G, and a few of them tell a covariance only roughly: it is shrunk towards the covariance by the noise
    of corners times the inflation, the more the fewer clusters there are (a Wishart prior of `STEADY` clusters). The inflation is by scores
    divided by the square root of 1 − A, right if corners err by themselves (CR2). `power`: of 1 − A for the sum itself; UNBIASED for
    a rig, where a few moments may hold most of what is known of a camera's place and CR3 would state up to 1 ÷ √(1 − A) times too much.
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


def _inflation(meat: Array, rows: Array, scale: float) -> float:
    """Mean of the scatter `meat` (K, K) over the directions in which the parameters of `rows` (P, K) are told, ÷ `scale`; at least 1."""
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
            told = np.flatnonzero(np.abs(here.shared[of]).sum(axis=(0, 1)) > 0)  # of a rig: of its seers only
            S, e = without_pose(here.by_frame[of], here.shared[of][:, :, told], here.gaps[of])
            part[np.ix_(told, told)] += S.T @ S
            pull[told] += S.T @ e
        yield part, pull


def covariance(arrow: Arrow, frames: Array, scale: float, honest: Clustered) -> Array:
    """Covariance (K + 6, K + 6) of the K shared parameters and of the mean motion of the poses `frames` (F,) that were used.

    `scale`: mean square of the whitened residuals. What a pose errs by itself is taken to be as many times larger than by the noise of
    corners as what the parameters err by.
    """
    many = len(frames)
    shared = honest.covariance
    reach = arrow.reach[frames].mean(axis=0)
    own = scale * honest.inflation * np.einsum("fab,fcb->ac", arrow.own[frames], arrow.own[frames]) / many**2
    cross = -shared @ reach.T
    return np.asarray(np.block([[shared, cross], [cross.T, own + reach @ shared @ reach.T]]))


def with_held(cov: Array, free: Array) -> Array:
    """`cov` of the `free` ones of K shared parameters and of the poses' mean motion, with zeros for what was held: (K + 6, K + 6)."""
    if free.all():
        return cov
    at = np.flatnonzero(np.append(free, np.ones(6, bool)))
    out = np.zeros((len(free) + 6, len(free) + 6))
    out[np.ix_(at, at)] = cov
    return out


def pose_covariance(state: State, corners: Corners3, weight: Array, arrow: Arrow, scale: float) -> Array:
    """Covariance (6, 6) of the small motion of one board's pose under a known camera, from corners that err together with their neighbours.

    A sandwich whose middle sums products of the corners' gradients with a weight that falls linearly to 0 at half of the board's longer side
    (Conley, GMM estimation with cross sectional dependence, 1999): bends of paper and errors of the lens move whole regions. The pose takes up
    a part of them, so that residuals show less: REACHED times as much is counted. Never less than by the noise of single corners, whose mean
    square is `scale`.
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
    root = np.linalg.inv(arrow.own[0])  # in its coordinates the noise of corners is the unit matrix
    middle = REACHED * root @ bread @ meat @ bread @ root.T / max(scale, 1e-300)
    values, vectors = np.linalg.eigh((middle + middle.T) / 2)
    wide = (vectors * np.maximum(values, 1.0)) @ vectors.T
    return np.asarray(arrow.own[0] @ wide @ arrow.own[0].T * scale) if np.isfinite(wide).all() else np.asarray(single)


def projection_uncertainty(calibration: Calibration, pixels: Array, distance: float = np.inf) -> Array:
    """Standard deviation, px, of where the camera sees a fixed point that it sees at `pixels` (N, 2): root mean square of both axes.

    The point stands `distance` m away, in front of boards that hold still: camera and boards were estimated together, and a turn of
    all boards that a shift of the principal point makes up for is no error (mrcal's projection uncertainty, mean-pcam). NaN where
    the lens model has no ray. It rests on how views disagree with each other; an error that is the same in all views isn't in it.
    """
    pixels = np.atleast_2d(np.asarray(pixels, float))
    if pixels.ndim != 2 or pixels.shape[1] != 2:
        raise RcdnError(f"pixels must have shape (N, 2), not {pixels.shape}")
    if not distance > 0:
        raise RcdnError(f"distance must be positive, in metres, or infinite, not {distance}")
    rays = unproject(calibration.camera, pixels)
    rays = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    seen = np.isfinite(rays).all(axis=1)
    _, by_point, by_camera = project_with_slopes(calibration.camera, rays[seen])
    turn = -by_point @ cross_matrix(rays[seen])
    shift = by_point / distance
    slopes = np.concatenate([by_camera, turn, shift], axis=2)
    variance = np.einsum("nia,ab,nib->n", slopes, calibration.cov, slopes, optimize=True) / 2
    out = np.full(len(pixels), np.nan)
    out[seen] = np.sqrt(variance)
    return out


def projection_deviation(calibration: Calibration, pixels: Array) -> Array:
    """Covariance (N, 2, 2), px², of where the camera sees the directions that it sees at `pixels` (N, 2), but for a rotation of all of them.

    What a rotation of the camera does to all pixels is no error: the one that takes most away, by least squares over `pixels`, is taken out.
    With it the difference of two calibrations after the best rotation can be compared. NaN where the lens model has no ray.
    """
    J, _ = unrotated_slopes(calibration.camera, pixels)
    many = J.shape[2]
    return np.asarray(np.einsum("nia,ab,njb->nij", J, calibration.cov[:many, :many], J, optimize=True))


def unrotated_slopes(camera: Camera, pixels: Array) -> tuple[Array, Array]:
    """Derivatives (N, 2, P), in the camera's parameters, of where it sees the directions that it sees at `pixels` (N, 2), without what a
    rotation of all directions makes up for; NaN where it has no ray, and (N,) bool where it has one."""
    pixels = np.atleast_2d(np.asarray(pixels, float))
    rays = unproject(camera, pixels)
    rays = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    seen = np.isfinite(rays).all(axis=1)
    _, by_point, by_camera = project_with_slopes(camera, rays[seen])
    turn = (-by_point @ cross_matrix(rays[seen])).reshape(-1, 3)
    flat = by_camera.reshape(len(turn), -1)
    flat = flat - turn @ np.linalg.lstsq(turn, flat, rcond=None)[0]
    out = np.full((len(pixels), *by_camera.shape[1:]), np.nan)
    out[seen] = flat.reshape(by_camera.shape)
    return out, np.asarray(seen)


def coverage(calibration: Calibration, cells: tuple[int, int] = (12, 9)) -> Array:
    """(rows, columns) how many used corners lie in each of `cells` (columns, rows) equal parts of the sensor."""
    width, height = calibration.camera.image_size
    corners = np.concatenate([v.xy[v.used] for v in calibration.used_views] or [np.zeros((0, 2))])
    edges = np.linspace(-0.5, height - 0.5, cells[1] + 1), np.linspace(-0.5, width - 0.5, cells[0] + 1)
    return np.asarray(np.histogram2d(corners[:, 1], corners[:, 0], bins=edges)[0].astype(int))
