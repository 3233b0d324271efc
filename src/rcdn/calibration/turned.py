"""Pictures that were turned by 180° before they got here, as photo programs and camera mounts do.

A turned picture has its principal point on the other side of the picture's middle; nothing else of a camera without
tangential distortion tells it. One camera for all of them has its principal point between both, with a small deviation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rcdn.calibration import robust
from rcdn.calibration.apart import apart_by, calibrate_apart
from rcdn.calibration.bundle import default_free
from rcdn.calibration.influence import (
    LEAST_SCATTER,
    ViewInformation,
    corners_of,
    of_state,
    solved,
    state_of,
)
from rcdn.types import Array, BoardView, Calibration, Camera, Pose
from rcdn.types.arrays import Bool, Real

ENOUGH = 6
"""least number of used views for the test"""
GAIN = (0.75, 10.0)
"""least gain of the likelihood for each view and in all, in units of the views' scatter. If none is turned and the
principal point is in the middle of the picture, the most likely choice gains that much in one of a hundred sets"""
MARGIN = 10.0
"""least gain of each turned view, turned back, in the same units: of seven sets of photographs, some of them turned,
right choices have 20 and more, wrong ones 7 at most"""
BETTER = 0.98
"""× the RMS as the pictures are: the RMS with some of them turned back is below this"""
AS_GOOD = 1.1
"""the same, if more views fit then"""
SURE = 8.0
"""standard deviations of the principal point from the picture's middle, then"""
STARTS, ROUNDS, SOLVED = 8, 20, 6
"""directions of the principal point from which the search begins, most rounds of each, and how often the camera is
solved and the search begun again from there"""
LISTED = 6
"""names of pictures in the finding"""


@dataclass(frozen=True, eq=False)
class TurnedPictures:
    """Pictures `names` that are turned against all others. With these turned back, the RMS is `rms` instead of
    `before`, px, and the camera differs by `difference`, px RMS over the picture after the best rotation."""

    names: tuple[str, ...]
    rms: float
    before: float
    difference: float

    @property
    def finding(self) -> str:
        """Which pictures are turned."""
        more = ", …" if len(self.names) > LISTED else ""
        some = ", ".join(self.names[:LISTED]) + more
        return (
            f"Some pictures are turned by 180° against the others ({len(self.names)}: {some}): with these turned back, "
            f"the RMS is {self.rms:.2g} px instead of {self.before:.2g}."
        )


REMEDY = "Turn them back, as the sensor had them, or leave them out (--leave-out)."


def turned_pictures(calibration: Calibration) -> TurnedPictures | None:
    """The pictures that are turned by 180° against most others; None if there are none, the views don't tell, or the
    calibration left them out."""
    used, out = calibration.used_views, [v for v in calibration.left_out if v.pose is not None]
    if len(used) < ENOUGH or any(v.pose is None for v in used):
        return None
    views = [*used, *(replace(v, used=np.ones(len(v), bool), reason="") for v in out)]
    plain = _without_correction(calibration)
    turned = _search(replace(plain, shape=None), views)  # the shape is a compromise, too, if some pictures are turned
    if turned is None:
        return None
    size = calibration.camera.image_size
    before, after = (calibrate_apart(plain, some, some) for some in (views, _arranged(views, turned, size)))
    if before is None or after is None or after.views < before.views:
        return None
    if after.rms > (BETTER if after.views == before.views else AS_GOOD) * before.rms:
        return None
    if (np.abs(_negated(after.camera)[2:4]) < SURE * after.std[2:4]).all():
        return None
    if not turned[: len(used)].any():
        return None
    names = tuple(dict.fromkeys(v.name for v, t in zip(views, turned, strict=True) if t))
    return TurnedPictures(names, after.rms, before.rms, apart_by(calibration.camera, after.camera))


def _without_correction(calibration: Calibration) -> Calibration:
    camera = calibration.camera
    if camera.correction is None:
        return calibration
    many = len(calibration.cov)
    kept = np.r_[: camera.coefficients, many - 6 : many]
    return replace(calibration, camera=replace(camera, correction=None), cov=calibration.cov[np.ix_(kept, kept)])


def _search(calibration: Calibration, views: Sequence[BoardView]) -> Bool[Array, " v"] | None:
    """(V,) bool: the views that are turned, at most half; None if none are, or if one of them isn't sure."""
    size = calibration.camera.image_size
    info, negated = _information(calibration, views)
    turned = _most_likely(info, negated)
    if _gain(info, negated, turned) < GAIN[0] * len(views) + GAIN[1]:
        return None
    for _ in range(SOLVED):
        info, negated = _information(calibration, _arranged(views, turned, size))
        if not (again := _most_likely(info, negated)).any():
            break
        turned ^= again
    if 2 * turned.sum() > len(turned):
        turned = ~turned
    none = np.zeros(len(turned), bool)
    step = _step(info, negated, none)
    margin = (_gains(info, negated, step, none) - _gains(info, negated, step, ~none)) / _scatter(info)
    return turned if turned.any() and (margin[turned] >= MARGIN).all() else None


def _negated(camera: Camera) -> Real[Array, " p"]:
    """(P,) the parameters that a turn by 180° changes to their negatives: the principal point from the picture's
    middle, and tangential distortion; NaN for all others."""
    out = np.full(len(camera.parameters), np.nan)
    out[2:4] = camera.parameters[2:4] - (np.array(camera.image_size) - 1) / 2
    for k, name in enumerate(camera.parameter_names[: camera.coefficients]):
        if name in ("p1", "p2"):
            out[k] = camera.parameters[k]
    return out


def _arranged(views: Sequence[BoardView], turned: Bool[Array, " v"], image_size: tuple[int, int]) -> list[BoardView]:
    """The views, those that are `turned` (V,) turned back."""
    return [_turned(v, image_size) if t else v for v, t in zip(views, turned, strict=True)]


def _information(calibration: Calibration, views: Sequence[BoardView]) -> tuple[ViewInformation, Real[Array, " p"]]:
    """The contribution of each of the `views`, and the `_negated` parameters, at the camera that they give."""
    corners, sigma = corners_of(calibration, views, [v.used for v in views])
    state = state_of(calibration, views)
    state, noise = robust.initial_fit(state, corners, sigma, default_free(state))
    info = of_state(state, corners, 1 / np.sqrt(np.maximum(noise**2 + sigma**2, LEAST_SCATTER**2)))
    return info.at_optimum(), _negated(state.cameras[0])


def _turned(view: BoardView, image_size: tuple[int, int]) -> BoardView:
    """The view in the picture turned by 180°: x → width − 1 − x, y → height − 1 − y, and the pose about the camera's
    axis."""
    pose = view.pose
    if pose is not None:
        pose = Pose(np.diag([-1.0, -1, 1, 1]) @ pose.T_cam_board)
    return replace(view, xy=np.array(image_size) - 1.0 - view.xy, pose=pose, residuals=-view.residuals)


def _most_likely(info: ViewInformation, negated: Real[Array, " p"]) -> Bool[Array, " v"]:
    """(V,) bool: which views are turned, by the most likely camera and the most likely choice for each view, linearised
    at the solution; not more than half. `negated` (P,): the solution's `_negated` parameters."""
    best, most = np.zeros(len(info), bool), 0.0
    for angle in np.arange(STARTS) * np.pi / STARTS:
        turned = info.score[:, 2:4] @ (np.cos(angle), np.sin(angle)) < 0
        for _ in range(ROUNDS):
            again = _choose(info, negated, _step(info, negated, turned))
            if (again == turned).all():
                break
            turned = again
        if (gain := _gains(info, negated, _step(info, negated, turned), turned).sum()) > most:
            best, most = turned, gain
    return ~best if 2 * best.sum() > len(best) else best


def _gain(info: ViewInformation, negated: Array, turned: Bool[Array, " v"]) -> float:
    """The gain of the likelihood over no turned picture, in units of the views' scatter: their errors are larger than
    those of corners, and correlated."""
    none = np.zeros(len(turned), bool)
    some, without = (_gains(info, negated, _step(info, negated, t), t).sum() for t in (turned, none))
    return float((some - without) / _scatter(info))


def _scatter(info: ViewInformation) -> float:
    """The views' squared errors ÷ those that their corners let expect."""
    squares = np.einsum("vp,vp->v", info.score, solved(info.information, info.score))
    return max(float(squares.mean()) / info.score.shape[1], 1e-12)


def _signs(negated: Array, turned: Bool[Array, " v"]) -> Real[Array, "v p"]:
    """(V, P) −1 for the `_negated` parameters of turned views, else 1."""
    return np.where(turned[:, None] & np.isfinite(negated), -1.0, 1.0)


def _gains(info: ViewInformation, negated: Array, step: Array, turned: Bool[Array, " v"]) -> Real[Array, " v"]:
    """(V,) twice the logarithm of the likelihood of each view, less that at the solution, if the parameters change by
    `step` (P,), negated ones to it: to its negative in turned views."""
    x = _signs(negated, turned) * step - np.nan_to_num(negated)
    return np.asarray(2 * np.einsum("vp,vp->v", info.score, x) - np.einsum("vp,vpq,vq->v", x, info.information, x))


def _choose(info: ViewInformation, negated: Array, step: Array) -> Bool[Array, " v"]:
    """(V,) bool: which views are more likely turned."""
    every = np.ones(len(info), bool)
    return _gains(info, negated, step, every) > _gains(info, negated, step, ~every)


def _step(info: ViewInformation, negated: Array, turned: Bool[Array, " v"]) -> Real[Array, " p"]:
    """(P,) the most likely `step` of `_gains` for this choice."""
    sign = _signs(negated, turned)
    H = np.einsum("vp,vpq,vq->pq", sign, info.information, sign) + info.prior
    return solved(H, (sign * (info.score + info.information @ np.nan_to_num(negated))).sum(axis=0))
