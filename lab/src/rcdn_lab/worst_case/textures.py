"""Pictures without a board: noise, dots, lines, waves, clutter, and unusual data types. Grey (H, W), from seeds."""

from __future__ import annotations

import cv2
import numpy as np

from rcdn.types import Array
from rcdn_lab.worst_case.checkers import BRIGHT, DARK, F32, grey, grid

Size = tuple[int, int]


def _rng(seed: int) -> np.random.Generator:
    return np.random.default_rng([22, seed])


def white_noise(size: Size, seed: int = 0) -> Array:
    """Independent pixels."""
    return _rng(seed).integers(0, 256, size[::-1], dtype=np.uint8)


def smooth_noise(size: Size, sigma: float, seed: int = 1) -> Array:
    """White noise blurred by `sigma` px, over all grey levels."""
    noise = cv2.GaussianBlur(_rng(seed).standard_normal(size[::-1], F32), (0, 0), sigma)
    return grey(np.clip(noise / (2.5 * noise.std()), -1, 1))


def salt_and_pepper(size: Size, share: float, seed: int = 2) -> Array:
    """Grey, with a `share` of the pixels black or white."""
    draw = _rng(seed).random(size[::-1], F32)
    return np.where(draw < share / 2, 0, np.where(draw < share, 255, 128)).astype(np.uint8)


def checker_noise(size: Size, pitch: int, seed: int = 3) -> Array:
    """Squares of `pitch` px, each randomly black or white."""
    cells = _rng(seed).random((size[1] // pitch + 1, size[0] // pitch + 1)) < 0.5
    large = np.where(cells, BRIGHT, DARK).astype(np.uint8).repeat(pitch, 0).repeat(pitch, 1)
    return np.ascontiguousarray(large[: size[1], : size[0]])


def saddles(size: Size, period: float) -> Array:
    """The product of two sines of `period` px: saddles everywhere."""
    x, y = grid(size)
    k = F32(2 * np.pi / period)
    return grey(np.sin(k * x) * np.sin(k * y + F32(0.4)))


def halftone(size: Size, period: float, angle: float = 0.4) -> Array:
    """A ramp as printed: round dots with a spacing of `period` px that grow, touch and become holes."""
    x, y = grid(size)
    k, c, s = F32(np.pi / period), F32(np.cos(angle)), F32(np.sin(angle))
    screen = np.sin(k * (c * x + s * y)) * np.sin(k * (c * y - s * x))
    return grey(np.clip(6 * (screen + 2 * x / size[0] - 1), -1, 1))


def moire(size: Size) -> Array:
    """Two gratings of nearly equal periods, rotated relative to each other."""
    x, y = grid(size)
    one, two = np.sin(x * F32(0.9) + y * F32(0.05)), np.sin(x * F32(0.05) + y * F32(0.87))
    three = np.sin(x * F32(0.95) - y * F32(0.04))
    return grey(np.clip(one * two + three * two, -1, 1))


def zone_plate(size: Size) -> Array:
    """Rings whose frequency rises to half a cycle per pixel at the border."""
    x, y = grid(size)
    square = (x - F32(size[0] / 2)) ** 2 + (y - F32(size[1] / 2)) ** 2
    return grey(np.cos(F32(np.pi / max(size)) * square))


def stripes(size: Size, period: int) -> Array:
    """Vertical stripes."""
    x, y = grid(size)
    return np.where((x + 0 * y) % period < period / 2, DARK, BRIGHT).astype(np.uint8)


def lines(size: Size, period: int, width: int = 1) -> Array:
    """A grid of dark lines, `width` px wide."""
    x, y = grid(size)
    return np.where((x % period < width) | (y % period < width), DARK, BRIGHT).astype(np.uint8)


def circles(size: Size, period: int) -> Array:
    """A grid of dark discs."""
    x, y = grid(size)
    radius = np.hypot(x % period - period / 2, y % period - period / 2)
    return grey(np.clip(radius - F32(0.35 * period), -1, 1))


def bricks(size: Size, width: int, height: int) -> Array:
    """Rows of bricks, every other one shifted by half: staggered junctions, alternately dark and bright."""
    x, y = grid(size)
    row = y // height
    return np.where(((x + width // 2 * (row % 2)) // width + row) % 2 == 0, DARK, BRIGHT).astype(np.uint8)


def text(size: Size, height: int, seed: int = 4) -> Array:
    """Random letters, `height` px high, line by line."""
    rng = _rng(seed)
    out = np.full(size[::-1], BRIGHT, np.uint8)
    letters = np.array(list("#+XxHKM8%&@EFAWZkz*=0123456789"))
    for y in range(height, size[1] + height, round(1.4 * height)):
        line = "".join(rng.choice(letters, int(size[0] / (0.6 * height)) + 1))
        cv2.putText(out, line, (2, y), cv2.FONT_HERSHEY_SIMPLEX, height / 25, DARK, max(1, height // 12))
    return out


def blocks(size: Size, quality: int, seed: int = 5) -> Array:
    """Smooth noise after JPEG compression of low `quality`."""
    _, data = cv2.imencode(".jpg", smooth_noise(size, 3.0, seed), [cv2.IMWRITE_JPEG_QUALITY, quality])
    return np.asarray(cv2.imdecode(data, cv2.IMREAD_GRAYSCALE))


def constant(size: Size, level: int) -> Array:
    """One grey level."""
    return np.full(size[::-1], level, np.uint8)


def sixteen_bits(size: Size, seed: int = 6) -> Array:
    """Independent pixels of 16 bits."""
    return _rng(seed).integers(0, 65536, size[::-1], dtype=np.uint16)


def reals(size: Size, largest: float, seed: int = 7) -> Array:
    """Normal noise of standard deviation `largest`, float32."""
    return _rng(seed).standard_normal(size[::-1], F32) * F32(largest)
