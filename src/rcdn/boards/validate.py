"""Drop-only validation: a corner that does not fit is removed; no label is ever changed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rcdn.boards.edges import edge_contrast, edge_sharpness, sample_grey
from rcdn.boards.graph import Field
from rcdn.boards.local import Grid, at_steps, cell_count
from rcdn.corners.adaptive import nearest_pitch
from rcdn.geometry.median import median
from rcdn.geometry.near import nearest
from rcdn.geometry.rules import CHECKER, Label
from rcdn.native import bind
from rcdn.types import Array
from rcdn.types.arrays import Real, Shaped

_prune = bind("rcdn_grid_prune")
_excess = bind("rcdn_grid_excess")
RESIDUAL = 0.15
"""largest distance from the neighbours' prediction, share of the pitch"""
RESIDUAL_LOOSE = 0.18
"""the same where the prediction extrapolates from few corners"""


LEAST_QUALITY = 0.3
"""least quality of a corner on the grid's rim: T-junctions along a board's outer edge have 0.1–0.26, true corners at
least 0.45"""
LEAST_SHARE = 0.45
"""lower bound of the contrast ratio to the neighbours: shadows lower the contrast of true corners, too"""


def prune(grid: Grid, field: Field) -> list[Grid]:
    """Remove misfits, worst first, then rim corners that are hardly X-corners, then corners in no complete cell, until
    nothing changes.

    In place. A misfit lies too far from its neighbours' prediction, or they predict nothing. A corner inside the grid
    is confirmed by its neighbours; one with no further corner within three squares beyond it must be an X-corner by its
    own evidence: response × fit relative to their median, times its contrast relative to its neighbours'.

    Of the parts that no edge joins, `grid` keeps the largest; the others are returned as grids of their own, largest
    first: `merge` decides whether they belong to the same board.
    """
    labels, corners = grid.labels, grid.corners
    part = np.empty(len(labels), np.int64)
    quality, contrast = field.response[corners] * field.fit[corners], field.contrast[corners]
    limits = RESIDUAL, RESIDUAL_LOOSE, LEAST_QUALITY, LEAST_SHARE
    count = _prune(labels, grid.xy[corners], quality, contrast, *limits, part)
    if count == 1 and part.max() == part.min():
        return []
    members = list(zip(part.tolist(), grid.at.items(), strict=True))
    grid.at = {spot: corner for number, (spot, corner) in members if number == 0}
    rest: list[dict[Label, int]] = [{} for _ in range(count - 1)]
    for number, (spot, corner) in members:
        if number > 0:
            rest[number - 1][spot] = corner
    return [Grid(dict(sorted(at.items())), grid.xy) for at in rest]


def predicted_excess(grid: Grid, spots: Sequence[Label]) -> Shaped[Array, " k"]:
    """Distances (K,) of labelled corners from their neighbours' predictions ÷ the allowed distance; 2 without a
    prediction."""
    labels = grid.labels
    rows = {spot: row for row, spot in enumerate(grid.at)}
    which, out = np.array([rows[spot] for spot in spots], np.int64), np.empty(len(spots))
    _excess(labels, grid.xy[grid.corners], which, RESIDUAL, RESIDUAL_LOOSE, out)
    return out


SMALL = ((5.6, 1.0), (7.0, 0.9))
"""(pitch px, least share of its bounding box that a board of smaller squares must fill)"""
SMALL_LEAST = 20
"""fewest corners of a board of such squares"""
LARGE, LARGE_FILL = 1000, 0.9
"""for a board of so many corners this share of its box is enough, however small its squares: no keyboard has as many"""


def believable(grid: Grid, least: int, scale: float = 1.0) -> bool:
    """Whether the grid is a board: at least `least` corners and four complete cells. `scale`: px of the grid per px of
    the original image if that was enlarged, else 1.

    Where squares are under 7 px of the original image, or of the reduced one in which they were seen, keyboards and
    grilles look just like boards: there at least 20 corners are needed, which fill nearly all of their bounding box,
    and all of it under 5.6 px, unless there are a thousand.
    """
    if len(grid) < least or cell_count(grid) < 4:
        return False
    spots, xy = grid.labels, grid.xy[grid.corners]
    pitch = median(nearest_pitch(xy)) / scale
    fill = len(spots) / float(np.prod(np.ptp(spots, axis=0) + 1))
    needed = next((share for limit, share in SMALL if pitch < limit), 0.0)
    needed = min(needed, LARGE_FILL) if len(spots) >= LARGE else needed
    return fill >= needed and (len(spots) >= SMALL_LEAST or not needed)


FAINT = 0.65
"""least median response of a board, share of the image's usual one: folds and slats near a real board have under 0.5"""
FEW, FEW_FAINT = 16, 0.6
"""a board of fewer corners needs this median response in any case: staggered tiles have saddles with 0.55"""


def plain(grid: Grid, response: Real[Array, " n"], typical: float) -> bool:
    """Whether the board's corners have clear responses; `response` (N,), `typical`: median of all sure corners."""
    own = median(response[grid.corners])
    return own >= FAINT * typical and (len(grid) >= FEW or own >= FEW_FAINT)


SOFT, SOFT_LEAST, SOFT_FILL = 0.5, 20, 0.8
"""edge sharpness below which a board must have so many corners and fill such a share of its bounding box"""


def distinct(grid: Grid, grey: Array) -> bool:
    """Whether the board has sharp edges, or enough corners to exclude folds and tartans, whose profiles resemble a
    blurred board's."""
    if edge_sharpness(grey, *_edges(grid)[2:]) >= SOFT:
        return True
    return len(grid) >= SOFT_LEAST and len(grid) >= SOFT_FILL * float(np.prod(np.ptp(grid.labels, axis=0) + 1))


def _edges(grid: Grid) -> tuple[Array, Array, Array, Array]:
    """The sides of the grid's squares: the row (L,) of the corner where each begins, 0 if it leads along u and 1 along
    v (L,), and where it begins and ends (L, 2) px."""
    labels, xy = grid.labels, grid.xy[grid.corners]
    following = at_steps(labels, labels, CHECKER.steps[:2])
    row, way = np.nonzero(following >= 0)
    return row, way, xy[row], xy[following[row, way]]


RIM_PITCH, RIM = 16.0, 0.6
"""least median length of a grid's links, px, and least contrast close to them, share of its corners': 1 px beside them,
waves and ramps of that length have .2"""


def has_rims(grid: Grid, field: Field) -> bool:
    """Whether the grid's edges are sharp close to them. Where a marker leaves a narrow rim of a square, what lies
    farther inside says nothing of the edge."""
    row, way, start, end = _edges(grid)
    known = grid.corners[grid.corners < len(field.xy)]
    if not len(known) or median(np.linalg.norm(end - start, axis=1)) < RIM_PITCH:
        return False
    colour = np.where((grid.labels[row].sum(axis=1) + way) % 2, 1, -1)
    shown = edge_contrast(field.grey, start, end, close=True).mean(axis=1) * colour
    return abs(median(shown)) >= RIM * median(field.contrast[known])


CENTRE, SIDE, INSIDE = 0.25, 0.12, 0.6
"""squares around the centre of a cell, and around the middle of a side, in which a corner belongs to a skipped line;
and around the centre, in which others are counted"""
SKIPPED, REGULAR, EITHER = 0.6, 0.8, 0.3
"""corners of skipped lines for each cell, their share of the others inside, and the share of the cells of either colour
that are next to one, from which on a grid skips lines: where it does there is one in each cell, and no other; markers
are in cells of one colour, clutter is anywhere"""


def skips_lines(grid: Grid, field: Field) -> bool:
    """Whether the grid's lines pass by others of the same board, as where motion or interlacing hides their edges: then
    strong corners that are not the grid's lie in the middle of its cells or of their sides."""
    corners, colour = _whole_cells(grid)
    free = field.strong.copy()
    free[grid.corners[grid.corners < len(free)]] = False
    other = field.xy[field.near(free, grid.xy[grid.corners], 0.0)]
    if len(other) < SKIPPED * len(corners):
        return False
    after = np.roll(corners, -1, axis=1)
    shortest = np.linalg.norm(after - corners, axis=2).min(axis=1)
    centre, cell = (found[:, 0] for found in nearest(corners.mean(axis=1), other))
    side, which = (found[:, 0] for found in nearest(((corners + after) / 2).reshape(-1, 2), other))
    between = (centre < CENTRE * shortest[cell]) | (side < SIDE * shortest[which // 4])
    inside = between | (centre < INSIDE * shortest[cell])
    if between.sum() < max(SKIPPED * len(corners), REGULAR * inside.sum(), 1):
        return False
    next_to = np.isin(np.arange(len(corners)), cell[between])
    return all((next_to & (colour == k)).sum() >= max(EITHER * (colour == k).sum(), 1) for k in (0, 1))


ASIDE, STRIPED = 0.25, 0.55
"""squares from either end of a side, beyond the blur of a corner, at which it is sampled; and the least difference of
the grey levels there between the corners of even and of odd u + v, share of the contrast, from which on a lattice lies
across stripes"""


def is_striped(grid: Grid, field: Field) -> bool:
    """Whether the grid lies diagonally across stripes: hazard marking, corrugated sheets, hatching.

    Its cells are dark and bright in turn there, too. But every second corner is in the middle of a dark stripe, and its
    neighbours are in bright ones, and so are the sides of the cells a quarter of their length from them; those of a
    board are between its dark and its bright squares everywhere. The median over all sides ignores the edge of a
    shadow.
    """
    row, _, start, end = _edges(grid)
    near, far = (sample_grey(field.grey, a + ASIDE * (b - a)) for a, b in ((start, end), (end, start)))
    difference = median(np.where(grid.labels[row].sum(axis=1) % 2 == 0, near - far, far - near))
    known = field.contrast[grid.corners[grid.corners < len(field.xy)]]
    contrast = max(median(known) if len(known) else 0.0, _cell_contrast(grid, field.grey))
    return abs(difference) > STRIPED * contrast


def _cell_contrast(grid: Grid, grey: Array) -> float:
    """Difference between the usual grey levels in the middles of a grid's cells of either colour; 0 without both."""
    corners, colour = _whole_cells(grid)
    middle = sample_grey(grey, corners.mean(axis=1))
    levels = [middle[colour == k] for k in (0, 1)]
    return abs(median(levels[0]) - median(levels[1])) if all(map(len, levels)) else 0.0


def _whole_cells(grid: Grid) -> tuple[Array, Array]:
    """Corners (C, 4, 2) px of a grid's complete cells, each in order around it, and the cells' colours (C,) 0 or 1."""
    labels = grid.labels
    (ring,) = CHECKER.cells
    rows = at_steps(labels, labels, [(0, 0), *ring])
    whole = (rows >= 0).all(axis=1)
    return grid.xy[grid.corners][rows[whole]], labels[whole].sum(axis=1) % 2


def is_full(grid: Grid) -> bool:
    """Whether every label of the bounding rectangle has a corner."""
    return len(grid) == int(np.prod(np.ptp(grid.labels, axis=0) + 1))
