"""OpenCV: CharucoDetector for ChArUco boards, ArucoDetector and the corners of its tags for AprilGrids. It is given the
complete target."""

from __future__ import annotations

import cv2
import numpy as np

from rcdn.targets.layout import odd_markers
from rcdn.types import Array
from rcdn.types.target import AprilGrid, Charuco, Target
from rcdn_lab.peers.coded.base import CodedPeer, Labelled, Read, board_size, boards_of, corners_of_tag

FAMILIES = {
    "tag16h5": "DICT_APRILTAG_16h5",
    "tag25h9": "DICT_APRILTAG_25h9",
    "tag36h10": "DICT_APRILTAG_36h10",
    "tag36h11": "DICT_APRILTAG_36h11",
}
"""AprilTag's names of families, and OpenCV's"""


def read(image: Array, target: Target) -> list[Labelled]:
    """The board's ids as read by OpenCV; [] for targets that it does not support."""
    if isinstance(target, Charuco):
        return _charuco(image, target)
    return _aprilgrid(image, target) if isinstance(target, AprilGrid) else []


def _charuco(image: Array, target: Charuco) -> list[Labelled]:
    """CharucoDetector, with refinement by cornerSubPix. For a board with inverted grey levels it is given the negative,
    as an ordinary board."""
    columns, rows = board_size(target)
    known = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, target.dictionary))
    odd = odd_markers(target)
    ids = target.first_id + np.arange((columns * rows + (not odd)) // 2)
    board = cv2.aruco.CharucoBoard((columns, rows), 1.0, target.marker, known, ids)
    board.setLegacyPattern(target.legacy)
    refined = cv2.aruco.DetectorParameters()
    refined.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    detector = cv2.aruco.CharucoDetector(board, detectorParams=refined)
    corners, numbers, _, _ = detector.detectBoard(255 - image if target.inverted else image)
    if numbers is None or not len(numbers):
        return []
    return [Labelled(np.asarray(numbers).ravel().astype(int), np.asarray(corners, float).reshape(-1, 2))]


def _aprilgrid(image: Array, target: AprilGrid) -> list[Labelled]:
    """The corners of the tags that ArucoDetector finds. Printed tags are rotated by 180° relative to OpenCV's images of
    them."""
    parameters = cv2.aruco.DetectorParameters()
    parameters.markerBorderBits = target.border
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    known = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, FAMILIES[target.family]))
    quads, tags, _ = cv2.aruco.ArucoDetector(known, parameters).detectMarkers(image)
    ids: list[int] = []
    xy: list[Array] = []
    for quad, tag in zip(quads, [] if tags is None else np.asarray(tags, int).ravel().tolist(), strict=True):
        numbers = corners_of_tag(target, int(tag))
        if numbers:
            ids += numbers
            xy += list(np.asarray(quad, float).reshape(4, 2)[[1, 0, 3, 2]])
    return boards_of(ids, xy)


def _load() -> Read:
    cv2.setNumThreads(1)
    return read


OPENCV = CodedPeer("opencv", lambda t: isinstance(t, Charuco | AprilGrid), lambda: None, lambda: cv2.__version__, _load)
