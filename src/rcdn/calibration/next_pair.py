"""The pose of the board whose pair of pictures would reduce the uncertainty of two cameras most."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rcdn.calibration.added_pair import PairForecast
from rcdn.calibration.candidates import Candidates, board_corners, candidates, in_frame, placed
from rcdn.calibration.next_view import INSIDE, NextView, best_of, described
from rcdn.calibration.outlines import distances as distances_from
from rcdn.errors import present
from rcdn.geometry import project
from rcdn.types import Array, Calibration, Plane, Pose
from rcdn.types.arrays import Bool, Real
from rcdn.types.calibration import SIDES

ALIKE = 0.04
"""diagonals by which the outline of a wanted board differs from those before, in one of the pictures: twice the
distance below which a picture is refused, since nobody holds a board exactly"""
NO_OUTLINES = np.zeros((0, 4, 2))


@dataclass(frozen=True, eq=False)
class NextPair:
    """Where to hold the board for the next pair of pictures: `views` in the left and the right camera, None for one
    that isn't to see it; `lead` (0 left, 1 right): the camera in whose frame the pose was chosen."""

    views: tuple[NextView | None, NextView | None]
    lead: int

    def __repr__(self) -> str:
        seen = ", ".join(f"{side} {_place(view)}" for side, view in zip(SIDES, self.views, strict=True))
        return f"<NextPair: {seen}, {self.leading.distance:.2g} m away, tilted by {self.leading.tilt:.0f}°>"

    @property
    def leading(self) -> NextView:
        """The view of the leading camera."""
        return present(self.views[self.lead], "the view of the leading camera")


def _place(view: NextView | None) -> str:
    return "not to see it" if view is None else f"at ({view.middle[0]:.0f}, {view.middle[1]:.0f}) px"


def next_pair(
    sides: tuple[Calibration, Calibration],
    forecast: PairForecast,
    size: tuple[int, int],
    plane: Plane,
    distances: tuple[Real[Array, " d"], Real[Array, " e"]],
    common: bool = False,
    taken: tuple[Array, Array] = (NO_OUTLINES, NO_OUTLINES),
) -> NextPair | None:
    """The pose that would reduce the mean uncertainty of the forecast's projections most; None if there is none.

    Candidates are those of `next_view` for both cameras, at `distances` from each. A camera counts if it sees at least
    half of the corners; both count together only if they see the whole board, since a part of a plain board may not
    tell which corner is which; else the one whose candidate it is. `common`: only poses that both see whole.
    None is wanted that all its pictures would show almost as those before, whose outlines in the left and in the right
    camera are `taken` (N, 4, 2), as in `outlines`.
    """
    board, share = board_corners(size, plane, sides[0].spacing)
    every = [
        _in_left(forecast, side, candidates(c.camera, size, plane, c.spacing, distances[side]))
        for side, c in enumerate(sides)
    ]
    lead = np.repeat([0, 1], [len(e.T) for e in every])
    pool = Candidates(
        *(np.concatenate([getattr(e, n) for e in every]) for n in ("T", "middle", "distance", "tilt", "side"))
    )
    points = placed(pool.T, board)
    seen = _seen(forecast, points, lead)
    flat = seen.reshape(len(seen), -1)
    new = ~_repeated(forecast, pool.T, np.asarray(seen.any(axis=2)), (size, plane, sides[0].spacing), taken)
    good = np.flatnonzero((flat.all(axis=1) if common else flat.any(axis=1)) & new)
    if not len(good):
        return None
    pool, seen, lead, points = pool.take(good), seen[good], lead[good], points[good]
    worst, level = forecast.after(points, seen * share)
    best = best_of(level, seen.mean(axis=(1, 2)))
    foreseen = (forecast.before, float(worst[best]), float(forecast.gain(level[best : best + 1])[0]))
    views = [
        _view(
            sides,
            forecast,
            side,
            (pool, best, int(lead[best])),
            (size, plane),
            float(seen[best, side].mean()),
            foreseen,
        )
        for side in (0, 1)
    ]
    return NextPair((views[0], views[1]), int(lead[best]))


def _in_left(forecast: PairForecast, side: int, found: Candidates) -> Candidates:
    """Candidates of the camera `side` with poses in the left one."""
    return replace(found, T=np.linalg.inv(forecast.pair.T) @ found.T) if side else found


def _seen(forecast: PairForecast, points: Real[Array, "c n 3"], lead: Array) -> Bool[Array, "c 2 n"]:
    """(C, 2, N) bool: the corners that count in each picture."""
    left, right = forecast.pair.cameras
    seen = np.stack([in_frame(left, points), in_frame(right, forecast.pair.in_right(points))], axis=1)
    counts = seen.mean(axis=2) >= INSIDE
    alone = counts.all(axis=1) & ~seen.all(axis=(1, 2))
    counts[alone, 1 - lead[alone]] = False
    counts[~counts[np.arange(len(lead)), lead]] = False
    return np.asarray(seen & counts[:, :, None])


def _repeated(
    forecast: PairForecast,
    T: Array,
    counts: Bool[Array, "c 2"],
    board: tuple[tuple[int, int], Plane, float],
    taken: tuple[Array, Array],
) -> Bool[Array, " c"]:
    """(C,) bool: every picture that `counts` of a board at `T` (C, 4, 4) would be like one before."""
    (cols, rows), plane, spacing = board
    box = plane.points(np.array([[0, 0], [cols - 1, 0], [cols - 1, rows - 1], [0, rows - 1]])) * spacing
    points, alike = placed(T, box), ~counts
    for side, camera in enumerate(forecast.pair.cameras):
        xy = project(camera, forecast.pair.in_right(points) if side else points) / float(np.hypot(*camera.image_size))
        for one in taken[side]:
            alike[:, side] |= distances_from(xy, one) < ALIKE
    return np.asarray(alike.all(axis=1))


def _view(
    sides: tuple[Calibration, Calibration],
    forecast: PairForecast,
    side: int,
    chosen: tuple[Candidates, int, int],
    board: tuple[tuple[int, int], Plane],
    inside: float,
    foreseen: tuple[float, float, float],
) -> NextView | None:
    """The view in the camera `side` of the candidate `chosen` (candidates, index, leading camera); None if it isn't to
    see the board."""
    if not inside:
        return None
    (pool, best, lead), (size, plane), calibration = chosen, board, sides[side]
    own = replace(pool, T=forecast.pair.T @ pool.T) if side else pool
    view = described(calibration, own, best, size, plane, inside, foreseen)
    if side == lead:
        return view
    middle = plane.points((np.array(size) - 1) / 2) * calibration.spacing
    centre = view.pose.T_cam_board[:3, :2] @ middle + view.pose.T_cam_board[:3, 3]
    at = project(calibration.camera, centre[None])[0]
    return replace(view, pose=Pose(own.T[best]), middle=at, distance=float(np.linalg.norm(centre)))
