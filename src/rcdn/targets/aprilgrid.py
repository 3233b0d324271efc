"""Reads AprilGrids: finds the numbering, row by row upwards from the bottom left, for which all tags together are most
likely."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rcdn.errors import ConfigError, shown
from rcdn.targets.charuco import ACCEPT, MARGIN, SURE
from rcdn.targets.charuco_layouts import CANDIDATES, contradicted
from rcdn.targets.families import families, family_of
from rcdn.targets.gains import MOST_COLUMNS, gains
from rcdn.targets.marker import Frame, appearance, evidence, modules
from rcdn.targets.projected_lattice import projected_lattice
from rcdn.targets.reading import Reading
from rcdn.targets.rectify import aspect_of, rectified, whole_squares
from rcdn.types import AprilGrid, Array
from rcdn.types.arrays import Bool, Int, Real
from rcdn.types.plane import plane_points

SAMPLES = 32
"""a square's side on the raster"""
FRAMES = (Frame(2, filling=True), Frame(1, filling=True))
NAMES = {
    "DICT_APRILTAG_16h5": "tag16h5",
    "DICT_APRILTAG_25h9": "tag25h9",
    "DICT_APRILTAG_36h10": "tag36h10",
    "DICT_APRILTAG_36h11": "tag36h11",
}


class _Numbering(NamedTuple):
    """A numbering of the tags, with its evidence `bits`: the family's `name`, the tags' `border`, `turns` to upright,
    `columns` of the board, number `lowest` of the tag at the bottom left; whether other tags contradict it."""

    bits: float
    name: str
    border: int
    turns: int
    columns: int
    lowest: int
    contradicted: bool


def read_aprilgrid(grey: Array, grid: Array, given: AprilGrid | None = None) -> Reading | None:
    """The numbering of R × C tags whose corners are at `grid` (2 R, 2 C, 2) px, NaN where unknown; None if none is
    certain.

    `given`: the target given by the user (None: unknown); of a certain one, see `Reading.contradicted`.
    """
    lifted = _lifted(_cells(grey, grid))
    seen = np.asarray(np.isfinite(lifted).all(axis=(2, 3)))
    if seen.sum() < 2:
        return None
    found: list[_Numbering] = []
    own = None if given is None else family_of(dictionary_of(given.family))
    for frame in FRAMES if given is None else (Frame(given.border, filling=True),):
        for side in (4, 5, 6) if own is None else (own.bits.shape[1],):
            measured = appearance(lifted[seen].mean(axis=0), side, frame, aspect_of(grid))
            if measured is None:
                continue
            ratios = np.zeros((*seen.shape, side + 2 * frame.border, side + 2 * frame.border))
            ratios[seen] = evidence(modules(lifted[seen], measured, side, frame), frame.border)
            for family in families(side) if own is None else (own,):
                if family.names[0] in NAMES:
                    found += _numberings(ratios, seen, family.bits, NAMES[family.names[0]], frame.border, given)
    found.sort(key=lambda f: -f.bits)
    if not found or found[0].bits < (ACCEPT if given is None else SURE + np.log2(4 * _places(seen.shape, given))):
        return None
    best = found[0]
    same = lambda f: (f.name, f.turns, f.columns, f.lowest)  # noqa: E731 – the numbering, for any border
    margin = best.bits - max((f.bits for f in found if same(f) != same(best)), default=0.0)
    if margin < MARGIN:
        return None
    if given is not None:
        row, column = divmod(best.lowest - given.first_id, given.columns)
        place = 2 * (best.columns - column - seen.shape[1 - best.turns % 2]), 2 * row
        return Reading(given, (best.turns + 2) % 4, place, best.bits, margin, best.contradicted)
    return _placed(best, margin, seen, gap_of(grid), _may_go_on(grid, grey.shape))


def _cells(grey: Array, grid: Array) -> Real[Array, "r c s s"]:
    """Grey levels of tags and of what is between them, alternately, from corners `grid` (2 R, 2 C, 2)."""
    rows, columns = grid.shape[:2]
    labels = np.repeat(np.arange(max(rows, columns))[:, None], 2, axis=1)
    lines = plane_points(labels, "aprilgrid", gap_of(grid))[:, 0]
    seen = projected_lattice(grid, lines[:columns], lines[:rows], (grey.shape[1], grey.shape[0]))
    if seen is None:
        return rectified(grey, grid, SAMPLES)
    cells = seen.rectified(grey, SAMPLES)
    cells[~whole_squares(np.isfinite(grid[..., 0]))] = np.nan
    return cells


def dictionary_of(family: str) -> str:
    """OpenCV's name of a family of AprilTags. Raises ConfigError if AprilGrids with this family aren't supported."""
    for dictionary, name in NAMES.items():
        if name == family:
            return dictionary
    raise ConfigError(f"family must be one of {', '.join(NAMES.values())}, not {shown(family)}")


def _places(shape: tuple[int, ...], given: AprilGrid) -> int:
    """The number of positions of `shape` (R, C) tags on a board, in either orientation (R × C or C × R); at least 1."""
    rows = given.rows or MOST_COLUMNS
    return max(
        (rows - shape[0] + 1) * (given.columns - shape[1] + 1),
        (rows - shape[1] + 1) * (given.columns - shape[0] + 1),
        1,
    )


def gap_of(grid: Array) -> float:
    """Median gap between tags ÷ their side, from corners `grid` (2 R, 2 C, 2)."""
    ratios = []
    for lines in (grid, grid.swapaxes(0, 1)):
        step = np.linalg.norm(np.diff(lines, axis=1), axis=2)
        side, between = step[:, ::2], step[:, 1::2]
        ratios.append((2 * between / (side[:, :-1] + side[:, 1:])).ravel())
    known = np.concatenate(ratios)
    known = known[np.isfinite(known)]
    return float(np.median(known)) if len(known) else 0.3


def _may_go_on(grid: Array, shape: tuple[int, ...]) -> Bool[Array, " 4"]:
    """(4,) bool: whether the next tags beyond the right, upper, left and lower side would lie outside the picture of
    `shape` (H, W), so that the board may continue there."""
    out = []
    for turns in range(4):  # each side in turn becomes the right one
        turned = np.rot90(grid, -turns)
        next_line = turned[:, -1] + 0.9 * (turned[:, -1] - turned[:, -2])  # near the middle of the next tags
        known = next_line[np.isfinite(next_line[:, 0])]
        out.append(not ((known >= 0) & (known < np.array(shape[::-1]))).all())
    return np.array(out)


def _lifted(cells: Array) -> Real[Array, "r c s s"]:
    """Grey levels of the tags (R, C, S, S), normalised: 0 is the level of the small dark squares around a tag, 1 that
    of the white gaps beside it."""
    part = slice(SAMPLES * 3 // 8, SAMPLES * 5 // 8)
    level = cells[:, :, part, part].mean(axis=(2, 3))
    padded = np.pad(level, 1, constant_values=np.nan)
    rows, columns = np.indices((cells.shape[0] // 2 + 1, cells.shape[1] // 2 + 1)) * 2 + 1

    def around(steps: tuple[tuple[int, int], ...]) -> Array:
        values = np.stack([padded[rows + a, columns + b] for a, b in steps])
        known = np.isfinite(values)
        typical = float(np.median(values[known])) if known.any() else np.nan
        return np.where(
            known.any(axis=0), np.where(known, values, 0).sum(axis=0) / np.maximum(known.sum(axis=0), 1), typical
        )

    dark, white = around(((-1, -1), (-1, 1), (1, -1), (1, 1))), around(((-1, 0), (1, 0), (0, -1), (0, 1)))
    return np.asarray((cells[::2, ::2] - dark[..., None, None]) / (white - dark)[..., None, None])


def _numberings(
    ratios: Array, seen: Array, bits: Array, name: str, border: int, given: AprilGrid | None = None
) -> list[_Numbering]:
    """The likeliest numberings by markers `bits` of the family `name`."""
    out = []
    for turns in range(4):
        turned = np.rot90(np.rot90(ratios, turns, (0, 1)), turns, (2, 3))
        row, column = np.nonzero(np.rot90(seen, turns))
        height, width = seen.shape if turns % 2 == 0 else seen.shape[::-1]
        up = height - 1 - row
        # OpenCV draws these tags rotated by half a turn relative to the printed ones
        gain = gains(turned[row, column], np.rot90(bits, 2, (1, 2)), border)
        if np.maximum(gain.max(axis=1), 0).sum() < (ACCEPT if given is None else SURE):
            continue
        choice = _choices(gain, column, up, width) if given is None else _choices_of(given, width, height)
        if not len(choice):
            continue
        number = choice[:, 1:] + column + choice[:, :1] * up
        valid = (number < len(bits)).all(axis=1)
        own = gain[np.arange(len(row)), np.minimum(number, len(bits) - 1)]
        score = np.where(valid, own.sum(axis=1), -np.inf)
        for m in np.argsort(-score)[:2]:
            columns, lowest = choice[m].tolist()
            against = contradicted(gain.max(axis=1), own[m], len(bits))
            out.append(_Numbering(float(score[m]), name, border, turns, columns, lowest, against))
    return out


def _choices_of(given: AprilGrid, width: int, height: int) -> Int[Array, "m 2"]:
    """Columns and the number of the tag at the bottom left, (M, 2), for all positions of `width` × `height` tags on a
    board."""
    rows = given.rows or MOST_COLUMNS
    place = [(c, r) for r in range(rows - height + 1) for c in range(given.columns - width + 1)]
    return np.array([(given.columns, given.first_id + r * given.columns + c) for c, r in place]).reshape(-1, 2)


def _choices(gain: Array, column: Array, up: Array, width: int) -> Int[Array, "m 2"]:
    """Columns and the number of the tag at the bottom left, (M, 2), as hypotheses from the most certain tags."""
    surest = np.argsort(-gain.max(axis=1))[:8]
    tag = np.argsort(-gain[surest], axis=1)[:, :CANDIDATES]
    k, columns = (
        a.ravel() for a in np.meshgrid(np.arange(tag.size), np.arange(width, MOST_COLUMNS + 1), indexing="ij")
    )
    square = np.repeat(surest, tag.shape[1])[k]
    lowest = tag.ravel()[k] - column[square] - columns * up[square]
    return np.asarray(np.unique(np.stack([columns, lowest], axis=1)[lowest >= 0], axis=0))


def _placed(best: _Numbering, margin: float, seen: Array, gap: float, goes_on: Array) -> Reading | None:
    """The position of the grid on its board: a board whose numbering starts at 0, unless the grid is a whole board,
    which may start at any number."""
    columns, turns = best.columns, best.turns
    height, width = seen.shape if turns % 2 == 0 else seen.shape[::-1]
    right, upper, left, lower = np.roll(goes_on, turns)
    whole = seen.all() and columns == width and not (right or left or lower)
    first = best.lowest if whole else 0
    column, row = (best.lowest - first) % columns, (best.lowest - first) // columns
    if column + width > columns:
        return None
    rows = row + height if seen.all() and not upper else None
    target = AprilGrid(columns, rows, best.name, round(gap, 2), best.border, first)
    # labels count from the bottom right, to the left and upwards: rotated by half a turn from upright
    place = 2 * (columns - column - width), 2 * row
    return Reading(target, (turns + 2) % 4, place, best.bits, margin, best.contradicted)
