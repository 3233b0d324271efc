"""Result of a calibration: the camera, its uncertainty, and the use of every board."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from rcdn.errors import RcdnError, many, shown
from rcdn.provided import camera_work
from rcdn.types.base import Array, Value, freeze
from rcdn.types.board_shape import BoardShape
from rcdn.types.camera import Camera
from rcdn.types.corners import Orientation
from rcdn.types.named import Named
from rcdn.types.plane import Plane
from rcdn.types.pose import Pose
from rcdn.types.ranges import LABEL, POSITION
from rcdn.types.shown import deviations, paragraph
from rcdn.types.target import Target

Level = Literal["good", "fair", "unsure", "bad"]
LEVELS: tuple[Level, ...] = ("good", "fair", "unsure", "bad")
"""from the best to the worst"""


@dataclass(frozen=True, eq=False)
class BoardView(Value):
    """One board in one picture, as used in a calibration.

    `name` of the picture; `board` its number there (0: the largest). `ij` (M, 2) labels, in the whole board if they are
    `settled`, else in the visible part; `xy` (M, 2) px; `sigma` (M,) standard deviation of the detection, px, NaN where
    unknown.
    `pose`: T_cam_board, metres, or None if none was found. `residuals` (M, 2) observed − projected, px (NaN without a
    pose); `used` (M,) bool, corners used by the calibration; `reason`: why the whole view was excluded, "" if it
    wasn't.
    `target`: the target identified by the board's codes, None for a plain board, and `ids` (M,) the corners' numbers on
    it, −1 where unknown. Labels refer to the board's `plane` (None: unknown, as in files of earlier versions) with
    sides of `spacing` m (None: the calibration's).
    """

    name: str
    board: int
    ij: Array
    xy: Array
    sigma: Array
    pose: Pose | None
    residuals: Array
    used: Array
    reason: str = ""
    settled: bool = True
    target: Target | None = None
    ids: Array | None = None
    plane: Plane | None = None
    spacing: float | None = None

    def __post_init__(self) -> None:
        if self.ids is not None:
            freeze(self, "ids", self.ids, np.int64, ())
        if (self.ids is None) != (self.target is None) or (self.ids is not None and len(self.ids) != len(self.xy)):
            raise RcdnError("BoardView.ids must have one row a corner, and come with a target")
        freeze(self, "ij", self.ij, np.int64, (2,), LABEL)
        freeze(self, "xy", self.xy, np.float64, (2,), POSITION)
        freeze(self, "sigma", self.sigma, np.float64, ())
        freeze(self, "residuals", self.residuals, np.float64, (2,))
        freeze(self, "used", self.used, np.bool_, ())
        if len({len(a) for a in (self.ij, self.xy, self.sigma, self.residuals, self.used)}) != 1:
            raise RcdnError("BoardView.ij, xy, sigma, residuals and used must have one row a corner each")

    def __len__(self) -> int:
        return len(self.xy)

    def __repr__(self) -> str:
        what = f"left out, {self.reason}" if self.reason else f"rms {self.rms:.3g} px"
        return (
            f"<BoardView {shown(self.name)} {self.board}: {many(len(self), 'corner')}, {self.used.sum()} used, {what}>"
        )

    @property
    def rms(self) -> float:
        """Reprojection error of the used corners (of all corners in an excluded view), px; NaN without a pose."""
        return _rms(self.residuals[self.used] if self.used.any() else self.residuals)


@dataclass(frozen=True)
class ModelScore:
    """Scores of one lens model, RMS reprojection errors weighted as in the fit, px: `rms` of the pictures it was fitted
    to, and `held_out` of pictures that it was not (NaN: not evaluated)."""

    model: str
    rms: float
    held_out: float


@dataclass(frozen=True)
class Reason:
    """One check behind a verdict: `key` names the check, `what` the measured quantity; `value` in `unit` (`px`, `°`, a
    `share` of 1, …) and the `limit` that determines `level`: the limit it meets if `good`, else the one it fails
    to meet. NaN: no measurement is possible. `sentence`: the finding; `action`: the recommended action, "" if none is
    needed."""

    key: str
    level: Level
    what: str
    value: float
    limit: float
    unit: str
    sentence: str
    action: str = ""


@dataclass(frozen=True)
class Verdict:
    """Whether to use a calibration: `good`: use it; `fair`: usable with care; `unsure`: the data can't confirm some
    aspect of it; `bad`: don't use it. `reasons`: all checks, the most severe first; `level` is that of the first.
    Without any, it is `NOT_JUDGED`."""

    level: Level
    reasons: tuple[Reason, ...] = ()

    def __repr__(self) -> str:
        if not self.judged:
            return "<Verdict not judged>"
        first = f": {self.reasons[0].sentence}" if self.against else ""
        return f"<Verdict {self.level}, {len(self.against)} of {len(self.reasons)} checks against it{first}>"

    @property
    def judged(self) -> bool:
        """Whether any check was made."""
        return bool(self.reasons)

    @property
    def against(self) -> tuple[Reason, ...]:
        """The checks with a level other than `good`."""
        return tuple(r for r in self.reasons if r.level != "good")


NOT_JUDGED = Verdict("unsure")
"""before the checks, and in files written before calibrations had verdicts"""


@dataclass(frozen=True, eq=False)
class Calibration(Value):
    """A camera with its uncertainty and the data it was calibrated from.

    `camera`; `spacing` m; `views`: all boards in the order of the input, including excluded ones. `cov` (P + 6, P + 6):
    covariance of the P `camera.parameters` and of the boards' mean small motion (rotation vector, rad, and translation,
    m, in camera axes), which projection uncertainty needs. `noise`: standard deviation of the corners along one axis in
    excess of their sigma, px. `models`: the lens models that were compared, the chosen one first; `held_out` is by
    k-fold cross-validation: the camera is calibrated from the other folds, then only poses are solved. `shape` of the
    board, None if it was assumed to be perfect. `size` (columns, rows) of the board in inner corners and its
    `orientation`; None if the views don't determine it. `target`: the target identified by the board's codes, None for
    a plain board. If the views show several targets, `spacing`, `size`, `orientation`, `shape` and `target` are those
    of the target that most views show. `advice`: sentences for the user, the most severe first: the findings of the
    `verdict`, then neutral notes.
    `verdict`: `NOT_JUDGED` before the checks were made.
    """

    camera: Camera
    spacing: float
    views: tuple[BoardView, ...]
    cov: Array
    noise: float
    models: tuple[ModelScore, ...]
    size: tuple[int, int] | None = None
    orientation: Orientation | None = None
    shape: BoardShape | None = None
    advice: tuple[str, ...] = ()
    verdict: Verdict = NOT_JUDGED
    target: Target | None = None

    def __post_init__(self) -> None:
        many = len(self.camera.parameters) + 6
        freeze(self, "cov", self.cov, np.float64, (many,))
        if self.cov.shape != (many, many):
            raise RcdnError(f"Calibration.cov must have shape ({many}, {many}), not {self.cov.shape}")

    def __repr__(self) -> str:
        return f"<Calibration: {level_in_words(self.verdict)}, {self._facts}>"

    def _repr_html_(self) -> str:
        few = self.camera.coefficients
        table = deviations(self.camera.parameter_names[:few], self.camera.parameters[:few], self.std[:few])
        return verdict_html("Calibration", self.verdict) + paragraph(self._facts) + table

    @property
    def _facts(self) -> str:
        width, height = self.camera.image_size
        views = f"{len(self.used_views)} of {many(len(self.views), 'view')}"
        return f"{self.camera.model} {width}×{height} px, rms {self.rms:.3g} px, {views}"

    @property
    def std(self) -> Named:
        """(P,) standard deviations of `camera.parameters`. Also by name: `std["fx"]`."""
        return Named(np.sqrt(np.diag(self.cov)[:-6]), self.camera.parameter_names)

    @property
    def rms(self) -> float:
        """Reprojection error: root of the mean squared length of the used corners' residuals, px."""
        return _rms(np.concatenate([v.residuals[v.used] for v in self.used_views] or [np.zeros((0, 2))]))

    @property
    def held_out(self) -> float:
        """RMS reprojection error, weighted as in the fit, of pictures held out of it, px; NaN if there were too few."""
        return self.models[0].held_out if self.models else float("nan")

    @property
    def used_views(self) -> tuple[BoardView, ...]:
        """The views used by the calibration."""
        return tuple(v for v in self.views if not v.reason)

    @property
    def left_out(self) -> tuple[BoardView, ...]:
        """The excluded views, each with its `reason`."""
        return tuple(v for v in self.views if v.reason)

    @property
    def outliers(self) -> int:
        """Number of excluded corners in the used views."""
        return int(sum((~v.used).sum() for v in self.used_views))


SIDES = ("left", "right")
"""the cameras of a pair"""


@dataclass(frozen=True, eq=False)
class StereoCalibration(Value):
    """Two cameras and their relative pose.

    `left`, `right`: their calibrations after the joint solution, with views in the same order: pair k is
    `left.views[k]` and `right.views[k]`, for so many `pairs` (None: for all that both have); views without a partner
    follow. `T_right_left` (4, 4): takes left camera coordinates to right ones, m; `cov`
    (6, 6): covariance of a small motion applied after it (rotation vector, rad; translation, m). `rms` reprojection
    error of both, px; `epipolar` root mean square distance of the corners from their epipolar lines, px, over both
    pictures (NaN if no corner was seen by both). Rectification, with OpenCV's names: `R_left`, `R_right` (3, 3),
    `P_left`, `P_right` (3, 4), `Q` (4, 4). `advice` and `verdict` as in `Calibration`, for the pair and for each
    camera. `given`: of `left` and `right` those whose lens was given and held constant.
    """

    left: Calibration
    right: Calibration
    T_right_left: Array
    cov: Array
    rms: float
    epipolar: float
    R_left: Array
    R_right: Array
    P_left: Array
    P_right: Array
    Q: Array
    advice: tuple[str, ...] = ()
    verdict: Verdict = NOT_JUDGED
    given: tuple[str, ...] = ()
    pairs: int | None = None

    def __post_init__(self) -> None:
        shapes = {"T_right_left": 4, "cov": 6, "R_left": 3, "R_right": 3, "P_left": 4, "P_right": 4, "Q": 4}
        for name, width in shapes.items():
            freeze(self, name, getattr(self, name), np.float64, (width,))
        if self.given != tuple(side for side in SIDES if side in self.given):
            raise RcdnError(f"given must hold 'left', 'right', both or none, in this order, not {shown(self.given)}")

    def __repr__(self) -> str:
        return f"<StereoCalibration: {level_in_words(self.verdict)}, {self._facts}>"

    def _repr_html_(self) -> str:
        sides = f"{self.left._repr_html_()}{self.right._repr_html_()}"
        return verdict_html("Stereo calibration", self.verdict) + paragraph(self._facts) + sides

    @property
    def _facts(self) -> str:
        return f"baseline {self.baseline:.5g} m, rms {self.rms:.3g} px, epipolar {self.epipolar:.3g} px"

    @property
    def view_pairs(self) -> list[tuple[BoardView, BoardView]]:
        """The pairs of views, a left and a right one each."""
        return list(zip(self.left.views, self.right.views, strict=False))[: self.pairs]

    @property
    def baseline(self) -> float:
        """Distance of the cameras' centres, m."""
        return float(np.linalg.norm(self.T_right_left[:3, 3]))

    def rectify(self, left: Any, right: Any) -> tuple[Array, Array]:
        """Both pictures of one moment, each as `Camera.undistort` takes it, undistorted and turned so that what both
        see lies in the same rows: of the pinhole cameras `P_left` and `P_right`, both of the left camera's size. What
        a camera didn't see is 0. `cv2.reprojectImageTo3D(disparity, Q)` makes points of disparities, m, in the left
        picture's axes. Maps are kept as `Camera.undistort` keeps them.

        Raises ImageError for anything that isn't such a picture, RcdnError for a size other than its camera's.
        """
        pictures: tuple[Array, Array] = camera_work().rectify(self, left, right)
        return pictures


def level_in_words(verdict: Verdict) -> str:
    return verdict.level if verdict.judged else "not judged"


def verdict_html(title: str, verdict: Verdict) -> str:
    """HTML of the verdict with the checks that were not `good`."""
    head = paragraph(f"{title}: {level_in_words(verdict)}", verdict.level if verdict.judged else None)
    return head + "".join(paragraph(f"{reason.sentence} {reason.action}".strip()) for reason in verdict.against)


def _rms(residuals: Array) -> float:
    seen = residuals[np.isfinite(residuals).all(axis=1)]
    return float(np.sqrt((seen**2).sum(axis=1).mean())) if len(seen) else float("nan")
