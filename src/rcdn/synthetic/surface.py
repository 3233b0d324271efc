"""Maps between pixels and board coordinates: the inverse map for rendering, the forward map for the ground truth."""

from __future__ import annotations

import numpy as np

from rcdn.geometry import project, transform
from rcdn.synthetic.lattice import middle
from rcdn.synthetic.scene import Bend, BoardSpec
from rcdn.types import Array, Camera, plane_points
from rcdn.types.arrays import Real, Shaped
from rcdn.types.plane import ROW


def _height(bend: Bend, x: Array, y: Array, centre: Array) -> tuple[Array, Array]:
    """Height of the sheet over its plane, and its derivative along the bending direction."""
    c, s = np.cos(bend.angle), np.sin(bend.angle)
    t = (x - centre[0]) * c + (y - centre[1]) * s
    w = 2 * np.pi / bend.period
    arg = w * t + bend.phase
    height = 0.5 * bend.curvature * t * t + bend.amplitude * np.sin(arg)
    return height, bend.curvature * t + bend.amplitude * w * np.cos(arg)


def board_points(spec: BoardSpec, uv: Shaped[Array, "n 2"]) -> Real[Array, "n 3"]:
    """Points (N, 3) of the sheet, in the board's frame, at board coordinates `uv` (N, 2)."""
    x, y = plane_points(uv, spec.pattern).T
    y = y * spec.aspect
    z = np.zeros(len(uv)) if spec.bend is None else _height(spec.bend, x, y, middle(spec))[0]
    return np.stack([x, y, z], axis=1)


def board_to_pixels(spec: BoardSpec, camera: Camera, uv: Array) -> Real[Array, "n 2"]:
    """Pixels (N, 2) of board coordinates (N, 2): the exact ground truth. NaN behind a pinhole camera."""
    return project(camera, transform(spec.pose, board_points(spec, uv)))


def viewing_cosine(spec: BoardSpec, uv: Array) -> Real[Array, " n"]:
    """Cosine (N,) of the angle between the sheet's normal and the line of sight; negative where the back is seen."""
    pose, points = spec.pose, board_points(spec, uv)
    normal = np.tile([0.0, 0.0, 1.0], (len(uv), 1))
    if spec.bend is not None:
        slope = _height(spec.bend, points[:, 0], points[:, 1], middle(spec))[1]
        normal[:, 0], normal[:, 1] = -slope * np.cos(spec.bend.angle), -slope * np.sin(spec.bend.angle)
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    seen = transform(pose, points)
    return np.asarray(((normal @ pose.R.T) * seen).sum(axis=1) / np.linalg.norm(seen, axis=1))


def rays_to_board(spec: BoardSpec, rays: Array) -> tuple[Array, Array]:
    """Intersection of viewing rays (..., 3) with the sheet: u, v (...), NaN where they miss it or see its back."""
    pose = spec.pose
    origin = -pose.R.T @ pose.t
    e = rays @ pose.R
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = -origin[2] / e[..., 2]
        if spec.bend is not None:
            depth = _meet_sheet(spec, spec.bend, origin, e, depth)
        depth = np.where((e[..., 2] > 0.02) & (depth > 0), depth, np.nan)
    x, y = origin[0] + depth * e[..., 0], (origin[1] + depth * e[..., 1]) / spec.aspect
    return (x, y) if spec.pattern == "checker" else (x - 0.5 / ROW * y, y / ROW)


def _meet_sheet(spec: BoardSpec, bend: Bend, origin: Array, e: Array, depth: Array) -> Array:
    """Depth of each ray's intersection with the bent sheet, by Newton's method from its intersection with the plane."""
    centre, c, s = middle(spec), np.cos(bend.angle), np.sin(bend.angle)
    reach = float(np.hypot(spec.cols, spec.rows)) + 4
    for _ in range(8):
        x, y = origin[0] + depth * e[..., 0], origin[1] + depth * e[..., 1]
        far = np.hypot(x - centre[0], y - centre[1]) > 3 * reach  # far beyond the sheet, which the parabola continues
        h, slope = _height(bend, x, y, centre)
        f = origin[2] + depth * e[..., 2] - h
        df = e[..., 2] - slope * (c * e[..., 0] + s * e[..., 1])
        depth = np.where(far | (np.abs(df) < 1e-3), np.nan, depth - f / df)
    x, y = origin[0] + depth * e[..., 0], origin[1] + depth * e[..., 1]
    missed = np.abs(origin[2] + depth * e[..., 2] - _height(bend, x, y, centre)[0]) > 1e-6  # the ray passes the sheet
    return np.where(missed, np.nan, depth)
