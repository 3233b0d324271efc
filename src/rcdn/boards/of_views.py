"""Boards and corners that several views of an image show, each once."""

from __future__ import annotations

import cv2
import numpy as np

from rcdn.corners.adaptive import nearest_pitch
from rcdn.geometry.boxes import BoxCells
from rcdn.geometry.median import median
from rcdn.geometry.near import nearest, within
from rcdn.geometry.polygon import depth
from rcdn.types import Array, Board, Corners
from rcdn.types.arrays import Bool

SAME = 0.35
"""corners closer than this share of a square are the same"""
SHARED, COVERED = 0.25, 0.5
"""largest share of a board's corners that may coincide with those of a larger board, and that may lie inside it;
beyond, it is no board of its own"""
BESIDE, ONE_SQUARE = 0.9, 1.5
"""squares of the larger board: what is nearer to its next corner lies among its corners, and the extent up to which a
board is part of one of its squares"""
GAP_AREA = 1.5
"""squares of the larger board; a board with a larger area and none of its corners inside lies in a gap of it"""
EDGE = 1e-3
"""px; tolerance of the test whether a corner lies inside a board's hull, so that its own corners do"""


def pitch_of(board: Board) -> float:
    """Median distance to the nearest corner, px."""
    return median(nearest_pitch(board.xy))


def inside(board: Board, xy: Array) -> Bool[Array, " n"]:
    """(N,) bool: which positions lie within the convex hull of a board's corners."""
    return depth(cv2.convexHull(board.xy.astype(np.float32)), xy) >= -EDGE


def distinct_boards(found: list[list[Board]]) -> list[Board]:
    """The boards of all views (the full-size one first), each once: of two that share corners, the one with more
    corners.

    A board among the corners of a larger one, or in one of its squares, is rejected: it consists of markers and glyphs.
    """
    ranked = sorted(
        ((len(b), -k, b) for k, boards in enumerate(found) for b in boards), key=lambda r: r[:2], reverse=True
    )
    every = [board for _, _, board in ranked]
    if len(every) < 2:
        return every
    low, high = (np.array([end(b.xy, axis=0) for b in every]) for end in (np.min, np.max))
    boxes, twins = BoxCells(low, high), _twins(every)
    kept: set[int] = set()
    for k, board in enumerate(every):
        around = kept.intersection(boxes.touched(low[k] - EDGE, high[k] + EDGE))
        if kept.isdisjoint(twins[k]) and not any(_covers(every[n], board.xy) for n in sorted(around)):
            kept.add(k)
    return sorted((every[k] for k in kept), key=lambda b: (-len(b), *b.xy[0]))


def _covers(board: Board, xy: Array) -> bool:
    """Whether a board's positions (N, 2) px lie among the corners of another, or together in one of its squares. A gap
    in it may be another board before it, of which it may have taken corners."""
    among = inside(board, xy)
    if among.mean() <= COVERED:
        return False
    pitch = nearest_pitch(board.xy)
    if np.ptp(xy, axis=0).max() < ONE_SQUARE * median(pitch):
        return True
    outline = cv2.convexHull(xy.astype(np.float32))
    if cv2.contourArea(outline) > GAP_AREA * median(pitch) ** 2:
        others = board.xy[nearest(xy, board.xy)[0][:, 0] > SAME * median(nearest_pitch(xy))]
        if not (depth(outline, others) > 0).any():
            return False
    distance, corner = nearest(board.xy, xy)
    return bool((among & (distance[:, 0] < BESIDE * pitch[corner[:, 0]])).mean() > COVERED)


def adds_to(board: Board, known: list[Board], more: int) -> bool:
    """Whether a board has `more` corners, at least, than each of the `known` ones with which it shares corners."""
    ranked = sorted([b for b in known if len(b) > len(board) - more], key=len, reverse=True)
    return not _twins([*ranked, board])[-1]


def _twins(boards: list[Board]) -> list[list[int]]:
    """For each board, the earlier ones that share more than `SHARED` of its corners."""
    xy, sizes = np.concatenate([b.xy for b in boards]), np.array([len(b) for b in boards])
    owner, reach = np.repeat(np.arange(len(boards)), sizes), np.array([SAME * pitch_of(b) for b in boards])
    theirs, own = within(xy, xy, reach[owner])
    later = owner[theirs] < owner[own]
    theirs, own = theirs[later], own[later]
    step = xy[own] - xy[theirs]
    close = np.sqrt(step[:, 0] * step[:, 0] + step[:, 1] * step[:, 1]) < reach[owner[theirs]]
    # each corner counts once for each board that has a corner there
    corner, other = np.divmod(np.unique(own[close] * len(boards) + owner[theirs[close]]), len(boards))
    pair, count = np.unique(owner[corner] * len(boards) + other, return_counts=True)
    out: list[list[int]] = [[] for _ in boards]
    for k, n in zip(*np.divmod(pair[count > SHARED * sizes[pair // len(boards)]], len(boards)), strict=True):
        out[k].append(int(n))
    return out


def distinct_corners(parts: list[Corners], reach: float = 3.0) -> Corners:
    """Corners of several lists, each once: of two closer than `reach` px, the one in the earlier list is kept."""
    out = parts[0]
    for more in parts[1:]:
        if len(out) and len(more):
            more = more.take(nearest(out.xy, more.xy)[0][:, 0] >= reach)
        if len(more):
            out = _joined(out, more)
    return out.sort()


def _joined(one: Corners, two: Corners) -> Corners:
    """Both lists in one; attributes that only one of them has (axes, sigma) are NaN in the other's rows."""

    def both(name: str) -> Array | None:
        a, b = getattr(one, name), getattr(two, name)
        if a is None and b is None:
            return None
        tail = (a if a is not None else b).shape[1:]
        fill = [np.full((len(c), *tail), np.nan) if v is None else v for c, v in ((one, a), (two, b))]
        return np.concatenate(fill)

    values = {name: np.concatenate([getattr(one, name), getattr(two, name)]) for name in ("xy", "response", "status")}
    return Corners(**values, axes=both("axes"), sigma=both("sigma"))
