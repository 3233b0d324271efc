"""What the joint solution of several cameras gives: their rig with its covariance, and the calibration of each."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rcdn.calibration import robust
from rcdn.calibration.board_points import plane_of
from rcdn.calibration.rig_task import RigTask
from rcdn.calibration.shape import board_shape
from rcdn.calibration.uncertainty import covariance, with_held
from rcdn.errors import CalibrationError
from rcdn.types import NOT_JUDGED, Array, BoardShape, BoardView, Calibration, Pose, Rig

PATHLESS = "the camera is out of step, and where the board was when it took this picture isn't known"
ODD = "it disagrees with the other cameras on where the board is"


@dataclass(frozen=True, eq=False)
class RigSolution:
    """The `fit` of a `task`, of which the frames `used` agree, with the covariance `cov` (K + 6, K + 6) of all shared
    parameters (lenses, places of the other cameras, then of boards fixed to each other, the cameras' lateness, the
    board's shape; 0 for what was held) and of the boards' mean motion in the first camera. `taken`: (camera, view) →
    T_cam_board (4, 4) of views whose board had moved when they were really taken; `lost`: views for which this isn't
    known."""

    task: RigTask
    fit: robust.Fit
    used: list[int]
    cov: Array
    taken: Mapping[tuple[int, int], Array]
    lost: Collection[tuple[int, int]]

    @classmethod
    def of(
        cls,
        task: RigTask,
        fit: robust.Fit,
        taken: Mapping[tuple[int, int], Array] | None = None,
        lost: Collection[tuple[int, int]] = (),
    ) -> RigSolution:
        """The solution with its covariance. Raises CalibrationError if no board agrees."""
        used = [f for f, reason in enumerate(fit.reasons) if not reason]
        if not used:
            raise CalibrationError("no board agrees with the others: check which pictures belong to one moment")
        cov = with_held(covariance(fit.arrow, np.array(used, int), fit.scale, fit.clustered), fit.free)
        return cls(task, fit, used, cov, taken or {}, lost)

    @property
    def places(self) -> slice:
        """The places of the other cameras among the shared parameters."""
        *lenses, _, _, _ = self.fit.state.counts
        return slice(sum(lenses), sum(lenses) + 6 * (len(lenses) - 1))

    @property
    def rms(self) -> float:
        """Root mean squared residual of the used corners, px."""
        seen = self.fit.used & np.isfinite(self.fit.residuals).all(axis=1)
        return float(np.sqrt((self.fit.residuals[seen] ** 2).sum(axis=1).mean()))

    def rig(self, names: tuple[str, ...]) -> Rig:
        """The cameras by their names, with the covariance of their places."""
        whole = np.zeros((6 * len(names), 6 * len(names)))
        whole[6:, 6:] = self.cov[self.places, self.places]
        state = self.fit.state
        return Rig(names, state.cameras, tuple(Pose(T) for T in state.rig), whole)

    def cameras(self, alone: Sequence[Calibration], rig: Rig) -> list[Calibration]:
        """The calibrations `alone`, those of the task's cameras as solved for jointly; not judged yet."""
        done, shape, noise = list(alone), self._shape(alone[self.task.shape]), self.fit.noise
        for local, c in enumerate(self.task.cameras):
            J = self._jacobian(rig, local)
            views = tuple(self._view(c, k, local, view) for k, view in enumerate(alone[c].views))
            done[c] = replace(
                alone[c], camera=self.fit.state.cameras[local], views=views, cov=J @ self.cov @ J.T, noise=noise,
                shape=shape, advice=(), verdict=NOT_JUDGED,
            )  # fmt: skip
        return done

    def _jacobian(self, rig: Rig, local: int) -> Array:
        """(P + 6, K + 6): Jacobian of the P parameters of the camera of this number, and of the boards' mean motion in
        its axes, by those of `cov`."""
        ends = np.cumsum([0, *self.fit.state.counts])
        mine = np.arange(ends[local], ends[local + 1])
        J = np.zeros((len(mine) + 6, len(self.cov)))
        J[np.arange(len(mine)), mine] = 1
        if local:
            at = self.places.start + 6 * (local - 1)
            J[len(mine) :, at : at + 6] = np.eye(6)
        J[len(mine) :, -6:] = rig.motion_to(local)
        return J

    def _shape(self, shaped: Calibration) -> BoardShape | None:
        """The shape of the board that all cameras saw."""
        if not len(self.fit.state.shape) or shaped.size is None:
            return None
        return board_shape(self.fit.state.shape, shaped.size, plane_of(shaped))

    def _view(self, camera: int, k: int, local: int, view: BoardView) -> BoardView:
        """A camera's view after the joint solution, in which the camera has the number `local`."""
        task, fit, name = self.task, self.fit, (camera, k)
        rows = task.rows.get(name)
        if rows is None:
            return replace(view, reason=ODD, used=np.zeros(len(view), bool)) if name in task.turned.odd else view
        T = self.taken[name] if name in self.taken else fit.state.rig[local] @ task.pose(fit.state, camera, k)
        reason = fit.reasons[int(task.corners.frame[rows[0]])]
        reason = reason or (PATHLESS if name in self.lost else "" if fit.used[rows].any() else ODD)
        ij, gaps, used = task.ij[rows], fit.residuals[rows], fit.used[rows]
        return replace(view, ij=ij, pose=Pose(T), residuals=gaps, used=used, reason=reason)
