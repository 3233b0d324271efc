"""Boards with known corners, rendered by supersampling: independent of rcdn.synthetic."""

import cv2
import numpy as np


def board_homography(pitch, tilt, turn, size, shift=(0.0, 0.0), axis=0.3, distance=12.0):
    """H (3, 3): board squares → pixels. Squares are `pitch` px wide at the middle; angles in radians."""
    cos, sin = np.cos(axis), np.sin(axis)
    k = np.array([[0, 0, sin], [0, 0, -cos], [-sin, cos, 0]])
    rotation = np.eye(3) + np.sin(tilt) * k + (1 - np.cos(tilt)) * k @ k
    cos, sin = np.cos(turn), np.sin(turn)
    rotation = rotation @ np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
    plane = np.column_stack((rotation[:, :2], (0, 0, distance)))
    focal = pitch * distance
    centre = np.array(size[::-1]) / 2 + shift
    return np.array([[focal, 0, centre[0]], [0, focal, centre[1]], [0, 0, 1]]) @ plane


def project(H, points):
    """Board points (N, 2) → pixels (N, 2)."""
    out = np.column_stack((points, np.ones(len(points)))) @ H.T
    return out[:, :2] / out[:, 2:]


def render(colour, size, blur=1.0, noise=0.0, seed=0, low=64.0, high=191.0, fine=5):
    """Grey uint8 (H, W) of `colour`: pixels (..., 2) → [0, 1], averaged over `fine`² samples a pixel."""
    offset = (np.arange(fine) + 0.5) / fine - 0.5
    y = (np.arange(size[0])[:, None] + offset).ravel()
    x = (np.arange(size[1])[:, None] + offset).ravel()
    ideal = colour(np.stack(np.meshgrid(x, y), axis=-1)).astype(np.float64)
    grey = ideal.reshape(size[0], fine, size[1], fine).mean(axis=(1, 3)) * (high - low) + low
    if blur > 0:
        grey = cv2.GaussianBlur(grey, (0, 0), blur, borderType=cv2.BORDER_REPLICATE)
    grey = grey + np.random.default_rng(seed).normal(0, 1, size) * noise
    return np.clip(np.rint(grey), 0, 255).astype(np.uint8)


def checkerboard(H):
    """Colour function of an endless checkerboard seen through H."""
    inverse = np.linalg.inv(H)

    def colour(xy):
        out = xy @ inverse[:, :2].T + inverse[:, 2]
        cell = np.floor(out[..., :2] / out[..., 2:]).astype(int)
        return (cell.sum(axis=-1) % 2 == 0) & (out[..., 2] > 0)

    return colour


def straighten(xy, size, barrel):
    """Distorted pixels (..., 2) → undistorted ones; `barrel` is the radial stretch at the middle of the long side."""
    centre = np.array(size[::-1]) / 2
    r = (xy - centre) / centre.max()
    return xy + (xy - centre) * barrel * (r * r).sum(axis=-1, keepdims=True)


def board(
    pitch=20.0, tilt=0.0, turn=0.2, blur=1.0, noise=0.0, seed=0, cells=3, size=None, axis=0.3, barrel=0.0, **grey
):
    """(grey, truth (N, 2), edges (N, 2, 2): unit edge directions) of an endless board; up to (2 cells + 1)² corners."""
    rng = np.random.default_rng(seed)
    size = size or (int(pitch * (2 * cells + 4)),) * 2
    H = board_homography(pitch, tilt, turn, size, rng.uniform(-0.5, 0.5, 2), axis)
    line = np.arange(-cells, cells + 1.0)
    points = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)

    def image_of(points):
        flat = bent = project(H, points)
        for _ in range(200 if barrel else 0):
            bent = bent + 0.7 * (flat - straighten(bent, size, barrel))
        return bent

    truth = image_of(points)
    edges = [image_of(points + 1e-4 * np.eye(2)[k]) - truth for k in (0, 1)]
    edges = np.stack([e / np.linalg.norm(e, axis=1, keepdims=True) for e in edges], axis=1)
    inside = ((truth > 8) & (truth < np.array(size[::-1]) - 9)).all(axis=1)
    colour = checkerboard(H)
    picture = render(lambda xy: colour(straighten(xy, size, barrel)), size, blur, noise, seed, **grey)
    return picture, truth[inside], edges[inside]
