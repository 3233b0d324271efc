"""Views of several cameras in one least-squares problem: their corners as its arrays, and what a solution makes of
them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from rcdn.calibration.board_points import flat_points, has_shape
from rcdn.calibration.robust import Fit
from rcdn.geometry.order import turn_labels
from rcdn.types import NOT_JUDGED, Array, BoardShape, BoardView, Calibration, Pose, Rig


class Rows(NamedTuple):
    """A row for each of N corners: `frame` and `camera` (N,) numbers, labels `ij` (N, 2), places on the board `flat`
    (N, 3) m, `xy` (N, 2) and `sigma` (N,) px; `shaped` (N,): whether the board's shape applies; `part` (N,) of a set of
    boards."""

    frame: Array
    camera: Array
    ij: Array
    flat: Array
    xy: Array
    sigma: Array
    shaped: Array
    part: Array


class JointViews:
    """Views gathered one after another; `shaped`: the calibration whose board's shape may apply. `rows`: rows of the
    corners by view."""

    def __init__(self, shaped: Calibration) -> None:
        self._shaped, self._parts, self._count = shaped, list[Rows](), 0
        self.rows: dict[tuple[int, int], Array] = {}

    def add(
        self, of: Calibration, name: tuple[int, int], frame: int, camera: int, turn: int = 0, part: int = 0
    ) -> None:
        """Add the view `name` (its camera, its number in `of`), its labels turned by `turn` quarter turns."""
        view = of.views[name[1]]
        ij = turn_labels(view.ij, of.size or (1, 1), turn) if turn else view.ij
        numbers = (np.full(len(view), k) for k in (frame, camera, has_shape(self._shaped, view), part))
        frames, cameras, shaped, parts = numbers
        sigma = np.nan_to_num(view.sigma)
        self._parts.append(Rows(frames, cameras, ij, flat_points(of, view, ij), view.xy, sigma, shaped, parts))
        self.rows[name] = np.arange(self._count, self._count + len(view))
        self._count += len(view)

    def joined(self) -> Rows:
        """The rows of all views."""
        return Rows(*map(np.concatenate, zip(*self._parts, strict=True)))


def solved_view(view: BoardView, ij: Array, rows: Array, T: Array, fit: Fit, reason: str) -> BoardView:
    """The `view`, with labels `ij` (N, 2) of all `rows`, at `T` (4, 4) after a fit; `reason` why it is left out."""
    return replace(view, ij=ij[rows], pose=Pose(T), residuals=fit.residuals[rows], used=fit.used[rows], reason=reason)


def solved_camera(
    before: Calibration, camera: int, views: Sequence[BoardView], fit: Fit, shape: BoardShape | None, cov: Array
) -> Calibration:
    """The calibration of the fit's `camera`, not judged yet."""
    return replace(
        before, camera=fit.state.cameras[camera], views=tuple(views), cov=cov, noise=fit.noise, shape=shape,
        advice=(), verdict=NOT_JUDGED,
    )  # fmt: skip


def camera_jacobian(rig: Rig, camera: int, size: int) -> Array:
    """(P + 6, size): Jacobian of a camera's P parameters and of the boards' mean motion in its axes, by the `size`
    parameters of a joint solution: all lenses, the poses of all cameras but the first, …, and the boards' mean motion
    in the first one's axes."""
    ends = np.cumsum([0, *(len(c.parameters) for c in rig.cameras)])
    mine = np.arange(ends[camera], ends[camera + 1])
    J = np.zeros((len(mine) + 6, size))
    J[np.arange(len(mine)), mine] = 1
    if camera:
        at = ends[-1] + 6 * (camera - 1)
        J[len(mine) :, at : at + 6] = np.eye(6)
    J[len(mine) :, -6:] = rig.motion_to(camera)
    return J


def rms_of(fit: Fit) -> float:
    """Root mean squared residual of the used corners, px."""
    seen = fit.used & np.isfinite(fit.residuals).all(axis=1)
    return float(np.sqrt((fit.residuals[seen] ** 2).sum(axis=1).mean()))
