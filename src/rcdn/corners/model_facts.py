"""The metadata of a network (the .json beside its ONNX file), validated before use."""

from __future__ import annotations

import json
from typing import Any

from rcdn.corners.normalise import KINDS
from rcdn.errors import RcdnError, shown

MOST_MARGIN = 1024
"""largest context around a tile, px"""
CELLS = (1, 2, 4, 8, 16, 32, 64)
"""allowed cell sizes, px; the sides of tiles are multiples of the cell size"""
SCALE = (1e-12, 1e12)
"""allowed range of a channel's largest value"""
FIX = "export the network again: rcdn export"
"""the fix that error messages about a network's files suggest"""


def read_facts(text: str, where: str) -> dict[str, Any]:
    """The metadata in `text`; the fields that inference uses are validated. Raises RcdnError, which begins with the
    file `where`."""
    try:
        facts = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise RcdnError(f"{where}: not JSON ({shown(str(error))}); {FIX}") from error
    _require(isinstance(facts, dict), where, "it must hold an object")
    margins, cell, kind = facts.get("margins"), facts.get("cell"), facts.get("normalisation")
    whole = (
        isinstance(margins, list)
        and len(margins) == 2
        and all(type(m) is int and 0 <= m <= MOST_MARGIN for m in margins)
    )
    _require(whole, where, f"'margins' must be two whole numbers from 0 to {MOST_MARGIN}, not {shown(margins)}")
    _require(type(cell) is int and cell in CELLS, where, f"'cell' must be one of {CELLS}, not {shown(cell)}")
    _require(
        isinstance(kind, str) and kind in KINDS, where, f"'normalisation' must be one of {KINDS}, not {shown(kind)}"
    )
    ranges = facts.get("ranges")
    rows = ranges is None or (isinstance(ranges, list) and all(isinstance(row, list) for row in ranges))
    _require(
        rows and all(_is_scale(v) for row in ranges or () for v in row),
        where,
        "'ranges' must be lists of positive numbers",
    )
    return facts


def _require(ok: bool, where: str, message: str) -> None:
    if not ok:
        raise RcdnError(f"{where}: {message}; {FIX}")


def _is_scale(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and SCALE[0] <= value <= SCALE[1]
