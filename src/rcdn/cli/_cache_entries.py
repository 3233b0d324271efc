"""What an entry of the cache holds: detections as plain values, with all digits, unlike the file of detections, and checked when they come back."""

from __future__ import annotations

import dataclasses
from typing import Any, get_args

import numpy as np

from rcdn.io import ImageResult
from rcdn.types import Board, Corners, Orientation, Pattern, Status
from rcdn.types.target import target_of, target_record

MOST = 1 << 20
"""pixels of a side and labels of a board are fewer"""


def packed(result: ImageResult) -> dict[str, Any]:
    """`result` as lists, dictionaries, texts and numbers."""
    size = {"width": int(result.width), "height": int(result.height)}
    found = {"corners": _plain(result.corners), "boards": [_plain(b) for b in result.boards]}
    return size | found | {"warnings": list(result.warnings)}


def _plain(value: Any) -> dict[str, Any]:
    """The fields of Corners or of a Board, arrays as lists."""
    pairs = [(f.name, getattr(value, f.name)) for f in dataclasses.fields(value)]
    pairs = [(name, target_record(v) if name == "target" and v is not None else v) for name, v in pairs]
    return {name: v.tolist() if hasattr(v, "tolist") else v for name, v in pairs}


def unpacked(record: Any, name: str) -> ImageResult:
    """The result that was packed. Raises one of many errors if `record` has another form, or values that no detection has."""
    width, height = _whole(record["width"]), _whole(record["height"])
    _check_points(record["corners"])
    boards = []
    for board in record["boards"]:
        _check_board(board, (width, height))
        target = None if board["target"] is None else target_of(board["target"])
        boards.append(Board(**board | {"image_size": (width, height), "target": target}))
    warnings = record["warnings"]
    if not isinstance(warnings, list) or not all(isinstance(text, str) for text in warnings):
        raise ValueError("no warnings")
    return ImageResult(name, width, height, Corners(**record["corners"]), tuple(boards), tuple(warnings))


def _check_board(board: dict[str, Any], size: tuple[int, int]) -> None:
    _check_points(board)
    labels = np.asarray(board["ij"])
    if tuple(map(_whole, board["image_size"])) != size:
        raise ValueError("a board of another picture")
    if labels.size and (labels.dtype.kind != "i" or not ((labels >= 0) & (labels < MOST)).all()):
        raise ValueError("no labels")
    if board["orientation"] not in get_args(Orientation) or board["pattern"] not in get_args(Pattern):
        raise ValueError("no kind of a board")


def _check_points(points: dict[str, Any]) -> None:
    """Raise ValueError unless positions are finite, statuses known, and all is numbers; how many, the types check themselves."""
    xy, status = np.asarray(points["xy"]), np.asarray(points["status"])
    if xy.dtype.kind not in "if" or not np.isfinite(xy).all() or (np.abs(xy) > MOST).any():
        raise ValueError("no positions")
    if len(status) and (status.dtype.kind != "i" or not np.isin(status, list(Status)).all()):
        raise ValueError("no statuses")
    for key in ("response", "axes", "sigma"):
        value = points.get(key)
        if value is not None and np.asarray(value).dtype.kind not in "if":
            raise ValueError(f"no numbers: {key}")


def _whole(value: Any) -> int:
    if type(value) is not int or not 0 < value < MOST:
        raise ValueError("not the size of a picture")
    return value
