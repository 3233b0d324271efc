"""Comparison of a file of detections with a file of truth (docs/formats.md): whole boards, recall, wrong corners, wrong
labels, false alarms."""

from __future__ import annotations

import json
from collections import defaultdict
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from rcdn.errors import FormatError
from rcdn.io import ImageResult, read_detections
from rcdn.metrics import match
from rcdn.types import Array, Board

RADIUS = 4.0
"""px; the paper's limit for a true corner (section 4.1)"""
COUNTS = (
    "pictures",
    "whole",
    "corners",
    "hits",
    "wrong",
    "mislabelled",
    "raw",
    "raw_hits",
    "open",
    "open_found",
    "empty",
    "alarms",
)
_TURNS = [np.array(m) for m in ([[1, 0], [0, 1]], [[0, 1], [-1, 0]], [[-1, 0], [0, -1]], [[0, -1], [1, 0]])]
SYMMETRIES = _TURNS + [t @ np.array([[1, 0], [0, -1]]) for t in _TURNS]


def table(detections: Path, truth: Path) -> list[dict[str, Any]]:
    """One row for each set, and one over all.

    A picture whose truth is null is `open`: only whether a board was found is counted; in one without corners a board
    is a false alarm. Raises FormatError for an invalid file.
    """
    images, _ = read_detections(detections)
    found = {"/".join(PurePosixPath(i.path.replace("\\", "/")).parts[-2:]): i for i in images}
    try:
        sets = json.loads(truth.read_text())
        rows = {name: _score_set(name, record, found) for name, record in sorted(sets.items())}
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise FormatError(f"{truth}: not a file of truth as `rcdn render` writes it: {error!r}") from error
    total = {key: sum(row[key] for row in rows.values()) for key in COUNTS}
    return [_row(name, counts) for name, counts in (rows | {"ALL": total}).items()]


def _score_set(name: str, record: dict[str, Any], found: dict[str, ImageResult]) -> dict[str, int]:
    counts: dict[str, int] = defaultdict(int)
    columns = (record["board"] or [0, 0])[0]
    for file, known in record["images"].items():
        image = found.get(f"{name}/{file}")
        boards = list(image.boards) if image else []
        if known["xy"] is None:
            counts["open"] += 1
            counts["open_found"] += bool(boards)
        elif not known["xy"]:
            counts["empty"] += 1
            counts["alarms"] += bool(boards)
        else:
            raw = image.corners.xy if image else np.zeros((0, 2))
            _score_picture(counts, boards, raw, known, columns if known.get("ordered") else 0, record["exhaustive"])
    return {key: counts[key] for key in COUNTS}


def _score_picture(
    counts: dict[str, int], boards: list[Board], raw: Array, known: dict[str, Any], columns: int, exhaustive: bool
) -> None:
    true, ignore = np.array(known["xy"], float), np.array(known.get("ignore") or np.zeros((0, 2)), float)
    counts["pictures"] += 1
    counts["corners"] += len(true)
    counts["raw"] += len(raw)
    counts["raw_hits"] += len(match(raw, true, RADIUS)[0])
    kept = [_counted(board, true, ignore) for board in boards]
    every = np.concatenate([xy for xy, _ in kept]) if kept else np.zeros((0, 2))
    hits = len(match(every, true, RADIUS)[0])
    counts["hits"] += hits
    counts["wrong"] += len(every) - hits if exhaustive else 0
    verdicts = [judged(xy, ij, true, columns) for xy, ij in kept]
    counts["mislabelled"] += sum(not fits for fits, _ in verdicts)
    counts["whole"] += any(whole for _, whole in verdicts)


def judged(xy: Array, ij: Array, true: Array, columns: int) -> tuple[bool, bool]:
    """Whether a board with corners `xy` (N, 2) px and labels `ij` (N, 2) has no wrong label, and whether it is also
    whole: it has each of the `true` corners (M, 2), and no other. `columns` of the true board, whose corners are given
    row by row; 0: its labels are unknown."""
    pairs, _ = match(xy, true, RADIUS)
    fits = True
    if columns and len(pairs) > 2:
        label = np.stack([pairs[:, 1] % columns, pairs[:, 1] // columns], axis=1)
        fits = labels_fit(ij[pairs[:, 0]], label)
    return fits, fits and len(pairs) == len(true) == len(xy)


def _counted(board: Board, true: Array, ignore: Array) -> tuple[Array, Array]:
    """Positions and labels of a board, except those at an ignored position that match no true corner."""
    if not len(ignore) or not len(board):
        return board.xy, board.ij
    drop = cKDTree(ignore).query(board.xy)[0] < RADIUS
    drop[match(board.xy, true, RADIUS)[0][:, 0]] = False
    return board.xy[~drop], board.ij[~drop]


def labels_fit(mine: Array, true: Array) -> bool:
    """Whether one symmetry of the square lattice and one translation take every label (N, 2) to its true one."""
    return any(len(np.unique(true - mine @ s.T, axis=0)) == 1 for s in SYMMETRIES)


def _row(name: str, counts: dict[str, int]) -> dict[str, Any]:
    def share(a: str, b: str) -> float | str:
        return round(counts[a] / counts[b], 4) if counts[b] else "-"

    return {
        "set": name,
        "whole": f"{counts['whole']}/{counts['pictures']}",
        "recall": share("hits", "corners"),
        "wrong": counts["wrong"],
        "mislabelled": counts["mislabelled"],
        "raw recall": share("raw_hits", "corners"),
        "raw precision": share("raw_hits", "raw"),
        "open": f"{counts['open_found']}/{counts['open']}",
        "alarms": f"{counts['alarms']}/{counts['empty']}",
    }
