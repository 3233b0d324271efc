"""The guide's output as JSON for the page: rounded numbers, none of them infinite."""

from __future__ import annotations

from typing import Any

import numpy as np

from rcdn.calibration.guidance import Look, Progress
from rcdn.types import Array, Board

DECIMALS = 1
"""decimals of positions on the page, px"""


def look_facts(board: Board | None, look: Look | None, refused: str) -> dict[str, Any]:
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
    if look is not None:
        record["refused"], record["hint"] = look.refused, look.hint
        record["fit"], record["take"] = _number(look.fit, 3) or 0.0, bool(look.take)
        record["arrow"] = None if look.arrow is None else _rounded(np.asarray(look.arrow, float))
    return record


def progress_facts(progress: Progress | None) -> dict[str, Any]:
    """Progress of the calibration; empty without a guide."""
    if progress is None:
        return {"sentence": "", "worst": None, "target": None, "map": None, "done": False, "wanted": None}
    wanted = progress.wanted
    return {
        "sentence": progress.sentence,
        "worst": _number(progress.worst, 4),
        "target": _number(progress.target, 4),
        "map": None if progress.map is None else _rows(progress.map),
        "done": bool(progress.done),
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
