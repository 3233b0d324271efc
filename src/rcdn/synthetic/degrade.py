"""Light, optics and sensor: from reflectance to the grey levels of a picture."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from rcdn.synthetic.scene import Cover, Light, Sensor
from rcdn.types import Array
from rcdn.types.arrays import Real, Shaped

F32 = np.float32


def signed_distance(cover: Cover, x: Array, y: Array) -> Array:
    """Signed distance from a cover's border, px, negative inside. `x`, `y`: any shape."""
    dx, dy = cover.x1 - cover.x0, cover.y1 - cover.y0
    length = float(np.hypot(dx, dy))
    c, s = (dx / length, dy / length) if length > 1e-9 else (1.0, 0.0)
    along, across = (x - cover.x0) * c + (y - cover.y0) * s, (y - cover.y0) * c - (x - cover.x0) * s
    if cover.square:
        return np.maximum(np.abs(along - length / 2) - length / 2, np.abs(across) - cover.radius)
    return np.hypot(along - np.clip(along, 0, length), across) - cover.radius


def coverage(cover: Cover, x: Array, y: Array) -> Array:
    """Share of each pixel under the cover, with a soft border of `soft` px."""
    return np.clip(0.5 - signed_distance(cover, x, y) / cover.soft, 0, 1)


@np.errstate(under="ignore")  # far from a glare
def illuminate(image: Array, light: Light, x: Array, y: Array, size: tuple[int, int]) -> Array:
    """Reflectance times illumination. `x`, `y` broadcast to the picture's pixels; `size` is that of the whole frame."""
    width, height = size
    X, Y = (x / width - 0.5).astype(F32), (y / height - 0.5).astype(F32)
    exponent = F32(light.gx) * X + F32(light.gy) * Y
    if light.wave:
        fx, fy, px, py = np.random.default_rng(light.wave_seed).uniform([2, 2, 0, 0], [8, 8, 6.3, 6.3])
        exponent = exponent + F32(light.wave) * np.cos(fx * X + px) * np.cos(fy * Y + py)
    image = image * np.exp(exponent)
    for shadow in light.shadows:
        image = image * (1 - (1 - F32(shadow.value)) * coverage(shadow, x, y))
    for gx, gy, sigma, strength in light.glares:
        image = image + F32(strength) * np.exp(-((x - gx) ** 2 + (y - gy) ** 2) / (2 * sigma * sigma))
    return np.asarray(image, F32)


def disk_kernel(radius: float) -> Array:
    """Normalised disk kernel of a defocused lens, with an anti-aliased border."""
    n = int(np.ceil(radius))
    y, x = np.mgrid[-n : n + 1, -n : n + 1]
    k = np.clip(radius + 0.5 - np.hypot(x, y), 0, 1).astype(F32)
    return np.asarray(k / k.sum())


def motion_kernel(length: float, angle: float) -> Array:
    """Normalised kernel of linear motion blur, a centred stroke of `length` px."""
    n = int(np.ceil(length / 2)) + 1
    y, x = np.mgrid[-n : n + 1, -n : n + 1]
    dx, dy = np.cos(angle) * length / 2, np.sin(angle) * length / 2
    stroke = Cover(-dx, -dy, dx, dy, 0.5)
    k = np.clip(0.5 - signed_distance(stroke, x, y), 0, 1).astype(F32)
    return np.asarray(k / k.sum())


def legible(
    image: Array, sensor: Sensor, xy: Real[Array, "n 2"], pitch: Real[Array, " n"], unsure: float = 0.6
) -> Array:
    """(N,) bool: whether corners at `xy` (N, 2), px in the irradiance `image`, are still localisable after optics and
    noise.

    The criterion is the Cramér–Rao bound for a single corner, from the remaining contrast C in a noise-free exposure:
    σ·sqrt(√π·blur / L) / C ≤ `unsure` px, with L the length of edge that belongs to one corner (`pitch` (N,), at most
    15 px), and C at least 6 grey levels.
    """
    clean = expose(image, replace(sensor, noise=0.0, shot=0.0, jpeg=0), np.random.default_rng(0))
    box = np.ones((11, 11), np.uint8)
    span = cv2.dilate(clean, box).astype(F32) - cv2.erode(clean, box)
    x, y = (np.clip(np.rint(xy[:, k]), 0, image.shape[1 - k] - 1).astype(int) for k in (0, 1))
    contrast = np.maximum(span[y, x], 1e-3)
    noise = np.hypot(sensor.noise, sensor.shot * 0.7)
    blur = np.hypot(sensor.blur, 0.5 * sensor.disk) + 0.3 + 0.3 * sensor.motion
    bound = noise * np.sqrt(np.sqrt(np.pi) * blur / np.clip(pitch, 3, 15)) / contrast
    return np.asarray((contrast >= 6) & (bound <= unsure))


def focus(image: Array, sensor: Sensor) -> Real[Array, "h w"]:
    """Irradiance (H, W) float32 to the exact grey levels (H, W) float32 of a sensor without noise."""
    border = cv2.BORDER_REFLECT_101
    if sensor.blur > 0:
        image = cv2.GaussianBlur(image, (0, 0), sensor.blur, borderType=border)
    if sensor.disk > 0:
        image = cv2.filter2D(image, -1, disk_kernel(sensor.disk), borderType=border)
    if sensor.motion > 0:
        image = cv2.filter2D(image, -1, motion_kernel(sensor.motion, sensor.motion_angle), borderType=border)
    image = np.clip(F32(sensor.offset) + F32(sensor.gain) * image, 0, 1)
    if sensor.gamma != 1:
        image = image ** F32(sensor.gamma)
    return np.asarray(image * F32(255))


def expose(image: Array, sensor: Sensor, rng: np.random.Generator) -> Shaped[Array, "h w"]:
    """Irradiance (H, W) float32 to grey levels (H, W) uint8."""
    grey = focus(image, sensor)
    if sensor.noise or sensor.shot:
        flat, shot = F32(sensor.noise), F32(sensor.shot)
        sigma = np.sqrt(flat**2 + shot**2 * grey / 255) if sensor.shot else flat
        grey = grey + sigma * rng.standard_normal(grey.shape, dtype=F32)
    if sensor.smooth > 0:
        grey = cv2.GaussianBlur(grey, (0, 0), sensor.smooth)
    if sensor.sharpen > 0:
        grey = grey + F32(sensor.sharpen) * (grey - cv2.GaussianBlur(grey, (0, 0), 1.2))
    if sensor.invert:
        grey = F32(255) - grey
    out = np.clip(np.rint(grey), 0, 255).astype(np.uint8)
    if not sensor.jpeg:
        return out
    code = cv2.imencode(".jpg", out, [cv2.IMWRITE_JPEG_QUALITY, sensor.jpeg])[1]
    return np.asarray(cv2.imdecode(code, cv2.IMREAD_GRAYSCALE))
