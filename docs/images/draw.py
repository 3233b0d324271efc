"""Draws the pictures of the how-to pages into docs/images/how-to, from rendered scenes:
`python docs/images/draw.py [NAME …]`."""

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
from rcdn.report.overlay import draw_overlay
from rcdn.report.target import make_page, to_svg
from rcdn.synthetic import PRESETS, BoardSpec, Scene, Sensor, camera_view, random_crop, render, truth
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
    head = (
        f"<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 {width} {height}' width='{width}' "
        f"height='{height}' {style}>"
    )
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


@picture("colmap.svg")
def colmap() -> str:
    parts = []
    for x0, name, shift in ((60, "rcdn, OpenCV", 0.0), (360, "COLMAP", 0.5)):
        for k in range(4):
            parts.append(f"<path d='M{x0 + 60 * k} 50v180M{x0} {50 + 60 * k}h180' stroke='#888'/>")
        parts.append(text(x0 + 90, 30, name, "font-weight='bold'"))
        for k in range(3):
            at, value = x0 + 30 + 60 * k, f"{k + shift:g}"
            parts.append(
                f"<circle cx='{at}' cy='80' r='4' fill='#0072b2'/>"
                + text(at, 68, f"({value}, {shift:g})", "font-size='12'")
            )
        corner = f"({-0.5 + shift:g}, {-0.5 + shift:g})"
        parts.append(f"<circle cx='{x0}' cy='50' r='4' fill='#d55e00'/>" + text(x0 - 22, 42, corner, "font-size='12'"))
    return svg(580, 250, *parts)


def overlay(image: np.ndarray) -> np.ndarray:
    found = rcdn.Detector().detect(image)
    return draw_overlay(image, found.corners, found.boards)


@picture("webcam.jpg")
def webcam() -> np.ndarray:
    shown = [overlay(render(camera_view(1, k))) for k in (1, 3, 4, 5, 7, 8)]
    small = [cv2.resize(image, (270, 203), interpolation=cv2.INTER_AREA) for image in shown]
    return np.vstack([beside(*small[:3]), np.full((10, 830, 3), 255, np.uint8), beside(*small[3:])])


@picture("out-of-focus.jpg")
def out_of_focus() -> np.ndarray:
    spec = BoardSpec(11, 8, (0.05, -0.08, 0.02), (-5, -3.5, 10.5))
    scene = replace(camera_view(1, 2), boards=(spec,), sensor=Sensor(noise=0.0))
    sharp = render(scene).astype(float)
    levels = [sharp, *(cv2.GaussianBlur(sharp, None, k / 4) for k in range(1, 17))]
    columns = [levels[round(max(0, 16 - 32 * x / 640))][:, x] for x in range(640)]
    noisy = np.stack(columns, axis=1) + np.random.default_rng(0).normal(0, 2, sharp.shape)
    soft = np.clip(np.rint(noisy), 0, 255).astype(np.uint8)
    shown = bgr(soft)
    (board,) = rcdn.Detector().boards(soft)
    for (x, y), sigma in zip(board.xy, board.sigma, strict=True):
        at = (round(x * 16), round(y * 16))
        cv2.circle(shown, at, round(2000 * sigma * 16), ORANGE, 2, cv2.LINE_AA, 4)
    return shown


def stated_and_true(scene: Scene) -> tuple[float, float] | None:
    """Root mean squares of the stated sigma and of the errors of a scene's board, px, if it was found whole."""
    boards = rcdn.Detector().boards(render(scene))
    if len(boards) != 1 or not boards[0].complete or boards[0].orientation != "unique":
        return None
    places = {tuple(ij): xy for ij, xy in zip(truth(scene)[0].ij.tolist(), truth(scene)[0].xy, strict=True)}
    errors = boards[0].xy - [places[tuple(ij)] for ij in boards[0].ij.tolist()]
    return float(np.sqrt((boards[0].sigma ** 2).mean())), float(np.sqrt((errors**2).mean()))


@picture("sigma.svg")
def sigma() -> str:
    parts, rng = [], np.random.default_rng(0)
    for k in range(1, 61):
        scene, blur, noise = camera_view(2, k), rng.uniform(0.5, 2.5), np.exp(rng.uniform(0, np.log(30)))
        pair = stated_and_true(replace(scene, sensor=Sensor(blur=float(blur), noise=float(noise))))
        if pair is not None:
            x, y = (60 + 420 * (np.log10(v) + 3) / 2.5 for v in pair)
            parts.append(f"<circle cx='{x:.1f}' cy='{480 - y:.1f}' r='4' fill='#0072b2' fill-opacity='.7'/>")
    axes = "<path d='M60 0V420H480M60 420L480 0' stroke='#444' fill='none'/>"
    for value in (0.001, 0.003, 0.01, 0.03, 0.1):
        at = 420 * (np.log10(value) + 3) / 2.5
        axes += text(60 + at, 438, f"{value:g}") + text(38, 425 - at, f"{value:g}")
    axes += text(270, 462, "stated: sigma, px") + text(14, 210, "true error, px", "transform='rotate(-90 14 210)'")
    return svg(500, 470, axes, *parts)


@picture("convert.svg")
def convert() -> str:
    parts = [box(300, 95, 130, 50, "rcdn convert", "#cde6f7")]
    for k, name in enumerate(("OpenCV", "ROS", "Kalibr", "COLMAP", "mrcal", "JSON")):
        y = 10 + 38 * k
        parts += [box(10, y, 110, 30, name, "#eee"), arrow(120, y + 15, 300, 105 + 6 * k)]
        parts += [box(610, y, 110, 30, name, "#eee"), arrow(430, 105 + 6 * k, 610, y + 15)]
    parts += [box(610, 238, 110, 30, "maps (.npz)", "#eee"), arrow(430, 141, 610, 253)]
    return svg(730, 280, *parts)


@picture("training.jpg")
def training() -> np.ndarray:
    crops = []
    for k in range(10):
        image, labels = random_crop(100 + k, 112, PRESETS["training"])
        shown = cv2.resize(bgr(image), None, fx=1.2, fy=1.2, interpolation=cv2.INTER_AREA)
        for x, y in labels[:, :2]:
            cv2.circle(shown, (round(x * 1.2), round(y * 1.2)), 3, ORANGE, 1, cv2.LINE_AA)
        crops.append(shown)
    rows = [beside(*crops[:5]), beside(*crops[5:])]
    return np.vstack([rows[0], np.full((10, rows[0].shape[1], 3), 255, np.uint8), rows[1]])


def main(names: list[str], out: Path = OUT, pictures: dict[str, Callable[[], object]] = PICTURES) -> None:
    """Draw the pictures of these names, or all."""
    for name in names or pictures:
        drawn = pictures[name]()
        if isinstance(drawn, str):
            write_text(out / name, drawn)
        elif name.endswith(".jpg"):
            (out / name).write_bytes(cv2.imencode(".jpg", drawn, [cv2.IMWRITE_JPEG_QUALITY, 75])[1].tobytes())
        else:
            write_image(out / name, drawn)


if __name__ == "__main__":
    main(sys.argv[1:])
