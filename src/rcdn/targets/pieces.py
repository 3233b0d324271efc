"""Pieces of one coded board, each read by itself, become one board where they agree."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rcdn.geometry import apply_homography, homography
from rcdn.geometry.near import nearest
from rcdn.targets.complete import completed
from rcdn.targets.families import family_of
from rcdn.targets.read import identified
from rcdn.types import Array, Board, Charuco, Target

READ = 150
"""corners of pieces that are read in a picture"""
OFF = 0.3
"""squares; how far corners of joined pieces may lie from their common plane, and the same corner in two pieces"""
RATIO = 0.09
"""how much the measured sizes of the markers of one board may differ, squares"""
INSIDE = 0.9
"""share of a piece's corners that are those of one plain board, above which the piece tells nothing that the board
doesn't"""
SHARED = 0.25
"""share of a plain board's corners that are those of a read one, above which it is that one"""


def read_pieces(grey: Array, boards: list[Board], pieces: list[Board], told: Target | None) -> list[Board]:
    """The `boards`, some of which were read, with what the codes on `pieces` of boards add: corners of theirs, or
    boards of their own.

    A piece whose code isn't certain is nothing.
    """
    read, left = [b for b in boards if b.target is not None], READ
    for piece in pieces:
        if len(piece) <= left and not _held(piece, read) and not _inside(piece, boards):
            left -= len(piece)
            found = identified(grey, piece, told, part=True)
            if found.target is not None:
                read = _with(read, found)
    read = [completed(grey, board) for board in read]
    plain = [b for b in boards if b.target is None and not _held(b, read)]
    return sorted([*read, *plain], key=lambda b: (-len(b), *b.xy[0]))


def _held(piece: Board, read: list[Board]) -> bool:
    """Are the corners of a piece, or many of them, those of a board that was read?"""
    return any((nearest(b.xy, piece.xy, 1)[0][:, 0] < OFF * _pitch(b)).mean() > SHARED for b in read)


def _inside(piece: Board, boards: list[Board]) -> bool:
    """Are nearly all corners of a piece those of one board that wasn't read? That one tells more, and it isn't
    certain."""
    plain = [b for b in boards if b.target is None]
    return any((nearest(b.xy, piece.xy, 1)[0][:, 0] < OFF * _pitch(b)).mean() > INSIDE for b in plain)


def _with(read: list[Board], piece: Board) -> list[Board]:
    """The boards with one more, or with that one joined to the board whose piece it is."""
    for k, board in enumerate(read):
        whole = joined(board, piece)
        if whole is not None:
            return [*read[:k], *read[k + 1 :], whole] if len(whole) > len(board) else read
    return [*read, piece]


def joined(one: Board, two: Board) -> Board | None:
    """Two read boards as one; None if they are two, or of two targets. Where both have a corner the larger one's
    stands."""
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
    """The target that both may be parts of; None if there is none."""
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
    """Usual distance of a corner from the next, px."""
    return float(np.median(nearest(board.xy, board.xy, 2)[0][:, 1]))
