"""Files of text: detections, corners.vnl, cameras, calibrations, scenes, settings. Each is read,
and what was read is put to use."""

from __future__ import annotations

import json
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from tests.fuzz import samples
from tests.fuzz.mutate import changed_json, changed_text
from tests.fuzz.source import Source
from tests.fuzz.target import Target, as_file, must, scratch

from rcdn import DetectorConfig
from rcdn.errors import FormatError, RcdnError
from rcdn.geometry import project, unproject
from rcdn.io import (
    ImageResult,
    read_calibrations,
    read_cameras,
    read_detections,
    read_stereo,
    read_vnl_boards,
    write_camera,
    write_detections,
    write_vnl,
)
from rcdn.synthetic import render, truth
from rcdn.types import Board, Camera

FORMATS = ("opencv", "ros", "kalibr", "colmap", "mrcal", "json")


def _read_detections(data: bytes) -> None:
    images, errors = read_detections(as_file(data, ".json"))
    for image in images:
        valid_result(image)
    path = scratch() / "again.json"
    write_detections(path, images, errors)
    again, _ = read_detections(path)
    for a, b in zip(images, again, strict=True):
        must(np.allclose(a.corners.xy, b.corners.xy, atol=1e-4, rtol=1e-9), "detections change when they are written")


def valid_result(image: ImageResult) -> None:
    """What every user of detections may rely on."""
    must(image.width > 0 and image.height > 0, f"a picture of {image.width} × {image.height}")
    must(np.isfinite(image.corners.xy).all(), "a corner isn't finite")
    for board in image.boards:
        valid_board(board)


def valid_board(board: Board) -> None:
    """Positions are finite, labels unique."""
    must(np.isfinite(board.xy).all(), "a corner of a board isn't finite")
    must(len({tuple(ij) for ij in board.ij.tolist()}) == len(board), "a label twice")
    must(board.grid().shape == (*board.size[::-1], 2), "a grid of another size")


def _read_vnl(data: bytes) -> None:
    for size, frame in ((None, (640, 480)), ((4, 3), (640, 480))):
        images = read_vnl_boards(as_file(data, ".vnl"), size, frame)
        for image in images:
            valid_result(image)
        try:
            write_vnl(scratch() / "again.vnl", images)
        except FormatError:  # names that mrcal can't read; no board is whole
            continue


def _read_camera(data: bytes) -> None:
    path = as_file(data, ".yaml")
    try:
        found = list(read_cameras(path).values())
    except RcdnError:
        pair = read_stereo(path)
        found = [pair.left, pair.right]
    for camera in found:
        valid_camera(camera)
        for kind in FORMATS:
            try:
                write_camera(scratch() / "again.txt", camera, kind)  # type: ignore[arg-type]
            except FormatError:  # it can't hold the lens
                continue


def valid_camera(camera: Camera) -> None:
    """Its numbers are finite, and points go through it and back without an output, as NaN where it can't see."""
    must(np.isfinite(camera.parameters).all(), "a camera's number isn't finite")
    must(min(camera.image_size) > 0, f"a camera of {camera.image_size} px")
    see(camera)


def see(camera: Camera) -> None:
    """Rays of pixels, and pixels of points."""
    width, height = camera.image_size
    rays = unproject(camera, np.array([[0.0, 0.0], [width / 2, height / 2], [width - 1, height - 1]]))
    project(camera, np.concatenate([rays, [[0.1, 0.2, 1.0], [0.0, 0.0, -1.0], [3.0, 1.0, 0.5]]]))


def _read_calibration(data: bytes) -> None:
    found = read_calibrations(as_file(data, ".json"))
    for one in found.values():
        valid_camera(one.camera)
        must(np.isfinite(one.spacing) and one.spacing > 0, f"a spacing of {one.spacing}")
        _ = one.rms, one.std, one.held_out, one.outliers


def _report(data: bytes) -> None:
    from rcdn.calibration.verdict import judge
    from rcdn.report.calibration import write_report

    for one in read_calibrations(as_file(data, ".json")).values():
        judge(one)
        write_report(scratch() / "page.html", one)


def _scene(data: bytes) -> None:
    """As `rcdn render --scene` does it."""
    from rcdn.cli.render import _read_scene

    scene = _read_scene(as_file(data, ".json"))
    for board in truth(scene):
        must(np.isfinite(board.xy[board.visible]).all(), "a visible corner without a position")
    grey = render(scene, samples=1)
    must(grey.dtype == np.uint8 and grey.shape == (scene.height, scene.width), f"a picture {grey.dtype} {grey.shape}")


def _train_config(data: bytes) -> None:
    from rcdn.training.config import read_config

    read_config(as_file(data, ".toml"))


@cache
def _recipes() -> tuple[str, ...]:
    folder = Path(__file__).parents[2] / "configs"
    return tuple(p.read_text() for p in sorted(folder.rglob("*.toml")))


def _detector_config(data: bytes) -> None:
    config = DetectorConfig.from_json(data.decode("utf-8", "replace"))
    must(DetectorConfig.from_json(config.to_json()) == config, "settings change when they are written")


@cache
def _configs() -> tuple[str, ...]:
    return DetectorConfig.auto().to_json(), DetectorConfig.paper().to_json()


def _pairs(data: bytes) -> None:
    from rcdn.batch.pair_file import PairFile

    PairFile.read(as_file(data, ".txt")).match(["l1.png", "l2.png"], ["r/1.png", "r/2.png"])


PAIRS = 'left, right\nl1.png r/1.png\n# no\n"l2.png"; "r/2.png"\n'


def _camera_file(source: Source) -> bytes:
    good = source.choice(samples.cameras())
    return (
        changed_json(source, good)
        if good.startswith("{") and _is_json(good)
        else changed_text(source, good, samples.cameras())
    )


@cache
def _is_json(text: str) -> bool:
    try:
        json.loads(text)
    except ValueError:
        return False
    return True


def _of(texts: Any, change: Any) -> Any:
    return lambda source: change(source, source.choice(texts()))


TARGETS = [
    Target("detections", _of(samples.detections, changed_json), _read_detections, ".json", guided=True),
    Target("vnl", _of(lambda: (samples.vnl(),), changed_text), _read_vnl, ".vnl", guided=True),
    Target("cameras", _camera_file, _read_camera, ".yaml", guided=True, share=2),
    Target("calibrations", _of(samples.calibrations, changed_json), _read_calibration, ".json", guided=True),
    Target("reports", _of(samples.calibrations, changed_json), _report, ".json", tries=4),
    Target("scenes", _of(samples.scenes, changed_json), _scene, ".json", tries=20),
    Target("settings", _of(_configs, changed_json), _detector_config, ".json", guided=True),
    Target("pairs", _of(lambda: (PAIRS,), changed_text), _pairs, ".txt", guided=True),
]
if find_spec("torch"):
    TARGETS.append(Target("recipes", _of(_recipes, changed_text), _train_config, ".toml", guided=True))
