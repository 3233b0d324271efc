"""Good inputs, made by the software itself: what mutations begin with."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from tests.fuzz.target import scratch

from rcdn.geometry import zero_correction
from rcdn.io import (
    ImageResult,
    StereoCameras,
    write_calibration,
    write_camera,
    write_detections,
    write_stereo,
    write_vnl,
)
from rcdn.synthetic import Background, BoardSpec, Scene, Sensor, render
from rcdn.types import (
    Array,
    Board,
    BoardShape,
    BoardView,
    Calibration,
    Camera,
    Corners,
    ModelScore,
    Pose,
    Reason,
    Verdict,
)
from rcdn_lab.camera_scenes import CAMERAS, SPACING, random_boards, random_pose, see
from rcdn_lab.coded.drawings import charuco_drawing


@cache
def picture(
    cols: int = 4,
    rows: int = 3,
    pitch: float = 12.0,
    size: tuple[int, int] = (96, 72),
    pattern: Any = "checker",
    seed: int = 1,
) -> Array:
    """A small board in the middle of a frame (height, width) uint8, a little turned and tilted."""
    rng = np.random.default_rng(seed)
    rvec = (*rng.uniform(-0.25, 0.25, 2).tolist(), float(rng.uniform(-0.6, 0.6)))
    focal = 3.0 * max(size)
    middle = np.array([(cols - 1) / 2, (rows - 1) / 2, 0.0])
    tvec = np.array([0, 0, focal / pitch]) - cv2.Rodrigues(np.array(rvec))[0] @ middle
    spec = BoardSpec(cols, rows, rvec, tuple(tvec.tolist()), pattern=pattern)
    centre = ((size[0] - 1) / 2, (size[1] - 1) / 2)
    return render(
        Scene(
            *size,
            focal,
            centre,
            boards=(spec,),
            sensor=Sensor(noise=1.0),
            background=Background("plain", seed),
            seed=seed,
        ),
        samples=2,
    )


@cache
def boards() -> tuple[Board, ...]:
    """Boards that a known camera saw, whole and partial ones."""
    return tuple(random_boards(CAMERAS["brown"], 3, views=6)[0])


def _result(name: str, found: Board) -> ImageResult:
    axes = np.tile([0.1, 1.6], (len(found), 1))
    corners = Corners(found.xy, found.response, found.status, axes, found.sigma).sort()
    return ImageResult(name, *found.image_size, corners, (found,))


def small_boards() -> list[Board]:
    """Whole boards of 4 × 3 corners."""
    return random_boards(CAMERAS["pinhole"], 5, views=3, whole=True, size=(4, 3))[0]


@cache
def detections() -> tuple[str, ...]:
    """Detections as JSON."""
    path = scratch() / "good.json"
    results = [_result(f"{k}.png", b) for k, b in enumerate(small_boards())]
    write_detections(path, results[:2], [("bad.png", "not a picture")])
    texts = [path.read_text()]
    write_detections(path, [ImageResult("none.png", 64, 48, Corners([], [], []), ())])
    return (*texts, path.read_text())


@cache
def vnl() -> str:
    """A corners.vnl."""
    path = scratch() / "good.vnl"
    write_vnl(path, [_result(f"{k}.png", b) for k, b in enumerate(small_boards())])
    return path.read_text()


def _pair() -> StereoCameras:
    T = np.eye(4)
    T[0, 3] = -0.1
    return StereoCameras(CAMERAS["pinhole"], CAMERAS["pinhole"], T)


def corrected() -> Camera:
    """A camera with a smooth correction."""
    plain = CAMERAS["brown"]
    return Camera(plain.K, plain.distortion, plain.image_size, plain.model, zero_correction(plain, 6))


@cache
def cameras() -> tuple[str, ...]:
    """Camera files in every format, of every lens that it holds, and of a pair."""
    texts = []
    names = {
        "opencv": "c.yaml",
        "ros": "c.yaml",
        "kalibr": "c.yaml",
        "colmap": "c.txt",
        "mrcal": "c.cameramodel",
        "json": "c.json",
    }
    for kind, name in names.items():
        for camera in (*CAMERAS.values(), Camera(CAMERAS["brown"].K, [-0.1], (640, 480), "division"), corrected()):
            texts += _written(lambda path, camera=camera, kind=kind: write_camera(path, camera, kind), name)
        texts += _written(lambda path, kind=kind: write_stereo(path, _pair(), kind), name)
    return tuple(texts)


def _written(write: Any, name: str) -> list[str]:
    """The files that `write` writes; none if the format can't hold it."""
    from rcdn.errors import RcdnError

    path = scratch() / "of" / name
    path.parent.mkdir(exist_ok=True)
    try:
        write(path)
    except RcdnError:
        return []
    texts = [made.read_text() for made in sorted(path.parent.iterdir())]
    for made in path.parent.iterdir():
        made.unlink()
    return texts


@cache
def calibration() -> Calibration:
    """A calibration of three views of 4 × 3 corners, one left out."""
    camera, rng, views = CAMERAS["brown"], np.random.default_rng(4), []
    while len(views) < 3:
        T = random_pose(rng, size=(4, 3))
        ij, xy = see(camera, T, (4, 3))
        if len(ij) == 12:
            gaps, reason = rng.normal(0, 0.1, xy.shape), "its labels are wrong" if len(views) == 2 else ""
            views.append(
                BoardView(
                    f"{len(views)}.png", 0, ij, xy, np.full(12, 0.1), Pose(T), gaps, np.full(12, not reason), reason
                )
            )
    cov = np.diag(np.full(len(camera.parameters) + 6, 1e-4) ** 2)
    verdict = Verdict("fair", (Reason("views", "fair", "used views", 2, 10, "", "Only 2 views.", "Take more."),))
    shape = BoardShape(np.zeros((3, 4, 3)))
    scores = (ModelScore("brown", 0.14, 0.15),)
    return Calibration(
        camera, SPACING, tuple(views), cov, 0.1, scores, (4, 3), "unique", shape, ("Take more.",), verdict
    )


@cache
def calibrations() -> tuple[str, ...]:
    """A saved calibration of one camera and one of two."""
    from rcdn.types import StereoCalibration

    one, path, I = calibration(), scratch() / "calibration.json", np.eye(3)  # noqa: E741
    T, P = np.eye(4), np.eye(3, 4)
    T[0, 3] = -0.1
    two = StereoCalibration(one, one, T, np.eye(6) * 1e-8, 0.14, 0.1, I, I, P, P, np.eye(4), (), one.verdict)
    texts = []
    for found in (one, two):
        write_calibration(path, found)
        texts.append(path.read_text())
    return tuple(texts)


@cache
def scenes() -> tuple[str, ...]:
    """Scenes as JSON, small ones."""
    from rcdn.synthetic import PRESETS, random_scene

    return tuple(random_scene(np.random.default_rng(k), PRESETS["hard"], (72, 64)).to_json() for k in range(6))


@cache
def coded_picture() -> Array:
    """A small ChArUco board, a little blurred, seen straight on."""
    image = cv2.GaussianBlur(charuco_drawing(6, 5, "DICT_4X4_50").image, (0, 0), 3.0)
    return np.asarray(cv2.resize(image, (168, 144), interpolation=cv2.INTER_AREA))


@cache
def pictures() -> tuple[tuple[str, bytes], ...]:
    """Small picture files of every kind: ending and bytes."""
    grey = picture()
    colour = np.stack([grey, grey[::-1], 255 - grey], axis=-1)
    deep = grey.astype(np.uint16) * 200
    small = grey[:9, :7].copy()
    out = []
    for ending, images in {
        ".png": (grey, colour, deep, small, np.dstack([colour, grey])), ".jpg": (grey, colour, small),
        ".tiff": (grey, colour, deep, small, grey.astype(np.float32)),
        ".bmp": (grey, colour), ".pgm": (grey, deep), ".ppm": (colour,), ".pbm": (grey,), ".webp": (colour, small),
        ".jp2": (grey,), ".hdr": (colour.astype(np.float32),),
        ".pfm": (grey.astype(np.float32),), ".gif": (colour,), ".ras": (grey,), ".exr": (), ".avif": (grey,),
    }.items():  # fmt: skip
        for image in images:
            try:
                done, data = cv2.imencode(ending, image)
            except cv2.error:  # a build of OpenCV without this format
                continue
            if done:
                out.append((ending, data.tobytes()))
    progressive = cv2.imencode(".jpg", colour, [cv2.IMWRITE_JPEG_PROGRESSIVE, 1, cv2.IMWRITE_JPEG_RST_INTERVAL, 2])[1]
    return (*out, (".jpg", progressive.tobytes()))


@cache
def model() -> tuple[bytes, dict[str, Any]]:
    """A network's ONNX file, and what is beside it."""
    import rcdn

    folder = Path(rcdn.__file__).parent / "weights"
    return (folder / "rcdn_q.onnx").read_bytes(), json.loads((folder / "rcdn_q.json").read_text())
