"""Names markers that stand alone, such as an AprilTag on a wall, in an image in which no board was found.

A single marker has no X-corners, so that nothing can be measured with it here; whoever photographed one should be told
so instead of "no board". OpenCV reads the markers.
"""

from __future__ import annotations

from functools import lru_cache, partial

import cv2
import numpy as np

from rcdn.types import Array
from rcdn.types.arrays import Shaped

DICTIONARIES = (
    "DICT_APRILTAG_36h11",
    "DICT_APRILTAG_36h10",
    "DICT_APRILTAG_25h9",
    "DICT_5X5_1000",
    "DICT_6X6_1000",
    "DICT_7X7_1000",
    "DICT_ARUCO_MIP_36h12",
    "DICT_4X4_50",
)
"""dictionaries that are tried, in this order"""
FEWEST_OF_16_BITS = 2
"""fewest different markers of 4 × 4 bits; one is enough of the other dictionaries. Of random squares of 4 × 4 bits one
in 330 is a marker of 4X4_50"""


def single_markers(grey: Shaped[Array, "h w"]) -> tuple[str, tuple[int, ...]] | None:
    """(dictionary in OpenCV's words, ids) of the markers in an image (H, W) uint8, of the first dictionary that has
    some; None if there are none. Only markers without a wrong bit count."""
    for name in filter(partial(hasattr, cv2.aruco), DICTIONARIES):  # an older OpenCV lacks some
        found = _detector(name).detectMarkers(np.ascontiguousarray(grey))[1]
        ids = () if found is None else tuple(sorted({int(number) for number in np.ravel(found)}))
        if len(ids) >= (FEWEST_OF_16_BITS if name == "DICT_4X4_50" else 1):
            return name, ids
    return None


@lru_cache
def _detector(name: str) -> cv2.aruco.ArucoDetector:
    parameters = cv2.aruco.DetectorParameters()
    parameters.errorCorrectionRate = 0.0
    return cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name)), parameters)
