"""Cameras of every lens, which format holds which, and what other programs make of a file."""

import functools
import json
import subprocess
from pathlib import Path

import cv2
import numpy as np
import pytest

from rcdn.geometry import project
from rcdn.types import Camera

SIZE = (1280, 720)
K = np.array([[812.3456789012345, 0, 641.1], [0, 809.87, 355.55555555555554], [0, 0, 1]])
FORMATS = ("opencv", "ros", "kalibr", "colmap", "mrcal", "json")
LENSES = {
    "pinhole": ("pinhole", []),
    "brown4": ("brown", [-0.1, 0.02, 1e-5, -1e-3]),
    "brown5": ("brown", [-0.1, 0.02, 1e-5, -1e-3, 0.003]),
    "rational": ("rational", [0.3, -0.02, 1e-5, -1e-3, 0.003, 0.35, 0.01, -0.002]),
    "fisheye": ("fisheye", [-0.02, 0.003, -1e-3, 2e-4]),
    "division": ("division", [-0.21]),
}
UNHELD = {
    *[("kalibr", lens) for lens in ("brown5", "rational", "division")],
    *[("mrcal", lens) for lens in ("fisheye", "division")],
    *[(kind, "division") for kind in ("opencv", "ros")],
}
HELD = [(kind, lens) for kind in FORMATS for lens in LENSES if (kind, lens) not in UNHELD]
POINTS = np.array([[x, y, 1.0] for x in (-0.7, -0.1, 0.0, 0.4) for y in (-0.4, 0.0, 0.3)]) * 2.5


def camera(lens="brown5", size=SIZE):
    model, distortion = LENSES[lens]
    return Camera(K, np.array(distortion, float), size, model)


def same_camera(a, b):
    """The same numbers (but for COLMAP's half pixel, and zeros that a format adds) and the same pixels."""
    assert a.model == b.model
    assert a.image_size == b.image_size
    np.testing.assert_allclose(a.K, b.K, rtol=1e-15)
    n = max(len(a.distortion), len(b.distortion))
    np.testing.assert_array_equal(*(np.pad(c.distortion, (0, n - len(c.distortion))) for c in (a, b)))
    np.testing.assert_allclose(project(a, POINTS), project(b, POINTS), atol=1e-9)


def opencv_pixels(K, D, fisheye, points=POINTS):
    """OpenCV's own projection."""
    points = np.asarray(points)[:, None]
    zero = np.zeros(3)
    if fisheye:
        return cv2.fisheye.projectPoints(points, zero, zero, np.array(K), np.ravel(D))[0].reshape(-1, 2)
    return cv2.projectPoints(points, zero, zero, np.array(K), np.ravel(D))[0].reshape(-1, 2)


SYSTEM_PYTHON = Path("/usr/bin/python3")


@functools.cache
def mrcal_is_there():
    return (
        SYSTEM_PYTHON.exists()
        and not subprocess.run([SYSTEM_PYTHON, "-c", "import mrcal"], capture_output=True).returncode
    )


def mrcal(code, *arguments):
    """What `code` prints as JSON in the Python that Debian's mrcal belongs to."""
    if not mrcal_is_there():
        pytest.skip("mrcal isn't installed: apt-get install python3-mrcal")
    code = f"import json, sys, mrcal, numpy as np\na = sys.argv[1:]\n{code}"
    done = subprocess.run([SYSTEM_PYTHON, "-c", code, *map(str, arguments)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)
