"""Photographs with labelled corners, original and degraded: ours, without a target, compared with others, which are
given the target."""

from __future__ import annotations

import json
import zlib
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from rcdn.errors import FormatError
from rcdn.io import read_image
from rcdn.types import Array
from rcdn.types.target import AprilGrid, Charuco, PuzzleBoard, Target
from rcdn_lab.coded.readers import OURS, can_read, judged, load
from rcdn_lab.coded.score import Count, TrueBoard, row
from rcdn_lab.share_out import share_out

PART, DEGRADED = "real", "degraded"
AS_IT_IS = "as it is"
CONDITIONS = ("half", "blur 2", "noise 20", "dark")
"""Halved by area averaging; a Gaussian of σ 2 px; noise of σ 20 grey levels; a fifth of the light."""
ALL = "ALL"
Picture = tuple[str, tuple[TrueBoard, ...]]
"""set/file, and its boards"""
Task = tuple[Picture, str]
Scores = dict[str, tuple[Count, Count]]
"""reader → its score on the boards that it supports, and ours on the same"""


def truth_of(folder: Path) -> list[Picture]:
    """The pictures that `truth.json` in a folder labels: `{"set/file": [{"kind", "ids", "xy", …}, …]}`, px; null: left
    out.

    ChArUco boards have `squares`, `dictionary`, `legacy`, `inverted` and `marker` (0.75 if absent); AprilGrids `tags`,
    `family`, `first`, `gap` (0.3) and `border` (2). Raises FormatError for an invalid file.
    """
    path = folder / "truth.json"
    try:
        known = json.loads(path.read_text())
        return [(name, tuple(_board(b) for b in boards)) for name, boards in known.items() if boards is not None]
    except (OSError, ValueError, KeyError, TypeError, AttributeError, IndexError) as error:
        raise FormatError(f"{path}: not a file of labelled boards: {error!r}") from error


def _board(known: dict[str, Any]) -> TrueBoard:
    ids, xy = np.array(known["ids"], int), np.array(known["xy"], float).reshape(-1, 2)
    return TrueBoard(_target(known), ids, xy, np.ones(len(ids), bool), whole=False)


def _target(known: dict[str, Any]) -> Target:
    if known["kind"] == "puzzleboard":
        return PuzzleBoard()
    if known["kind"] == "charuco":
        (columns, rows), legacy = known["squares"], known.get("legacy", False)
        marker, inverted = known.get("marker", 0.75), known.get("inverted", False)
        return Charuco(columns, rows, known["dictionary"], marker, known.get("first", 0), legacy, inverted)
    columns, rows = known["tags"]
    return AprilGrid(
        columns, rows, known["family"], known.get("gap", 0.3), known.get("border", 2), known.get("first", 0)
    )


def degraded(image: Array, condition: str, name: str) -> tuple[Array, float]:
    """A copy (H, W) uint8 of a grey picture under one of `CONDITIONS`, and its scale; `name` seeds the noise. `as it
    is`: the picture itself."""
    if condition == AS_IT_IS:
        return image, 1.0
    grey: Array = image.astype(np.float32)
    if condition == "half":
        height, width = (n // 2 for n in grey.shape)
        grey = np.asarray(cv2.resize(grey[: 2 * height, : 2 * width], (width, height), interpolation=cv2.INTER_AREA))
    elif condition == "blur 2":
        grey = np.asarray(cv2.GaussianBlur(grey, (0, 0), 2.0))
    elif condition == "dark":
        grey = grey / 5
    else:
        rng = np.random.default_rng(zlib.crc32(f"{condition}/{name}".encode()))
        grey = grey + 20 * rng.standard_normal(grey.shape, dtype=np.float32)
    return np.clip(np.rint(grey), 0, 255).astype(np.uint8), 0.5 if condition == "half" else 1.0


def scaled(board: TrueBoard, scale: float) -> TrueBoard:
    """The board in a picture of another scale."""
    return TrueBoard(board.target, board.ids, (board.xy + 0.5) * scale - 0.5, board.demanded, board.whole)


def table(
    folder: Path,
    peers: Sequence[str] = (),
    conditions: Sequence[str] = (AS_IT_IS,),
    workers: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> list[dict[str, Any]]:
    """One row for each condition, set and reader, and one for all sets. `ours`: corners that ours read on the boards
    that the reader supports; `ratio`: ours ÷ the reader's."""
    pictures = truth_of(folder)
    names = (OURS, *peers)
    tasks = [(picture, condition) for condition in conditions for picture in pictures]
    sums: dict[tuple[str, str, str], tuple[Count, Count]] = {}
    work = share_out(partial(_one, folder=folder, names=names), tasks, workers, load, (names,), progress)
    for ((name, _), condition), scores in zip(tasks, work, strict=True):
        for reader, (theirs, ours) in scores.items():
            for group in (Path(name).parent.name, ALL):
                a, b = sums.get((condition, group, reader), (Count(), Count()))
                sums[condition, group, reader] = a + theirs, b + ours
    return [
        _row(*key, *counts) for key, counts in sorted(sums.items(), key=lambda item: _order(item[0], conditions, names))
    ]


def _order(key: tuple[str, str, str], conditions: Sequence[str], names: Sequence[str]) -> tuple[int, bool, str, int]:
    condition, group, reader = key
    return list(conditions).index(condition), group == ALL, group, list(names).index(reader)


def _row(condition: str, group: str, reader: str, theirs: Count, ours: Count) -> dict[str, Any]:
    ratio = round(ours.right / theirs.right, 3) if theirs.right else None
    part = PART if condition == AS_IT_IS else DEGRADED
    start = {"part": part, "set": group, "condition": condition, "reader": reader}
    return {**start, **row(theirs), "ours": ours.right, "ratio": ratio}


def _one(task: Task, folder: Path, names: Sequence[str]) -> Scores:
    (name, boards), condition = task
    image, scale = degraded(np.clip(np.rint(read_image(folder / name)), 0, 255).astype(np.uint8), condition, name)
    boards = tuple(scaled(board, scale) for board in boards)
    all_of_us = judged(OURS, image, boards)
    out = {OURS: (all_of_us, all_of_us)}
    for reader in names[1:]:
        some = [board for board in boards if can_read(reader, board.target)]
        if some:
            ours = all_of_us if len(some) == len(boards) else judged(OURS, image, some)
            out[reader] = judged(reader, image, some), ours
    return out
