"""Draws the pictures of the how-to pages into docs/images/how-to, from rendered scenes: `python docs/images/draw.py [NAME …]`."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

import rcdn
from rcdn.calibration import projection_uncertainty
from rcdn.io import write_image, write_text
from rcdn.report.target import make_page, to_svg
from rcdn.synthetic import BoardSpec, camera_view, render, truth
from rcdn.types import AprilGrid, Charuco, Checkerboard, Deltille, Printed, PuzzlePart

OUT = Path(__file__).parent / "how-to"
SQUARE = 0.025
ORANGE, BLUE = (0, 110, 230), (210, 140, 40)
PICTURES: dict[str, Callable[[], object]] = {}


def picture(name: str) -> Callable[[Callable[[], object]], Callable[[], object]]:
    """Registers what draws the file of that name: BGR or grey arrays become JPEGs and PNGs, texts SVGs."""

    def register(draw: Callable[[], object]) -> Callable[[], object]:
        PICTURES[name] = draw
        return draw

    return register


def bgr(image: np.ndarray) -> np.ndarray:
    return cv2.cvtColor(image, cv2.COLOR_GRAY2BGR) if image.ndim == 2 else image


def beside(*pictures: np.ndarray) -> np.ndarray:
    """Pictures of one height in a row, with white between them."""
    gap = np.full((len(pictures[0]), 10, 3), 255, np.uint8)
    return np.hstack([part for p in pictures for part in (p, gap)][:-1])


def half(image: np.ndarray) -> np.ndarray:
    return cv2.resize(image, None, fx=0.65, fy=0.65, interpolation=cv2.INTER_AREA)


def svg(width: int, height: int, *parts: str) -> str:
    """A drawing on white, px, so that it is seen on dark pages, too."""
    style = "font-family='sans-serif' font-size='14' text-anchor='middle'"
    head = f"<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 {width} {height}' width='{width}' height='{height}' {style}>"
    return "\n".join([head, f"<rect width='{width}' height='{height}' fill='white'/>", *parts, "</svg>", ""])


def text(x: float, y: float, words: str, more: str = "") -> str:
    return f"<text x='{x:g}' y='{y:g}' {more}>{words}</text>"


def box(x: float, y: float, width: float, height: float, words: str, fill: str) -> str:
    shape = f"<rect x='{x:g}' y='{y:g}' width='{width:g}' height='{height:g}' rx='6' fill='{fill}' stroke='#444'/>"
    return shape + text(x + width / 2, y + height / 2 + 5, words)


def arrow(x0: float, y0: float, x1: float, y1: float) -> str:
    turn = np.degrees(np.arctan2(y1 - y0, x1 - x0))
    line = f"<line x1='{x0:g}' y1='{y0:g}' x2='{x1:g}' y2='{y1:g}' stroke='#444' stroke-width='1.5'/>"
    return line + f"<path d='M0 0L-9 -4L-9 4Z' fill='#444' transform='translate({x1:g} {y1:g}) rotate({turn:.1f})'/>"


@picture("undistort.jpg")
def undistort() -> np.ndarray:
    spec = BoardSpec(11, 8, (0.05, -0.08, 0.02), (-5, -3.5, 8.2))
    scene = replace(camera_view(1, 2), focal=430.0, distortion=(-0.3, 0.1, 0.0, 0.0), boards=(spec,))
    found = []
    for image in (render(scene), scene.camera.undistort(render(scene))):
        (board,) = rcdn.Detector().boards(image)
        shown = bgr(image)
        for row in board.grid()[[0, -1]]:
            cv2.line(shown, *np.rint(row[[0, -1]]).astype(int).tolist(), ORANGE, 2, cv2.LINE_AA)
        found.append(half(shown))
    return beside(*found)


@picture("opencv.jpg")
def opencv() -> np.ndarray:
    scene = camera_view(1, 1)
    image = render(scene)
    (board,) = rcdn.Detector().boards(image)
    pose = rcdn.estimate_pose(board, scene.camera, spacing=SQUARE)
    shown, turn = bgr(image), cv2.Rodrigues(pose.R)[0]
    cv2.drawFrameAxes(shown, scene.camera.K, scene.camera.distortion, turn, pose.t, 3 * SQUARE, 3)
    return shown


@picture("ros2.svg")
def ros2() -> str:
    return svg(
        720, 170,
        box(10, 60, 150, 50, "camera driver", "#eee"), arrow(160, 85, 290, 85), text(225, 75, "image"),
        box(290, 60, 140, 50, "rcdn_node.py", "#cde6f7"), text(360, 130, "camera, spacing, size"),
        arrow(430, 75, 550, 35), text(485, 40, "corners"), box(550, 10, 160, 50, "PointCloud", "#eee"),
        arrow(430, 95, 550, 135), text(485, 138, "pose"), box(550, 110, 160, 50, "PoseWithCovariance", "#eee"),
    )  # fmt: skip


@picture("boards.svg")
def boards() -> str:
    parts, x = [], 0.0
    for target, spacing in [
        (Checkerboard(9, 6), 25),
        (Charuco(8, 6, "DICT_4X4_50", 0.75), 25),
        (AprilGrid(5, 3, "tag36h11", 0.3), 40),
        (PuzzlePart(9, 6), 24),
        (Deltille(9, 6), 25),
    ]:
        sheet = to_svg(make_page(Printed(target, spacing / 1000)))
        inner = sheet[sheet.index("<svg") :].replace("<svg", f"<svg text-anchor='start' x='{x:g}'", 1)
        inner = re.sub(r"width=\"[^\"]+\" height=\"[^\"]+\"", "width='170' height='120'", inner, count=1)
        parts.append(inner)
        x += 170
    return svg(850, 120, *parts)


def placed(middle: bool) -> list[rcdn.Board]:
    """Exact corners of 12 views with noise of .1 px; boards farther off and in the middle, or as they are."""
    rng, found = np.random.default_rng(0), []
    for k in range(1, 13):
        scene = camera_view(1, k)
        if middle:
            spec = scene.boards[0]
            centre = cv2.Rodrigues(np.array(spec.rvec))[0] @ [4, 2.5, 0]
            spec = replace(spec, tvec=(-centre[0], -centre[1], 20.0 - centre[2]))
            scene = replace(scene, boards=(spec,))
        (true,) = truth(scene)
        xy = true.xy + rng.normal(0, 0.1, true.xy.shape)
        n = len(xy)
        zeros, seen = np.zeros(n), np.ones(n)
        found.append(rcdn.Board(xy, true.ij, (640, 480), seen, zeros.astype(np.uint8), "unique", sigma=0.1 * seen))
    return found


@picture("report.jpg")
def report() -> np.ndarray:
    y, x = np.mgrid[0:480:16, 0:640:16] + 8.0
    maps = []
    for middle in (True, False):
        calibration = rcdn.calibrate(placed(middle), spacing=SQUARE, model="brown", flat=True)
        sigma = projection_uncertainty(calibration, np.stack([x, y], -1).reshape(-1, 2)).reshape(x.shape)
        grey = np.clip(np.log(sigma / 0.2) / np.log(50) * 255, 0, 255).astype(np.uint8)
        shown = cv2.applyColorMap(cv2.resize(grey, (640, 480)), cv2.COLORMAP_BONE)
        for board in placed(middle):
            for px, py in board.xy:
                cv2.circle(shown, (round(px), round(py)), 3, ORANGE, -1, cv2.LINE_AA)
        maps.append(half(shown))
    return beside(*maps)


def main(names: list[str], out: Path = OUT) -> None:
    """Draw the pictures of these names, or all."""
    for name in names or PICTURES:
        drawn = PICTURES[name]()
        if isinstance(drawn, str):
            write_text(out / name, drawn)
        elif name.endswith(".jpg"):
            (out / name).write_bytes(cv2.imencode(".jpg", drawn, [cv2.IMWRITE_JPEG_QUALITY, 75])[1].tobytes())
        else:
            write_image(out / name, drawn)


if __name__ == "__main__":
    main(sys.argv[1:])
