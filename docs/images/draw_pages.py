"""Draws the pictures of pages beside the how-to pages into docs/images/pages:
`python docs/images/draw_pages.py [NAME …]`.

Those of the paper and of its peers need the laboratory (`pip install -e . -e lab`).
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from draw import ORANGE, arrow, beside, bgr, box, main, svg, text

import rcdn
from rcdn.synthetic import BoardSpec, Sensor, camera_view, render
from rcdn_lab.peers import PEERS

OUT = Path(__file__).parent / "pages"
RESULTS = Path(__file__).parents[2] / "benchmarks" / "results"
SIZE = (9, 6)
GREY, OURS, GREEN = "#eeeeee", "#cde6f7", "#d7efdc"
INSTALLED = {"scipy": 143, "opencv": 153, "numpy": 73, "pip, setuptools": 24, "rcdn": 10, "all others": 21}
"""MB below site-packages after `pip install` of the wheel, Python 3.11, Linux x86-64: `du`,
libraries with their package"""
TRIED = {
    "what stands": 0.048,
    "symmetry over .35 × pitch": 0.056,
    "symmetry over .25 × pitch": 0.062,
    "surface fit alone": 0.078,
    "mixed with the peak": 0.084,
    "the paper's fit, up to": 0.11,
}
"""errors px of docs/log.md's first table"""
PICTURES: dict[str, Callable[[], object]] = {}


def picture(draw: Callable[[], object]) -> Callable[[], object]:
    """Registers what draws the file of the function's name."""
    draws_pixels = draw.__name__ in ("formulation", "paper", "peers")
    PICTURES[f"{draw.__name__.replace('_', '-')}.{'jpg' if draws_pixels else 'svg'}"] = draw
    return draw


def lines(x: float, y: float, *words: str, more: str = "text-anchor='start'") -> str:
    """Lines of text below each other."""
    return "".join(text(x, y + 18 * k, word, more) for k, word in enumerate(words))


def bar(y: float, name: str, length: float, words: str, fill: str = OURS, left: float = 150) -> str:
    """A bar that begins at `left`, with its name before it and words behind."""
    shape = f"<rect x='{left:g}' y='{y:g}' width='{length:.1f}' height='20' fill='{fill}' stroke='#444'/>"
    return text(left - 10, y + 15, name, "text-anchor='end'") + shape + lines(left + 8 + length, y + 15, words)


@picture
def install() -> str:
    rows = [bar(10 + 28 * k, name, 2 * mb, f"{mb} MB") for k, (name, mb) in enumerate(INSTALLED.items())]
    return svg(540, 20 + 28 * len(rows), *rows)


@picture
def log() -> str:
    rows = [
        bar(10 + 28 * k, name, 2500 * error, f"{error:.3f} px".removeprefix("0"), OURS if not k else GREY, 220)
        for k, (name, error) in enumerate(TRIED.items())
    ]
    return svg(580, 20 + 28 * len(rows), *rows)


@picture
def adapters() -> str:
    parts = [box(10, 95, 110, 50, "pictures", GREY), arrow(120, 120, 170, 120)]
    parts += [box(170, 95, 140, 50, "rcdn.Detector", OURS), arrow(310, 120, 370, 120)]
    parts += [box(370, 80, 150, 80, "", OURS), text(445, 112, "adapters.views"), text(445, 134, "ids, xy, points")]
    for k, name in enumerate(("lensboy", "aniposelib", "caliscope", "multical", "mrcal")):
        y = 10 + 46 * k
        parts += [box(610, y, 110, 34, name, GREY), arrow(520, 104 + 8 * k, 610, y + 17)]
    return svg(730, 240, *parts)


def held_out() -> dict[str, dict[str, float]]:
    """Set → detector → error of held-out fifths, px, on the pictures in which everybody finds the board."""
    rows = json.loads((RESULTS / "calibration.json").read_text("utf-8"))["rows"]
    found: dict[str, dict[str, float]] = {}
    for row in rows:
        if row["on"] == "common" and row["folds"]:
            found.setdefault(row["set"], {})[row["detector"]] = row["folds"]
    return {name: errors for name, errors in found.items() if len(errors) > 3}


@picture
def calibration_results() -> str:
    colours = {"opencv": "#d55e00", "opencv-sb": "#e69f00", "boofcv-size": "#009e73"}
    sets, parts = held_out(), []
    left, wide = 140, 440

    def across(ratio: float) -> float:
        return left + wide * (math.log2(min(ratio, 4.0)) + 0.7) / 2.7

    for k, (name, errors) in enumerate(sets.items()):
        y = 40 + 17 * k
        parts.append(text(left - 8, y + 4, name.replace("ALL", "geometric mean"), "text-anchor='end' font-size='12'"))
        for other, colour in colours.items():
            if other not in errors:  # it finds too few of this camera's boards
                continue
            x = across(errors[other] / errors["auto"])
            parts.append(f"<circle cx='{x:.1f}' cy='{y}' r='4.5' fill='{colour}' fill-opacity='.8'/>")
    low = 40 + 17 * len(sets)
    for ratio in (0.7, 1, 1.5, 2, 3, 4):
        x = across(ratio)
        parts.append(f"<path d='M{x:.1f} 28V{low}' stroke='#999' stroke-width='{2 if ratio == 1 else 0.5}'/>")
        parts.append(text(x, low + 16, f"≥ {ratio}" if ratio == 4 else f"{ratio:g}"))
    for k, (other, colour) in enumerate(colours.items()):
        parts.append(f"<circle cx='{left + 130 * k + 8}' cy='14' r='4.5' fill='{colour}'/>")
        parts.append(lines(left + 130 * k + 18, 19, other))
    parts.append(text(left + wide / 2, low + 36, "error of held-out fifths ÷ that of rcdn"))
    return svg(left + wide + 30, low + 46, *parts)


def one_board(noise: float) -> np.ndarray:
    """A tilted board, blurred and noisy, (480, 640) grey."""
    spec = BoardSpec(*SIZE, (0.25, -0.45, 0.12), (-4.2, -2.7, 10.5))
    return render(replace(camera_view(3, 1), boards=(spec,), sensor=Sensor(blur=0.9, noise=noise)))


def titled(image: np.ndarray, words: str) -> np.ndarray:
    """A panel with a line of words above it."""
    head = np.full((28, image.shape[1], 3), 255, np.uint8)
    cv2.putText(head, words, (4, 19), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (30, 30, 30), 1, cv2.LINE_AA)
    return np.vstack([head, bgr(image)])


def smaller(image: np.ndarray, share: float = 0.4) -> np.ndarray:
    return cv2.resize(image, None, fx=share, fy=share, interpolation=cv2.INTER_AREA)


def marked(image: np.ndarray, xy: np.ndarray) -> np.ndarray:
    """The picture with a ring at each corner."""
    shown = bgr(image).copy()
    for x, y in xy:
        cv2.circle(shown, (round(x * 16), round(y * 16)), 6 * 16, ORANGE, 2, cv2.LINE_AA, 4)
    return shown


@picture
def peers() -> np.ndarray:
    image, panels = one_board(48.0), []
    for name in ("chess", "mate", "geiger", "rochade"):
        found = PEERS[name].load()(image, SIZE)
        xy = np.concatenate([grid.xy for grid in found]) if found else np.zeros((0, 2))
        what = "corners" if PEERS[name].raw else "on boards"
        panels.append(titled(smaller(marked(image, xy)[60:420, 20:460], 0.38), f"{name}: {len(xy)} {what}"))
    return np.vstack([beside(*panels[:2]), beside(*panels[2:])])


@picture
def paper() -> np.ndarray:
    image, detector = one_board(9.0), rcdn.Detector(rcdn.DetectorConfig.paper())
    response = np.clip(detector.response(image) / detector.response(image).max(), 0, 1)
    found = detector.detect(image)
    shown = marked(image, found.boards[0].xy)
    for row in found.boards[0].grid():
        cv2.polylines(shown, [np.rint(row).astype(np.int32)], False, ORANGE, 1, cv2.LINE_AA)
    glow = cv2.dilate((255 * response).astype(np.uint8), np.ones((3, 3), np.uint8))
    first = titled(smaller(image), "3.1: a picture")
    second = titled(smaller(cv2.applyColorMap(glow, cv2.COLORMAP_INFERNO)), "network F: its response")
    third = titled(smaller(marked(image, found.corners.xy)), "3.3: corners, refined")
    return np.vstack([beside(first, second), beside(third, titled(smaller(shown), "3.4: the board"))])


@picture
def formulation() -> np.ndarray:
    erf = np.vectorize(math.erf)
    v, u = np.mgrid[-1:1:201j, -1:1:201j] * 0.45
    panels = []
    for words, blur, turn, shift, bend in (
        ("U V, blur .03", 0.03, 0.0, 0.0, 0.0),
        ("blur .12", 0.12, 0.0, 0.0, 0.0),
        ("a turn of one edge", 0.06, 0.25, 0.0, 0.0),
        ("a shift, a bend", 0.06, 0.0, 0.1, 0.5),
    ):
        wave = erf((u - shift - turn * v - bend * v**2) / blur) * erf(v / blur)
        panels.append(titled(np.rint(128 + 100 * wave).astype(np.uint8), words))
    return beside(*panels)


@picture
def reference_detection() -> str:
    parts = [box(10, 80, 150, 40, "DetectorConfig", GREY), arrow(160, 100, 210, 100)]
    parts += [box(210, 80, 120, 40, "Detector", OURS), text(270, 40, "path, array, PIL image"), arrow(270, 48, 270, 80)]
    parts += [arrow(330, 100, 420, 100), text(374, 92, ".detect"), box(420, 80, 120, 40, "Detection", GREEN)]
    for y, name, words in (
        (10, "corners", "xy, sigma, response"),
        (80, "boards", "xy, ij, size, sigma"),
        (150, "warnings", "sentences"),
    ):
        parts += [arrow(540, 100, 610, y + 20), box(610, y, 150, 40, name, GREEN), lines(770, y + 25, words)]
    return svg(910, 200, *parts)


@picture
def reference_values() -> str:
    parts = [box(10, 20, 120, 40, "Detection", OURS), arrow(130, 40, 200, 40), box(200, 20, 120, 40, "Board …", GREEN)]
    parts += [arrow(320, 40, 440, 100), text(392, 52, "calibrate"), box(440, 80, 140, 40, "Calibration", OURS)]
    for y, name in ((10, "Camera"), (80, "Pose …"), (150, "Verdict"), (220, "BoardShape")):
        parts += [arrow(580, 100, 650, y + 20), box(650, y, 130, 40, name, GREEN)]
    parts += [
        box(200, 150, 120, 40, "Printed", GREY),
        arrow(260, 150, 260, 60),
        lines(268, 110, "Charuco, AprilGrid,", "PuzzleBoard"),
    ]
    return svg(800, 270, *parts)


@picture
def reference_calibration() -> str:
    board = "<path d='M520 60L640 30L660 190L530 200Z' fill='#eee' stroke='#444'/>"
    parts = [board, text(592, 222, "board: X (column), Y (row), Z away")]
    parts += [arrow(520, 60, 580, 45), lines(560, 36, "X"), arrow(520, 60, 525, 120), lines(506, 110, "Y")]
    camera = "<path d='M60 130L130 80V180Z' fill='#cde6f7' stroke='#444'/>"
    parts += [camera, text(125, 210, "camera: x right, y down, z ahead"), arrow(60, 130, 220, 130), text(230, 135, "z")]
    parts += [
        "<path d='M60 130L520 60' stroke='#d55e00' stroke-dasharray='5 4'/>",
        text(330, 80, "t: the board's first corner"),
    ]
    parts += [text(330, 175, "x_camera = R X_board + t"), text(330, 200, "pixel = π(camera, x_camera)")]
    return svg(720, 235, *parts)


@picture
def reference_files() -> str:
    parts = [box(290, 90, 120, 50, "rcdn.io", OURS)]
    sides = (
        ("pictures, videos", "detections .json", "corners.vnl"),
        ("cameras: 6 formats", "calibrations .json", "rigs .toml, .yaml", "maps .npz"),
    )
    for k, name in enumerate(sides[0]):
        parts += [box(10, 20 + 66 * k, 160, 40, name, GREY), arrow(170, 40 + 66 * k, 290, 105 + 10 * k)]
    for k, name in enumerate(sides[1]):
        parts += [box(530, 5 + 58 * k, 170, 40, name, GREY), arrow(410, 100 + 10 * k, 530, 25 + 58 * k)]
    return svg(710, 235, *parts)


if __name__ == "__main__":
    main(sys.argv[1:], OUT, PICTURES)
