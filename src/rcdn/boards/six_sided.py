"""Tests for lattices of triangles: six alternating sectors, and positions predicted by the neighbours. Drop-only, as
for squares."""

from __future__ import annotations

import numpy as np

from rcdn.boards.edges import sample_grey
from rcdn.boards.graph import Field
from rcdn.boards.local import Grid, Labels, Predictions, at_steps, cell_count, parts
from rcdn.corners.six_sector import ring, six_axes
from rcdn.geometry.elementary import log
from rcdn.geometry.rules import TRIANGLES, Label
from rcdn.types import Array
from rcdn.types.arrays import Int, Real, Shaped

REACH = tuple((d, e) for d in range(-2, 3) for e in range(-2, 3) if 0 < max(abs(d), abs(e), abs(d + e)) <= 2)
"""steps from a corner to spots where a lattice may grow: they span two edges, since a shadow's edge may hide a line of
corners"""
OFF_INSIDE, OFF_RIM, OFF_LOOSE = 0.04, 0.1, 0.18
"""largest distance of a corner from its neighbours' prediction, share of the shortest step: with all six neighbours,
with fewer, and where the prediction uses few corners (`ENOUGH`)"""
OFF_PX, OFF_MEDIAN, OFF_MOST = 0.6, 6.0, 0.06
"""distance that is always allowed: so many px, and so many times the board's median, the latter up to this share of a
step"""
ENOUGH = 7
"""corners on which a prediction stands firmly"""
EVEN, EVEN_MEDIAN, EVEN_MOST = 0.02, 10.0, 0.4
"""largest share of a ring's variance that is even, i.e. does not change its sign under a half turn; the same as a
multiple of the board's median (noise has an even part, too); and an upper bound in any case: the edge of a shadow or an
occluder near a corner, which biases its position, is even"""
ALIKE, ALIKE_SEARCHED = 0.12, 0.4
"""least contrast of a corner, share of the usual one beside it (shadows leave a fifth); of one without a network
response"""
CLOSE, CLOSE_PX, FAR = (0.3, 0.6), 2.2, 0.9
"""distances from a corner at which its sectors are sampled, shares of the distance to their centroids: close to the
corner but outside its blur, and far from it"""
ALONG, ASIDE = (0.85, 1.0, 1.15), (-0.35, -0.18, 0.0, 0.18, 0.35)
"""positions of a sector's samples relative to that distance, radially and to the sides: their mean reduces the noise"""
STEP_CLOSE, STEP_FAR = 0.15, 0.3
"""least step between adjacent sectors there, share of the mean step"""
DARK = 6.0
"""grey levels added before the logarithm, so that noise in dark regions does not count as contrast"""
CELLS = 6
"""fewest complete triangles of a board"""
RESPONSE = 0.3
"""least median response of a board"""
IRREGULAR = 0.035
"""largest median distance of a board's corners from their neighbours' predictions, steps: fisheye images and bent
sheets have 0.022, cloth 0.05 to 0.09"""
FEW, FEW_IRREGULAR, FEW_FIT = 25, 0.025, 0.75
"""below so many corners: the same limit, and the least median `fit`"""
TINY, TINY_LEAST = 8.0, 20
"""px of the original image; a board of shorter steps must have so many corners"""


def six_sided(
    grey: Array, xy: Real[Array, "k 2"], du: Real[Array, "k 2"], dv: Real[Array, "k 2"], sign: int
) -> Real[Array, " k"]:
    """Contrast (K,) of corners at `xy` (K, 2) whose six sectors alternate as the lattice predicts; 0 for all others.

    Contrast is the step of the logarithm of the grey level. `du`, `dv` (K, 2) px: the lattice's steps there; `sign`:
    colour of the sector between them. Sectors must alternate near the corner and further out, since a dark background
    beyond a narrow margin is no triangle. The logarithm gives lit and shaded parts the same contrast.
    """
    ways = np.array(TRIANGLES.steps)
    arms = ways[:, 0, None] * du[:, None] + ways[:, 1, None] * dv[:, None]
    middle, across = (arms + np.roll(arms, -1, axis=1)) / 3, (np.roll(arms, -1, axis=1) - arms) / 3
    close = np.clip(CLOSE_PX / np.maximum(np.linalg.norm(middle, axis=2).min(axis=1), 1e-9), *CLOSE)
    out = []
    for radius, least in ((close, STEP_CLOSE), (np.full(len(xy), FAR), STEP_FAR)):
        spots = [
            xy[:, None] + (radius * along)[:, None, None] * (middle + s * across) for along in ALONG for s in ASIDE
        ]
        value = log(sample_grey(grey, np.stack(spots, axis=2)) + DARK).mean(axis=2)
        steps = (value - np.roll(value, -1, axis=1)) * np.array([1, -1, 1, -1, 1, -1]) * sign
        mean = steps.mean(axis=1)
        out.append(np.where((mean > 0) & (steps.min(axis=1) > least * mean), mean, 0.0))
    return np.asarray(np.where(out[0] > 0, out[1], 0.0))


def shortest(guess: Predictions) -> Real[Array, " k"]:
    """Shortest of the lattice's three steps (K,), px."""
    return np.asarray(np.min([np.linalg.norm(s, axis=1) for s in (guess.du, guess.dv, guess.dv - guess.du)], axis=0))


def median_contrast(
    field: Field, grid: Grid, sign: int, spots: list[Label], du: Array, dv: Array
) -> Shaped[Array, " k"]:
    """Median contrast (K,) of the labelled corners within two steps of each spot, evaluated with the spot's steps."""
    near = grid.around(spots, 2)
    rows, columns = np.nonzero(near >= 0)
    value = six_sided(field.grey, grid.xy[near[rows, columns]], du[rows], dv[rows], sign)
    table = np.full(near.shape, np.nan)
    table[rows, columns] = value
    table[:, near.shape[1] // 2] = np.nan
    some = np.isfinite(table).any(axis=1)
    out = np.full(len(spots), np.inf)
    out[some] = np.nanmedian(table[some], axis=1)
    return out


def validate(field: Field, grid: Grid, sign: int) -> None:
    """Remove, in place: corners that a half turn does not negate; misfits, worst first; corners whose six sectors do
    not alternate; corners without a neighbour; all but the largest part.
    """
    while True:
        before = len(grid)
        _drop_uneven(field, grid)
        _drop_misfits(grid)
        _drop_poor(field, grid, sign)
        beside = _neighbours(grid, grid.labels).tolist()
        grid.at = {spot: corner for (spot, corner), n in zip(grid.at.items(), beside, strict=True) if n}
        _largest_part(grid)
        if len(grid) == before or not grid.at:
            return


def _neighbours(grid: Grid, spots: Labels) -> Int[Array, " k"]:
    """Number (K,) of labelled neighbours of each spot."""
    return np.asarray((at_steps(grid.labels, spots, TRIANGLES.steps) >= 0).sum(axis=1))


def _drop_uneven(field: Field, grid: Grid) -> None:
    """Remove corners whose neighbourhood is not negated by a half turn."""
    spots = sorted(grid.at)
    guess = grid.predictions(spots)
    step = np.where(guess.support > 0, shortest(guess), 0)
    even = six_axes(field.grey, grid.xy[[grid.at[s] for s in spots]], ring(step)).even
    limit = min(max(EVEN, EVEN_MEDIAN * float(np.median(even))), EVEN_MOST) if len(even) else 0.0
    grid.at = {spot: grid.at[spot] for spot, share in zip(spots, even.tolist(), strict=True) if share <= limit}


def _drop_misfits(grid: Grid) -> None:
    """Remove corners too far from their neighbours' prediction, worst first: the edge of a shadow or an occluder may
    have biased them."""
    while len(grid) > 3:
        spots = sorted(grid.at)
        guess = grid.predictions(spots)
        off = np.linalg.norm(grid.xy[[grid.at[s] for s in spots]] - guess.xy, axis=1)
        known = guess.support > 0
        typical = float(np.median(off[known])) if known.any() else 0.0
        around = _neighbours(grid, spots)
        share = np.select([around == 6, guess.support >= ENOUGH], [OFF_INSIDE, OFF_RIM], OFF_LOOSE)
        step = np.nan_to_num(shortest(guess))
        limit = np.maximum(np.maximum(share * step, OFF_PX), np.minimum(OFF_MEDIAN * typical, OFF_MOST * step))
        excess = np.where(known, off / np.maximum(limit, 1e-9), 2.0)
        worst = int(excess.argmax())
        if excess[worst] <= 1:
            return
        del grid.at[spots[worst]]


def _drop_poor(field: Field, grid: Grid, sign: int) -> None:
    if len(grid) < 4:
        return
    spots = sorted(grid.at)
    guess = grid.predictions(spots)
    xy = grid.xy[[grid.at[s] for s in spots]]
    known = guess.support > 0
    contrast = np.zeros(len(spots))
    contrast[known] = six_sided(field.grey, xy[known], guess.du[known], guess.dv[known], sign)
    typical = np.zeros(len(spots))
    if known.any():
        some = [s for s, t in zip(spots, known, strict=True) if t]
        typical[known] = median_contrast(field, grid, sign, some, guess.du[known], guess.dv[known])
    for spot, poor in zip(spots, contrast <= ALIKE * typical, strict=True):
        if poor:
            del grid.at[spot]


def _largest_part(grid: Grid) -> None:
    """Keep the largest of the parts that are more than two edges apart."""
    for part in parts(grid.at, REACH)[1:]:
        for spot in part:
            del grid.at[spot]


def believable(field: Field, grid: Grid, least: int, scale: float) -> bool:
    """Whether it is a board: enough corners and triangles, most corners with a network response, and as regular as
    print.

    Few corners must have clear responses, and where triangles are tiny in the original image (`scale` px of `grid` per
    px of it) there must be many corners: woven and printed cloth has triangles, too.
    """
    if len(grid) < least or cell_count(grid, TRIANGLES) < CELLS:
        return False
    corner, guess = np.array(list(grid.at.values())), grid.predictions(list(grid.at))
    response = np.where(corner < len(field.xy), field.response[np.minimum(corner, len(field.xy) - 1)], 0)
    known = guess.support > 0
    step = shortest(guess)
    off = float(np.median((np.linalg.norm(grid.xy[corner] - guess.xy, axis=1) / step)[known]))
    orientation = six_axes(field.grey, grid.xy[corner], ring(np.nan_to_num(step)))
    if np.median(response) < RESPONSE or off > IRREGULAR:
        return False
    if len(grid) < FEW and (off > FEW_IRREGULAR or np.median(orientation.fit) < FEW_FIT):
        return False
    return bool(len(grid) >= TINY_LEAST or np.median(step[known]) >= TINY * scale)
