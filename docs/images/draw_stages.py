"""Draws docs/images/stages.jpg, what the stages of a detection pass on, of one rendered picture:
`python docs/images/draw_stages.py`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

import rcdn
from rcdn.boards.convert import as_field
from rcdn.boards.graph import links
from rcdn.corners import candidates_at, find_maxima
from rcdn.corners.sieve import CELL, cells_with_saddles
from rcdn.io import write_image
from rcdn.report.overlay import draw_overlay
from rcdn.synthetic import BoardSpec, Sensor, camera_view, render

OUT = Path(__file__).parent / "stages.jpg"
BLUE, ORANGE, RED = (233, 180, 86), (0, 159, 230), (80, 70, 245)
SCALE, BAR = 2, 26


def scene_picture() -> np.ndarray:
    """A tilted board under a wide lens, with noise, on a busy ground, (H, W) grey."""
    board = BoardSpec(7, 5, (0.35, -0.5, 0.2), (-3.2, -2.4, 9.5))
    scene = camera_view(3, 1)
    camera = {
        "width": 320,
        "height": 240,
        "focal": 250.0,
        "centre": (159.5, 119.5),
        "distortion": (-0.25, 0.05, 0.0, 0.0),
    }
    return render(replace(scene, **camera, boards=(board,), sensor=Sensor(blur=0.8, noise=6)))


def enlarged(image: np.ndarray) -> np.ndarray:
    image = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR) if image.ndim == 2 else image
    return cv2.resize(image, None, fx=SCALE, fy=SCALE, interpolation=cv2.INTER_NEAREST)


def at(xy: np.ndarray) -> tuple[int, int]:
    x, y = np.rint((np.asarray(xy) + 0.5) * SCALE - 0.5).astype(int)
    return int(x), int(y)


def panel(words: str, image: np.ndarray) -> np.ndarray:
    bar = np.full((BAR, image.shape[1], 3), 255, np.uint8)
    cv2.putText(bar, words, (4, 18), cv2.FONT_HERSHEY_SIMPLEX, 0.6, (30, 30, 30), 1, cv2.LINE_AA)
    return np.vstack([bar, image])


def main() -> None:
    grey, detector = scene_picture(), rcdn.Detector()
    config, cells = detector.config, cells_with_saddles(grey)
    shade = enlarged(grey)
    dim = cv2.resize(cells.astype(np.uint8), None, fx=CELL * SCALE, fy=CELL * SCALE, interpolation=cv2.INTER_NEAREST)
    shade[dim[: len(shade), : shade.shape[1]] == 0] //= 3
    response = detector.response(grey) * np.kron(cells, np.ones((CELL, CELL)))[: grey.shape[0], : grey.shape[1]]
    response = response.astype(np.float32)
    found = candidates_at(grey, response, find_maxima(response, config), config)
    corners, graph = enlarged(grey), enlarged(grey)
    for xy, axes in zip(found.all.xy, found.orientation.axes, strict=True):
        for angle in axes[np.isfinite(axes)]:
            way = 6 * np.array([np.cos(angle), np.sin(angle)])
            cv2.line(corners, at(xy - way), at(xy + way), ORANGE, 1, cv2.LINE_AA)
        cv2.circle(corners, at(xy), 2, RED, -1, cv2.LINE_AA)
    field = as_field(grey, found)
    for k, row in enumerate(links(field)):
        for other in row[row >= 0]:
            cv2.line(graph, at(field.xy[k]), at(field.xy[other]), BLUE, 2, cv2.LINE_AA)
    seen = detector.detect(grey)
    board = draw_overlay(grey, seen.corners, seen.boards)
    board = cv2.resize(board, shade.shape[1::-1], interpolation=cv2.INTER_AREA)
    glow = cv2.applyColorMap((255 * np.clip(response, 0, 1)).astype(np.uint8), cv2.COLORMAP_INFERNO)
    panels = [
        panel("the picture, grey", enlarged(grey)), panel("sieve: cells with saddles", shade),
        panel("response", enlarged(glow)), panel("corners and their axes", corners),
        panel("links that the picture shows", graph), panel("boards, labelled and fitted", board),
    ]  # fmt: skip
    whole = np.vstack([np.hstack(panels[:3]), np.hstack(panels[3:])])
    write_image(OUT, cv2.resize(whole, None, fx=0.6, fy=0.6, interpolation=cv2.INTER_AREA))


if __name__ == "__main__":
    main()
