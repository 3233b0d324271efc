"""The guide's output as JSON for the page: rounded numbers, none of them infinite."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from rcdn.calibration.guidance import Look, PairProgress, Progress
from rcdn.types import Array, Board

DECIMALS = 1
"""decimals of positions on the page, px"""


def assessment_facts(board: Board | None, assessment: Look | None, refused: str) -> dict[str, Any]:
    """The message about one frame; `refused`: the reason for refusal if there is no guide yet."""
    record: dict[str, Any] = {
        "type": "look",
        "board": None,
        "refused": refused,
        "hint": "",
        "fit": 0.0,
        "arrow": None,
        "take": False,
    }
    if board is not None:
        record["board"] = _rounded(board.xy)
        record["grid"] = board.ij.tolist()
    if assessment is not None:
        record["refused"], record["hint"] = assessment.refused, assessment.hint
        record["fit"], record["take"] = _number(assessment.fit, 3) or 0.0, bool(assessment.take)
        record["arrow"] = None if assessment.arrow is None else _rounded(np.asarray(assessment.arrow, float))
    return record


def moment_facts(boards: Sequence[Board | None], assessment: Any, refused: str) -> dict[str, Any]:
    """The message about a frame of each camera, assessed by a `PairLook` or as by `guides.OneCamera`: of one camera
    that of its frame; of two that of each in `sides`, and what holds for both."""
    sides = [None] * len(boards) if assessment is None else assessment.sides
    if len(boards) == 1:
        return assessment_facts(boards[0], sides[0], refused)
    record = assessment_facts(None, None, refused)
    record["sides"] = [assessment_facts(b, s, "") for b, s in zip(boards, sides, strict=True)]
    if assessment is not None:
        record["refused"], record["hint"] = assessment.refused, assessment.hint
        record["fit"], record["take"] = _number(assessment.fit, 3) or 0.0, bool(assessment.take)
    return record


def progress_facts(progress: Progress | PairProgress | None) -> dict[str, Any]:
    """Progress of the calibration; empty without a guide. `wanted` and `maps` of two cameras are lists."""
    if progress is None:
        return {"sentence": "", "worst": None, "target": None, "map": None, "done": False, "wanted": None}
    record = {
        "sentence": progress.sentence,
        "worst": _number(progress.worst, 4),
        "target": _number(progress.target, 4),
        "done": bool(progress.done),
    }
    if isinstance(progress, PairProgress):
        views = (None, None) if progress.wanted is None else progress.wanted.views
        maps = progress.maps
        return record | {
            "parts": [_number(p, 4) for p in progress.parts],
            "map": None,
            "maps": None if maps is None else [_rows(m) for m in maps],
            "wanted": [None if v is None else _rounded(v.outline) for v in views],
        }
    wanted = progress.wanted
    return record | {
        "map": None if progress.map is None else _rows(progress.map),
        "wanted": None if wanted is None else _rounded(wanted.outline),
    }


def _number(value: float, digits: int) -> float | None:
    return round(float(value), digits) if np.isfinite(value) else None


def _rows(values: Array) -> list[list[float | None]]:
    return [[_number(v, 4) for v in row] for row in np.asarray(values, float)]


def _rounded(xy: Array) -> list[list[float]] | None:
    """Rounded positions (N, 2) px; None if one isn't finite."""
    values = np.asarray(xy, float)
    return np.round(values, DECIMALS).tolist() if np.isfinite(values).all() else None
