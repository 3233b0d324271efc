"""Both board recoveries side by side, for docs/recovery.md."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from rcdn.errors import many
from rcdn.io import write_bytes, write_image
from rcdn.report.overlay import draw_overlay
from rcdn.types import Array, Board
from rcdn_lab.recovery import Case

WIDTH, HEIGHT = 480, 360
"""of one panel, px"""
BAR, GAP = 26, 6
"""px: height of a caption, and width of the white gap between panels"""

SHEET = ("tilt 75", "fisheye 180", "cylinder", "wave", "occluded", "cut")
"""Kinds shown on the sheet, from the corners of `auto`."""
QUALITY = 80
"""JPEG quality of the sheet"""


class Gallery:
    """Keeps a case of each kind and preset: the first in which the recoveries differ, otherwise the first."""

    def __init__(self) -> None:
        self.cases: dict[tuple[str, str], Case] = {}

    def add(self, case: Case) -> None:
        """Consider one more case."""
        key = case.kind, case.preset
        if key not in self.cases or (case.differ and not self.cases[key].differ):
            self.cases[key] = case

    def write(self, folder: Path) -> None:
        """One picture `<kind>-<preset>.jpg` for each, and `recovery.jpg`, the sheet. Raises OutputError."""
        pairs = {key: side_by_side(case) for key, case in self.cases.items()}
        for (kind, preset), pair in pairs.items():
            write_image(folder / f"{kind.replace(' ', '_')}-{preset}.jpg", pair)
        whole = sheet([pairs[kind, "auto"] for kind in SHEET])
        write_bytes(
            folder / "recovery.jpg", cv2.imencode(".jpg", whole, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1].tobytes()
        )


def side_by_side(case: Case) -> Array:
    """The picture twice, (H, W, 3) BGR uint8: the paper's recovery at the left, ours at the right, captions above."""
    left = _panel(case, case.growth, f"{case.kind}: paper's growth, {_count(case.growth)}")
    right = _panel(case, case.graph, f"{case.kind}: link graph, {_count(case.graph)}")
    gap = np.full((len(left), GAP, 3), 255, np.uint8)
    return np.hstack([left, gap, right])


def sheet(pairs: Sequence[Array], columns: int = 2) -> Array:
    """Pictures of one size in rows of `columns`, separated by white; the last row is filled with white."""
    height, width = pairs[0].shape[:2]
    rows = -(-len(pairs) // columns)
    out = np.full((rows * (height + 2 * GAP) - 2 * GAP, columns * (width + 3 * GAP) - 3 * GAP, 3), 255, np.uint8)
    for k, pair in enumerate(pairs):
        y, x = k // columns * (height + 2 * GAP), k % columns * (width + 3 * GAP)
        out[y : y + height, x : x + width] = pair
    return out


def _count(boards: Sequence[Board]) -> str:
    corners = sum(len(b) for b in boards)
    return f"{many(len(boards), 'board')}, {many(corners, 'corner')}"


def _panel(case: Case, boards: Sequence[Board], caption: str) -> Array:
    x, y, width, height = _window(case)
    corner = np.array([x, y])
    moved = [replace(b, xy=b.xy - corner, image_size=(width, height)) for b in boards]
    corners = case.found.corners
    inside = ((corners.xy >= corner) & (corners.xy < corner + np.array([width, height]))).all(axis=1)
    seen = replace(corners, xy=corners.xy - corner).take(inside)
    drawn = draw_overlay(case.image[y : y + height, x : x + width], seen, moved)
    small = cv2.resize(drawn, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA)
    bar = np.full((BAR, WIDTH, 3), 255, np.uint8)
    cv2.putText(bar, caption, (4, 18), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (30, 30, 30), 1, cv2.LINE_AA)
    return np.vstack([bar, small])


def _window(case: Case) -> tuple[int, int, int, int]:
    """The part (x, y, width, height) of the picture that is shown: the boards' extent and a margin, 4 : 3."""
    full_height, full_width = case.image.shape
    if not case.growth + case.graph:
        return 0, 0, full_width, full_height
    xy = np.concatenate([b.xy for b in case.growth + case.graph])
    low, high = xy.min(axis=0), xy.max(axis=0)
    width = min(full_width, max(200, round(1.4 * max((high - low)[0], (high - low)[1] * WIDTH / HEIGHT))))
    height = min(full_height, round(width * HEIGHT / WIDTH))
    x, y = np.rint((low + high - [width, height]) / 2).astype(int).tolist()
    return min(max(x, 0), full_width - width), min(max(y, 0), full_height - height), width, height
