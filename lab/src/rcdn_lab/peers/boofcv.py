"""BoofCV's chessboard of X-corners, with and without the board's size, in a Java virtual machine inside this process
(JPype).

BoofCV's origin (0, 0) is the corner of the top-left pixel, half a pixel off ours, and its sizes count squares, ours
corners.
"""

from __future__ import annotations

import shutil
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from rcdn.errors import present
from rcdn.types import Array
from rcdn_lab.peers.base import Find, Grid, Peer, lattice, not_installed, version_of

ORIGIN = 0.5


def _missing() -> str | None:
    lacking = not_installed("jpype", "pyboof")
    if lacking:
        return lacking
    return None if shutil.which("java") else "no java on the path: install Java 17 (Debian: openjdk-17-jre-headless)"


@cache
def _java() -> Any:
    """The module jpype with a running Java virtual machine, which can be started only once per process."""
    import jpype

    if not jpype.isJVMStarted():
        spec = present(find_spec("pyboof"), "the package pyboof")  # not imported, because that would start a server
        jar = Path(present(spec.submodule_search_locations, "the folder of pyboof")[0]) / "PyBoof-all.jar"
        jpype.startJVM("-Xmx1g", "-XX:+UseSerialGC", classpath=[str(jar)], interrupt=False)  # Ctrl-C is left to Python
        jpype.JClass("boofcv.concurrency.BoofConcurrency").USE_CONCURRENT = False
    return jpype


def _picture(image: Array) -> Any:
    jpype = _java()
    grey = jpype.JClass("boofcv.struct.image.GrayF32")(image.shape[1], image.shape[0])
    grey.setData(jpype.JArray(jpype.JFloat)(np.ascontiguousarray(image, np.float32).ravel()))
    return grey


def _load_given() -> Find:
    jpype = _java()
    config = jpype.JClass("boofcv.abst.fiducial.calib.ConfigChessboardX")
    dimensions = jpype.JClass("boofcv.abst.fiducial.calib.ConfigGridDimen")
    factory = jpype.JClass("boofcv.factory.fiducial.FactoryFiducialCalibration")

    @cache
    def detector(size: tuple[int, int]) -> Any:
        return factory.chessboardX(config(), dimensions(size[1] + 1, size[0] + 1, 1.0))

    def find(image: Array, size: tuple[int, int]) -> list[Grid]:
        made = detector(size)
        if not made.process(_picture(image)):
            return []
        points = list(made.getDetectedPoints().points)
        xy = np.array([(p.p.getX(), p.p.getY()) for p in points], float).reshape(-1, 2) - ORIGIN
        return [Grid(xy, lattice(size)[[int(p.index) for p in points]])]

    return find


def _load_free() -> Find:
    jpype = _java()
    grey = jpype.JClass("boofcv.struct.image.GrayF32")
    patterns = jpype.JClass("boofcv.alg.fiducial.calib.chess.DetectChessboardXCornerPatterns")
    made = patterns(jpype.JClass("boofcv.abst.fiducial.calib.ConfigChessboardX")(), grey.class_)

    def find(image: Array, _size: tuple[int, int]) -> list[Grid]:
        made.findPatterns(_picture(image))
        return [_grid(info) for info in made.getFoundChessboard().toList()]

    return find


def _grid(info: Any) -> Grid:
    xy = np.array([(n.getX(), n.getY()) for n in info.nodes], float).reshape(-1, 2) - ORIGIN
    return Grid(xy, lattice((int(info.cols), int(info.rows))))


GIVEN = Peer("boofcv-size", "given", _missing, lambda: version_of("PyBoof"), _load_given)
FREE = Peer("boofcv", "free", _missing, lambda: version_of("PyBoof"), _load_free)
