"""The drawing of the next picture: squares where the camera would see them."""

import re
from dataclasses import replace

import numpy as np
from test_calibration_report import BROWN, FISHEYE, Page, simulated, written

from rcdn.calibration.next_view import next_view
from rcdn.geometry import project, transform
from rcdn.report.calibration.maps import Sensor
from rcdn.report.calibration.next_pose import suggested_pose


def loose(camera=BROWN):
    """A calibration that states a loose lens."""
    calibration = simulated(camera, many=12, reach=(0.15, 0.1))
    cov = np.array(calibration.cov)
    cov[np.arange(9), np.arange(9)] *= 400
    return replace(calibration, cov=cov)


def test_squares_are_where_the_camera_would_see_them():
    for camera in (BROWN, FISHEYE):
        calibration = loose(camera)
        found = next_view(calibration)
        art = suggested_pose(calibration, found).art
        outlines = [
            np.array([p.split() for p in part.rstrip("z").split("L")], float)
            for kind in ("dark", "light")
            for part in re.search(rf'class="suggested {kind}" d="M([^"]*)"', art)[1].split("M")
        ]
        # every inner corner that the frame shows is a corner of a square
        cols, rows = found.size
        ij = np.array([(i, j, 0) for j in range(rows) for i in range(cols)], float)
        xy = project(camera, transform(found.pose, ij * calibration.spacing))
        shown = ((xy > 0) & (xy < np.array(camera.image_size) - 1)).all(axis=1)
        assert shown.mean() > 0.65
        drawn = np.concatenate(outlines)
        for corner in Sensor(camera.image_size).to(xy[shown]):
            assert np.abs(drawn - corner).sum(axis=1).min() < 0.2


def test_little_to_gain_is_said():
    calibration = simulated()
    firm = replace(calibration, cov=1e-4 * calibration.cov)
    found = next_view(firm)
    assert not found.worth_saying
    assert "Little is left to gain" in suggested_pose(firm, found).caption


def test_the_page_has_both_drawings(tmp_path):
    calibration = loose()
    page = Page(written(tmp_path, calibration))
    assert "Hold the board here next" in page.text
    assert "suggested next" in page.text
    blank = replace(calibration, views=tuple(replace(v, pose=None) for v in calibration.views))
    assert "Poses of the board" not in Page(written(tmp_path, blank)).text
