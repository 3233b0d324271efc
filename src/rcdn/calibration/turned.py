"""Pictures that were turned by 180° or mirrored before they got here, as photo programs, camera mounts and the selfie
mode do.

A turned picture has its principal point on the other side of the picture's middle, a mirrored one in one direction
only; nothing else of a camera without tangential distortion tells it, for a mirrored checkerboard is a checkerboard.
One camera for all of them has its principal point between both, with a small deviation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rcdn.calibration import robust
from rcdn.calibration.apart import CameraGroup, apart_by, calibrate_apart, rms_of, significance, without_correction
from rcdn.calibration.board_points import plane_of, side_of
from rcdn.calibration.bundle import default_free
from rcdn.calibration.influence import (
    LEAST_SCATTER,
    ViewInformation,
    corners_of,
    of_state,
    solved,
    state_of,
)
from rcdn.calibration.relative_pose import reversed_in_a_mirror
from rcdn.types import Array, BoardView, Calibration, Camera, Pose
from rcdn.types.arrays import Bool, Real

ENOUGH = 6
"""least number of used views for the test"""
GAIN = (0.75, 10.0)
"""least gain of the likelihood for each view and in all, in units of the views' scatter. If none is turned and the
principal point is in the middle of the picture, the most likely choice gains that much in one of a hundred sets"""
MARGIN = 10.0
"""least gain of each changed view, with the change undone, in the same units: of seven sets of photographs, some of
them turned, right choices have 20 and more, wrong ones 7 at most"""
BETTER = 0.98
"""× the RMS as the pictures are: the RMS with the change of some of them undone is below this"""
AS_GOOD = 1.1
"""the same, if more views fit then"""
SURE = 8.0
"""standard deviations of the principal point from the picture's middle, then"""
STARTS, ROUNDS, SOLVED = 8, 20, 6
"""directions of the principal point from which the search begins, most rounds of each, and how often the camera is
solved and the search begun again from there"""
AGREE = 4.0
"""standard deviations by which the cameras of groups of pictures differ at most, with the change of some undone, if the
change explains that they differ"""
LEAVE_OUT = "--leave-out; in Python leave_out"
"""how pictures are left out"""
EXPLAINED = 0.8
"""least share, then, of the drop in squared residuals from one camera for all to one for each group"""
LISTED = 6
"""names of pictures in the finding"""


@dataclass(frozen=True)
class Change:
    """How pictures differ from the others, `done` and with what remedy, `undo`; `flipped`: which of x and y run the
    other way."""

    done: str
    undo: str
    flipped: tuple[bool, bool]

    @property
    def mirrors(self) -> bool:
        """Whether it takes right for left."""
        return self.flipped[0] != self.flipped[1]


CHANGES = (
    Change("turned by 180°", "turned back", (True, True)),
    Change("mirrored left to right", "mirrored back", (True, False)),
    Change("mirrored top to bottom", "mirrored back", (False, True)),
)


@dataclass(frozen=True, eq=False)
class TurnedPictures:
    """Pictures `names` that underwent one of the `changes`, the most likely one first, against all others. With the
    change undone, the RMS is `rms` instead of `before`, px, in `views` views that agree, and the camera differs by
    `difference`, px RMS over the picture after the best rotation."""

    changes: tuple[Change, ...]
    names: tuple[str, ...]
    rms: float
    before: float
    views: int
    difference: float

    def explains(self, groups: Sequence[CameraGroup]) -> bool:
        """Whether the cameras of these `groups` of pictures agree with the change undone, which each underwent as a
        whole or not at all, and one camera for all then fits about as well as theirs."""
        names = set(self.names)
        if any(names & set(g.names) and not names >= set(g.names) for g in groups):
            return False
        change = self.changes[0]
        back = [replace(g, camera=_camera_undone(g.camera, change)) if names >= set(g.names) else g for g in groups]
        most = self.before**2 - rms_of(groups) ** 2
        return bool(significance(back).max() < AGREE) and self.before**2 - self.rms**2 >= EXPLAINED * most

    @property
    def finding(self) -> str:
        """Which pictures are turned or mirrored."""
        more = ", …" if len(self.names) > LISTED else ""
        some = ", ".join(self.names[:LISTED]) + more
        done = " or ".join(change.done for change in self.changes)
        undo = " or ".join(dict.fromkeys(change.undo for change in self.changes))
        return (
            f"Some pictures are {done} against the others ({len(self.names)}: {some}): with these {undo}, "
            f"the RMS is {self.rms:.2g} px instead of {self.before:.2g}."
        )

    @property
    def remedy(self) -> str:
        """What to do with them."""
        if len(self.changes) > 1:
            return f"Look which it is, and make them as the sensor had them, or leave them out ({LEAVE_OUT})."
        verb = "Mirror" if self.changes[0].mirrors else "Turn"
        return f"{verb} them back, as the sensor had them, or leave them out ({LEAVE_OUT})."


def turned_pictures(calibration: Calibration) -> TurnedPictures | None:
    """The pictures that are turned by 180° or mirrored against most others; None if there are none, the views don't
    tell, or the calibration left them out.

    Of several changes that explain these views, those that do about as well as the best are named: with the principal
    point in the middle of the picture in one direction, a turned picture is like a mirrored one. Codes are not read in
    mirrored pictures, and boards of triangles have no mirrored labels: these can only be turned.
    """
    used, out = calibration.used_views, [v for v in calibration.left_out if v.pose is not None]
    if len(used) < ENOUGH or any(v.pose is None for v in used):
        return None
    views = [*used, *(replace(v, used=np.ones(len(v), bool), reason="") for v in out)]
    plain = without_correction(calibration)
    perfect = replace(plain, shape=None)  # the shape is a compromise, too, if some pictures are turned
    here = _information(perfect, views)
    squares = all(v.target is None for v in views) and plane_of(calibration).pattern == "checker"
    possible = [c for c in CHANGES if squares or not c.mirrors]
    turned = {c: t for c in possible if (t := _search(perfect, views, c, here)) is not None and t[: len(used)].any()}
    # the labels of a board that looks the same after half a turn follow how it lies, and so would its shape
    shaped = plain if calibration.orientation == "unique" else perfect
    before = calibrate_apart(shaped, views, views) if turned else None
    if before is None:
        return None
    found = {c: each for c, t in turned.items() if (each := _better(shaped, views, c, t, before)) is not None}
    if not found:
        return None
    best = min(found, key=lambda c: found[c].rms)
    others = [c for c in possible if c != best and _is_alike(shaped, views, turned[best], c, found[best])]
    return replace(found[best], changes=(best, *others))


def _is_alike(
    calibration: Calibration,
    views: Sequence[BoardView],
    turned: Bool[Array, " v"],
    change: Change,
    best: TurnedPictures,
) -> bool:
    """Whether a `change` explains the `turned` views about as well as the `best` one, and leaves out no more views."""
    arranged = _arranged(calibration, views, change, turned)
    other = calibrate_apart(calibration, arranged, arranged)
    return other is not None and other.views >= best.views and other.rms * BETTER <= best.rms


def _better(
    calibration: Calibration, views: Sequence[BoardView], change: Change, turned: Bool[Array, " v"], before: CameraGroup
) -> TurnedPictures | None:
    """The pictures that underwent the `change`, if the views fit better without it than `before`."""
    arranged = _arranged(calibration, views, change, turned)
    after = calibrate_apart(calibration, arranged, arranged)
    if after is None or after.views < before.views:
        return None
    if after.rms > (BETTER if after.views == before.views else AS_GOOD) * before.rms:
        return None
    sure = np.abs(_negated(after.camera, change)[2:4]) >= SURE * after.std[2:4]
    if not sure.any():
        return None
    names = tuple(dict.fromkeys(v.name for v, t in zip(views, turned, strict=True) if t))
    gap = apart_by(calibration.camera, after.camera)
    return TurnedPictures((change,), names, after.rms, before.rms, after.views, gap)


def _search(
    calibration: Calibration, views: Sequence[BoardView], change: Change, here: tuple[ViewInformation, Camera]
) -> Bool[Array, " v"] | None:
    """(V,) bool: the views that underwent the `change`, at most half; None if none did, or if one of them isn't sure.
    `here`: the `_information` of the views as they are."""
    info, negated = here[0], _negated(here[1], change)
    turned = _most_likely(info, negated)
    if _gain(info, negated, turned) < GAIN[0] * len(views) + GAIN[1]:
        return None
    for _ in range(SOLVED):
        info, camera = _information(calibration, _arranged(calibration, views, change, turned))
        negated = _negated(camera, change)
        if not (again := _most_likely(info, negated)).any():
            break
        turned ^= again
    if 2 * turned.sum() > len(turned):
        turned = ~turned
    none = np.zeros(len(turned), bool)
    step = _step(info, negated, none)
    margin = (_gains(info, negated, step, none) - _gains(info, negated, step, ~none)) / _scatter(info)
    return turned if turned.any() and (margin[turned] >= MARGIN).all() else None


def _negated(camera: Camera, change: Change) -> Real[Array, " p"]:
    """(P,) the parameters that a `change` takes to their negatives: the principal point from the picture's middle, and
    tangential distortion, in the directions that are flipped; NaN for all others."""
    x, y = change.flipped
    flipped = {"cx": x, "p2": x, "cy": y, "p1": y}
    out = np.where([flipped.get(name, False) for name in camera.parameter_names], camera.parameters, np.nan)
    out[2:4] -= (np.array(camera.image_size) - 1) / 2
    return out


def _camera_undone(camera: Camera, change: Change) -> Camera:
    """The camera of pictures whose `change` is undone."""
    negated, parameters = _negated(camera, change), camera.parameters.copy()
    parameters[2:4] -= np.where(change.flipped, 2 * negated[2:4], 0.0)
    tangential = np.isfinite(negated[4:])
    parameters[4:][tangential] *= -1
    return camera.with_parameters(parameters)


def _information(calibration: Calibration, views: Sequence[BoardView]) -> tuple[ViewInformation, Camera]:
    """The contribution of each of the `views` at the camera that they give, and this camera. Of the two poses that a
    plane allows, the calibration has chosen."""
    corners, sigma = corners_of(calibration, views, [v.used for v in views])
    state = state_of(calibration, views)
    state, noise = robust.initial_fit(state, corners, sigma, default_free(state), turn=False)
    info = of_state(state, corners, 1 / np.sqrt(np.maximum(noise**2 + sigma**2, LEAST_SCATTER**2)))
    return info.at_optimum(), state.cameras[0]


def _arranged(
    calibration: Calibration, views: Sequence[BoardView], change: Change, turned: Bool[Array, " v"]
) -> list[BoardView]:
    """The views, the `change` of those that are `turned` (V,) undone."""
    return [_undone(calibration, v, change) if t else v for v, t in zip(views, turned, strict=True)]


def _undone(calibration: Calibration, view: BoardView, change: Change) -> BoardView:
    """The view in the picture whose flipped directions run back: x → width − 1 − x, y → height − 1 − y, and the pose
    likewise. In a mirrored picture the labels of the board ran the wrong way, too."""
    image_size, there = np.array(calibration.camera.image_size), np.array(change.flipped)
    sign = np.where(there, -1.0, 1.0)
    board, ij = np.eye(4), view.ij
    if change.mirrors:
        axis, last = _mirrored_labels(calibration, view)
        ij = ij.copy()
        ij[:, axis] = last - ij[:, axis]
        board[axis, axis], board[axis, 3] = -1.0, last * side_of(calibration, view)
    pose = None if view.pose is None else Pose(np.diag([*sign, 1, 1]) @ view.pose.T_cam_board @ board)
    xy = np.where(there, image_size - 1.0 - view.xy, view.xy)
    return replace(view, ij=ij, xy=xy, pose=pose, residuals=sign * view.residuals)


def _mirrored_labels(calibration: Calibration, view: BoardView) -> tuple[int, int]:
    """Along which axis the labels of a board run the other way in its mirror image, and the last one there."""
    size = calibration.size
    axis = 1 if size is None else reversed_in_a_mirror(size)
    return axis, int(view.ij[:, axis].max()) if size is None or not view.settled else size[axis] - 1


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
