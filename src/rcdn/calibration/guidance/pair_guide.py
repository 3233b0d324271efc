"""Guidance during the calibration of two cameras that stand side by side: where to hold the board next, which moment to
take, when it is sufficient."""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rcdn.calibration.added_pair import SideForecast
from rcdn.calibration.coded import Spacing
from rcdn.calibration.guidance.arguments import check_accepted, check_by_picture, check_grey, check_of_frame, seconds
from rcdn.calibration.guidance.gates import TAKEN
from rcdn.calibration.guidance.guide import FEWEST_CORNERS, Guide, Look, outcome
from rcdn.calibration.guidance.pair_estimate import Moment, PairKnown, pair_learned
from rcdn.calibration.guidance.pair_progress import BOTH, PairPlan, PairProgress, pair_planned
from rcdn.calibration.guidance.progress import Known, Plan, Progress, Wish
from rcdn.calibration.labels import Size
from rcdn.calibration.next_pair import NO_OUTLINES
from rcdn.calibration.outlines import outline
from rcdn.errors import ConfigError, present
from rcdn.types import SQUARES, Array, Board, Plane

SIDES = ("Left", "Right")
PAIR = "must have the board of the left and of the right picture"


@dataclass(frozen=True, eq=False)
class PairLook:
    """The assessment of a moment: `sides`, that of each camera's frame, and `refused`, `hint`, `take`, `fit` as in
    `Look`, for both together. `used` (2,): which of both boards count."""

    sides: tuple[Look, Look]
    used: tuple[bool, bool]
    refused: str
    hint: str
    take: bool
    fit: float

    def __repr__(self) -> str:
        return f"<PairLook: {outcome(self.take, self.refused, self.hint)}, fit {self.fit:.2f}>"


class PairGuide:
    """As `Guide`, for two cameras that are fixed to one another and see the board at the same moments.

    One criterion from the first pair on: the mean of high power (`added_view.NORM`) of the uncertainties of projections
    over the left frame, over the right frame, and from the left picture into the right one, at the boards' distance and
    infinitely far. The last are what rectified rows and triangulated depths depend on: both lenses and the relative
    pose, with their covariances. The first pair must show the whole board to both cameras; until the pictures alone
    determine the calibration, cameras have the prior of `first_guess`.

    `image_sizes`: (width, height) px of the left and of the right picture; all else as in `Guide`, where `target` px
    is to be reached by all three.
    """

    def __init__(
        self,
        image_sizes: tuple[tuple[int, int], tuple[int, int]],
        spacing: Spacing,
        *,
        model: str = "auto",
        size: Size | None = None,
        target: float = 0.1,
    ) -> None:
        left, right = (_Side(s, spacing, model=model, size=size, target=target) for s in image_sizes)
        self._sides = (left, right)
        self._writing = threading.Lock()
        self._moments: dict[str, Moment] = {}
        self._plan = self._planned({}, None)

    def __getstate__(self) -> dict[str, Any]:
        """Everything but the lock, once no other thread is in `add`."""
        with self._writing:
            return {**vars(self), "_writing": None, "_sides": tuple(map(copy, self._sides))}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state, _writing=threading.Lock())

    @property
    def progress(self) -> PairProgress:
        """The present state of the calibration."""
        return self._plan.progress

    @property
    def size(self) -> Size | None:
        """The board's size (columns, rows) in corners; None if unknown."""
        return self._plan.known.size

    def add(self, boards: Moment, name: str) -> PairProgress:
        """Take the `boards` of one moment, called `name`, and calibrate again; takes up to seconds. Boards that are
        refused leave the guide as it was."""
        return self.add_all({name: boards})

    def add_all(self, moments: Mapping[str, Moment]) -> PairProgress:
        """`add` for several moments by name, with a single calibration: all of them or, if one is refused, none."""
        check_by_picture(moments, "moments")
        for name, boards in moments.items():
            if not _is_pair(boards) or all(b is None for b in boards):
                raise ConfigError(f"{name} {PAIR}, one of them at least")
            self._check(boards, name)
        with self._writing:
            return self._replanned({**self._moments, **moments})

    def remove(self, name: str) -> PairProgress:
        """Remove the moment `name`. Raises ConfigError if there is none."""
        with self._writing:
            check_accepted(name, self._moments)
            return self._replanned({k: b for k, b in self._moments.items() if k != name})

    def look(self, boards: Moment, time: float, greys: Sequence[Array] | None = None) -> PairLook:
        """Judge the boards of one moment, None where there is none; `time` as in `Guide.look`; `greys`: the frames
        (H, W) uint8 (None: their sharpness and exposure are not judged). Raises ConfigError for anything else."""
        self._check(boards, "boards", greys)
        time = seconds(time)
        plan = self._plan
        both = all(b is not None and len(b) >= FEWEST_CORNERS for b in boards)
        for k, side in enumerate(self._sides):
            side.follow(plan, k, both)
        assessments = [
            side.look(board, time, None if greys is None else greys[k])
            for k, (side, board) in enumerate(zip(self._sides, boards, strict=True))
        ]
        if plan.progress.wanted is None:
            return _first(boards, assessments, plan)
        return _later(boards, assessments, plan)

    def _check(self, boards: Moment, name: str, greys: Sequence[Array] | None = None) -> None:
        """Raise ConfigError unless `boards`, called `name`, and `greys` are those of both cameras."""
        if not _is_pair(boards):
            raise ConfigError(f"{name} {PAIR}, None where there is none")
        if greys is not None and not (_is_pair(greys) or (isinstance(greys, np.ndarray) and len(greys) == 2)):
            raise ConfigError("greys must have the frame of the left and of the right camera")
        for k, (side, board) in enumerate(zip(self._sides, boards, strict=True)):
            if board is not None:
                check_of_frame(board, side.wish.image_size, f"{name}[{k}]")
            if greys is not None:
                check_grey(greys[k], side.wish.image_size, f"greys[{k}]")

    def _replanned(self, moments: dict[str, Moment]) -> PairProgress:
        """Plan with the accepted `moments`; if that raises an error, the guide is as it was."""
        plan = self._planned(moments, self._plan.known)
        for side, boards in zip(self._sides, _by_side(moments), strict=True):
            side.hold(boards)
        self._moments, self._plan = moments, plan
        return plan.progress

    def _planned(self, moments: Mapping[str, Moment], before: PairKnown | None) -> PairPlan:
        (left, right), boards = self._sides, _by_side(moments)
        size, plane = self._whole(boards)
        wishes = (left.wish, right.wish)
        known = pair_learned(wishes, list(moments.values()), list(moments), size, plane, before)
        return pair_planned(wishes, known, (left.sharp, right.sharp), (_outlines(boards[0]), _outlines(boards[1])))

    def _whole(self, boards: Sequence[Mapping[str, Board]]) -> tuple[Size | None, Plane]:
        """Size and plane of the whole board, as the accepted `boards` of both cameras show it; size None if unknown."""
        every = [board for mine in boards for board in mine.values()]
        printed = [side.whole(every) for side in self._sides]
        return next((p for p in printed if p[0] is not None), (None, SQUARES))


def _by_side(moments: Mapping[str, Moment]) -> tuple[dict[str, Board], dict[str, Board]]:
    """The boards of the left and of the right camera by the moments' names."""
    left, right = ({n: b for n, m in moments.items() if (b := m[k]) is not None} for k in (0, 1))
    return left, right


def _outlines(boards: Mapping[str, Board]) -> Array:
    """(N, 4, 2) outlines of boards."""
    return np.stack([outline(b) for b in boards.values()]) if boards else NO_OUTLINES


def _is_pair(values: Any) -> bool:
    return isinstance(values, (tuple, list)) and len(values) == 2


def _first(boards: Moment, assessments: Sequence[Look], plan: PairPlan) -> PairLook:
    """Before both have seen the board at once: any still, sharp pair of whole boards is taken."""
    whole = [b is not None and b.complete and len(b) >= FEWEST_CORNERS for b in boards]
    if plan.known.size is not None:
        whole = [
            w and b is not None and sorted(b.size) == sorted(plan.known.size)
            for w, b in zip(whole, boards, strict=True)
        ]
    same = all(whole) and sorted(boards[0].size) == sorted(boards[1].size)  # type: ignore[union-attr]
    refused = _refused(assessments, (True, True)) or ("" if same else "One camera doesn't see the whole board.")
    bare = [replace(x, arrow=None, fit=0.0, gain=0.0, take=False) for x in assessments]
    return PairLook((bare[0], bare[1]), (True, True), refused, "Hold still." if same else BOTH, not refused, 0.0)


def _later(boards: Moment, assessments: Sequence[Look], plan: PairPlan) -> PairLook:
    wanted = present(plan.progress.wanted, "the wanted pose")
    needed = [view is not None for view in wanted.views]
    there = [b is not None and len(b) >= FEWEST_CORNERS for b in boards]
    counts = (needed[0] or there[0], needed[1] or there[1])
    lead = wanted.lead if there[wanted.lead] or not any(there) else 1 - wanted.lead
    refused = _refused(assessments, counts)
    fit = min((x.fit for x, n in zip(assessments, needed, strict=True) if n), default=0.0)
    hint = assessments[lead].hint
    if hint == "Hold still." and not all(there[k] for k in (0, 1) if needed[k]):
        hint = BOTH
    take = not refused and assessments[lead].take
    return PairLook((assessments[0], assessments[1]), (there[0], there[1]), refused, hint, take, fit)


def _refused(assessments: Sequence[Look], counts: tuple[bool, bool]) -> str:
    """Why the moment can't be taken: the first reason of a camera that counts, named if the other one has none."""
    reasons = [x.refused if c else "" for x, c in zip(assessments, counts, strict=True)]
    if any(not r and c for r, c in zip(reasons, counts, strict=True)):  # one of them shows something new
        reasons = ["" if r == TAKEN else r for r in reasons]
    if reasons[0] == reasons[1]:
        return reasons[0]
    return next(f"{side} camera: {why}" for side, why in zip(SIDES, reasons, strict=True) if why)


class _Side(Guide):
    """One of both cameras: judges its frames as `Guide` does, against a plan that is made for both."""

    @property
    def wish(self) -> Wish:
        """What is to be calibrated."""
        return self._wish

    @property
    def sharp(self) -> tuple[float, float]:
        """m: the depth of field, as far as it is known."""
        return self._sharp

    def whole(self, boards: Sequence[Board]) -> tuple[Size | None, Plane]:
        """Size and plane of the whole board, from accepted `boards` of both cameras; size None if unknown."""
        return self._whole(boards)

    def hold(self, boards: dict[str, Board]) -> None:
        """The boards of this camera that were taken."""
        self._boards = boards

    def follow(self, plan: PairPlan, side: int, both: bool) -> None:
        """Judge frames by `plan`; `both`: whether both cameras have found the board."""
        known, forecast, wanted = plan.known, plan.forecast, plan.progress.wanted
        if forecast is None:
            return
        own = Known(known.sides[side], None, known.names, known.size, known.plane)
        view = None if wanted is None else wanted.views[side]
        joint = plan.progress
        progress = Progress(joint.views, None, view, joint.worst, None, joint.target, joint.done, joint.sentence)
        self._plan = Plan(progress, own, SideForecast(forecast, side, both))

    def _planned(self, known: Known) -> Plan:
        return self._plan if known is self._plan.known else super()._planned(known)
