"""OpenCV from 4.9 on: its names moved, and which of its packages is installed doesn't matter."""

import tomllib

from tests.doc_blocks import ROOT, run

from rcdn.provenance import OPENCV, versions

OLD = """
import cv2
levels = []
cv2.setLogLevel = lambda level: levels.append(level) or 3
if hasattr(cv2.utils, "logging"):
    del cv2.utils.logging
import numpy as np
import rcdn
from rcdn.io import write_image
write_image("a.png", np.zeros((9, 9), np.uint8))
print(rcdn.read_image("a.png").shape, levels)
"""


def test_logs_are_held_back_where_opencv_4_has_their_level(tmp_path):
    """Silent, then as the program had it; each as often as the picture is looked at."""
    shape, levels = run(tmp_path, "-c", OLD).split(" [")
    assert shape == "(9, 9)"
    numbers = [int(n) for n in levels.strip("]\n").split(",")]
    assert numbers == [0, 3] * (len(numbers) // 2)


def test_some_opencv_is_known_by_its_version():
    found = versions(*OPENCV, "no-such-package")
    assert found
    assert set(found) <= set(OPENCV)
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert [name for name in project["dependencies"] if name.startswith("opencv")] == ["opencv-python-headless>=4.9"]
