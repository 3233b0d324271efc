"""One board before a plain background, without noise or blur unless a test asks for them."""

import cv2
import numpy as np

from rcdn.geometry import unproject
from rcdn.synthetic import Background, BoardSpec, Scene, Sensor

BROWN = {"model": "brown", "distortion": (-0.2, 0.05, 0.002, -0.001, 0.01)}
FISHEYE = {"model": "fisheye", "distortion": (0.02, -0.005, 0.001, -0.0002)}


def board(scene, rvec=(0.0, 0.0, 0.0), at=(200.3, 150.2), pitch=30.0, cols=7, rows=5, **spec):
    """A board whose middle is seen at pixel `at`, with squares of about `pitch` px there."""
    ray = unproject(scene.camera, np.array(at))
    middle = np.array([(cols - 1) / 2, (rows - 1) / 2 * spec.get("aspect", 1.0), 0])
    t = ray * scene.focal / pitch - cv2.Rodrigues(np.array(rvec, float))[0] @ middle
    return BoardSpec(cols, rows, rvec, tuple(t.tolist()), **spec)


def empty(width=400, height=300, focal=500.0, centre=(199.5, 149.5), **scene):
    """A frame without a board."""
    scene = {"sensor": Sensor(blur=0, noise=0), "background": Background("plain", 1)} | scene
    return Scene(width, height, focal, centre, **scene)


def corners_of(spec):
    """(column, row) of all corners, row by row."""
    return np.stack(np.meshgrid(np.arange(spec.cols), np.arange(spec.rows)), axis=-1).reshape(-1, 2)
