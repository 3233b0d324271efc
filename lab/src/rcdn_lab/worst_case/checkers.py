"""Synthetic checkerboards that are slow to detect: tiny squares, hundreds of boards, bent and broken ones. Analytic,
with soft edges; grey (H, W) uint8."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from rcdn.types import Array

DARK, BRIGHT = 40.0, 220.0
F32 = np.float32


def wave(phase: Array, pitch: float | Array) -> Array:
    """A square wave of period 2 in `phase`, −1 to 1, with transitions one pixel wide if a square has `pitch` px."""
    distance = 0.5 - np.abs(phase % 2 - 1)
    return np.asarray(np.clip(2 * distance * pitch, -1, 1), F32)


def grid(size: tuple[int, int]) -> tuple[Array, Array]:
    """Columns (1, W) and rows (H, 1) of a picture of (width, height)."""
    width, height = size
    return np.arange(width, dtype=F32)[None], np.arange(height, dtype=F32)[:, None]


def grey(contrast: Array) -> Array:
    """Contrast in −1..1 as grey levels between `DARK` and `BRIGHT`."""
    return np.asarray(np.rint((DARK + BRIGHT) / 2 + (BRIGHT - DARK) / 2 * contrast), np.uint8)


def board(size: tuple[int, int], pitch: float, angle: float = 0.0) -> Array:
    """The largest board of squares of `pitch` px that fits, rotated by `angle` rad, on white."""
    x, y = grid(size)
    c, s = float(np.cos(angle)), float(np.sin(angle))
    u, v = (
        ((x - size[0] / 2) * c + (y - size[1] / 2) * s) / pitch,
        ((y - size[1] / 2) * c - (x - size[0] / 2) * s) / pitch,
    )
    across, down = size[0] - 3 * pitch, size[1] - 3 * pitch
    turn = c * c - s * s
    columns, rows = (int((c * one - s * other) / turn / pitch) for one, other in ((across, down), (down, across)))
    return _on_white(u + columns / 2, v + rows / 2, columns, rows, pitch)


def cut(size: tuple[int, int], pitch: float, angle: float, margin: int = 12) -> Array:
    """A rotated board that is larger than the picture, behind a bright frame."""
    x, y = grid(size)
    c, s = np.cos(angle), np.sin(angle)
    u, v = (c * x + s * y) / F32(pitch) + F32(0.31), (c * y - s * x) / F32(pitch) + F32(0.27)
    out = grey(wave(u, pitch) * wave(v, pitch))
    out[:margin] = out[-margin:] = out[:, :margin] = out[:, -margin:] = BRIGHT
    return out


def _on_white(u: Array, v: Array, columns: int, rows: int, pitch: float) -> Array:
    """`columns` × `rows` squares from (0, 0) on in coordinates u, v, with soft edges."""
    rim = np.minimum(np.minimum(u, columns - u), np.minimum(v, rows - v)) * pitch
    share = np.clip(rim + 0.5, 0, 1)
    return grey(1 - share + share * wave(u + F32(0.5), pitch) * wave(v + F32(0.5), pitch))


def screen(size: tuple[int, int], columns: int, rows: int) -> Array:
    """A board of `columns` × `rows` squares as shown on a monitor, almost filling the picture."""
    x, y = grid(size)
    pitch = min(size[0] / (columns + 1.5), size[1] / (rows + 1.5))
    return _on_white(
        (x - size[0] / 2) / pitch + columns / 2, (y - size[1] / 2) / pitch + rows / 2, columns, rows, pitch
    )


def many(size: tuple[int, int], squares: int, pitch: int, gap: int) -> Array:
    """As many boards of `squares` × `squares` squares of `pitch` px as fit, `gap` px apart."""
    x, y = grid(size)
    side = squares * pitch + gap
    return _on_white((x % side - gap / 2) / pitch, (y % side - gap / 2) / pitch, squares, squares, pitch)


def turned(size: tuple[int, int], squares: int, pitch: int, gap: int, seed: int) -> Array:
    """As `many`, each board rotated by an angle of its own."""
    rng = np.random.default_rng(seed)
    x, y = grid(size)
    cell = squares * pitch + gap
    column, row = (x // cell).astype(int), (y // cell).astype(int)
    angles = rng.uniform(-0.4, 0.4, (size[1] // cell + 1, size[0] // cell + 1)).astype(F32)[row, column]
    c, s = np.cos(angles), np.sin(angles)
    dx, dy = (x % cell - cell / 2) / pitch, (y % cell - cell / 2) / pitch
    return _on_white(c * dx + s * dy + squares / 2, c * dy - s * dx + squares / 2, squares, squares, pitch)


def touching(size: tuple[int, int], pitch: int, cell: int) -> Array:
    """Adjacent boards without margins, each shifted relative to its neighbours."""
    x, y = grid(size)
    column, row = x // cell, y // cell
    u, v = (x + 3 * row) / pitch, (y + 5 * column) / pitch
    return grey(wave(u, pitch) * wave(v, pitch))


def flipped(size: tuple[int, int], pitch: int, share: float, seed: int) -> Array:
    """One board, a random `share` of whose squares has the other colour."""
    rng = np.random.default_rng(seed)
    x, y = grid(size)
    signs = rng.random((size[1] // pitch + 2, size[0] // pitch + 2)) < share
    other = signs[(y // pitch).astype(int), (x // pitch).astype(int)]
    return grey(wave(x / pitch + F32(0.5), pitch) * wave(y / pitch + F32(0.5), pitch) * np.where(other, -1, 1))


def holed(size: tuple[int, int], pitch: int, hole: int, every: int) -> Array:
    """One board with round holes of `hole` px across, `every` px apart."""
    x, y = grid(size)
    inside = np.hypot(x % every - every / 2, y % every - every / 2) < hole / 2
    return np.where(inside, np.uint8(128), cut(size, pitch, 0.0))


def nested(size: tuple[int, int], pitch: float, levels: int) -> Array:
    """A board whose bright squares contain boards, recursively."""
    x, y = grid(size)
    out = np.ones((size[1], size[0]), F32)
    for level in range(levels):
        p = pitch / 5**level
        fine = wave(x / p, p) * wave(y / p, p)
        out = np.where(out > 0, fine, out)
    return grey(out)


def warped(size: tuple[int, int], pitch: float, bend: Callable[[Array, Array], tuple[Array, Array]]) -> Array:
    """A checker of squares of about `pitch` px in the coordinates to which `bend` maps columns and rows, px."""
    x, y = grid(size)
    u, v = bend(x - F32(size[0] / 2), y - F32(size[1] / 2))
    return grey(wave(u / F32(pitch), pitch) * wave(v / F32(pitch), pitch))


def spiral(x: Array, y: Array) -> tuple[Array, Array]:
    """Logarithmic spirals, 96 squares per turn."""
    u, v = F32(96 / np.pi) * np.log(np.hypot(x, y) + 1), F32(96 / np.pi) * np.arctan2(y, x)
    return 8 * (u + v), 8 * (v - u)


def rings(x: Array, y: Array) -> tuple[Array, Array]:
    """Concentric rings, 120 sectors."""
    return np.hypot(x, y), np.arctan2(y, x) * F32(8 * 120 / (2 * np.pi))


def waves(x: Array, y: Array) -> tuple[Array, Array]:
    """Lines that undulate by 6 px over 150 px."""
    return x + 6 * np.sin(y / 24), y + 6 * np.sin(x / 24)


def triangles(size: tuple[int, int], edge: float) -> Array:
    """Equilateral triangles of two colours."""
    x, y = grid(size)
    height = edge * np.sqrt(3) / 2
    u, v = x / F32(edge) - y / F32(2 * height), y / F32(height)
    return grey(np.where((u % 1) + (v % 1) < 1, F32(-1), F32(1)))


def tiled(size: tuple[int, int], tile: Array) -> Array:
    """The `tile` (h, w) repeated over the whole picture."""
    height, width = tile.shape
    repeats = -(-size[1] // height), -(-size[0] // width)
    return np.tile(tile, repeats)[: size[1], : size[0]]


def codes(size: tuple[int, int], pixel: int, gap: int, seed: int) -> Array:
    """Square codes of 6 × 6 bits in black frames, each bit `pixel` px wide, `gap` px apart."""
    rng = np.random.default_rng(seed)
    cell = 8 * pixel + gap
    across, down = size[0] // cell + 1, size[1] // cell + 1
    bits = np.full((down, across, 8 * pixel + gap, 8 * pixel + gap), BRIGHT, np.uint8)
    inner = np.zeros((down, across, 8, 8), bool)
    inner[:, :, 1:7, 1:7] = rng.random((down, across, 6, 6)) < 0.5
    ink = np.where(inner, BRIGHT, DARK).astype(np.uint8)
    bits[:, :, : 8 * pixel, : 8 * pixel] = ink.repeat(pixel, 2).repeat(pixel, 3)
    return np.ascontiguousarray(bits.transpose(0, 2, 1, 3).reshape(down * cell, across * cell)[: size[1], : size[0]])
