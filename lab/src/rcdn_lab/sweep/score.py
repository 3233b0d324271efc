"""The score of one detector on one picture, and the row for many pictures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from rcdn.metrics import match
from rcdn.synthetic import BoardTruth
from rcdn.types import Array
from rcdn_lab.detections import labels_fit
from rcdn_lab.peers import Grid

SHARE, LARGEST_RADIUS = 0.35, 4.0
"""Largest distance of a hit: a share of the distance to the corner's nearest neighbour, and px."""


@dataclass(frozen=True, eq=False)
class Score:
    """Score of one picture: `hits` of `corners`; found corners that match nothing (`wrong`) and boards without a hit
    (`false`).

    `mislabelled`: boards whose labels disagree with the truth; `success`: None if the detector returns no boards. `gap`
    (P,) px of the hits, `bound` (P,) the mean error of an efficient estimator there, `z` (2P,) errors ÷ sigma, where
    there is one. `error`: the exception, if the detector failed.
    """

    corners: int
    hits: int
    wrong: int
    mislabelled: int
    false: int
    success: bool | None
    gap: Array = field(default_factory=lambda: np.zeros(0))
    bound: Array = field(default_factory=lambda: np.zeros(0))
    z: Array = field(default_factory=lambda: np.zeros(0))
    error: str = ""


class Answers:
    """The true corners of a picture, in one list: `xy`, `board` (number), `ij`, `radius` of a hit, `bound`;
    `ignore`."""

    def __init__(self, boards: Sequence[BoardTruth], bound: Sequence[Array]) -> None:
        def join(parts: list[Array], tail: tuple[int, ...] = ()) -> Array:
            return np.concatenate([np.zeros((0, *tail)), *parts])

        self.count = len(boards)
        self.xy = join([b.xy[b.visible] for b in boards], (2,))
        self.ij = join([b.ij[b.visible] for b in boards], (2,)).astype(int)
        self.board = join([np.full(int(b.visible.sum()), k) for k, b in enumerate(boards)]).astype(int)
        self.radius = np.minimum(SHARE * join([b.pitch[b.visible] for b in boards]), LARGEST_RADIUS)
        self.bound = join([e[b.visible] for b, e in zip(boards, bound, strict=True)])
        self.ignore = join([b.xy[b.ignore] for b in boards], (2,))
        self.ignore_radius = np.minimum(SHARE * join([b.pitch[b.ignore] for b in boards]), LARGEST_RADIUS).clip(min=2.0)


def score(grids: Sequence[Grid], truth: Answers, raw: bool = False) -> Score:
    """Score of `grids` against the truth. `raw`: they are corners without boards, and cannot be a success.

    Success: each true board is one grid that has all its visible corners, no other, and correct labels (relative to a
    symmetry of the lattice), and there is no further grid. Corners at an ignored position do not count.
    """
    kept = [_counted(grid, truth) for grid in grids]
    kept = [(grid, pairs) for grid, pairs in kept if len(grid.xy)]
    owner = np.concatenate([[0], *[pairs[:, 1] for _, pairs in kept]]).astype(int)[1:]
    hits = len(np.unique(owner))
    found = sum(len(grid.xy) for grid, _ in kept)
    good = [_labels_right(grid, pairs, truth) for grid, pairs in kept]
    whole = [
        len(grid.xy) == len(pairs) > 0 and len(pairs) == int((truth.board == truth.board[pairs[0, 1]]).sum()) and fits
        for (grid, pairs), fits in zip(kept, good, strict=True)
    ]
    demanded = len(np.unique(truth.board))
    # duplicate boards are no success: with as many grids as boards, and hits everywhere, there is no duplicate
    success = None if raw else all(whole) and len(whole) == demanded and hits == len(truth.xy)
    parts = [_errors(grid, pairs, truth) for grid, pairs in kept]
    gap, bound, z = (np.concatenate([np.zeros(0), *[p[k] for p in parts]]) for k in range(3))
    return Score(
        len(truth.xy), hits, found - sum(len(pairs) for _, pairs in kept),
        0 if raw else sum(not fits for fits in good), 0 if raw else sum(not len(pairs) for _, pairs in kept),
        success, gap, bound, z,
    )  # fmt: skip


def broken(truth: Answers, raw: bool, error: str) -> Score:
    """The score of a detector that failed with an exception: nothing found and no success, even in a picture without
    boards."""
    return replace(score([], truth, raw), success=None if raw else False, error=error)


def _counted(grid: Grid, truth: Answers) -> tuple[Grid, Array]:
    """The grid without corners at an ignored position that match nothing, and its hits (P, 2): index in grid, in
    truth."""
    pairs, gaps = match(grid.xy, truth.xy, LARGEST_RADIUS)
    pairs = pairs[gaps < truth.radius[pairs[:, 1]]]
    if not len(truth.ignore) or not len(grid.xy):
        return grid, pairs
    gap, spot = cKDTree(truth.ignore).query(grid.xy)
    keep = gap >= truth.ignore_radius[spot]
    keep[pairs[:, 0]] = True
    number = np.cumsum(keep) - 1
    pick = Grid(*(None if a is None else a[keep] for a in (grid.xy, grid.ij, grid.sigma)))  # type: ignore[arg-type]
    return pick, np.column_stack([number[pairs[:, 0]], pairs[:, 1]])


def _labels_right(grid: Grid, pairs: Array, truth: Answers) -> bool:
    """Whether all hits are on one true board, with labels that one symmetry and one translation take to the true
    ones."""
    if not len(pairs) or grid.ij is None:
        return True
    if len(np.unique(truth.board[pairs[:, 1]])) > 1:
        return False
    return labels_fit(grid.ij[pairs[:, 0]], truth.ij[pairs[:, 1]])


def _errors(grid: Grid, pairs: Array, truth: Answers) -> tuple[Array, Array, Array]:
    step = grid.xy[pairs[:, 0]] - truth.xy[pairs[:, 1]]
    z = np.zeros(0) if grid.sigma is None else (step / grid.sigma[pairs[:, 0], None]).ravel()
    return np.linalg.norm(step, axis=1), truth.bound[pairs[:, 1]], z[np.isfinite(z)]


def row(scores: Sequence[Score]) -> dict[str, Any]:
    """The figures of many pictures: shares, counts, and errors of all hits together; None where undefined.

    `bound`: mean error of an efficient estimator on the same corners; `ratio`: mean error ÷ bound; `z`: root mean
    square of error ÷ sigma, by coordinate: 1 if sigma is correct.
    """
    judged = [s.success for s in scores if s.success is not None]
    corners, hits = sum(s.corners for s in scores), sum(s.hits for s in scores)
    gap, bound, z = (np.concatenate([np.zeros(0), *[getattr(s, k) for s in scores]]) for k in ("gap", "bound", "z"))
    errors = [s.error for s in scores if s.error]
    known = np.isfinite(bound)
    mean = float(gap.mean()) if len(gap) else None
    least = float(bound[known].mean()) if known.any() else None
    return {
        "pictures": len(scores),
        "success": _rounded(sum(judged) / len(judged)) if judged else None,
        "recall": _rounded(hits / corners) if corners else None,
        "wrong": sum(s.wrong for s in scores),
        "mislabelled": sum(s.mislabelled for s in scores) if judged else None,
        "false": sum(s.false for s in scores) if judged else None,
        "mean px": _rounded(mean),
        "p95 px": _rounded(float(np.percentile(gap, 95)) if len(gap) else None),
        "bound px": _rounded(least),
        "ratio": _rounded(float(gap[known].mean()) / least if least else None, 2),
        "z": _rounded(float(np.sqrt((z**2).mean())) if len(z) else None, 2),
        "failed": len(errors),
        "first failure": errors[0] if errors else None,
    }


def _rounded(value: float | None, digits: int = 4) -> float | None:
    return None if value is None else round(value, digits)
