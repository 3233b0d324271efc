"""Joins pieces of one coded board, each decoded by itself, into one board where they agree."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rcdn.geometry import apply_homography, homography
from rcdn.geometry.near import nearest
from rcdn.targets.complete import completed
from rcdn.targets.complete_tags import completed_tags
from rcdn.targets.families import family_of
from rcdn.targets.read import identified
from rcdn.types import AprilGrid, Array, Board, Charuco, Target

READ = 150
"""largest number of corners of pieces that are decoded per picture"""
OFF = 0.3
"""largest distance of corners of joined pieces from their common plane, and between the same corner in two pieces,
squares"""
RATIO = 0.09
"""largest difference of the measured sizes of the markers of one board, squares"""
INSIDE = 0.9
"""share of a piece's corners that belong to one undecoded board, above which the piece adds no information to that
board"""
SHARED = 0.25
"""share of a board's or piece's corners that belong to a decoded board, above which it is the same board"""


def read_pieces(grey: Array, boards: list[Board], pieces: list[Board], given: Target | None) -> list[Board]:
    """The `boards`, some of which were decoded, with the additions from decoded `pieces`: further corners, or further
    boards.

    A piece whose code isn't certain is discarded.
    """
    read, left = [b for b in boards if b.target is not None], READ
    for piece in pieces:
        if len(piece) <= left and not _held(piece, read) and not _inside(piece, boards):
            left -= len(piece)
            found = identified(grey, piece, given, part=True)
            if found.target is not None:
                read = _with(read, found)
    read = [_completed(grey, board) for board in read]
    plain = [b for b in boards if b.target is None and not _held(b, read)]
    return sorted([*read, *plain], key=lambda b: (-len(b), *b.xy[0]))


def _completed(grey: Array, board: Board) -> Board:
    if isinstance(board.target, AprilGrid):
        return completed_tags(np.ascontiguousarray(grey), board, board.target)
    return completed(grey, board)


def _held(piece: Board, read: list[Board]) -> bool:
    """Whether many of the corners of a piece belong to a board that was decoded."""
    return any((nearest(b.xy, piece.xy, 1)[0][:, 0] < OFF * _pitch(b)).mean() > SHARED for b in read)


def _inside(piece: Board, boards: list[Board]) -> bool:
    """Whether nearly all corners of a piece belong to one board that wasn't decoded: that board has more evidence than
    the piece, and still isn't certain."""
    plain = [b for b in boards if b.target is None]
    return any((nearest(b.xy, piece.xy, 1)[0][:, 0] < OFF * _pitch(b)).mean() > INSIDE for b in plain)


def _with(read: list[Board], piece: Board) -> list[Board]:
    """The boards with `piece` joined to the board to which it belongs, or else added as a further board."""
    for k, board in enumerate(read):
        whole = joined(board, piece)
        if whole is not None:
            return [*read[:k], *read[k + 1 :], whole] if len(whole) > len(board) else read
    return [*read, piece]


def joined(one: Board, two: Board) -> Board | None:
    """Two decoded boards as one; None if they are separate boards, or of different targets. A corner of both keeps the
    larger board's position."""
    if len(two) > len(one):
        one, two = two, one
    target = common(one.target, two.target)
    if target is None:
        return None
    place = {tuple(at): k for k, at in enumerate(one.ij.tolist())}
    row = np.array([place.get(tuple(at), -1) for at in two.ij.tolist()])
    pitch, both = min(_pitch(one), _pitch(two)), row >= 0
    if (np.linalg.norm(one.xy[row[both]] - two.xy[both], axis=1) > OFF * pitch).any():
        return None
    new = np.flatnonzero(~both)
    ij, xy = np.concatenate([one.ij, two.ij[new]]), np.concatenate([one.xy, two.xy[new]])
    off = np.linalg.norm(apply_homography(homography(ij, xy), ij.astype(float)) - xy, axis=1)
    if not (off <= OFF * pitch).all() or nearest(one.xy, two.xy[new], 1)[0].min(initial=np.inf) < OFF * pitch:
        return None
    order = np.lexsort((ij[:, 0], ij[:, 1]))
    pick = lambda name: np.concatenate([getattr(one, name), getattr(two, name)[new]])[order]  # noqa: E731
    return replace(
        one, xy=xy[order], ij=ij[order], response=pick("response"), status=pick("status"), sigma=None,
        target=target, ids=target.ids(ij[order]),
    )  # fmt: skip


def common(one: Target | None, two: Target | None) -> Target | None:
    """The target of which both may be parts; None if there is none."""
    if not (isinstance(one, Charuco) and isinstance(two, Charuco)):
        return one if one == two else None
    same = lambda t: (t.columns, t.first_id, t.legacy, t.inverted, family_of(t.dictionary).names)  # noqa: E731
    if same(one) != same(two) or abs(one.marker - two.marker) > RATIO:
        return None
    if one.rows and two.rows and one.rows != two.rows:
        return None
    names = family_of(one.dictionary).names
    larger = max(one.dictionary, two.dictionary, key=names.index)
    return replace(one, rows=one.rows or two.rows, dictionary=larger)


def _pitch(board: Board) -> float:
    """Median distance from a corner to its nearest neighbour, px."""
    return float(np.median(nearest(board.xy, board.xy, 2)[0][:, 1]))
