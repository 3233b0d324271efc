"""Data types that are passed between the stages. All are frozen; arrays have the stated shapes.

Pixel (0, 0) is the centre of the top-left pixel; x right, y down; camera z forward; arrays end in (x, y).
"""

from rcdn.types.base import Array
from rcdn.types.board_shape import BoardShape
from rcdn.types.calibration import (
    LEVELS,
    NOT_JUDGED,
    BoardView,
    Calibration,
    Level,
    ModelScore,
    Reason,
    StereoCalibration,
    Verdict,
)
from rcdn.types.camera import LENS, Camera, CameraModel
from rcdn.types.corners import Board, Corners, Orientation, Status, usual_size
from rcdn.types.correction import LensCorrection
from rcdn.types.limits import Warnings, allowed
from rcdn.types.plane import SQUARES, Pattern, Plane, plane_points
from rcdn.types.pose import Pose, PoseEstimate, pose_std, translation_covariance
from rcdn.types.printed import Checkerboard, Deltille, Print, Printed, PuzzlePart
from rcdn.types.rig import Rig, RigPoseEstimate
from rcdn.types.rig_calibration import FixedBoard, MissingLink, RigCalibration, RigPair, TimeShift
from rcdn.types.target import AprilGrid, Charuco, PuzzleBoard, Target

__all__ = [
    "LENS",
    "LEVELS",
    "NOT_JUDGED",
    "SQUARES",
    "AprilGrid",
    "Array",
    "Board",
    "BoardShape",
    "BoardView",
    "Calibration",
    "Camera",
    "CameraModel",
    "Charuco",
    "Checkerboard",
    "Corners",
    "Deltille",
    "FixedBoard",
    "LensCorrection",
    "Level",
    "MissingLink",
    "ModelScore",
    "Orientation",
    "Pattern",
    "Plane",
    "Pose",
    "PoseEstimate",
    "Print",
    "Printed",
    "PuzzleBoard",
    "PuzzlePart",
    "Reason",
    "Rig",
    "RigCalibration",
    "RigPair",
    "RigPoseEstimate",
    "Status",
    "StereoCalibration",
    "Target",
    "TimeShift",
    "Verdict",
    "Warnings",
    "allowed",
    "plane_points",
    "pose_std",
    "translation_covariance",
    "usual_size",
]
