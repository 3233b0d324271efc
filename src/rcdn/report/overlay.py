"""Overlays: detections drawn over the picture, for visual inspection.

Each board has a colour of its own: thin lines along rows and columns (of a deltille along its three families of lines),
a thicker outline, and a mark at each corner whose shape shows its status. The first corner is a filled disc with its
label; a red arrow shows +i, a green one +j (with letters, for readers who can't distinguish the colours). Corners of
boards with decoded codes are labelled with their ids. Corners that belong to no board are small yellow dots.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np

from rcdn.errors import many
from rcdn.io import as_grey
from rcdn.types import Array, Board, Corners, Pattern, Status

Colour = tuple[int, int, int]

PALETTE: tuple[Colour, ...] = (
    (233, 180, 86),  # sky blue
    (0, 159, 230),  # orange
    (167, 121, 204),  # purple
    (200, 200, 60),  # turquoise
    (0, 110, 230),  # vermilion
    (210, 140, 40),  # blue
)
"""BGR; after Okabe and Ito, lightened for a dark background, without yellow (corners outside boards), red and green
(arrows)."""
YELLOW, RED, GREEN, WHITE, BLACK = (66, 228, 240), (80, 70, 245), (90, 215, 60), (255, 255, 255), (20, 20, 20)
SMALL, COMFORTABLE = 800, 1200
"""A picture whose longer side is below SMALL px is enlarged by an integer factor, to COMFORTABLE px or just above."""
SHIFT = 4
"""Number of fractional bits of sub-pixel positions in OpenCV's drawing functions."""
SMALL_TEXT = 0.72
"""Font size of the corners' ids relative to other text."""
SAME = 0.75
"""Distance up to which a corner is identified with a board's corner, px."""
LEGEND = {
    Status.REFINED: "refined",
    Status.SEED: "not refined",
    Status.LOW_CONFIDENCE: "low confidence",
    Status.COMPLETED: "completed by its board",
}


def draw_overlay(image: Array, corners: Corners, boards: Sequence[Board]) -> Array:
    """Draw `corners` and `boards` (px, pixel centres at integers) over `image`.

    `image` (H, W) grey or (H, W, 3) BGR, any numeric type. Returns (s·H, s·W, 3) BGR uint8; s is 1 unless the picture
    is small (see `enlargement`). A position x is drawn at (x + 0.5)·s − 0.5. Raises ImageError for other shapes.
    """
    grey = _dimmed(image)
    scale = enlargement(grey.shape[1], grey.shape[0])
    if scale > 1:
        grey = cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC)
    canvas = _Canvas(cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR), scale)
    loose = canvas.to_canvas(_loose(corners, boards))
    for xy in loose:
        canvas.disc(xy, 2.6 * canvas.unit, YELLOW)
    for k, board in enumerate(boards):
        if len(board):
            _draw_board(canvas, board, PALETTE[k % len(PALETTE)])
    _draw_legend(canvas, boards)
    everything = np.concatenate([loose, *(canvas.to_canvas(b.xy) for b in boards)])
    for k, board in enumerate(boards):  # captions last, so that no line crosses them
        if len(board):
            xy = canvas.to_canvas(board.xy)
            _draw_caption(canvas, _caption(k + 1, board), xy, everything, PALETTE[k % len(PALETTE)])
    return canvas.image


def enlargement(width: int, height: int) -> int:
    """The integer factor by which a picture of this size, px, is enlarged before drawing."""
    longer = max(width, height)
    return 1 if longer >= SMALL else min(16, -(-COMFORTABLE // longer))


class _Canvas:
    """A picture to draw on with sub-pixel positions; `unit` is the width of a thin line, px."""

    def __init__(self, image: Array, scale: int) -> None:
        self.image = image
        self.scale = scale
        self.extent = float(np.sqrt(image.shape[0] * image.shape[1])) / 900
        self.unit = max(1, round(self.extent))
        self.taken: list[tuple[int, int, int, int]] = []

    def to_canvas(self, xy: Array) -> Array:
        """Positions (N, 2) in the picture as positions on the canvas, where pixel centres are at integers, too."""
        return (np.asarray(xy, dtype=np.float64).reshape(-1, 2) + 0.5) * self.scale - 0.5

    def lines(self, segments: Array, colour: Colour, width: int) -> None:
        """Draw segments (N, 2, 2), each from its first to its second point."""
        fixed = _fixed(np.asarray(segments).reshape(-1, 2, 2))
        cv2.polylines(self.image, list(fixed), False, colour, width, cv2.LINE_AA, SHIFT)

    def disc(self, xy: Array, radius: float, colour: Colour, edge: Colour = BLACK) -> None:
        """Draw a filled disc with a thin edge."""
        at = _point(xy)
        cv2.circle(self.image, at, _length(radius + 0.8 * self.unit), edge, -1, cv2.LINE_AA, SHIFT)
        cv2.circle(self.image, at, _length(radius), colour, -1, cv2.LINE_AA, SHIFT)

    def mark(self, xy: Array, radius: float, status: int, colour: Colour) -> None:
        """Draw the mark of a corner: ring (refined), half ring (low confidence), cross (seed) or diamond
        (completed)."""
        for ink, width in ((BLACK, 3 * self.unit), (colour, self.unit)):  # the dark halo makes it legible on white
            self._mark(xy, radius, status, ink, width)

    def _mark(self, xy: Array, radius: float, status: int, colour: Colour, width: int) -> None:
        if status == Status.SEED:
            a, b = np.array([radius, radius]), np.array([radius, -radius])
            self.lines(np.array([[xy - a, xy + a], [xy - b, xy + b]]), colour, width)
        elif status == Status.COMPLETED:
            tips = xy + 1.25 * radius * np.array([[1, 0], [0, 1], [-1, 0], [0, -1]])
            cv2.polylines(self.image, [_fixed(tips)], True, colour, width, cv2.LINE_AA, SHIFT)
        else:
            arcs = ((0, 360),) if status == Status.REFINED else ((40, 140), (220, 320))
            axes = (_length(radius), _length(radius))
            for start, end in arcs:
                cv2.ellipse(self.image, _point(xy), axes, 0, start, end, colour, width, cv2.LINE_AA, SHIFT)

    def arrow(self, start: Array, end: Array, colour: Colour) -> None:
        """Draw an arrow from `start` to `end`."""
        length = max(float(np.hypot(*(end - start))), 1e-9)
        tip = min(0.35, 9 * self.unit / length)
        for ink, width in ((BLACK, 4 * self.unit), (colour, 2 * self.unit)):
            cv2.arrowedLine(self.image, _point(start), _point(end), ink, width, cv2.LINE_AA, SHIFT, tip)

    def text(self, text: str, xy: Array, colour: Colour, centred: bool = False, size: float = 1.0) -> None:
        """Draw text with a dark halo; `xy` is the left end of the baseline, or the centre if `centred`; `size` relative
        to the usual one."""
        width, height = self.text_size(text, size)
        x, y = (int(v) for v in np.round(xy - (np.array([width, -height]) / 2 if centred else 0)))
        u = self.unit  # shifted copies form the halo: in OpenCV 5 a thicker stroke widens the font
        for dx, dy, ink in ((-u, -u, BLACK), (u, -u, BLACK), (-u, u, BLACK), (u, u, BLACK), (0, 0, colour)):
            cv2.putText(
                self.image, text, (x + dx, y + dy), cv2.FONT_HERSHEY_SIMPLEX, size * self.font, ink, u, cv2.LINE_AA
            )

    @property
    def font(self) -> float:
        """OpenCV's font scale, chosen so that letters are legible when the whole picture is displayed."""
        return 0.5 * max(self.unit, self.extent)

    def text_size(self, text: str, size: float = 1.0) -> tuple[int, int]:
        """(width, height) of a text, px, without descenders."""
        (width, height), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, size * self.font, self.unit)
        return width, height

    def shade(self, x: int, y: int, width: int, height: int) -> None:
        """Darken a rectangle, as a background for text."""
        part = self.image[max(y, 0) : y + height, max(x, 0) : x + width]
        part[:] = part // 4


def _fixed(xy: Array) -> Any:
    """Positions as fixed-point integers, clipped far outside the picture so that they fit into 32 bits."""
    return np.round(np.clip(xy, -1e6, 1e6) * (1 << SHIFT)).astype(np.int32)


def _point(xy: Array) -> tuple[int, int]:
    x, y = _fixed(xy)
    return int(x), int(y)


def _length(value: float) -> int:
    return max(1, round(value * (1 << SHIFT)))


def _dimmed(image: Array) -> Array:
    """The picture as grey (H, W) uint8, mapped to dark and medium grey so that colours stand out; very dark pictures
    are brightened."""
    grey = as_grey(image).astype(np.float32)
    high = float(np.percentile(grey[:: max(1, grey.shape[0] // 500)], 99.5))
    white = 255.0 if 100 <= high <= 255 else max(high * 1.15, 1e-6)
    return np.clip(45 + grey * (150 / white), 45, 195).astype(np.uint8)


def _loose(corners: Corners, boards: Sequence[Board]) -> Array:
    """The corners (K, 2) that belong to no board."""
    used = np.concatenate([np.zeros((0, 2)), *(b.xy for b in boards)])
    if not len(used) or not len(corners):
        return corners.xy
    from scipy.spatial import cKDTree

    distance, _ = cKDTree(used).query(corners.xy)
    return corners.xy[distance > SAME]


def _draw_board(canvas: _Canvas, board: Board, colour: Colour) -> None:
    xy = canvas.to_canvas(board.xy)
    at = {(int(i), int(j)): k for k, (i, j) in enumerate(board.ij)}
    pairs = _neighbours(at, board.pattern)
    segments = xy[np.array(pairs, dtype=int).reshape(-1, 2)]
    lengths = np.hypot(*(segments[:, 1] - segments[:, 0]).T)
    side = float(np.median(lengths)) if pairs else 20.0 * canvas.unit
    radius = float(np.clip(0.2 * side, 2.5 * canvas.unit, 6 * canvas.unit))
    if pairs:
        beside = _triangles_beside if board.pattern == "deltille" else _cells_beside
        outline = np.array([beside(at, board.ij[a], board.ij[b]) < 2 for a, b in pairs])
        bare = _shortened(segments, lengths, radius)
        canvas.lines(bare[~outline], colour, canvas.unit)
        canvas.lines(bare[outline], colour, 2 * canvas.unit)
    for point, status in zip(xy, board.status, strict=True):
        canvas.mark(point, radius, int(status), colour)
    _draw_origin(canvas, board, xy, radius, colour)
    if board.ids is not None:
        _draw_numbers(canvas, board, xy, radius)


def _draw_numbers(canvas: _Canvas, board: Board, xy: Array, radius: float) -> None:
    """Draw the corners' ids, above and to the right of them; if there isn't enough room, those of every k-th column and
    row, and of the four corners of the board."""
    ids = np.asarray(board.ids)
    sizes = [canvas.text_size(str(n), SMALL_TEXT) for n in ids.tolist()]
    width, height = (max(size[k] for size in sizes) for k in (0, 1))
    place = board.ij - board.ij.min(axis=0)
    every = _apart(board.grid() * canvas.scale, width + radius, height + radius)
    ends = [int(np.argmax(place @ direction)) for direction in ((1, 1), (1, -1), (-1, 1), (-1, -1))]
    for k in sorted({*np.flatnonzero((place % every == 0).all(axis=1)).tolist(), *ends}):
        canvas.text(str(ids[k]), xy[k] + (radius, -radius), WHITE, size=SMALL_TEXT)


def _apart(grid: Array, width: float, height: float) -> int:
    """The smallest step between labelled columns and rows of corners `grid` (rows, columns, 2) at which labels of that
    size, px, don't overlap."""
    steps = [d[np.isfinite(d[..., 0])] for d in (np.diff(grid, axis=1), np.diff(grid, axis=0))]
    across, down = (np.median(d, axis=0) if len(d) else np.array([width, height]) for d in steps)
    nearest = np.abs([across, down, across + down, across - down])
    free = np.minimum(width / np.maximum(nearest[:, 0], 1e-9), height / np.maximum(nearest[:, 1], 1e-9))
    return int(np.clip(np.ceil(free.max()), 1, max(grid.shape)))


def _shortened(segments: Array, lengths: Array, radius: float) -> Array:
    """Segments cut off at the marks, so that the picture is visible inside these; at least a fifth of each remains."""
    cut = np.minimum(radius / np.maximum(lengths, 1e-9), 0.4)[:, None] * (segments[:, 1] - segments[:, 0])
    return np.stack([segments[:, 0] + cut, segments[:, 1] - cut], axis=1)


def _neighbours(at: dict[tuple[int, int], int], pattern: Pattern) -> list[tuple[int, int]]:
    """Pairs of indices of neighbouring corners along i or j, of a deltille also along j − i."""
    steps = ((1, 0), (0, 1), (-1, 1)) if pattern == "deltille" else ((1, 0), (0, 1))
    return [(k, at[n]) for (i, j), k in at.items() for d, e in steps if (n := (i + d, j + e)) in at]


def _cells_beside(at: dict[tuple[int, int], int], a: Array, b: Array) -> int:
    """The number of complete squares adjacent to the edge from label `a` to label `b`; an edge with fewer than two is
    part of the outline."""
    (i, j), (di, dj) = (int(v) for v in a), (int(v) for v in b - a)
    sides = ((dj, di), (-dj, -di))  # perpendicular to the edge
    return sum((i + si, j + sj) in at and (i + di + si, j + dj + sj) in at for si, sj in sides)


def _triangles_beside(at: dict[tuple[int, int], int], a: Array, b: Array) -> int:
    """The number of complete triangles adjacent to the edge from label `a` to label `b`: rotating the edge by 60° to
    either side gives their third corners."""
    (i, j), (di, dj) = (int(v) for v in a), (int(v) for v in b - a)
    return ((i - dj, j + di + dj) in at) + ((i + di + dj, j - di) in at)


def _draw_origin(canvas: _Canvas, board: Board, xy: Array, radius: float, colour: Colour) -> None:
    """Draw the first corner, or the visible one nearest to it, with its label, and arrows along +i and +j."""
    first = int(np.lexsort((board.ij[:, 0], board.ij.sum(axis=1)))[0])
    start, middle = xy[first], xy.mean(axis=0)
    ahead = board.ij - board.ij[first]
    for axis, ink, letter in ((0, RED, "i"), (1, GREEN, "j")):
        on_line = np.flatnonzero((ahead[:, 1 - axis] == 0) & (ahead[:, axis] > 0))
        if len(on_line):
            along = xy[on_line[np.argmin(ahead[on_line, axis])]] - start
            canvas.arrow(start, start + 0.85 * along, ink)
            across = _unit_vector(np.array([-along[1], along[0]]))
            outwards = across if across @ (start + along / 2 - middle) > 0 else -across
            canvas.text(letter, start + along / 2 + outwards * 11 * canvas.unit, ink, centred=True)
    canvas.disc(start, 1.3 * radius + canvas.unit, colour, WHITE)
    canvas.disc(start, 0.8 * canvas.unit, BLACK)
    if board.ids is None:  # otherwise its id is drawn beside it
        i, j = board.ij[first]
        outside = start + _unit_vector(start - middle) * (2 * radius + 16 * canvas.unit)
        canvas.text(f"{i},{j}", outside, colour, centred=True)


def _unit_vector(v: Array) -> Array:
    return v / max(float(np.hypot(*v)), 1e-9)


def _caption(number: int, board: Board) -> str:
    """The caption of a board, such as `board 1: 9x6 complete, unique`, in ASCII: OpenCV's older fonts have no other
    characters."""
    if board.target is not None:
        return f"board {number}: {board.target}, {many(len(board), 'corner')}"
    if board.pattern != "checker":
        return f"board {number}: {board.pattern}, {many(len(board), 'corner')}, {board.orientation.replace('_', ' ')}"
    cols, rows = board.size
    whole = "complete" if board.complete else f"partial, {len(board)} of {cols * rows}"
    return f"board {number}: {cols}x{rows} {whole}, {board.orientation.replace('_', ' ')}"


def _draw_caption(canvas: _Canvas, text: str, xy: Array, others: Array, colour: Colour) -> None:
    """Draw the caption of the board with corners `xy` (M, 2) near it, where it hides no other caption and few of the
    corners `others`."""
    width, height = canvas.text_size(text)
    pad = 4 * canvas.unit
    box = width + 2 * pad, height + 2 * pad
    x, y = min(_places(canvas, xy, box), key=lambda at: _covered(canvas, (*at, *box), others))
    canvas.taken.append((x, y, *box))
    canvas.shade(x, y, *box)
    canvas.text(text, np.array([x + pad, y + pad + height]), colour)


def _places(canvas: _Canvas, xy: Array, box: tuple[int, int]) -> list[tuple[int, int]]:
    """Candidate positions (top-left corner) for a caption, best first: above, below, then farther from the board."""
    low, high = xy.min(axis=0), xy.max(axis=0)
    limits = canvas.image.shape[1] - box[0], canvas.image.shape[0] - box[1]
    columns = (low[0], high[0] - box[0], (low[0] + high[0] - box[0]) / 2)
    gaps = [24 * canvas.unit + k * (box[1] + canvas.unit) for k in range(6)]
    rows = [y for gap in gaps for y in (low[1] - gap - box[1], high[1] + gap)]
    return [
        (int(np.clip(x, 0, max(limits[0], 0))), int(np.clip(y, 0, max(limits[1], 0)))) for y in rows for x in columns
    ]


def _covered(canvas: _Canvas, box: tuple[int, int, int, int], xy: Array) -> int:
    """The cost of a caption at `box` (x, y, width, height): the number of hidden corners, plus a large penalty for each
    overlapped caption."""
    x, y, width, height = box
    margin = 6 * canvas.unit
    inside = (np.abs(xy - [x + width / 2, y + height / 2]) < [width / 2 + margin, height / 2 + margin]).all(axis=1)
    return int(inside.sum()) + 10_000 * sum(_overlap(box, other) for other in canvas.taken)


def _overlap(a: tuple[int, int, int, int], b: tuple[int, int, int, int]) -> bool:
    return a[0] < b[0] + b[2] and b[0] < a[0] + a[2] and a[1] < b[1] + b[3] and b[1] < a[1] + a[3]


def _draw_legend(canvas: _Canvas, boards: Sequence[Board]) -> None:
    """Draw the legend of the marks in use at the lower left, unless there are only refined corners."""
    found = {Status(int(s)) for b in boards for s in b.status}
    if found <= {Status.REFINED}:
        return
    rows = sorted(found)
    height = canvas.text_size("Hg")[1] + 6 * canvas.unit
    width = max(canvas.text_size(LEGEND[s])[0] for s in rows) + 28 * canvas.unit
    x, y = 4 * canvas.unit, canvas.image.shape[0] - 4 * canvas.unit - height * len(rows)
    canvas.taken.append((x, y, width, height * len(rows)))
    canvas.shade(x, y, width, height * len(rows))
    for k, status in enumerate(rows):
        middle = np.array([x + 10.0 * canvas.unit, y + (k + 0.5) * height])
        canvas.mark(middle, 4.0 * canvas.unit, status, WHITE)
        canvas.text(LEGEND[status], middle + np.array([10 * canvas.unit, height / 2 - 4 * canvas.unit]), WHITE)
