"""Detection in the views of one image: a large image is first processed at half size, and further views only as far as
earlier ones are inconclusive."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from rcdn.boards import count_cells, find_boards, find_pieces
from rcdn.boards.deltille import find_deltilles
from rcdn.boards.of_views import adds_to, distinct_boards, distinct_corners
from rcdn.boards.paper import find_boards_paper
from rcdn.config import DetectorConfig
from rcdn.corners import Candidates, Maxima, candidates_at, find_maxima
from rcdn.corners.adaptive import nearest_pitch
from rcdn.corners.levelled import levelled
from rcdn.corners.refine import saddle_position
from rcdn.corners.response import ResponseModel
from rcdn.corners.sieve import STEEP_FLOOR, STEEP_FLOOR_BESIDE, saddles_by_steepness
from rcdn.corners.six_sector import six_candidates
from rcdn.geometry.rows import joint, rows_among
from rcdn.pyramid import (
    View,
    at_the_frame,
    boards_in_picture,
    closer_view,
    corners_in_picture,
    faint_cells,
    halved_first,
    may_go_on,
    outside,
    pictures_of,
    plainly_seen,
    shown_nearby,
    trace_cells,
    unexplained,
    whole_views,
    without_gaps,
)
from rcdn.types import AprilGrid, Array, Board, Corners, Warnings
from rcdn.types.arrays import Shaped

STRAY = (0.5, 0.005)
"""largest displacement, px + squares, of a corner of the halved view when it is refined in the full image. A corner
that moves further is something else in one of the two, for instance where the edge of a shadow runs close by"""
MORE = 3
"""corners that a board must have more without the picture's light, unless it is complete then: single ones are often
beside something that covers the board"""
HIDDEN, HIDDEN_CELLS = 12, 2
"""fewest strong corners and cells of a view without a board that may be those of a board under hard shadows"""


@dataclass(frozen=True, eq=False)
class ViewResult:
    """Detections in one view, in pixels of the full image: corners, boards, and the positions `strong` (N, 2) of the
    surest corners.

    `response`: the response map, in pixels of the view; `detailed`: whether the corners have the accuracy of the full
    image; `pieces`: a function that returns possible pieces of boards among the other corners, called only by code
    readers; `cells`: a function that counts the cells of linked corners, called only where there is no board.
    """

    view: View
    corners: Corners
    boards: list[Board]
    strong: Array
    response: Array
    detailed: bool
    pieces: Callable[[], list[Board]] = list
    cells: Callable[[], int] = int


@dataclass(frozen=True, eq=False)
class Views:
    """Detection in the views of one image `grey` (H, W), each as it is, or `levelled`: without its light."""

    grey: Array
    model: ResponseModel
    config: DetectorConfig
    warnings: Warnings
    levelled: bool = False

    def results(self) -> list[ViewResult]:
        """Results of all views that had to be processed, the full image first; those of the image without its light
        last, if the others show a board in part, or hardly one."""
        out = self._of_views()
        if not self._looks_twice or self.warnings.texts or not self._is_open(out):
            return out  # what exceeds the limits once isn't looked at twice
        own = [board for result in out for board in result.boards]
        for result in replace(self, levelled=True)._of_views():
            boards = [board for board in result.boards if adds_to(board, own, 1 if board.complete else MORE)]
            out.append(replace(result, boards=boards, detailed=False))
        return out

    @property
    def _looks_twice(self) -> bool:
        """Whether boards with gaps may be looked at again: not if the settings ask for a quick detection, in one view
        or without the last fit, as of frames that are followed live."""
        return self._from_coarse and self.config.pyramid and self.config.sharpen is not None

    def _is_open(self, results: list[ViewResult]) -> bool:
        """Whether there are boards with missing corners; or none, but corners and cells as in a board under hard
        shadows."""
        boards = distinct_boards([result.boards for result in results])
        if boards:
            return not without_gaps(boards)
        return any(len(result.strong) >= HIDDEN and result.cells() >= HIDDEN_CELLS for result in results)

    def _shown(self, part: Shaped[Array, "h w"]) -> Array:
        return levelled(part) if self.levelled else part

    def _of_views(self) -> list[ViewResult]:
        """Results of the views of the image, the full image first."""
        views = whole_views(self.grey.shape) if self.config.pyramid else whole_views(self.grey.shape)[:1]
        parts = dict(zip(views, map(self._shown, pictures_of(self.grey, views)), strict=True))
        out, plain = self._first(parts)
        known, seen = distinct_boards([result.boards for result in out]), [result.view for result in out]
        strong, complete = joint([result.strong for result in out], (0, 2)), known if without_gaps(known) else []
        for view in [view for view in views if view not in seen]:
            if view.scale < 1:
                out.append(self._detect(view, parts[view], complete))
            elif not plain:
                out.append(self._detect(view, parts[view]))
        enlarged = any(result.view.scale > 1 for result in out)
        if self.config.pyramid and not enlarged and (closer := closer_view(strong, known, self.grey.shape)):
            out.append(self._detect(closer, self._shown(closer.of(self.grey)), complete))
        return out

    def _first(self, parts: dict[View, Array]) -> tuple[list[ViewResult], bool]:
        """Results of the full image, and of the halved one if that is processed first; and whether all boards there are
        clearly visible. `parts`: the images of the views, the full image first."""
        views = list(parts)
        half = halved_first(views) if self._from_coarse else None
        if half is None:
            seen = self._detect(views[0], parts[views[0]])
            return [seen], self._plain(seen)
        seen = self._detect(half, parts[half])
        detailed = self._in_detail(seen, parts[views[0]]) if self._plain(seen) else None
        whole = self._detect(views[0], parts[views[0]], [] if detailed is None else seen.boards, seen)
        return [whole, detailed or seen], detailed is not None

    @property
    def _from_coarse(self) -> bool:
        """Whether a coarse view may be processed first: its corners are then refined in the full image with the saddle
        method."""
        config = self.config
        return config.pattern == "checker" and config.recovery == "graph" and config.refine.method == "saddle"

    def _plain(self, seen: ViewResult) -> bool:
        return plainly_seen(seen.boards, seen.strong, self.grey.shape, seen.view.scale)

    def _detect(
        self,
        view: View,
        part: Shaped[Array, "h w"],
        known: list[Board] | None = None,
        coarser: ViewResult | None = None,
    ) -> ViewResult:
        """Result of one view with image `part` (h, w); next to complete boards that are `known`, only what it adds to
        them.

        `coarser`: result of the view at half size, near whose detections there is something to find.
        """
        if self.config.pattern == "deltille":
            return self._triangles(view, part)
        if known:
            result = self._beside(known, view, part, coarser)
            if result is not None:
                return result
        if coarser is None or self.model.cells is None:
            cells = self.model.cells_of(part)
        else:
            cells = _open_cells(part, coarser, shown_nearby(coarser.response, coarser.boards, part.shape), STEEP_FLOOR)
        response, peaks = self._peaks(part, cells)
        return self._recovered(view, part, response, peaks)

    def _beside(self, known: list[Board], view: View, part: Array, coarser: ViewResult | None) -> ViewResult | None:
        """What a view shows apart from known boards; None if these may extend further in it.

        After a `coarser` view this means squares that were too small for it, and corners at the image border.
        """
        if coarser is None:
            shape, cells = None, self.model.cells_of(part)
        else:
            shape = part.shape
            cells = _open_cells(part, coarser, at_the_frame(known, shape), STEEP_FLOOR_BESIDE)
        if cells is not None:
            cells = outside(view, cells, known)
        response, peaks = self._peaks(part, cells)
        strong = peaks.strong(self.config)
        if may_go_on(view, peaks.xy[strong], known, shape):
            return None
        if strong.sum() < 2:  # to extend by a square, a board needs two more corners
            return self._nothing(view, response, peaks.xy[strong])
        left = unexplained(view, peaks.xy, known)
        peaks, strong = peaks.take(left), strong[left]
        if not count_cells(part, candidates_at(part, response, peaks.take(strong), self.config)):
            return self._nothing(view, response, peaks.xy[strong])
        return self._recovered(view, part, response, peaks)

    def _peaks(self, part: Array, cells: Array | None) -> tuple[Array, Maxima]:
        response = self.model(part, self.config.threads, cells=cells)
        return response, find_maxima(response, self.config, cells, self.warnings)

    def _recovered(self, view: View, part: Array, response: Array, peaks: Maxima) -> ViewResult:
        """Corners at the peaks of a view, and the boards among them."""
        found = candidates_at(part, response, peaks, self.config)
        if self.config.recovery == "growth":
            boards = find_boards_paper(part, found, self.config.min_corners)
        else:
            boards = find_boards(
                part, found, self.config.min_corners, max(view.scale, 1.0), self.warnings, self._has_tags
            )
        result = _result(view, found, boards, self.grey.shape, response)
        pieces = partial(_pieces, view, part, found, boards, self.grey.shape)
        return replace(result, pieces=pieces, cells=partial(count_cells, part, found))

    def _nothing(self, view: View, response: Array, strong: Array) -> ViewResult:
        none = Corners(np.zeros((0, 2)), np.zeros(0), np.zeros(0))
        return ViewResult(view, none, [], view.to_picture(strong), response, detailed=True)

    @property
    def _has_tags(self) -> bool:
        """Whether lattices of tags count as boards, too."""
        return self.config.target == "auto" or isinstance(self.config.target, AprilGrid)

    def _triangles(self, view: View, part: Array) -> ViewResult:
        response = self.model(part, self.config.threads)
        peaks = find_maxima(response, self.config, warnings=self.warnings)
        found = six_candidates(part, response, peaks, self.config)
        boards = find_deltilles(part, found, self.config.min_corners, max(view.scale, 1.0))
        return _result(view, found, boards, self.grey.shape, response)

    def _in_detail(self, seen: ViewResult, whole: Shaped[Array, "h w"]) -> ViewResult | None:
        """The result of a reduced view with its corners refined in the `whole` image (H, W); None if a board's corner
        moves too far."""
        before, pitch = seen.corners.xy, nearest_pitch(seen.corners.xy)
        at = np.clip(np.rint(before), 0, np.array(whole.shape[::-1]) - 1).astype(np.int64)
        after = saddle_position(whole, at, self.config.refine.half, pitch)
        stray = ~(np.linalg.norm(after - before, axis=1) <= STRAY[0] + STRAY[1] * pitch)
        rows = [rows_among(board.xy, before) for board in seen.boards]
        if any(stray[row].any() for row in rows):
            return None
        after[stray] = before[stray]
        boards = [replace(board, xy=after[row]) for board, row in zip(seen.boards, rows, strict=True)]
        return replace(seen, corners=replace(seen.corners, xy=after).sort(), boards=boards, detailed=True)


def _open_cells(part: Array, coarser: ViewResult, near: Array, floor: float) -> Array:
    """Cells of the image `part` in which it may show more than its half-size view, `coarser`: those `near` the
    detections there, and those where squares are small for it (`floor`: see `saddles_by_steepness`)."""
    saddles, blunt, steep = saddles_by_steepness(part, floor)
    cells = (saddles & (near | faint_cells(coarser.response, part.shape))) | steep
    return cells if coarser.boards else cells | (blunt & trace_cells(coarser.response, part.shape))


def _pieces(view: View, part: Array, found: Candidates, boards: list[Board], shape: tuple[int, ...]) -> list[Board]:
    """Pieces of boards in a view, in pixels of the full image."""
    return boards_in_picture(view, find_pieces(part, found, boards), shape)


def _result(view: View, found: Candidates, boards: list[Board], shape: tuple[int, ...], response: Array) -> ViewResult:
    """The result of a view of an image (H, W), in pixels of that image."""
    corners = corners_in_picture(view, _with_members(found, boards))
    strong = view.to_picture(found.corners.xy)
    return ViewResult(view, corners, boards_in_picture(view, boards, shape), strong, response, view.scale >= 1)


def _with_members(found: Candidates, boards: list[Board]) -> Corners:
    """The corners above the threshold, and those below it or without a response that belong to a board."""
    xy, status = joint([board.xy for board in boards], (0, 2)), joint([board.status for board in boards], 0)
    row = rows_among(found.all.xy, xy)
    own = np.append(status, np.uint8(0))[row]
    known = replace(found.all, status=np.where(row >= 0, own, found.all.status)).take(found.sure | (row >= 0))
    new = rows_among(xy, found.all.xy) < 0  # corners that were no candidates: found only by completing the boards
    response = joint([board.response for board in boards], 0)
    return distinct_corners([known, Corners(xy[new], response[new], status[new])], reach=0)
