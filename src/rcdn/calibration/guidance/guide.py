"""Guidance during the calibration of a camera: where to hold the board next, which frame to take, when the calibration
is sufficient."""

from __future__ import annotations

import threading
from collections.abc import Collection, Mapping
from copy import copy
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rcdn.calibration.arguments import check_spacing, given_size
from rcdn.calibration.calibrate import MODELS
from rcdn.calibration.coded import Geometries, Spacing, kind_of
from rcdn.calibration.guidance import gates
from rcdn.calibration.guidance.arguments import check_accepted, check_by_picture, check_grey, check_of_frame, seconds
from rcdn.calibration.guidance.hints import Held, hint
from rcdn.calibration.guidance.progress import Known, Plan, Progress, Wish, learned, planned
from rcdn.calibration.guidance.quality import quality
from rcdn.calibration.guidance.way_up import TURN, upright
from rcdn.calibration.labels import Size
from rcdn.calibration.next_view import NextView, distances_of
from rcdn.calibration.outlines import distances, outline
from rcdn.calibration.start import Seen, poses
from rcdn.errors import ConfigError, RcdnError, shown
from rcdn.geometry import project
from rcdn.types import SQUARES, Array, Board, Plane
from rcdn.types.arrays import Real
from rcdn.types.ranges import whole_size

FEWEST_CORNERS = 12
"""least number of corners of a board"""
FIT = 0.85
"""least agreement with the wanted pose"""
ENOUGH = 0.7
"""share of the wanted view's gain (`NextView.gain`) above which any view is taken"""
OFF = 0.25
"""share of the board's size in the picture: an outline that deviates by as much has an agreement of 0"""
PATIENCE = 30.0
"""s; a board that was in view for that time and not turned upside down will not be"""
GLANCE = 0.5
"""s; most that a frame adds to that time"""
BEYOND = 1.1
"""× (÷) the distance at which a still board is too near (too far) to be sharp: least (greatest) distance of wanted
poses afterwards, but none at which a board was sharp is left out"""


@dataclass(frozen=True, eq=False)
class Look:
    """The assessment of a frame. `refused`: the reason why it cannot be taken, in a sentence, "" if it can. `hint`:
    what to do next. `take`: it is good, and should be taken now. `fit`: agreement of the board with the wanted pose, 0
    to 1. `gain`: share of the wanted view's gain that this one would bring. `arrow`: from the board's centre to the
    wanted one, (2, 2) px, or None."""

    refused: str
    hint: str
    take: bool = False
    fit: float = 0.0
    gain: float = 0.0
    arrow: Array | None = None

    def __repr__(self) -> str:
        return f"<Look: {outcome(self.take, self.refused, self.hint)}, fit {self.fit:.2f}, gain {self.gain:.2f}>"


def outcome(take: bool, refused: str, hint: str) -> str:
    """The outcome of an assessment, in short."""
    return "take it" if take else f"refused, {shown(refused)}" if refused else shown(hint)


class Guide:
    """Guides a person who holds a board in front of a camera, or the camera in front of a board.

    `look` judges every frame, in order, and reports when one should be taken; `add` takes its board and calibrates
    again; `progress` contains the next wanted pose of the board and how far the calibration is. The wanted view is the
    one that reduces the projection uncertainty most where it is large (`rcdn.calibration.next_view`); as long as
    there is no camera, under a prior (`first_guess`). The same frames give the same answers. `look` may be called while
    another thread is in `add` or `remove`; calls of these two wait for one another.

    `image_size` (width, height) px; `spacing` m, lens `model` and board `size` (columns, rows) in corners as in
    `rcdn.calibrate` (by default `size` is taken from the first whole board); `target` px: the worst projection
    uncertainty to reach. Raises RcdnError for a wrong argument.
    """

    def __init__(
        self,
        image_size: tuple[int, int],
        spacing: Spacing,
        *,
        model: str = "auto",
        size: Size | None = None,
        target: float = 0.1,
    ) -> None:
        if not isinstance(spacing, Mapping):
            check_spacing(spacing)
        if model not in MODELS:
            raise ConfigError(f"model must be one of {', '.join(MODELS)}, not {shown(model)}")
        if not (np.isfinite(target) and target > 0):
            raise ConfigError(f"target must be a positive number of pixels, not {shown(target)}")
        self._wish = Wish(whole_size(image_size, "image_size"), spacing, model, float(target))
        self._given = given_size(size)
        self._writing = threading.Lock()
        self._boards: dict[str, Board] = {}
        self._stillness = gates.Stillness()
        self._sharp = (0.0, float("inf"))
        self._turns = True
        self._asked, self._before = 0.0, 0.0
        self._plan = planned(self._wish, learned(self._wish, [], [], self._given, SQUARES))

    def __getstate__(self) -> dict[str, Any]:
        """Everything but the lock, once no other thread is in `add`."""
        with self._writing:
            return {**vars(self), "_writing": None, "_stillness": copy(self._stillness)}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state, _writing=threading.Lock())

    @property
    def progress(self) -> Progress:
        """The present state of the calibration."""
        return self._plan.progress

    def add(self, board: Board, name: str) -> Progress:
        """Take `board` of the picture `name`, and calibrate again; an existing picture of that name is replaced. Takes
        up to seconds. Raises ConfigError for a board that can't be used with the accepted ones, such as one of another
        kind, and leaves the guide as it was."""
        return self.add_all({name: board})

    def add_all(self, boards: Mapping[str, Board]) -> Progress:
        """`add` for several pictures by name, such as those of an earlier session, with a single calibration: all of
        them or, if one is refused, none."""
        check_by_picture(boards, "boards")
        for board in boards.values():
            check_of_frame(board, self._wish.image_size)
        with self._writing:
            every = {**self._boards, **boards}
            return self._replanned(every, *self._whole(every.values()))

    def remove(self, name: str) -> Progress:
        """Remove the picture `name`. Raises ConfigError if there is none."""
        with self._writing:
            check_accepted(name, self._boards)
            rest = {k: b for k, b in self._boards.items() if k != name}
            return self._replanned(rest, *self._whole(rest.values()))

    def look(self, board: Board | None, time: float, grey: Array | None = None) -> Look:
        """Judge the board of the frame at `time`, None if there is none; `grey` (H, W) uint8: the frame, in whose
        pixels the board's corners are given, for its sharpness and exposure (None: they are not judged). `time` s of
        any clock, ascending: after an earlier one, as of a video that starts again, the board must be still anew.
        Raises ConfigError for anything else, such as the list that `Detector.boards` returns."""
        time = seconds(time)
        if board is not None:
            check_of_frame(board, self._wish.image_size)
        if grey is not None:
            check_grey(grey, self._wish.image_size)
        if board is None or len(board) < FEWEST_CORNERS:
            self._stillness.lost()
            why = "No board is seen." if board is None else "Too little of the board is seen."
            return Look(why, "Hold the board in front of the camera.")
        self._learn(board)
        state = self._plan
        now = _Now.of(board, state)
        refused = gates.too_small(board) or self._stillness.moving(board, time) or self._poor(board, now, grey)
        refused = refused or self._of_another_kind(board) or gates.taken(board, self._boards.values())
        wanted = state.progress.wanted
        if wanted is None or now is None:
            return Look(refused, state.progress.sentence or "Hold the whole board in the picture.")
        fit, gain = _fit(board, wanted, state), now.gain
        if self._other_way(board, wanted, time):
            return Look(refused, TURN, False, fit, gain, None)
        worth = gain >= ENOUGH or (fit >= FIT and gain > 0)
        sentence = (
            "Hold still." if worth else hint(now.held, _held_as_wanted(wanted, state), state.known.calibration.camera)
        )
        arrow = np.stack([now.held.middle, wanted.middle])
        return Look(refused, sentence or state.progress.sentence, not refused and worth, fit, gain, arrow)

    def _other_way(self, board: Board, wanted: NextView, time: float) -> bool:
        """Whether the board must be turned upside down first. A person who was shown that for PATIENCE with the board
        in view cannot, and is not asked again."""
        since, self._before = float(np.clip(time - self._before, 0, GLANCE)), time
        if not self._turns or wanted.upright is None:
            return False
        way = upright(board, self._plan.known.size)
        if way == wanted.upright:
            self._asked = 0.0
        if way in (None, wanted.upright):
            return False
        self._asked += since
        if self._asked < PATIENCE or self._writing.locked():
            return True
        with self._writing:
            self._turns = False
            self._plan = self._planned(self._plan.known)
        return False

    def _of_another_kind(self, board: Board) -> str:
        """A board that can't be used with the accepted ones: `add` would refuse it."""
        every = [*self._boards.values(), board]
        if len({kind_of(b) for b in every}) == 1:
            return ""
        try:
            Geometries.of(every, self._wish.spacing, self._given)
        except RcdnError:
            return "This is another kind of board than in the accepted pictures."
        return ""

    def _poor(self, board: Board, now: _Now | None, grey: Array | None) -> str:
        """Blur and exposure of a board that is still; if it is blurred and nearer or farther than all sharp ones, it is
        outside the depth of field."""
        if grey is None:
            return ""
        found = quality(grey, board)
        if why := gates.blurred(board, found):
            self._out_of_focus(now)
            return why
        return gates.poor(found)

    def _out_of_focus(self, now: _Now | None) -> None:
        """Limit the wanted distances on the side of the blurred board at which no sharp one was."""
        known = self._plan.known
        seen = distances_of(known.calibration)
        if now is None or not len(seen) or self._writing.locked():
            return
        here, (least, greatest) = now.held.distance, self._sharp
        if least < here < seen.min():
            least = min(here * BEYOND, float(seen.min()))
        elif seen.max() < here < greatest:
            greatest = max(here / BEYOND, float(seen.max()))
        if (least, greatest) != self._sharp:
            with self._writing:
                self._sharp = least, greatest
                self._plan = self._planned(known)

    def _learn(self, board: Board) -> None:
        """Set the board's size, from the first board that is whole or whose codes contain it."""
        if self._plan.known.size is not None or self._writing.locked():
            return
        size, plane = self._printed(board)
        if size is not None:
            with self._writing:
                self._replanned(self._boards, size, plane)

    def _printed(self, board: Board) -> tuple[Size | None, Plane]:
        """Size and plane of the whole board, from this board or an earlier one; size None if unknown."""
        if self._plan.known.size is not None:
            return self._plan.known.size, self._plan.known.plane
        if self._given is not None:
            return self._given, board.plane
        if board.target is not None:
            return Geometries.of([board], self._wish.spacing).main.size, board.plane
        return (board.size if board.complete else None), board.plane

    def _whole(self, boards: Collection[Board]) -> tuple[Size | None, Plane]:
        """Size and plane of the whole board, from all accepted `boards`: as known, unless their codes say otherwise,
        since they show more of it than was seen before; size None if unknown."""
        printed = [self._printed(board) for board in boards] or [(self._plan.known.size, self._plan.known.plane)]
        size, plane = next((p for p in printed if p[0] is not None), printed[0])
        coded = [board for board in boards if board.target is not None]
        if not coded or self._given is not None:
            return size, plane
        main = Geometries.of(coded, self._wish.spacing).main
        return (size, plane) if size is not None and main.can_be_of(size) else (main.size, coded[0].plane)

    def _replanned(self, boards: dict[str, Board], size: Size | None, plane: Plane) -> Progress:
        """Plan with the accepted `boards`; if that raises an error, the guide is as it was."""
        known = learned(self._wish, list(boards.values()), list(boards), size, plane)
        plan = self._planned(known)
        self._boards, self._plan = boards, plan
        return plan.progress

    def _planned(self, known: Known) -> Plan:
        if not self._turns:
            known = replace(known, way=None, turn=False)
        return planned(self._wish, known, self._sharp)


@dataclass(frozen=True, eq=False)
class _Now:
    """The present pose of the board, `held`, under the current camera, and its `gain` as in `Look`."""

    held: Held
    gain: float

    @classmethod
    def of(cls, board: Board, state: Plan) -> _Now | None:
        """None if no pose fits."""
        points = board.points * state.known.calibration.spacing
        T = poses(state.known.calibration.camera, [Seen(points, board.xy)])[0]
        if not np.isfinite(T).all():
            return None
        seen = np.column_stack([points, 0 * points[:, 0]]) @ T[:3, :3].T + T[:3, 3]
        centre = (seen.min(axis=0) + seen.max(axis=0)) / 2 if state.known.size != board.size else seen.mean(axis=0)
        middle = project(state.known.calibration.camera, centre[None])[0]
        return cls(Held.of(middle, centre, T[:3, :3]), _gain(seen, state))


def _gain(points: Real[Array, "n 3"], state: Plan) -> float:
    """Share of the wanted view's gain that a view of `points` (N, 3) would bring."""
    forecast, wanted = state.forecast, state.progress.wanted
    if forecast is None or wanted is None or not wanted.gain > 0:
        return 0.0
    _, level = forecast.after(points[None], np.ones((1, len(points))))
    return float(forecast.gain(level)[0] / wanted.gain)


def _fit(board: Board, wanted: NextView, state: Plan) -> float:
    """Agreement with the wanted pose: 1 for the same outline, 0 for one that deviates by OFF of its size, and for a
    board that is not seen whole."""
    if sorted(board.size) != sorted(state.known.size or ()):
        return 0.0
    diagonal = float(np.hypot(*board.image_size))
    off = float(distances(wanted.outline[None] / diagonal, outline(board))[0])
    extent = float(np.ptp(wanted.outline, axis=0).max()) / diagonal
    return float(np.clip(1 - off / max(OFF * extent, 1e-9), 0, 1))


def _held_as_wanted(wanted: NextView, state: Plan) -> Held:
    T = wanted.pose.T_cam_board
    middle = state.known.plane.points((np.array(wanted.size) - 1) / 2) * state.known.calibration.spacing
    return Held.of(wanted.middle, T[:3, :2] @ middle + T[:3, 3], T[:3, :3])
