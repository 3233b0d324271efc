"""Detection at several scales: which views of an image to process.

The network is trained for squares of about 6 to 60 px and blur up to 4 px. A small image whose boards are not clearly
visible, or a part of a large one with tiny squares, is also processed enlarged; a large image also reduced, which
narrows wide blur. Boards are recovered in each view separately (`boards.of_views` has those of all views once).
Positions are returned in pixels of the original image.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from rcdn.boards.of_views import EDGE, SAME, inside, pitch_of
from rcdn.corners.sieve import CELL
from rcdn.geometry.boxes import PointCells
from rcdn.geometry.near import nearest, within
from rcdn.geometry.polygon import deeper, least_depth
from rcdn.types import Array, Board, Corners
from rcdn.types.arrays import Bool, Real, Shaped

SMALL_PICTURE = 330 * 250
"""px; an image up to this size is also processed enlarged, unless its boards are clearly visible"""
PLAIN = 10.0
"""px; from this size of squares on, a board without gaps that the image border does not cut needs no other view"""
NEXT = (0.8, 1.5)
"""squares beyond a board's rim: the nearest and the farthest extent of its next corner together with its
surroundings"""
AROUND = 1.5
"""squares around a board of a coarser view in which the next finer one may show more of it"""
LEAST_REDUCED = 140 * 100
"""px; an image is halved repeatedly as long as at least this size is left"""
MOST_HALVINGS = 3
"""how often a picture is halved"""
PLAIN_REDUCED = 6.0
"""px of a reduced view; like `PLAIN`, for squares that need the full image only for accuracy"""
SURE, SURE_REACH = 0.4, 48
"""response of a coarser view, and radius around it in px of that view, within which the next finer view may show more
of the same board"""
FAINT, FAINT_SIDE, FAINT_SHARE = 0.25, 15, 0.12
"""likewise for squares nearly too small for that view: least response, side of a window, px, and least share of it with
such a response"""
BARE, BARE_SIDE, BARE_SHARE = 0.05, 31, 0.06
"""likewise for blurred squares of 3 to 5 px of that view, where it shows no board: its response there is hardly more
than in textures, so that only cells with blunt saddles count"""
TINY = 8.5
"""px; squares below this size are worth an enlarged view"""
LEAST_TINY = 12
"""fewest strong corners of such density for an enlarged view"""
MOST_ENLARGED = 500 * 400
"""px; largest part of an image that is enlarged"""
BEYOND = (0.3, 1.5)
"""radius, squares + px of the view, around the predicted next corner of a board within which a peak may be that
corner"""
SPECK_PITCH, SPECK = 5.6, 0.1
"""px; a board of smaller squares must span this share of the image diagonal"""


@dataclass(frozen=True)
class View:
    """A part of the image, enlarged or reduced. `box` (x0, y0, x1, y1) px of the image, ends excluded."""

    box: tuple[int, int, int, int]
    scale: float = 1.0

    def of(self, grey: Shaped[Array, "h w"]) -> Array:
        """The view of `grey` (H, W)."""
        x0, y0, x1, y1 = self.box
        part = grey[y0:y1, x0:x1]
        if self.scale == 1:
            return part
        method = cv2.INTER_CUBIC if self.scale > 1 else cv2.INTER_AREA
        size = tuple(max(1, round(n * self.scale)) for n in part.shape[::-1])
        return np.asarray(cv2.resize(part, size, interpolation=method))

    def reduced(self, larger: Array) -> Array:
        """This view of a whole image, computed from a larger view of it."""
        x0, y0, x1, y1 = self.box
        size = tuple(max(1, round(n * self.scale)) for n in (x1 - x0, y1 - y0))
        return np.asarray(cv2.resize(larger, size, interpolation=cv2.INTER_AREA))

    def ratio(self) -> Real[Array, " 2"]:
        """Pixels of the view per pixel of the image, (2,); not exactly `scale`, since views have integer sizes."""
        x0, y0, x1, y1 = self.box
        return np.array([max(1, round(n * self.scale)) / n for n in (x1 - x0, y1 - y0)])

    def to_picture(self, xy: Array) -> Real[Array, "n 2"]:
        """Positions (N, 2) of the view in pixels of the image."""
        if self.scale == 1:
            return np.asarray(xy + np.array(self.box[:2], float))
        return (xy + 0.5) / self.ratio() - 0.5 + np.array(self.box[:2])

    def from_picture(self, xy: Array) -> Real[Array, "n 2"]:
        """The inverse of `to_picture`."""
        return np.asarray((xy - np.array(self.box[:2]) + 0.5) * self.ratio() - 0.5)


def whole_views(shape: tuple[int, ...]) -> list[View]:
    """Views of a whole image (H, W), the full-size one first."""
    height, width = shape[:2]
    box = (0, 0, width, height)
    views = [View(box)]
    if height * width <= SMALL_PICTURE:
        views.append(View(box, 2.0))
    for k in range(1, MOST_HALVINGS + 1):
        if height * width / 4**k >= LEAST_REDUCED:
            views.append(View(box, 0.5**k))
    return views


def closer_view(xy: Real[Array, "n 2"], boards: list[Board], shape: tuple[int, ...]) -> View | None:
    """The part of the image where strong corners `xy` (N, 2) px are as dense as those of tiny squares, enlarged; or
    None.

    Corners that belong to `boards` of larger squares, or lie between their corners, do not count.
    """
    height, width = shape[:2]
    large = [board for board in boards if pitch_of(board) >= TINY] if len(xy) else []
    if large:
        cells, left = PointCells(xy), np.ones(len(xy), bool)
        for board in large:
            rows = cells.inside(board.xy.min(axis=0) - EDGE, board.xy.max(axis=0) + EDGE)
            left[rows] &= ~inside(board, xy[rows])
        xy = xy[left]
    if len(xy) < LEAST_TINY:
        return None
    distance = nearest(xy, xy, 4)[0]
    tiny = xy[(distance[:, 1:] < TINY).sum(axis=1) >= 2]
    if len(tiny) < LEAST_TINY:
        return None
    low, high = np.percentile(tiny, [5, 95], axis=0)
    pad = 0.25 * (high - low) + 4 * TINY
    x0, y0 = np.maximum(np.floor(low - pad), 0).astype(int)
    x1, y1 = np.minimum(np.ceil(high + pad) + 1, [width, height]).astype(int)
    if (x1 - x0) * (y1 - y0) > MOST_ENLARGED:
        return None
    return View((int(x0), int(y0), int(x1), int(y1)), 2.0)


def pictures_of(grey: Shaped[Array, "h w"], views: list[View]) -> list[Array]:
    """Images of the views of a whole image `grey` (H, W). Each reduced one is computed from the previous one, which is
    faster."""
    out: list[Array] = []
    for view in views:
        out.append(view.of(grey) if view.scale >= 1 or not out else view.reduced(out[-1]))
    return out


def without_gaps(boards: list[Board]) -> bool:
    """Whether there are boards, and each is more than two corners wide and has no missing corner inside."""
    return bool(boards) and all(board.complete and min(board.size) > 2 for board in boards)


def halved_first(views: list[View]) -> View | None:
    """The view processed before the full image: the halved one; None for a small image."""
    x0, y0, x1, y1 = views[0].box
    halved = [view for view in views if view.scale == 0.5]
    return halved[0] if halved and (x1 - x0) * (y1 - y0) > SMALL_PICTURE else None


def shown_nearby(response: Real[Array, "h w"], boards: list[Board], shape: tuple[int, ...]) -> Array:
    """Cells (⌈H/4⌉, ⌈W/4⌉) bool of an image (H, W) near the `response` (h, w) and the `boards` of a coarser view."""
    side = 2 * SURE_REACH + 1
    cells = _cells_under(cv2.dilate((response >= SURE).view(np.uint8), np.ones((side, side), np.uint8)), shape)
    for board in boards:
        more = AROUND * pitch_of(board)
        _mark(cells, board.xy.min(axis=0) - more, board.xy.max(axis=0) + more)
    return cells


def faint_cells(response: Real[Array, "h w"], shape: tuple[int, ...]) -> Array:
    """Cells (⌈H/4⌉, ⌈W/4⌉) bool of an image (H, W) where the `response` (h, w) of a coarser view is faint but dense, as
    on squares that are nearly too small for it."""
    return _dense(response, FAINT, FAINT_SIDE, FAINT_SHARE, shape)


def trace_cells(response: Real[Array, "h w"], shape: tuple[int, ...]) -> Array:
    """Cells (⌈H/4⌉, ⌈W/4⌉) bool of an image (H, W) where there is at least a trace of `response` (h, w) of a coarser
    view, as on blurred squares that are too small for it, and in textures."""
    return _dense(response, BARE, BARE_SIDE, BARE_SHARE, shape)


def _dense(response: Real[Array, "h w"], least: float, side: int, share: float, shape: tuple[int, ...]) -> Array:
    """Cells of an image (H, W) around which, in a window of `side` px of the view, at least a `share` of the `response`
    (h, w) is `least` or more."""
    dense = cv2.blur((response >= least).view(np.uint8) * np.uint8(255), (side, side))
    return _cells_under((dense >= round(255 * share)).view(np.uint8), shape)


def _cells_under(mask: Shaped[Array, "h w"], shape: tuple[int, ...]) -> Array:
    """Cells (⌈H/4⌉, ⌈W/4⌉) bool of an image (H, W) whose centres are marked in the `mask` (h, w) uint8 of a view of
    it."""
    at = []
    for fine, coarse in zip(shape, mask.shape, strict=True):
        middle = CELL * np.arange(-(-fine // CELL)) + CELL / 2
        at.append(np.minimum((middle * (coarse / fine)).astype(int), coarse - 1))
    return np.asarray(mask[np.ix_(*at)] > 0)


def plainly_seen(boards: list[Board], strong: Array, shape: tuple[int, ...], scale: float = 1.0) -> bool:
    """Whether there are boards, all without gaps, whose squares need no larger view than that of `scale`, and whose
    rims are real.

    A rim is real if no `strong` corner (N, 2) px lies near the predicted next corners beyond it, and none of these is
    `at_the_frame` of the image (H, W), where only the full image can show them.
    """
    least = PLAIN if scale == 1 else PLAIN_REDUCED / scale
    if not without_gaps(boards) or any(pitch_of(board) < least for board in boards):
        return False
    rim, second, _ = _rims(boards)
    return (
        not (scale == 1 and _at_the_frame(rim, second, shape).any()) and not _answered(strong, rim, second, scale).any()
    )


def at_the_frame(boards: list[Board], shape: tuple[int, ...]) -> Array:
    """Cells (⌈H/4⌉, ⌈W/4⌉) bool of an image (H, W) in which complete `boards` may have further corners so near the
    border that a reduced view would not show them."""
    cells = np.zeros([-(-n // CELL) for n in shape], bool)
    rim, second, _ = _rims(boards)
    some = _at_the_frame(rim, second, shape)
    step = np.linalg.norm(rim - second, axis=1)[some, None]
    middle, reach = (2 * rim - second)[some], BEYOND[0] * step + BEYOND[1]
    for low, high in zip(middle - reach, middle + reach, strict=True):
        _mark(cells, low, high)
    return cells


def _mark(cells: Array, low: Array, high: Real[Array, " 2"]) -> None:
    """Set to True, in place, the `cells` that a box from `low` to `high` (2,) px touches."""
    (x0, y0), (x1, y1) = (np.maximum(n, 0).astype(int) for n in (low // CELL, high // CELL + 1))
    cells[y0:y1, x0:x1] = True


def _at_the_frame(rim: Real[Array, "n 2"], second: Array, shape: tuple[int, ...]) -> Bool[Array, " n"]:
    """(n,) bool: which predicted corners beyond a `rim` (n, 2) px would lie neither half a square or more inside an
    image (H, W) nor outside it."""
    return ~_in_frame(rim + NEXT[1] * (rim - second), shape) & _in_frame(rim + NEXT[0] * (rim - second), shape)


def _in_frame(xy: Array, shape: tuple[int, ...]) -> Bool[Array, " n"]:
    """(N,) bool: which positions (N, 2) px lie in an image (H, W)."""
    return np.asarray(((xy >= 0) & (xy <= np.array(shape[1::-1]) - 1)).all(axis=1))


def _answered(xy: Real[Array, "n 2"], rim: Array, second: Array, scale: float) -> Array:
    """(n,) bool: which of the next corners beyond a `rim` (n, 2) px, extrapolated from the `second` line behind it,
    have one of `xy` (N, 2) px nearby, as detected in a view of `scale`."""
    step = np.linalg.norm(rim - second, axis=1)
    return np.asarray(nearest(xy, 2 * rim - second)[0][:, 0] < BEYOND[0] * step + BEYOND[1] / scale)


def _rims(boards: list[Board]) -> tuple[Array, Array, Array]:
    """The outermost and the second line of corners on all sides of complete boards, (n, 2) px each, and the start of
    each side in them."""
    grids = [g for board in boards for g in (board.grid(), board.grid().swapaxes(0, 1))]
    rims, seconds = [g[k] for g in grids for k in (0, -1)], [g[k] for g in grids for k in (1, -2)]
    return np.concatenate(rims), np.concatenate(seconds), np.cumsum([0, *(len(side) for side in rims[:-1])])


def outside(view: View, cells: Array, boards: list[Board]) -> Array:
    """The `cells` (h / 4, w / 4) bool of a view, of 4×4 px, that lie neither on corners of `boards` nor half a square
    inside their rims."""
    row, column = np.nonzero(cells)
    at = view.to_picture(CELL * np.stack([column, row], axis=1) + (CELL - 1) / 2)
    left, places = np.ones(len(at), bool), PointCells(at)
    for board in boards:
        _clear(left, places, board.grid(), CELL / view.scale)
    corners = np.concatenate([np.zeros((0, 2)), *(board.xy for board in boards)])
    reach = np.repeat([SAME * pitch_of(board) for board in boards], [len(board) for board in boards])
    left[within(at, corners, reach)[1]] = False
    out = np.zeros_like(cells)
    out[row[left], column[left]] = True
    return out


def may_go_on(view: View, xy: Shaped[Array, "n 2"], boards: list[Board], shape: tuple[int, ...] | None = None) -> bool:
    """Whether one of the complete boards of the image may have more corners in a view with strong peaks `xy` (N, 2) px
    of it.

    It may if there are peaks at more than half of the predicted next corners beyond a side; or at one of them that is
    `at_the_frame` of the image of `shape` (H, W), if that is given.
    """
    rim, second, first = _rims(boards)
    close = _answered(view.to_picture(xy), rim, second, view.scale)
    if shape is not None and (close & _at_the_frame(rim, second, shape)).any():
        return True
    return bool((np.add.reduceat(close, first, dtype=int) > 0.5 * np.diff(first, append=len(close))).any())


def unexplained(view: View, xy: Real[Array, "n 2"], boards: list[Board]) -> Array:
    """Which peaks `xy` (N, 2) px of a view are not explained by complete boards of the image, (N,) bool.

    Peaks inside a board's rim are explained. If a view shows the same board again and nothing else, no cell is left
    then: its rim alone has none.
    """
    left = np.ones(len(xy), bool)
    places = PointCells(view.to_picture(xy))
    for board in boards:
        _clear(left, places, board.grid())
    return left


def _clear(left: Bool[Array, " n"], places: PointCells, grid: Array, more: float = 0.0) -> None:
    """Set `left` (N,), in place, to False for those `places` (N, 2) that lie further inside a board's `grid` (rows,
    columns, 2) than half way from its rim to its next inner corners + `more` px."""
    rim = np.concatenate([grid[0], grid[1:, -1], grid[-1, -2::-1], grid[-2:0:-1, 0]])
    rows = places.inside(rim.min(axis=0), rim.max(axis=0))
    left[rows[deeper(rim, places.points[rows], 0.5 * least_depth(rim, grid[1:-1, 1:-1]) + more)]] = False


def boards_in_picture(view: View, boards: list[Board], shape: tuple[int, ...]) -> list[Board]:
    """Boards of a view as boards of the image (H, W), without specks: tiny squares on a small part of it are a
    grille."""
    size = (int(shape[1]), int(shape[0]))
    moved = [replace(b, xy=view.to_picture(b.xy), image_size=size) for b in boards]
    return [b for b in moved if not _speck(b)]


def _speck(board: Board) -> bool:
    span = float(np.linalg.norm(np.ptp(board.xy, axis=0), axis=0))
    return pitch_of(board) < SPECK_PITCH and span < SPECK * float(np.linalg.norm(board.image_size, axis=0))


def corners_in_picture(view: View, corners: Corners) -> Corners:
    """Corners of a view in pixels of the image."""
    return replace(corners, xy=view.to_picture(corners.xy)) if len(corners) else corners
