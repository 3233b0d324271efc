"""Contents of a cache entry: detections as plain values with all digits (the file of detections rounds them), checked
when they are read back."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from rcdn.io import ImageResult
from rcdn.types import Board, Corners
from rcdn.types.target import target_of, target_record


def packed(result: ImageResult) -> dict[str, Any]:
    """`result` as lists, dictionaries, strings and numbers."""
    size = {"width": int(result.width), "height": int(result.height)}
    found = {"corners": _plain(result.corners), "boards": [_plain(b) for b in result.boards]}
    return size | found | {"warnings": list(result.warnings)}


def _plain(value: Any) -> dict[str, Any]:
    """The fields of Corners or of a Board, arrays as lists."""
    pairs = [(f.name, getattr(value, f.name)) for f in dataclasses.fields(value)]
    pairs = [(name, target_record(v) if name == "target" and v is not None else v) for name, v in pairs]
    return {name: v.tolist() if hasattr(v, "tolist") else v for name, v in pairs}


def unpacked(record: Any, name: str) -> ImageResult:
    """The inverse of `packed`. Raises errors of several types if `record` has another structure, or values that no
    detection has: the types check their ranges, and this function the further conditions on detections."""
    read = lambda target: None if target is None else target_of(target)  # noqa: E731
    corners = Corners(**record["corners"])
    boards = tuple(Board(**board | {"target": read(board["target"])}) for board in record["boards"])
    if not all(np.isfinite(xy).all() for xy in (corners.xy, *(board.xy for board in boards))):
        raise ValueError("no positions")
    if not all((board.ij >= 0).all() for board in boards):
        raise ValueError("no labels")
    warnings = record["warnings"]
    if not isinstance(warnings, list) or not all(isinstance(text, str) for text in warnings):
        raise ValueError("no warnings")
    return ImageResult(name, record["width"], record["height"], corners, boards, tuple(warnings))
