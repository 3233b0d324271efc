"""Image → response → Corners → Boards. Wiring only."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from rcdn.boards import BOARDS, find_boards, find_pieces, has_cells, largest
from rcdn.boards.deltille import find_deltilles
from rcdn.boards.paper import find_boards_paper
from rcdn.config import DetectorConfig
from rcdn.corners import Candidates, candidates_at, find_maxima
from rcdn.corners.response import load_model
from rcdn.corners.six_sector import six_candidates
from rcdn.errors import ConfigError, shown
from rcdn.io import grey_of
from rcdn.precision import sharpen
from rcdn.precision.surroundings import Surroundings
from rcdn.pyramid import (
    View,
    boards_in_picture,
    closer_view,
    corners_in_picture,
    distinct_boards,
    distinct_corners,
    outside,
    pictures_of,
    plainly_seen,
    settled,
    unexplained,
    whole_views,
)
from rcdn.targets.circles import is_circle_grid
from rcdn.targets.glance import Glance, glance_at
from rcdn.types import AprilGrid, Array, Board, Corners, Target, Warnings, allowed
from rcdn.types.shown import drawing, paragraph

FITTED, PER_BOARD = (800, 4000), 100
"""corners of boards that are fitted once more: at least, and a megapixel (photographs have 2,000 a megapixel at most); and how many corners' time
a board takes besides"""
NO_CIRCLES = "not supported: a circle grid (the gaps between its circles are no {} × {} corners)"
MIRRORED = "mirrored: {} has no numbers, since its codes are seen in a mirror; flip the picture"


@dataclass(frozen=True, eq=False)
class Detection:
    """What one picture holds: `corners`, every X-corner above the threshold or in a board; `boards`, the grids, largest first.

    `warnings`: a line for each limit that left something out, since the picture shows more than can be looked at in the time that a picture of
    its size may take, and for what is seen but `not supported` or
    `mirrored`; of a usual photograph there are none.
    """

    corners: Corners
    boards: list[Board]
    warnings: tuple[str, ...] = ()

    def __repr__(self) -> str:
        counts = [(len(self.corners), "corner"), (len(self.boards), "board")]
        counts += [(len(self.warnings), "warning")] * bool(self.warnings)
        return f"<Detection: {', '.join(f'{n} {what}' + 's' * (n != 1) for n, what in counts)}>"

    def _repr_html_(self) -> str:
        """A drawing of all boards, where there are any, and a line for each."""
        lines = [paragraph(line) for line in (repr(self)[1:-1], *(repr(board)[1:-1] for board in self.boards))]
        boards = [(board.xy, board.ij) for board in self.boards]
        return "".join((drawing(self.boards[0].image_size, boards, self.corners.xy) if boards else "", *lines))


class Detector:
    """Finds X-corners and boards. Nobody has to say a board's size.

    `config`: see `DetectorConfig`; default: the preset `auto`. Images: arrays (H, W) grey or (H, W, 3) BGR, 8 or 16 bit or float
    (docs/conventions.md), paths of pictures, or PIL images. Bad input raises RcdnError; a picture without a board gives [] and no error.
    A detector may be used for any number of pictures; the same picture always gives the same bytes, whatever `config.threads`; with the
    preset `auto` and plain boards of squares, on the CPU, on every x86-64 processor (docs/decisions/0020-the-same-bits-on-every-processor.md).
    """

    def __init__(self, config: DetectorConfig | None = None) -> None:
        self.config = DetectorConfig() if config is None else config
        if not isinstance(self.config, DetectorConfig):
            raise ConfigError(f"config must be a DetectorConfig, such as DetectorConfig.paper(), not {shown(config)}")
        if not isinstance(self.config.target, str):
            from rcdn.targets import check_told

            check_told(self.config.target)
        self._model = load_model(self.config.weights, self.config.device)

    def __repr__(self) -> str:
        return f"<Detector {self.config!r} on {self._model.device}>"

    def response(self, image: Any) -> Array:
        """Response map (H, W) float32, ≥ 0: how much each pixel looks like an X-corner."""
        return self._model(grey_of(image), self.config.threads)

    def corners(self, image: Any) -> Corners:
        """X-corners at sub-pixel positions, by falling response."""
        return self.detect(image).corners

    def boards(self, image: Any) -> list[Board]:
        """Recovered boards, the one with most corners first; [] if there is none."""
        return self.detect(image).boards

    def detect(self, image: Any) -> Detection:
        """Corners and boards of one picture at the cost of one."""
        grey, warnings = grey_of(image), Warnings()
        views = whole_views(grey.shape) if self.config.pyramid else whole_views(grey.shape)[:1]
        parts = pictures_of(grey, views)
        looks = [self._look(grey.shape, warnings, views[0], parts[0])]
        strong, known = looks[0].strong, looks[0].boards
        plain = plainly_seen(known, strong, grey.shape)
        rest = [(v, part) for v, part in zip(views[1:], parts[1:], strict=True) if v.scale < 1 or not plain]
        looks += [self._look(grey.shape, warnings, *view, known) for view in rest]
        enlarged = any(view.scale > 1 for view, _ in rest)
        if self.config.pyramid and not enlarged and (closer := closer_view(strong, known, grey.shape)):
            looks.append(self._look(grey.shape, warnings, closer, closer.of(grey)))
        boards = distinct_boards([look.boards for look in looks])
        boards = largest(boards, allowed(grey.size, *BOARDS), "boards", warnings)
        boards = self._identified(grey, boards, looks, warnings)
        inside = [look.corners.take(_members(look.corners, boards)) for look in looks]
        seen = _joint([corners.xy for corners in inside], (0, 2))
        inside += [_unseen(board, seen) for board in boards if board.target is not None]
        whole = [look.corners for look in looks if look.view.scale >= 1]
        corners = distinct_corners([distinct_corners(inside, reach=0), *whole])
        corners = corners.take(_members(corners, boards) | _in_frame(corners.xy, grey.shape))
        if self.config.sharpen is not None and self.config.pattern == "checker":
            sharp = _sharpened(grey, boards, self.config.sharpen.geometry, warnings)
            corners, boards = _moved(corners, boards, sharp), sharp
        return Detection(corners, boards, warnings.texts)

    def _identified(self, grey: Array, boards: list[Board], looks: list[_Look], warnings: Warnings) -> list[Board]:
        """The boards with what their codes say, and what codes make of pieces of boards, if not all boards are seen to be plain; lattices of tags
        only if that is certain, since nothing else tells them from any other pattern.

        It is told of codes that can be read in the mirror image only, and of grids of circles, which are no boards.
        """
        if self.config.pattern == "deltille":
            return boards
        out, plain = [], bool(boards)
        for board in boards:
            glance = glance_at(grey, board) if board.pattern == "checker" else None
            coded = self.config.target != "plain" and (glance is None or glance.may_carry_codes)
            known = self._read(grey, board, warnings) if coded else board
            plain &= not coded
            if known.target is None and self._is_circle_grid(glance):
                warnings.add("circles", NO_CIRCLES.format(*board.size))
            else:
                out.append(known)
        if self.config.target != "plain" and not plain:
            pieces = [piece for look in looks for piece in look.pieces()]
            if pieces or any(board.target is not None for board in out):
                from rcdn.targets.pieces import read_pieces

                out = read_pieces(grey, out, pieces, self._told)
        return [board for board in out if board.pattern != "aprilgrid" or board.target is not None]

    def _is_circle_grid(self, glance: Glance | None) -> bool:
        literal = self.config.recovery == "growth"  # the paper tells no kinds apart
        return glance is not None and not literal and is_circle_grid(glance)

    def _read(self, grey: Array, board: Board, warnings: Warnings) -> Board:
        """The board with what its codes say, if they say anything for certain."""
        from rcdn.targets.mirror import mirrored_target  # here: few boards carry codes
        from rcdn.targets.read import identified

        known = identified(grey, board, self._told)
        if known.target is None and (target := mirrored_target(grey, board, self._told)) is not None:
            warnings.add("mirrored", MIRRORED.format(target))
        return known

    @property
    def _told(self) -> Target | None:
        """The only target that boards may be, if it was told."""
        return None if isinstance(self.config.target, str) else self.config.target

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
            boards = find_boards(part, found, self.config.min_corners, max(view.scale, 1.0), warnings, self._tags)
        return replace(_look_of(view, found, boards, shape), pieces=partial(_pieces, view, part, found, boards, shape))

    @property
    def _tags(self) -> bool:
        """Whether lattices of tags are boards, too."""
        return self.config.target == "auto" or isinstance(self.config.target, AprilGrid)

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
        around = _surroundings(grey, board) if fits else None
        fits &= board.pattern == "checker" or around is not None
        out.append(sharpen(grey, board, geometry, around) if fits else board)
    if passed:
        warnings.add("fit", f"{passed:,} corners of boards have no sigma: they are too many for the last fit")
    return out


def _surroundings(grey: Array, board: Board) -> Surroundings | None:
    """What is printed around the corners of a board that was read."""
    if board.target is None:
        return None
    from rcdn.targets.surroundings import surroundings  # here: few boards carry codes

    return surroundings(grey, board)


@dataclass(frozen=True, eq=False)
class _Look:
    """One view: its corners and boards, and the positions `strong` (N, 2) of the surest."""

    view: View
    corners: Corners
    boards: list[Board]
    strong: Array
    pieces: Callable[[], list[Board]] = list
    """what may be pieces of boards among its other corners; only those who read codes ask for it"""


def _pieces(view: View, part: Array, found: Candidates, boards: list[Board], shape: tuple[int, ...]) -> list[Board]:
    """Pieces of boards in a view, in pixels of the picture."""
    return boards_in_picture(view, find_pieces(part, found, boards), shape)


def _look_of(view: View, found: Candidates, boards: list[Board], shape: tuple[int, ...]) -> _Look:
    """What a view of a picture (H, W) shows, in pixels of the picture."""
    corners = corners_in_picture(view, _with_members(found, boards))
    strong = view.to_picture(found.corners.xy)
    return _Look(view, corners, boards_in_picture(view, boards, shape), strong)


def _unseen(board: Board, seen: Array) -> Corners:
    """The corners of a board that are none of those `seen` (N, 2) in views: codes told where to look for them."""
    return Corners(board.xy, board.response, board.status).take(_rows(board.xy, seen) < 0)


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
