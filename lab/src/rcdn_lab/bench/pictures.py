"""Rendered pictures for timing: a board that fills half of the picture, and clutter and texture without one."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from rcdn.errors import ConfigError
from rcdn.synthetic import Background, BoardSpec, Scene, Sensor, render
from rcdn.synthetic.surface import board_to_pixels
from rcdn.types import Array
from rcdn_lab.bench import textured
from rcdn_lab.sweep.pictures import placed

Size = tuple[int, int]
FIRST = 9_100_000
"""seed of the backgrounds"""
FILLED = 0.5
"""share of the picture that the board with its quiet zone takes, if it fits"""
NOISE, BLUR = 3.0, 0.7
"""standard deviations: noise, grey levels; blur, px"""
TILT, AXIS, ROLL = np.deg2rad([15.0, 35.0, 5.0])
PANEL = (320, 240)
"""px; clutter is rendered in panels, so that its density per pixel is the same in large and small pictures"""
CLUTTER = ("tiles", "text", "shapes", "blocks")


@dataclass(frozen=True, eq=False)
class Cell:
    """What all detectors are timed on alternately: `pictures` (H, W) uint8 of one `size` (width, height), one after the
    other.

    `board`: the size (columns, rows) given to detectors that need it; `only`: the detectors timed, empty: all that
    search for that size.
    """

    kind: str
    size: Size
    board: Size
    pictures: tuple[Array, ...]
    only: tuple[str, ...] = ()


@cache
def rendered(kind: str, size: Size, board: Size) -> Array:
    """The picture `board`, `clutter` or `texture`, (H, W) uint8; the same arguments give the same bytes."""
    image = board_picture(size, board) if kind == "board" else panels(size, kind)
    image.setflags(write=False)
    return image


def board_picture(size: Size, board: Size) -> Array:
    """One board, slightly tilted and rotated, on a smooth background, with mild blur and noise."""
    scene = _scene(size, "noise", FIRST)
    blank = BoardSpec(*board, (0, 0, 0), (0, 0, 1))
    pitch = float(np.sqrt(FILLED * size[0] * size[1] / ((board[0] + 2) * (board[1] + 2))))
    rim = [(i, j) for i in (-1.5, board[0] + 0.5) for j in (-1.5, board[1] + 0.5)]
    while pitch > 4:
        spec = placed(blank, scene.camera, np.array(scene.centre), pitch, float(TILT), float(AXIS), float(ROLL))
        if spec is not None:
            xy = board_to_pixels(spec, scene.camera, np.array(rim))
            if ((xy >= 0) & (xy <= np.array(size) - 1)).all():
                return render(replace(scene, boards=(spec,)), samples=1)  # more samples take a minute at 12 megapixels
        pitch *= 0.97
    raise ConfigError(f"--board {board[0]}x{board[1]} doesn't fit a picture of {size[0]}x{size[1]} px")


def panels(size: Size, kind: str) -> Array:
    """Panels without a board, each row shifted: where panels meet there are T-junctions, no X-junctions.

    `clutter`: tiles, text, shapes and blocks; `texture`: leaves of filtered noise.
    """
    width, height = size
    across = -(-width // PANEL[0]) + 1
    rows = []
    for row in range(-(-height // PANEL[1])):
        numbers = range(row * across, (row + 1) * across)
        line = np.hstack([_panel(kind, k, row) for k in numbers])
        shift = PANEL[0] // 2 if row % 2 else 0
        rows.append(line[:, shift : shift + width])
    return np.ascontiguousarray(np.vstack(rows)[:height])


def _panel(kind: str, number: int, row: int) -> Array:
    if kind == "texture":
        return textured.panel(PANEL, number, BLUR, NOISE)
    return render(_scene(PANEL, CLUTTER[(number + row) % len(CLUTTER)], FIRST + 1 + number))


def _scene(size: Size, background: str, seed: int) -> Scene:
    width, height = size
    return Scene(
        width, height, float(width), ((width - 1) / 2, (height - 1) / 2), sensor=Sensor(blur=BLUR, noise=NOISE),
        background=Background(background, seed), seed=seed,
    )  # fmt: skip
