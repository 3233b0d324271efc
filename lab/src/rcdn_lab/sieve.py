"""Corners lost by the sieve (corners/sieve.py): the peaks of the network evaluated everywhere, compared with the cells
that the sieve marks."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import astuple, dataclass
from typing import Any

import numpy as np

from rcdn.config import DetectorConfig
from rcdn.corners import find_maxima
from rcdn.corners.response import ResponseModel, load_model
from rcdn.corners.sieve import CELL, FLOOR, SHARE
from rcdn.errors import ConfigError
from rcdn.geometry.near import nearest
from rcdn.pyramid import View, pictures_of, whole_views
from rcdn.synthetic import BoardTruth
from rcdn.types import Array
from rcdn_lab.share_out import share_out
from rcdn_lab.sweep.pictures import FIRST, Picture, picture, seed_of
from rcdn_lab.sweep.score import SHARE as OF_PITCH
from rcdn_lab.sweep.settings import FACTORS

REACH = 2.0
"""px of a view; a peak this close to a corner belongs to it"""
ALL = "all"
Task = tuple[str, str, int]
"""factor, level, index of the picture"""

_model: list[ResponseModel] = []
"""The network of this process."""


@dataclass(frozen=True)
class Count:
    """Counts over one or more views: `peaks` of the dense response above the threshold, and those in marked cells
    (`kept`); `corners` of the boards to which such a peak belongs, and those whose peak is kept (`found`); `cells`, and
    those that are `marked`."""

    peaks: int = 0
    kept: int = 0
    corners: int = 0
    found: int = 0
    cells: int = 0
    marked: int = 0

    def __add__(self, other: Count) -> Count:
        return Count(*(a + b for a, b in zip(astuple(self), astuple(other), strict=True)))


def settings_of(count: int) -> dict[str, Any]:
    """Settings recorded with the figures."""
    return {
        "count": count, "preset": "auto", "first seed": FIRST, "cell": CELL, "share": SHARE, "floor": FLOOR,
        "corner's peak": f"the nearest, within {REACH} px of the view and {OF_PITCH} of the distance "
        "to the nearest neighbour",
    }  # fmt: skip


def table(
    count: int = 5, factors: Sequence[str] = (), workers: int = 1, progress: Callable[[int, int], None] | None = None
) -> list[dict[str, Any]]:
    """One row for each factor and level of the sweep, of `count` pictures each, and a last one over all.

    `factors`: of `FACTORS`, empty: all; `progress` is called with the number of pictures done and in total. The same
    arguments give the same rows, whatever `workers`. Raises ConfigError for an unknown factor.
    """
    if unknown := sorted(set(factors) - set(FACTORS)):
        raise ConfigError(f"--factor: nothing is called {', '.join(unknown)}; known: {', '.join(FACTORS)}")
    levels = [(f, v) for f in (factors or FACTORS) for v in FACTORS[f]]
    tasks = [(factor, level, k) for factor, level in levels for k in range(count)]
    found = dict.fromkeys(levels, Count())
    for (factor, level, _), part in zip(tasks, share_out(_one, tasks, workers, _load, (), progress), strict=True):
        found[factor, level] += part
    rows = [_row(factor, level, part) for (factor, level), part in found.items()]
    return [*rows, _row(ALL, worst(rows), sum(found.values(), Count()))]


def worst(rows: Sequence[dict[str, Any]]) -> str:
    """The level that loses the largest share of its corners, with its factor; `-` if none loses any."""
    least = min(rows, key=_recall)
    return f"{least['factor']} {least['level']}" if least["lost"] else "-"


def _recall(row: dict[str, Any]) -> float:
    return 1.0 if row["recall"] is None else float(row["recall"])


def by_factor(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """One row for each factor, which names its worst level, from `table`'s rows, and one over all."""
    levels = [row for row in rows if row["factor"] != ALL]
    parts = {
        factor: [row for row in levels if row["factor"] == factor]
        for factor in dict.fromkeys(r["factor"] for r in levels)
    }
    out = []
    for factor, own in (parts | {ALL: levels}).items():
        total = _row(factor, worst(own), sum((Count(*(row[k] for k in COUNTS)) for row in own), Count()))
        least = None if total["recall"] is None else min(map(_recall, own))
        out.append({"factor": factor, "worst": total["level"], "of worst": least} | {k: total[k] for k in SHORT})
    return out


COUNTS = ("peaks", "kept", "corners", "found", "cells", "marked")
SHORT = ("corners", "lost", "recall", "peaks", "recall of peaks", "share of cells")


def _row(factor: str, level: str, c: Count) -> dict[str, Any]:
    """The figures of a row; None for ratios with denominator 0."""

    def share(part: int, whole: int) -> float | None:
        return round(part / whole, 6) if whole else None

    counts = dict(zip(COUNTS, astuple(c), strict=True))
    return {
        "factor": factor, "level": level, **counts, "lost": c.corners - c.found, "recall": share(c.found, c.corners),
        "recall of peaks": share(c.kept, c.peaks), "share of cells": share(c.marked, c.cells),
    }  # fmt: skip


def _load() -> None:
    _model[:] = [load_model(DetectorConfig().model)]


def _one(task: Task) -> Count:
    """All views of one picture."""
    factor, level, index = task
    return counted(_model[0], picture(FACTORS[factor][level], seed_of(factor, level, index)))


def counted(model: ResponseModel, made: Picture) -> Count:
    """Counts of a model's sieve over a picture's views. Raises ConfigError for a model without a sieve."""
    views = whole_views(made.image.shape)
    parts = pictures_of(made.image, views)
    return sum((_of_view(model, v, p, made.boards) for v, p in zip(views, parts, strict=True)), Count())


def _of_view(model: ResponseModel, view: View, part: Array, boards: Sequence[BoardTruth]) -> Count:
    cells = model.cells_of(part)
    if cells is None:
        raise ConfigError("evaluate sieve: this network is computed everywhere; there is no sieve")
    peaks = find_maxima(model(part, 1), DetectorConfig())
    xy = peaks.xy[peaks.score >= peaks.level]
    kept = cells[xy[:, 1] // CELL, xy[:, 0] // CELL]
    owner = _owner(view, xy, boards)
    return Count(len(xy), int(kept.sum()), len(owner), int(kept[owner].sum()), cells.size, int(cells.sum()))


def _owner(view: View, xy: Array, boards: Sequence[BoardTruth]) -> Array:
    """Indices of the peaks `xy` (N, 2) px of a view that belong to visible corners of the boards: one for each corner
    that has one."""
    truth = np.concatenate([np.zeros((0, 2)), *(b.xy[b.visible] for b in boards)])
    pitch = np.concatenate([np.zeros(0), *(b.pitch[b.visible] for b in boards)])
    gap, index = (a[:, 0] for a in nearest(view.to_picture(xy), truth))
    return index[gap <= np.minimum(REACH / view.scale, OF_PITCH * pitch)]
