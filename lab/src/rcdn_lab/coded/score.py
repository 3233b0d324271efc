"""Comparison of corner ids with the truth. A wrong id ruins a calibration; a missing one does not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple, dataclass
from typing import Any

import numpy as np

from rcdn.targets.families import FAMILIES
from rcdn.types import Array
from rcdn.types.target import AprilGrid, Charuco, Target
from rcdn_lab.peers.coded import Labelled

REACH, SHARE = 4.0, 0.35
"""largest distance between a corner and its truth, px; and share of the distance to the next corner, if that is less"""


@dataclass(frozen=True, eq=False)
class TrueBoard:
    """The truth of a board: its `target`, `ids` (N,) and `xy` (N, 2) px of its corners (NaN for those that the picture
    cannot show), and which are `demanded` (N,). `whole`: all corners are listed; otherwise found corners far from the
    true ones, with ids that are not listed, are not judged."""

    target: Target
    ids: Array
    xy: Array
    demanded: Array
    whole: bool = True


@dataclass(frozen=True)
class Count:
    """Counts over one or more pictures: `pictures`; true `boards`; those that were `named` (a correct id, and kind,
    dictionary and legacy correct); those with every demanded corner (`complete`); `corners` demanded and found `right`;
    `wrong` ids; boards of an `other` kind than the true one; pictures on which the reader failed with an exception
    (`failed`)."""

    pictures: int = 0
    boards: int = 0
    named: int = 0
    complete: int = 0
    corners: int = 0
    right: int = 0
    wrong: int = 0
    other: int = 0
    failed: int = 0

    def __add__(self, more: Count) -> Count:
        return Count(*(a + b for a, b in zip(astuple(self), astuple(more), strict=True)))

    @property
    def recall(self) -> float | None:
        """Share of the demanded corners found with their correct id; None if none is demanded."""
        return self.right / self.corners if self.corners else None


def row(count: Count) -> dict[str, Any]:
    """The figures of a table row."""
    recall = count.recall
    return {
        "pictures": count.pictures,
        "boards": count.boards,
        "named": count.named,
        "whole": count.complete,
        "corners": count.corners,
        "right": count.right,
        "recall": None if recall is None else round(recall, 4),
        "wrong": count.wrong,
        "other kind": count.other,
        "failed": count.failed,
    }


def score(found: Sequence[Labelled], boards: Sequence[TrueBoard]) -> Count:
    """Score of one picture. A corner is right if its id is within reach of its truth, on the true board that most of
    the found board's corners fit; it is wrong if its id is elsewhere, or is not on that board although the corner is.
    Without true boards every id is wrong."""
    hit = [np.zeros(len(b.ids), bool) for b in boards]
    named = [False] * len(boards)
    wrong = other = 0
    for one in found:
        if not boards:
            wrong += len(one.ids)
            continue
        fits = [_right(one, board) for board in boards]
        k = max(range(len(boards)), key=lambda n: int((fits[n] >= 0).sum()))
        good = fits[k] >= 0
        hit[k][fits[k][good]] = True
        wrong += int((~good & _judged(one, boards[k])).sum())
        same = one.target is None or same_print(one.target, boards[k].target)
        other += not same
        named[k] |= same and bool(good.any())
    right = [(h & b.demanded).sum() for h, b in zip(hit, boards, strict=True)]
    complete = [bool((h | ~b.demanded).all()) for h, b in zip(hit, boards, strict=True)]
    demanded = sum(int(b.demanded.sum()) for b in boards)
    return Count(1, len(boards), sum(named), sum(complete), demanded, int(sum(right)), wrong, other)


def _right(found: Labelled, board: TrueBoard) -> Array:
    """(M,) index of the true corner that each found one matches, by its id and its position; −1 for none."""
    index = {number: k for k, number in enumerate(board.ids.tolist())}
    at = np.array([index.get(number, -1) for number in found.ids.tolist()], int)
    gap = np.linalg.norm(found.xy - board.xy[at], axis=1)
    with np.errstate(invalid="ignore"):
        return np.where((at >= 0) & (gap <= reach(board)[at]), at, -1)


def _judged(found: Labelled, board: TrueBoard) -> Array:
    """(M,) bool: the ids that are wrong unless they are right."""
    if board.whole:
        return np.ones(len(found.ids), bool)
    near = np.linalg.norm(found.xy[:, None] - board.xy[None], axis=2) <= reach(board)
    return np.asarray(np.isin(found.ids, board.ids) | near.any(axis=1))


def reach(board: TrueBoard) -> Array:
    """(N,) px within which a found corner matches the true one; half the distance to the next corner if it is not
    demanded: at the border of the frame or of a cover, where an id can be right although the corner is damaged."""
    gap = np.linalg.norm(board.xy[:, None] - board.xy[None], axis=2)
    gap[np.isnan(gap) | np.eye(len(gap), dtype=bool)] = np.inf
    nearest = gap.min(axis=1, initial=np.inf)
    return np.where(board.demanded, np.minimum(REACH, SHARE * nearest), np.minimum(2 * REACH, nearest / 2))


def same_print(reported: Target, true: Target) -> bool:
    """Whether kind, marker family, legacy and inverted grey levels are the same. Dictionaries with a common beginning
    are one family."""
    if isinstance(reported, Charuco) and isinstance(true, Charuco):
        alike = (reported.legacy, reported.inverted) == (true.legacy, true.inverted)
        return alike and _family(reported.dictionary) == _family(true.dictionary)
    if isinstance(reported, AprilGrid) and isinstance(true, AprilGrid):
        return reported.family == true.family
    return reported.kind == true.kind


def _family(dictionary: str) -> int:
    return next((k for k, names in enumerate(FAMILIES) if dictionary in names), -1)
