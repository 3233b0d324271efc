"""The pose of the board that would make the next picture worth most."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rcdn.calibration.added_view import Information, Prior, share_told, variances, weight_of
from rcdn.calibration.board_points import flat_points, plane_of
from rcdn.calibration.sight import off_axis, out_of_sight
from rcdn.calibration.uncertainty import projection_uncertainty
from rcdn.calibration.view_checks import THIRDS
from rcdn.geometry import cross_matrix, project, project_with_slopes, rotation, unproject
from rcdn.types import Array, Calibration, Plane, Pose

PLACES = (0.12, 0.31, 0.5, 0.69, 0.88)
"""where the board's middle may be, shares of the frame's width and height"""
DISTANCES = (0.05, 0.5, 0.95)
"""quantiles of the distances seen: there the picture is sharp, and the board found"""
TILTS, SIDES = (30.0, 45.0), 8
"""degrees that the board may be tilted, besides 0, and directions of a tilt"""
INSIDE = 0.7
"""share of the corners that must lie in the frame"""
NEARLY = 1.1
"""× the lowest uncertainty that a candidate reaches: of those below it the one with most corners in the frame is taken"""
MARGIN = 0.01
"""of the frame's shorter side: corners nearer to its rim don't count"""
MOST_CORNERS = 7
"""columns and rows of corners that stand for the board's; their weight makes up for the others"""
GRID = (13, 10)
"""columns and rows of the points over the frame at which the projection is judged, the rim included"""
BATCH = 256
"""candidates that are computed together"""
NEARER = ("right edge", "lower right corner", "lower edge", "lower left corner", "left edge", "upper left corner",
          "upper edge", "upper right corner")  # fmt: skip
"""what comes nearer under a tilt in each direction, as the picture shows it"""
WORTH_SAYING, GAIN = 0.25, 0.95
"""px of worst projection uncertainty from which on another picture is worth a word, and the share that must not be left of it"""


@dataclass(frozen=True, eq=False)
class NextView:
    """Where to hold the board for the next picture.

    `pose` of the board's inner corners, its first at the origin; `size` (columns, rows) of them; `outline` (4, 2) px of the outermost ones, in order
    around; `middle` (2,) px of the board's middle; `inside`, the share of the corners in the frame; `distance` m of the
    middle; `tilt` degrees against the line of sight, `nearer`: the edge or corner, as seen, that is nearer. `before`, `after` px:
    the worst projection uncertainty over the frame now, and what is expected with that view.
    """

    pose: Pose
    size: tuple[int, int]
    outline: Array
    middle: Array
    inside: float
    distance: float
    tilt: float
    nearer: str
    before: float
    after: float

    @property
    def worth_saying(self) -> bool:
        """The camera is loose somewhere, and this view would help."""
        return self.before >= WORTH_SAYING and self.after <= GAIN * self.before


@dataclass(frozen=True, eq=False)
class _Candidates:
    """C poses (C, 4, 4), with the pixel of the board's middle (C, 2), distance (C,) m, tilt (C,) degrees, side (C,) index of NEARER."""

    T: Array
    middle: Array
    distance: Array
    tilt: Array
    side: Array

    def take(self, index: Array) -> _Candidates:
        return _Candidates(self.T[index], self.middle[index], self.distance[index], self.tilt[index], self.side[index])


def next_view(calibration: Calibration) -> NextView | None:
    """The view that would lower the worst projection uncertainty over the frame most; None if no candidate can be seen or judged,
    or if nobody knows the covariance.

    Candidates are boards in 25 places of the frame, at three distances within those seen, facing the camera or tilted by 30° or 45° in eight
    directions, with at least 70 % of their corners in the frame. Each would add its information to that of `calibration.cov`, its own pose
    marginalised; the scale of that is what the used views brought on average, so that correlated residuals don't promise too much. To first order:
    the camera is taken for right, and its errors for small. The choice is among candidates only, and the same every time.
    """
    distances = _distances(calibration)
    points, by_camera, by_motion = _judged(calibration)
    if not len(distances) or not len(points) or not np.isfinite(calibration.cov).all():
        return None
    plane, size = plane_of(calibration), _size(calibration)
    candidates = _candidates(calibration, size, plane, distances)
    board, share = _corners(size, plane, calibration.spacing)
    seen = _in_frame(calibration, candidates, board)
    good = seen.mean(axis=1) >= INSIDE
    if not good.any():
        return None
    candidates, seen = candidates.take(good), seen[good]
    prior = Prior.of(calibration)
    weight = weight_of(calibration) * np.sqrt(share * share_told(calibration, prior))
    worst = []
    for k in range(0, len(seen), BATCH):
        camera_points = _placed(candidates.T[k : k + BATCH], board)
        more = Information.of(calibration.camera, camera_points, weight * seen[k : k + BATCH])
        worst.append(variances(prior, more, by_camera, by_motion).max(axis=1))
    after = np.sqrt(np.concatenate(worst))
    best = _best(after, seen.mean(axis=1))
    before = float(np.nanmax(projection_uncertainty(calibration, points)))
    return _found(calibration, candidates, best, size, plane, float(seen[best].mean()), before, float(after[best]))


def _best(after: Array, inside: Array) -> int:
    """The candidate with the lowest uncertainty `after` (C,), or one that is nearly as good with more of the board in the frame: `inside` (C,)."""
    nearly = np.flatnonzero(after <= NEARLY * after.min())
    return int(nearly[np.lexsort([after[nearly], -inside[nearly]])[0]])


def sentence(found: NextView, image_size: tuple[int, int]) -> str:
    """What to do, in words."""
    share = (found.middle + 0.5) / np.array(image_size)
    col, row = (int(np.clip(s * 3, 0, 2)) for s in share)
    place = "the middle" if (col, row) == (1, 1) else f"the {THIRDS[row][col]}"
    tilt = f"tilted by {found.tilt:.0f}°, its {found.nearer} towards the camera" if found.tilt else "facing the camera"
    part = "" if found.inside > 0.99 else f", partly outside ({found.inside:.0%} of its corners in the frame)"
    return (
        f"Hold the board in {place} of the picture, {found.distance:.2g} m away, {tilt}{part}: the worst projection uncertainty would fall "
        f"from {found.before:.2g} px to about {found.after:.2g} px."
    )


def advised(calibration: Calibration) -> Calibration:
    """`calibration` with advice that ends with the next picture, where that would help."""
    found = next_view(calibration)
    if found is None or not found.worth_saying:
        return calibration
    said = f"Next picture: {sentence(found, calibration.camera.image_size)}"
    return replace(calibration, advice=(*calibration.advice, said))


def _distances(calibration: Calibration) -> Array:
    """(D,) m, of the boards' middles: quantiles of those seen."""
    seen = []
    for view in calibration.used_views:
        if view.pose is not None:
            middle = flat_points(calibration, view, (view.ij.min(axis=0) + view.ij.max(axis=0)) / 2)
            seen.append(float(np.linalg.norm(view.pose.R[:, :2] @ middle + view.pose.t)))
    return np.unique(np.quantile(seen, DISTANCES)) if seen else np.zeros(0)


def _size(calibration: Calibration) -> tuple[int, int]:
    """(columns, rows) of the board, or of the largest part of it that was seen; the longer side along that of the frame."""
    boxes = [v.ij.max(axis=0) - v.ij.min(axis=0) + 1 for v in calibration.used_views]
    cols, rows = calibration.size or max(((int(b[0]), int(b[1])) for b in boxes), key=lambda s: s[0] * s[1])
    width, height = calibration.camera.image_size
    return (cols, rows) if (cols >= rows) == (width >= height) else (rows, cols)


def _corners(size: tuple[int, int], plane: Plane, spacing: float) -> tuple[Array, float]:
    """(N, 2) m, some of the board's corners, evenly spread; and how many corners each stands for."""
    picks = [np.unique(np.linspace(0, n - 1, min(n, MOST_CORNERS)).round()) for n in size]
    ij = np.stack(np.meshgrid(*picks), axis=-1).reshape(-1, 2)
    return plane.points(ij) * spacing, size[0] * size[1] / len(ij)


def _candidates(calibration: Calibration, size: tuple[int, int], plane: Plane, distances: Array) -> _Candidates:
    """All poses: places × distances × tilts."""
    width, height = calibration.camera.image_size
    spots = np.array([[x * width, y * height] for y in PLACES for x in PLACES]) - 0.5
    rays = unproject(calibration.camera, spots)
    there = np.isfinite(rays).all(axis=1)
    rays, spots = rays[there] / np.linalg.norm(rays[there], axis=1, keepdims=True), spots[there]
    tilts = [(0.0, 0), *((t, s) for t in TILTS for s in range(SIDES))]
    side = np.radians([360 / SIDES * s for _, s in tilts])
    angle = np.radians([t for t, _ in tilts])
    # a positive turn about (−sin, cos) brings the side (cos, sin) of the board nearer
    lean = rotation(np.stack([-np.sin(side) * angle, np.cos(side) * angle, 0 * angle], axis=-1))
    R = _facing(rays)[:, None] @ lean
    middle = plane.points((np.array(size) - 1) / 2) * calibration.spacing
    T = np.tile(np.eye(4), (len(rays), len(distances), len(tilts), 1, 1))
    T[..., :3, :3] = R[:, None]
    T[..., :3, 3] = rays[:, None, None] * distances[:, None, None] - (R[..., :2] @ middle)[:, None]
    shape = T.shape[:3]
    spread = (
        np.broadcast_to(spots[:, None, None], (*shape, 2)).reshape(-1, 2),
        np.broadcast_to(distances[:, None], shape).ravel(),
        np.broadcast_to(np.degrees(angle), shape).ravel(),
        np.broadcast_to([s for _, s in tilts], shape).ravel(),
    )
    return _Candidates(T.reshape(-1, 4, 4), *spread)


def _facing(rays: Array) -> Array:
    """(K, 3, 3) the least rotations that take the z axis to unit `rays` (K, 3)."""
    axis = np.stack([-rays[:, 1], rays[:, 0], 0 * rays[:, 0]], axis=-1)
    sine = np.linalg.norm(axis, axis=1)
    return rotation(axis * (np.arctan2(sine, rays[:, 2]) / np.maximum(sine, 1e-12))[:, None])


def _placed(T: Array, board: Array) -> Array:
    """(C, N, 3) camera coordinates of `board` (N, 2) under poses `T` (C, 4, 4)."""
    return np.asarray(board @ T[:, :3, :2].transpose(0, 2, 1) + T[:, None, :3, 3])


def _in_frame(calibration: Calibration, candidates: _Candidates, board: Array) -> Array:
    """(C, N) bool: the corner is in the frame, and its ray no farther off the axis than any of the frame's: not beyond a fold."""
    camera = calibration.camera
    width, height = camera.image_size
    points = _placed(candidates.T, board)
    xy = project(camera, points)
    edge = MARGIN * min(width, height)
    inside = (xy >= edge).all(axis=2) & (xy <= np.array([width - 1, height - 1]) - edge).all(axis=2)
    widest = float(np.nanmax(off_axis(camera, _grid(camera.image_size)), initial=0.0))
    angle = np.degrees(np.arctan2(np.hypot(points[..., 0], points[..., 1]), points[..., 2]))
    return np.asarray(inside & (angle <= widest))


def _grid(image_size: tuple[int, int]) -> Array:
    x, y = (np.linspace(0, n - 1, k) for n, k in zip(image_size, GRID, strict=True))
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def _judged(calibration: Calibration) -> tuple[Array, Array, Array]:
    """Points (G, 2) px over the frame where the lens sees, with the derivatives of the projection of a far point there in the camera's
    parameters (G, 2, P) and in the boards' mean motion (G, 2, 6), as in `projection_uncertainty`."""
    points = _grid(calibration.camera.image_size)
    points = points[~np.logical_or(*out_of_sight(calibration.camera, points))]
    rays = unproject(calibration.camera, points)
    rays = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    _, by_point, by_camera = project_with_slopes(calibration.camera, rays)
    turn = -by_point @ cross_matrix(rays)
    return points, by_camera, np.concatenate([turn, 0 * by_point], axis=2)


def _found(
    calibration: Calibration,
    candidates: _Candidates,
    best: int,
    size: tuple[int, int],
    plane: Plane,
    inside: float,
    before: float,
    after: float,
) -> NextView:
    last = np.array(size) - 1
    box = plane.points(np.array([[0, 0], [last[0], 0], last, [0, last[1]]])) * calibration.spacing
    tilt = float(candidates.tilt[best])
    return NextView(
        pose=Pose(candidates.T[best]),
        size=size,
        outline=project(calibration.camera, _placed(candidates.T[best][None], box)[0]),
        middle=candidates.middle[best],
        inside=inside,
        distance=float(candidates.distance[best]),
        tilt=tilt,
        nearer=NEARER[int(candidates.side[best]) * len(NEARER) // SIDES] if tilt else "",
        before=before,
        after=after,
    )
