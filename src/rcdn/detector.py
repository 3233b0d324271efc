"""Image → response → Corners → Boards. Wiring only."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rcdn.boards import BOARDS, find_boards, has_cells, largest
from rcdn.boards.deltille import find_deltilles
from rcdn.boards.paper import find_boards_paper
from rcdn.config import DetectorConfig
from rcdn.corners import Candidates, candidates_at, find_maxima
from rcdn.corners.response import load_model
from rcdn.corners.six_sector import six_candidates
from rcdn.errors import ConfigError, shown
from rcdn.io import as_grey
from rcdn.precision import sharpen
from rcdn.pyramid import (
    View,
    boards_in_picture,
    closer_view,
    corners_in_picture,
    distinct_boards,
    distinct_corners,
    outside,
    pictures_of,
    settled,
    unexplained,
    whole_views,
)
from rcdn.types import Array, Board, Corners, Warnings, allowed
from rcdn.types.ranges import grid_size

FITTED, PER_BOARD = (800, 4000), 100
"""corners of boards that are fitted once more: at least, and a megapixel (photographs have 2,000 a megapixel at most); and how many corners' time
a board takes besides"""


@dataclass(frozen=True, eq=False)
class Detection:
    """What one picture holds: `corners`, every X-corner above the threshold or in a board; `boards`, the grids, largest first.

    `warnings`: a line for each limit that left something out, since the picture shows more than can be looked at in the time that a picture of
    its size may take; of a usual photograph there are none.
    """

    corners: Corners
    boards: list[Board]
    warnings: tuple[str, ...] = ()


class Detector:
    """Finds X-corners and boards. Nobody has to say a board's size.

    `config`: see `DetectorConfig`; default: the preset `auto`. Images: (H, W) grey or (H, W, 3) BGR, 8 or 16 bit or float
    (docs/conventions.md). Bad input raises RcdnError; a picture without a board gives [] and no error. A detector may be used for
    any number of pictures; the same picture always gives the same bytes, whatever `config.threads`; with the
    preset `auto` and boards of squares, on the CPU, on every x86-64 processor (docs/decisions/0020-the-same-bits-on-every-processor.md).
    """

    def __init__(self, config: DetectorConfig | None = None) -> None:
        self.config = DetectorConfig() if config is None else config
        if not isinstance(self.config, DetectorConfig):
            raise ConfigError(f"config must be a DetectorConfig, such as DetectorConfig.paper(), not {shown(config)}")
        self._model = load_model(self.config.weights, self.config.device)

    def response(self, image: Any) -> Array:
        """Response map (H, W) float32, ≥ 0: how much each pixel looks like an X-corner."""
        return self._model(as_grey(image), self.config.threads)

    def corners(self, image: Any) -> Corners:
        """X-corners at sub-pixel positions, by falling response."""
        return self.detect(image).corners

    def boards(self, image: Any) -> list[Board]:
        """Recovered boards, the one with most corners first; [] if there is none."""
        return self.detect(image).boards

    def detect(self, image: Any) -> Detection:
        """Corners and boards of one picture at the cost of one."""
        grey, warnings = as_grey(image), Warnings()
        views = whole_views(grey.shape) if self.config.pyramid else whole_views(grey.shape)[:1]
        parts = pictures_of(grey, views)
        looks = [self._look(grey.shape, warnings, views[0], parts[0])]
        known = looks[0].boards
        looks += [self._look(grey.shape, warnings, *view, known) for view in zip(views[1:], parts[1:], strict=True)]
        if self.config.pyramid and (closer := closer_view(looks[0].strong, looks[0].boards, grey.shape)):
            looks.append(self._look(grey.shape, warnings, closer, closer.of(grey)))
        boards = distinct_boards([look.boards for look in looks])
        boards = largest(boards, allowed(grey.size, *BOARDS), "boards", warnings)
        inside = [look.corners.take(_members(look.corners, boards)) for look in looks]
        whole = [look.corners for look in looks if look.view.scale >= 1]
        corners = distinct_corners([distinct_corners(inside, reach=0), *whole])
        corners = corners.take(_members(corners, boards) | _in_frame(corners.xy, grey.shape))
        if self.config.sharpen is not None and self.config.pattern == "checker":
            sharp = _sharpened(grey, boards, self.config.sharpen.geometry, warnings)
            corners, boards = _moved(corners, boards, sharp), sharp
        return Detection(corners, self._with_targets(grey, boards), warnings.texts)

    def _with_targets(self, grey: Array, boards: list[Board]) -> list[Board]:
        """The boards with what their codes say; lattices of tags only if that is certain, since nothing else tells them from any other pattern."""
        if self.config.target == "plain":
            return boards
        from rcdn.targets import identified  # here: it takes SciPy, whose import is slow

        boards = [identified(grey, board) for board in boards]
        return [board for board in boards if board.pattern != "aprilgrid" or board.target is not None]

    def _look(
        self, shape: tuple[int, ...], warnings: Warnings, view: View, part: Array, known: list[Board] | None = None
    ) -> _Look:
        """What one view, the picture `part` (h, w), shows of the whole (H, W), in pixels of that one.

        A reduced view that shows no more than `known` boards shows nothing.
        """
        if self.config.pattern == "deltille":
            return self._look_for_triangles(part, view, shape, warnings)
        cells = self._model.cells_of(part)
        nothing = _Look(view, Corners(np.zeros((0, 2)), np.zeros(0), np.zeros(0)), [], np.zeros((0, 2)))
        known = known if known and view.scale < 1 and settled(known) else None
        if known and cells is not None and self._is_quiet(part, outside(view, cells, known)):
            return nothing
        response = self._model(part, self.config.threads, cells=cells)
        peaks = find_maxima(response, self.config, cells, warnings)
        if known:
            strong = peaks.take(peaks.strong(self.config))
            left = unexplained(view, strong.xy, known)
            if left is not None and not has_cells(part, candidates_at(part, response, strong.take(left), self.config)):
                return nothing
        found = candidates_at(part, response, peaks, self.config)
        if self.config.recovery == "growth":
            boards = find_boards_paper(part, found, self.config.min_corners)
        else:
            boards = find_boards(
                part, found, self.config.min_corners, max(view.scale, 1.0), warnings, self.config.target == "auto"
            )
        return _look_of(view, found, boards, shape)

    def _is_quiet(self, part: Array, cells: Array) -> bool:
        """Are there fewer strong peaks in some `cells` of a view than the two that a board needs to go on by a square?"""
        response = self._model(part, self.config.threads, cells=cells)
        peaks = find_maxima(response, self.config, cells)
        return int(peaks.strong(self.config).sum()) < 2

    def _look_for_triangles(self, part: Array, view: View, shape: tuple[int, ...], warnings: Warnings) -> _Look:
        response = self._model(part, self.config.threads)
        peaks = find_maxima(response, self.config, warnings=warnings)
        found = six_candidates(part, response, peaks, self.config)
        boards = find_deltilles(part, found, self.config.min_corners, max(view.scale, 1.0))
        return _look_of(view, found, boards, shape)


def _sharpened(grey: Array, boards: list[Board], geometry: bool, warnings: Warnings) -> list[Board]:
    """The boards fitted once more, the largest first, as far as the corners that may be are not used up; the others as they are."""
    left, out, passed = allowed(grey.size, *FITTED), [], 0
    for board in boards:
        fits = len(board) + PER_BOARD <= left
        left -= (len(board) + PER_BOARD) * fits
        passed += len(board) * (not fits)
        out.append(sharpen(grey, board, geometry) if fits and board.pattern == "checker" else board)
    if passed:
        warnings.add("fit", f"{passed:,} corners of boards have no sigma: they are too many for the last fit")
    return out


@dataclass(frozen=True, eq=False)
class _Look:
    """One view: its corners and boards, and the positions `strong` (N, 2) of the surest."""

    view: View
    corners: Corners
    boards: list[Board]
    strong: Array


def _look_of(view: View, found: Candidates, boards: list[Board], shape: tuple[int, ...]) -> _Look:
    """What a view of a picture (H, W) shows, in pixels of the picture."""
    corners = corners_in_picture(view, _with_members(found, boards))
    return _Look(view, corners, boards_in_picture(view, boards, shape), view.to_picture(found.corners.xy))


def _in_frame(xy: Array, shape: tuple[int, ...]) -> Array:
    """(N,) bool: which positions lie on pixels of a picture (H, W); the refinement may lead a little beyond."""
    return np.asarray(((xy >= -0.5) & (xy <= np.array(shape[::-1]) - 0.5)).all(axis=1))


def _members(corners: Corners, boards: list[Board]) -> Array:
    """(N,) bool: which corners are in a board."""
    return _rows(corners.xy, _joint([board.xy for board in boards], (0, 2))) >= 0


def _moved(corners: Corners, before: list[Board], after: list[Board]) -> Corners:
    """The corners with those of boards where their boards have them now, and with their sigma; NaN for the others."""
    xy, sigma = corners.xy.copy(), np.full(len(corners), np.nan)
    row = _rows(_joint([board.xy for board in before], (0, 2)), corners.xy)
    xy[row] = _joint([board.xy for board in after], (0, 2))
    sigma[row] = _joint([np.full(len(b), np.nan) if b.sigma is None else b.sigma for b in after], 0)
    return replace(corners, xy=xy, sigma=sigma).sort()


def _with_members(found: Candidates, boards: list[Board]) -> Corners:
    """The corners above the threshold, and those below it or without a response that are in a board."""
    xy, status = _joint([board.xy for board in boards], (0, 2)), _joint([board.status for board in boards], 0)
    row = _rows(found.all.xy, xy)
    own = np.append(status, np.uint8(0))[row]
    known = replace(found.all, status=np.where(row >= 0, own, found.all.status)).take(found.sure | (row >= 0))
    new = _rows(xy, found.all.xy) < 0  # no candidates before: the boards alone found them
    response = _joint([board.response for board in boards], 0)
    return distinct_corners([known, Corners(xy[new], response[new], status[new])], reach=0)


def _joint(parts: list[Array], empty: int | tuple[int, ...]) -> Array:
    return np.concatenate(parts) if parts else np.zeros(empty)


def _rows(xy: Array, among: Array) -> Array:
    """Row (N,) of each of `xy` (N, 2) in `among` (M, 2), the very same numbers; −1 if it isn't there."""
    wanted, known = (np.ascontiguousarray(a, np.float64).view(np.complex128)[:, 0] for a in (xy, among))
    if not len(known):
        return np.full(len(wanted), -1)
    order = np.argsort(known, kind="stable")
    row = order[np.minimum(np.searchsorted(known, wanted, sorter=order), len(known) - 1)]
    return np.where(known[row] == wanted, row, -1)


def find_chessboard_corners(image: Any, pattern_size: tuple[int, int]) -> tuple[bool, Array | None]:
    """A drop-in for `cv2.findChessboardCorners(image, pattern_size)`: (found, corners (N, 1, 2) float32, row by row).

    `pattern_size`: inner corners (columns, rows). The corners are sub-pixel already. (False, None) where no complete board of that size
    is in the picture. Raises ConfigError for a size under 3×3 and ImageError for an unusable image.
    """
    cols, rows = grid_size(pattern_size, "pattern_size", 3)
    for board in _shared_detector().boards(image):
        grid = board.grid_of((cols, rows)) if board.complete else None
        if grid is not None:
            return True, np.ascontiguousarray(grid.reshape(-1, 1, 2), np.float32)
    return False, None


_shared: list[Detector] = []


def _shared_detector() -> Detector:
    """One detector for all calls, made at the first."""
    if not _shared:
        _shared.append(Detector())
    return _shared[0]
