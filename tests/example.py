"""What a program of a user may look like: type checkers accept it, with the types that it states
(tests/test_typing.py)."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import rcdn


def boards_of(folder: Path) -> list[rcdn.Board]:
    """All boards of a folder's pictures."""
    detector = rcdn.Detector(rcdn.DetectorConfig.auto(min_corners=20))
    found: list[rcdn.Board] = []
    for path in sorted(folder.glob("*.png")):
        detection: rcdn.Detection = detector.detect(path)
        found.extend(detection.boards)
    return found


def given_camera() -> rcdn.Camera:
    """A camera of known numbers, without distortion and with it."""
    plain = rcdn.Camera(np.diag([500.0, 500.0, 1.0]), None, (640, 480))
    lens = rcdn.Camera([[500, 0, 320], [0, 500, 240], [0, 0, 1]], [-0.2, 0.05, 0, 0], [640, 480], model="brown")
    K: NDArray[np.float64] = plain.K
    width: int = lens.image_size[0]
    print(K, width, plain.distortion.shape)
    return lens


def camera_of(boards: list[rcdn.Board]) -> rcdn.Camera:
    """The camera that saw them."""
    calibration: rcdn.Calibration = rcdn.calibrate(boards, spacing=0.025)
    deviation: float = calibration.std["fx"]
    two: NDArray[np.float64] = calibration.std[:2]
    rms: float = calibration.rms
    print(deviation, two, rms, calibration.verdict.level)
    return calibration.camera


def use(camera: rcdn.Camera, board: rcdn.Board, picture: NDArray[np.uint8]) -> bool:
    """What cameras and boards can do."""
    camera.save("camera.yaml")
    again: rcdn.Camera = rcdn.Camera.load(Path("camera.yaml"), name=None)
    pixels = again.project(np.zeros((3, 3)))
    rays = again.unproject(pixels)
    map_x, map_y = again.undistortion_maps(balance=0.5)
    pose: rcdn.Pose = rcdn.estimate_pose(board, camera, spacing=0.025)
    found, corners = rcdn.find_chessboard_corners(picture, (9, 6))
    size: tuple[int, int] = board.size
    print(rays.shape, map_x.shape, map_y.dtype, pose.R @ pose.t, size, again.undistort(picture).shape)
    return found and corners is not None
