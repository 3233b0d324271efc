"""Rendered boards with known corners, as `sharpen` gets them: the picture and a board somewhat off the truth."""

from dataclasses import replace

import cv2
import numpy as np

from rcdn.synthetic import Background, BoardSpec, Scene, Sensor, render, truth
from rcdn.types import Board

SIZE = (420, 320)


def scene(seed, pitch=20.0, tilt=12.0, noise=3.0, blur=0.7, bend=None, light=None, covers=(), bleed=0.0, **sensor):
    """A board of 9 × 6 corners somewhere in the frame, turned anyhow. `tilt` in degrees."""
    rng = np.random.default_rng(seed)
    axis, roll, lean = rng.uniform(0, 2 * np.pi), rng.uniform(0, 2 * np.pi), np.deg2rad(tilt)
    turn = cv2.Rodrigues(np.array([np.cos(axis) * lean, np.sin(axis) * lean, 0]))[0]
    turn = turn @ cv2.Rodrigues(np.array([0, 0, roll]))[0]
    depth = 600 / pitch
    middle = np.append(rng.uniform(-15, 15, 2) / pitch, depth) - turn @ [4, 2.5, 0]
    board = BoardSpec(
        9, 6, tuple(cv2.Rodrigues(turn)[0].ravel()), tuple(middle), black=0.16, white=0.83, bend=bend, bleed=bleed
    )
    out = Scene(
        *SIZE, 600, ((SIZE[0] - 1) / 2, (SIZE[1] - 1) / 2), boards=(board,), covers=covers,
        sensor=Sensor(blur=blur, noise=noise, **sensor), background=Background("noise", seed), seed=seed,
    )  # fmt: skip
    return out if light is None else replace(out, light=light)


def board_of(xy, ij, size=SIZE):
    """A board with unit responses."""
    ones = np.ones(len(xy))
    return Board(xy, ij, size, ones, np.zeros(len(xy), np.uint8), "unique")


def example(seed, jitter=0.15, **settings):
    """(grey, board with corners `jitter` px off, truth (N, 2)) of the visible corners of a scene."""
    spec = scene(seed, **settings)
    seen = truth(spec)[0]
    keep = seen.visible
    off = np.random.default_rng(seed + 1000).normal(0, jitter, (int(keep.sum()), 2))
    return render(spec, samples=4), board_of(seen.xy[keep] + off, seen.ij[keep]), seen.xy[keep]


def bound(grey, board, noise):
    """Cramér–Rao bound of each corner by itself, px an axis (N,): Fisher information of its own cell at known edges."""
    clean = cv2.GaussianBlur(grey.astype(float), (0, 0), 0.5)
    gy, gx = np.gradient(clean)
    grid = board.grid()
    out = np.full(len(board), np.nan)
    y, x = np.mgrid[: grey.shape[0], : grey.shape[1]]
    for k, (i, j) in enumerate(board.ij):
        if 0 < i < grid.shape[1] - 1 and 0 < j < grid.shape[0] - 1:
            du, dv = (grid[j, i + 1] - grid[j, i - 1]) / 2, (grid[j + 1, i] - grid[j - 1, i]) / 2
            inverse = np.linalg.inv(np.stack([du, dv], axis=1))
            u, v = (inverse @ np.stack([x - grid[j, i, 0], y - grid[j, i, 1]]).reshape(2, -1)).reshape(2, *x.shape)
            mine = (np.abs(u) < 0.5) & (np.abs(v) < 0.5)
            slopes = np.stack([gx[mine], gy[mine]])
            out[k] = noise * np.sqrt(np.trace(np.linalg.inv(slopes @ slopes.T)) / 2)
    return out
