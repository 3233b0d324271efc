"""What uses a camera works with a smooth correction, too: poses, reach, files of calibrations,
the report, the terminal."""

from dataclasses import replace

import numpy as np
import pytest

from rcdn.batch import camera_files
from rcdn.calibration import estimate_pose
from rcdn.calibration.arguments import check_camera
from rcdn.calibration.sight import reach
from rcdn.errors import ConfigError
from rcdn.geometry import project, rotation, transform, zero_correction
from rcdn.geometry.spline_grid import largest_shift
from rcdn.io import read_calibration, read_camera, write_calibration
from rcdn.report.calibration import write_report
from rcdn.terminal import camera_text
from rcdn.types import Board, BoardView, Calibration, Camera, ModelScore, Pose

SIZE = (640, 480)
BASE = Camera([[560, 0, 322], [0, 560, 238], [0, 0, 1]], [-0.25, 0.06, 0.0004, -0.0003, 0.0], SIZE, "brown")
IJ = np.array([(i, j) for j in range(6) for i in range(9)])
SPACING = 0.025


def rippled(columns=11):
    grid = zero_correction(BASE, columns)
    control = 0.002 * np.random.default_rng(0).normal(size=grid.control.shape)
    return replace(BASE, correction=grid.with_control(control))


def pose(seed):
    rng = np.random.default_rng(seed)
    R = rotation(rng.uniform(-0.4, 0.4, 3))
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, np.array([*rng.uniform(-0.05, 0.05, 2), 0.5]) - R @ [0.1, 0.0625, 0]
    return Pose(T)


def seen(camera, where):
    return project(camera, transform(where, np.column_stack([IJ * SPACING, np.zeros(len(IJ))])))


def calibration(camera):
    zero, ones = np.zeros((len(IJ), 2)), np.ones(len(IJ))
    views = tuple(
        BoardView(f"{k}.png", 0, IJ, seen(camera, pose(k)), 0.1 * ones, pose(k), zero + 0.1, ones > 0)
        for k in range(12)
    )
    cov = np.diag(np.full(len(camera.parameters) + 6, 1e-8))
    return Calibration(camera, SPACING, views, cov, 0.1, (ModelScore("brown", 0.14, 0.15),), (9, 6), "unique")


def test_poses_are_those_of_the_corrected_camera():
    camera, truth = rippled(), pose(3)
    status = np.ones(len(IJ), np.int8)
    board = Board(seen(camera, truth), IJ, SIZE, np.ones(len(IJ)), status, "unique")
    found = estimate_pose(board, camera, SPACING)
    assert pytest.approx(truth.T_cam_board, abs=1e-7) == found.T_cam_board
    assert estimate_pose(board, BASE, SPACING).rms > 0.1


def test_the_frame_has_rays():
    assert reach(rippled()) == 1


def test_calibrations_are_read_back_with_every_digit(tmp_path):
    done = calibration(rippled())
    write_calibration(tmp_path / "a.json", done)
    back = read_calibration(tmp_path / "a.json")
    np.testing.assert_array_equal(back.camera.parameters, done.camera.parameters)
    np.testing.assert_array_equal(back.cov, done.cov)
    np.testing.assert_array_equal(read_camera(tmp_path / "a.json").parameters, done.camera.parameters)


def test_people_see_the_coefficients_and_one_line_of_the_correction(tmp_path):
    done = calibration(rippled())
    most = largest_shift(done.camera)
    assert 1 < most < 4
    lines = camera_text.camera_lines(done)
    assert f"  and a smooth correction of 11×9 control points, up to {most:.2f} px" in lines
    assert len(lines) < 14
    write_report(tmp_path / "report.html", done)
    page = (tmp_path / "report.html").read_text()
    assert "smooth correction" in page
    assert "s00x" not in page
    assert "s0_0x" not in page


def test_what_a_file_cannot_hold_is_said(tmp_path, capsys):
    camera = rippled()
    for name, message in (
        ("a.json", ""),
        ("a.npz", ""),
        ("a.yaml", "a.yaml: best fit of brown"),
        ("a.cameramodel", "px at most"),
    ):
        camera_files.check_format(tmp_path / name, None)
        camera_files.write_one(tmp_path / name, camera, None)
        printed = capsys.readouterr().err
        assert message in printed
        assert bool(message) == bool(printed)
    with np.load(tmp_path / "a.npz") as found:
        assert found["map_x"].shape == SIZE[::-1]


def test_a_calibration_in_place_of_its_camera_is_told():
    with pytest.raises(ConfigError, match=r"not Calibration; give camera=calibration\.camera"):
        check_camera(calibration(rippled()))
