"""Pictures, as files and as arrays: read, and looked for boards in."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from tests.fuzz import samples
from tests.fuzz.mutate import changed_bytes
from tests.fuzz.source import ODD_REALS, Source
from tests.fuzz.target import Target, as_file, must
from tests.fuzz.texts import valid_board

from rcdn import Detector, DetectorConfig, read_image
from rcdn.types import Array

LARGEST_SIDE = 128
"""px, the longer side of pictures that boards are looked for in"""
DTYPES = (
    "u1",
    "u1",
    "u1",
    "f4",
    "f4",
    "u2",
    "f8",
    "i1",
    "i2",
    "i4",
    "i8",
    "u4",
    "u8",
    "f2",
    "?",
    ">u2",
    ">f4",
    "c8",
    "O",
    "S1",
    "m8[s]",
)


@cache
def _detector(pattern: Any, preset: str = "auto", threads: int = 1) -> Detector:
    return Detector(DetectorConfig.preset(preset, threads=threads, pattern=pattern))


def _file(source: Source) -> bytes:
    return changed_bytes(source, source.choice(samples.pictures())[1])


def _read(data: bytes) -> None:
    grey = read_image(as_file(data, ".png"))
    valid_grey(grey)
    if max(grey.shape) <= 96 and len(data) % 8 == 0:
        detected(_detector("checker"), grey)


def valid_grey(grey: Array) -> None:
    """(H, W), uint8 or finite float32 in 0..255."""
    must(grey.ndim == 2 and grey.size, f"a picture of shape {grey.shape}")
    must(grey.dtype in (np.uint8, np.float32), f"a picture of {grey.dtype}")
    must(grey.dtype == np.uint8 or (grey.min() >= 0 and grey.max() <= 255), "grey values outside 0..255")


def array(source: Source) -> Array:
    """A picture or what isn't one: any type and shape, of noise, boards, few values or odd ones."""
    height, width = (source.choice((1, 2, 3, 5, 8, 13, 24, 31, 48, 64, 65, 100, LARGEST_SIDE)) for _ in range(2))
    if source.chance(3):
        height, width = 1 + source.below(LARGEST_SIDE), 1 + source.below(LARGEST_SIDE)
    tail = source.choice(((), (), (), (), (3,), (4,), (1,), (2,), (0,), (3, 1)))
    grey = _content(source, height, width)
    values = grey if not tail else np.broadcast_to(grey.reshape(*grey.shape, *[1] * len(tail)), (*grey.shape, *tail))
    return _typed(source, np.ascontiguousarray(values))


def _content(source: Source, height: int, width: int) -> Array:
    """(height, width) float64, mostly in 0..255."""
    kind, rng = source.byte() % 8, source.random()
    if kind == 0:
        return rng.integers(0, 256, (height, width)).astype(float)
    if kind == 1:
        return np.full((height, width), float(source.byte()))
    if kind == 2:
        return 255.0 * rng.integers(0, 2, (height, width))
    if kind == 3:
        side, shift = source.between(2, 16), source.below(16)
        y, x = np.mgrid[:height, :width] + shift
        return 255.0 * ((x // side + y // side) % 2)
    if kind == 4:
        y, x = np.mgrid[:height, :width]
        return 127.5 + 127.5 * np.sin(x * rng.uniform(0.05, 3)) * np.sin(y * rng.uniform(0.05, 3))
    pattern = "deltille" if kind == 5 else "checker"
    good = samples.picture(
        source.between(3, 6),
        source.between(2, 5),
        source.choice((7.0, 10.0, 14.0)),
        (width + 8, height + 8),
        pattern,
        source.below(3),
    )
    cut = good[source.below(8) :, source.below(8) :][:height, :width].astype(float)
    return np.clip(cut + rng.normal(0, source.choice((0.0, 3.0, 30.0)), cut.shape), 0, 255)


def _typed(source: Source, values: Array) -> Any:
    kind = np.dtype(source.choice(DTYPES))
    if kind.kind == "f":
        values = values * source.choice((1.0, 1.0, 1 / 255, 1e-3, 1e4, 1e25, 1e-38, -1.0)) + source.choice(
            (0.0, 0.0, -128.0, 1e6)
        )
        with np.errstate(all="ignore"):
            values = values.astype(kind)
            for _ in range(source.below(4)):
                values.flat[source.below(values.size or 1) if values.size else slice(0)] = source.choice(ODD_REALS)
    else:
        with np.errstate(all="ignore"):
            values = (values * (256.0 if kind.itemsize > 1 and source.chance(2) else 1.0)).astype(kind)
    form = source.byte() % 8
    if form == 0:
        return values[::-1]
    if form == 1:
        return values[:, ::2]
    if form == 2:
        return np.asfortranarray(values)
    if form == 3:
        raw = np.zeros(values.nbytes + 1, np.uint8)[1:]
        odd = raw.view(values.dtype).reshape(values.shape) if values.dtype != object else values
        odd[...] = values
        return odd
    return values


def detected(detector: Detector, image: Any) -> None:
    """Detect; what comes back must be whole, within the picture, and the same twice."""
    found = detector.detect(image)
    height, width = np.asarray(image).shape[:2]
    corners = found.corners
    _within(corners.xy, width, height)
    must(np.isfinite(corners.response).all(), "a response isn't finite")
    if corners.axes is not None:
        known = corners.axes[~np.isnan(corners.axes)]
        must((known >= 0).all() and (known <= np.pi).all(), "axes outside [0, π]")
    for board in found.boards:
        valid_board(board)
        _within(board.xy, width, height)
        must(tuple(board.image_size) == (width, height), f"a board of a picture of {board.image_size}")
        must((board.ij.min(axis=0) == 0).all(), "labels that don't begin at 0")
        must(board.sigma is None or (board.sigma[np.isfinite(board.sigma)] > 0).all(), "a sigma that isn't positive")
        must(len(board) >= detector.config.min_corners, f"a board of {len(board)} corners")


def _within(xy: Array, width: int, height: int) -> None:
    must(np.isfinite(xy).all(), "a position isn't finite")
    must((xy >= -0.5).all() and (xy <= [width - 0.5, height - 0.5]).all(), f"a position outside of {width} × {height}")


def _squares(image: Any) -> None:
    detected(_detector("checker"), image)


def _triangles(image: Any) -> None:
    detected(_detector("deltille"), image)


def _paper(image: Any) -> None:
    detected(_detector("checker", "paper"), image)


TARGETS = [
    Target("picture files", _file, _read, ".png", share=2),
    Target("arrays", array, _squares, share=3),
    Target("arrays of triangles", array, _triangles),
    Target("arrays by the paper", array, _paper, share=0.5),
]
