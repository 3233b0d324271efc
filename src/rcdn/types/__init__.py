"""Values that pass between the stages. Frozen; arrays have the stated shapes.

Pixel (0, 0) is the centre of the top-left pixel; x right, y down; camera z forward; arrays end in (x, y).
"""

from rcdn.types.base import Array
from rcdn.types.board_shape import BoardShape
from rcdn.types.calibration import LEVELS, BoardView, Calibration, Level, ModelScore, Reason, StereoCalibration, Verdict
from rcdn.types.camera import LENS, Camera, CameraModel, Pose, PoseEstimate
from rcdn.types.corners import Board, Corners, Orientation, Pattern, Status, plane_points, usual_size
from rcdn.types.correction import LensCorrection
from rcdn.types.limits import Warnings, allowed
from rcdn.types.target import AprilGrid, Charuco, PuzzleBoard, Target

__all__ = [
    "LENS",
    "LEVELS",
    "AprilGrid",
    "Array",
    "Board",
    "BoardShape",
    "BoardView",
    "Calibration",
    "Camera",
    "CameraModel",
    "Charuco",
    "Corners",
    "LensCorrection",
    "Level",
    "ModelScore",
    "Orientation",
    "Pattern",
    "Pose",
    "PoseEstimate",
    "PuzzleBoard",
    "Reason",
    "Status",
    "StereoCalibration",
    "Target",
    "Verdict",
    "Warnings",
    "allowed",
    "plane_points",
    "usual_size",
]
