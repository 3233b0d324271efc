"""Textured clutter without a board: overlapping leaves of all sizes, each with a texture of filtered noise.

The dead leaves model (Lee, Mumford and Huang 2001, "Occlusion models for natural images"): a density of radii that
falls with the third power gives pictures the same statistics at all scales, as in photographs. No photograph is used.
"""

from __future__ import annotations

import cv2
import numpy as np

from rcdn.types import Array

F32 = np.float32
RADII = (3.0, 90.0)
"""px"""
LEAVES = 900
"""leaves of a panel; uncovered pixels are ground, with a texture of its own"""
GREY, DEEP = (25.0, 230.0), (8.0, 45.0)
"""ranges: grey level of a leaf, and standard deviation of its texture"""


def panel(size: tuple[int, int], seed: int, blur: float, noise: float) -> Array:
    """(H, W) uint8 of `size` (width, height): leaves with `blur` px and noise of `noise` grey levels."""
    rng = np.random.default_rng([4711, seed])
    number = _leaves(size, rng)
    grey, deep = rng.uniform(*GREY, LEAVES + 1), rng.uniform(*DEEP, LEAVES + 1)
    bank = np.stack([texture(size, kind, rng) for kind in KINDS])
    kind = rng.integers(0, len(KINDS), LEAVES + 1)[number]
    rows, columns = np.indices(number.shape)
    scene = grey[number] + deep[number] * bank[kind, rows, columns]
    seen = cv2.GaussianBlur(scene.astype(F32), (0, 0), blur) + noise * rng.standard_normal(number.shape, F32)
    return np.clip(np.rint(seen), 0, 255).astype(np.uint8)


def _leaves(size: tuple[int, int], rng: np.random.Generator) -> Array:
    """(H, W) int: the number of the topmost ellipse at each pixel, 0 where there is none."""
    low, high = RADII
    radii = (low**-2 - rng.random(LEAVES) * (low**-2 - high**-2)) ** -0.5
    centres = rng.uniform((0, 0), size, (LEAVES, 2))
    out = np.zeros(size[::-1], F32)
    for number, (radius, centre) in enumerate(zip(radii, centres, strict=True), start=1):
        box = (2 * radius, 2 * radius * rng.uniform(0.3, 1.0))
        cv2.ellipse(out, (tuple(centre.tolist()), box, float(rng.uniform(0, 180))), float(number), -1)
    return out.astype(int)


KINDS = ("pink", "grain", "threads", "stains")


def texture(size: tuple[int, int], kind: str, rng: np.random.Generator) -> Array:
    """(H, W) with mean 0 and standard deviation 1: white noise through a filter.

    `pink`: amplitude proportional to 1 / frequency; `grain`: one octave around a period of 3–8 px; `threads`: one
    period and one direction, as in cloth, grass or fur; `stains`: one octave, thresholded to two levels.
    """
    fy, fx = np.fft.fftfreq(size[1])[:, None], np.fft.rfftfreq(size[0])[None, :]
    frequency = np.hypot(fx, fy)
    centre = 1 / rng.uniform(3.0, 8.0)
    if kind == "pink":
        gain = 1 / np.maximum(frequency, 1 / max(size))
    elif kind == "threads":
        angle = rng.uniform(0, np.pi)
        along, across = np.cos(angle) * fx + np.sin(angle) * fy, np.cos(angle) * fy - np.sin(angle) * fx
        gain = np.exp(-((np.abs(along) - centre) ** 2) / (2 * (0.25 * centre) ** 2) - across**2 / (2 * 0.03**2))
    else:
        gain = np.exp(-0.5 * (np.log(np.maximum(frequency, 1e-6) / centre) / 0.35) ** 2)
    spectrum = np.fft.rfft2(rng.standard_normal(size[::-1])) * gain
    spectrum[0, 0] = 0
    out = np.fft.irfft2(spectrum, s=size[::-1])
    if kind == "stains":
        out = np.sign(out - np.quantile(out, rng.uniform(0.3, 0.7)))
    return np.asarray((out - out.mean()) / out.std(), F32)
