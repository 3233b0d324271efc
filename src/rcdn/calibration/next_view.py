"""The pose of the board whose picture would reduce the uncertainty most."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rcdn.calibration.added_view import Forecast
from rcdn.calibration.arguments import check_calibration
from rcdn.calibration.board_points import flat_points, plane_of
from rcdn.calibration.candidates import SIDES, Candidates, board_corners, candidates, in_frame, placed
from rcdn.calibration.one_thread import one_thread
from rcdn.calibration.view_checks import THIRDS
from rcdn.errors import two_digits
from rcdn.geometry import project
from rcdn.types import Array, Calibration, Plane, Pose
from rcdn.types.arrays import Real

DISTANCES = (0.05, 0.5, 0.95)
"""quantiles of the distances of the used views: at these the picture was sharp and the board was detected"""
INSIDE = 0.5
"""least share of the corners that must lie in the frame"""
NEARLY = 1.1
"""× the lowest uncertainty of all candidates: among the candidates below it, the one with most corners in the frame is
chosen"""
NEARER = ("right edge", "lower right corner", "lower edge", "lower left corner", "left edge", "upper left corner",
          "upper edge", "upper right corner")  # fmt: skip
"""the edge or corner of the board, as seen in the picture, that comes nearer under a tilt in each direction"""
WORTH_SAYING, GAIN = 0.25, 0.95
"""worst projection uncertainty, px, above which another picture is suggested; and the share of it that the picture must
fall below"""


@dataclass(frozen=True, eq=False)
class NextView:
    """Where to hold the board for the next picture.

    `pose` of the board's inner corners, the first at the origin; `size` (columns, rows) of them; `outline` (4, 2) px of
    the outermost ones, in order around the board; `middle` (2,) px of the board's centre; `inside`, the share of the
    corners in the frame; `distance` m of the centre; `tilt` degrees from the plane perpendicular to the line of sight;
    `nearer`: the edge or corner, as seen in the picture, that is nearer. `before`, `after` px: the worst projection
    uncertainty over the frame now, and the predicted one with that view; `gain`, by which the view was chosen: the
    predicted decrease of the logarithm of the uncertainty's mean over the frame, a mean of high power
    (`added_view.NORM`). `upright`: whether the board is wanted the right way up, its labels growing to the right in the
    picture; None: either way up.
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
    gain: float
    upright: bool | None = None

    def __repr__(self) -> str:
        (columns, rows), (x, y) = self.size, self.middle
        return (
            f"<NextView: {columns}×{rows} board at ({x:.0f}, {y:.0f}) px, {self.distance:.2g} m away, tilted by "
            f"{self.tilt:.0f}°, worst {two_digits(self.before)} px before, {two_digits(self.after)} px after>"
        )

    @property
    def worth_saying(self) -> bool:
        """Whether the camera is uncertain somewhere in the frame and this view would reduce it."""
        return self.before >= WORTH_SAYING and self.after <= GAIN * self.before


def next_view(
    calibration: Calibration,
    *,
    distances: Real[Array, " d"] | None = None,
    size: tuple[int, int] | None = None,
    plane: Plane | None = None,
) -> NextView | None:
    """The view that would reduce the projection uncertainty over the frame most, above all where it is large; None if
    no candidate is visible or the camera's covariance is unknown.

    Candidates are boards in 25 places of the frame, at three distances within those of the used views (or at
    `distances` (D,) m), facing the camera or tilted by 30° or 45° in eight directions, with at least half of their
    corners in the frame. `size` (columns, rows) of the board and the `plane` of its labels: by default those of the
    calibration, or of the largest part seen. Each candidate would add its information to that of `calibration.cov`, its
    own pose marginalised; it is scaled by what the used views contributed on average, so that correlated residuals do
    not make the prediction too optimistic. The prediction is of first order: the model is assumed to be right and its
    errors to be small. The choice is among the candidates only, and deterministic.
    """
    check_calibration(calibration)
    distances = _distances(calibration) if distances is None else distances
    forecast = Forecast.of(calibration)
    if not len(distances) or forecast is None:
        return None
    camera, plane, size = calibration.camera, plane or plane_of(calibration), size or _size(calibration)
    every = candidates(camera, size, plane, calibration.spacing, distances)
    board, share = board_corners(size, plane, calibration.spacing)
    seen = in_frame(camera, placed(every.T, board))
    good = seen.mean(axis=1) >= INSIDE
    if not good.any():
        return None
    every, seen = every.take(good), seen[good]
    worst, level = forecast.after(placed(every.T, board), seen * share)
    best = best_of(level, seen.mean(axis=1))
    foreseen = (forecast.before, float(worst[best]), float(forecast.gain(level[best : best + 1])[0]))
    return described(calibration, every, best, size, plane, float(seen[best].mean()), foreseen)


def best_of(after: Real[Array, " c"], inside: Real[Array, " c"]) -> int:
    """Index of the candidate with the lowest uncertainty `after` (C,), or of one that is nearly as good with more of
    the board in the frame, `inside` (C,)."""
    nearly = np.flatnonzero(after <= NEARLY * after.min())
    return int(nearly[np.lexsort([after[nearly], -inside[nearly]])[0]])


def sentence(found: NextView, image_size: tuple[int, int]) -> str:
    """The instruction in words, with its predicted benefit."""
    return (
        f"{place_and_tilt(found, image_size)[:-1]}: the worst projection uncertainty would fall from "
        f"{two_digits(found.before)} px to about {two_digits(found.after)} px."
    )


def place_and_tilt(found: NextView, image_size: tuple[int, int]) -> str:
    """The instruction in words: where to hold the board."""
    share = (found.middle + 0.5) / np.array(image_size)
    col, row = (int(np.clip(s * 3, 0, 2)) for s in share)
    place = "the middle" if (col, row) == (1, 1) else f"the {THIRDS[row][col]}"
    tilt = f"tilted by {found.tilt:.0f}°, its {found.nearer} towards the camera" if found.tilt else "facing the camera"
    part = "" if found.inside > 0.99 else f", partly outside ({found.inside:.0%} of its corners in the frame)"
    return f"Hold the board in {place} of the picture, {found.distance:.2g} m away, {tilt}{part}."


@one_thread()
def advised(calibration: Calibration) -> Calibration:
    """`calibration` with the next picture as the last of its advice, if that would help."""
    found = next_view(calibration)
    if found is None or not found.worth_saying:
        return calibration
    line = f"Next picture: {sentence(found, calibration.camera.image_size)}"
    return replace(calibration, advice=(*calibration.advice, line))


def distances_of(calibration: Calibration) -> Real[Array, " v"]:
    """(V,) m, of the boards' centres from the camera in the used views."""
    seen = []
    for view in calibration.used_views:
        if view.pose is not None:
            middle = flat_points(calibration, view, (view.ij.min(axis=0) + view.ij.max(axis=0)) / 2)
            seen.append(float(np.linalg.norm(view.pose.R[:, :2] @ middle + view.pose.t)))
    return np.array(seen)


def _distances(calibration: Calibration) -> Real[Array, " d"]:
    """(D,) m, of the boards' centres: quantiles over the used views."""
    seen = distances_of(calibration)
    return np.unique(np.quantile(seen, DISTANCES)) if len(seen) else seen


def _size(calibration: Calibration) -> tuple[int, int]:
    """(columns, rows) of the board, or of the largest part of it that was seen, with its longer side along that of the
    frame."""
    boxes = [v.ij.max(axis=0) - v.ij.min(axis=0) + 1 for v in calibration.used_views]
    cols, rows = calibration.size or max(((int(b[0]), int(b[1])) for b in boxes), key=lambda s: s[0] * s[1])
    width, height = calibration.camera.image_size
    return (cols, rows) if (cols >= rows) == (width >= height) else (rows, cols)


def described(
    calibration: Calibration,
    every: Candidates,
    best: int,
    size: tuple[int, int],
    plane: Plane,
    inside: float,
    foreseen: tuple[float, float, float],
) -> NextView:
    """The candidate with the index `best` of a board of `size` (columns, rows); `foreseen`:
    `before`, `after` and `gain`."""
    last = np.array(size) - 1
    box = plane.points(np.array([[0, 0], [last[0], 0], last, [0, last[1]]])) * calibration.spacing
    tilt = float(every.tilt[best])
    return NextView(
        pose=Pose(every.T[best]),
        size=size,
        outline=project(calibration.camera, placed(every.T[best][None], box)[0]),
        middle=every.middle[best],
        inside=inside,
        distance=float(every.distance[best]),
        tilt=tilt,
        nearer=NEARER[int(every.side[best]) * len(NEARER) // SIDES] if tilt else "",
        before=foreseen[0],
        after=foreseen[1],
        gain=foreseen[2],
    )
