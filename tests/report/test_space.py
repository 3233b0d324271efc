"""Boards in space: what is drawn is where the poses are."""

import re
from dataclasses import replace

import numpy as np
import pytest
from test_calibration_report import BROWN, FISHEYE, FOLDED, simulated

from rcdn.geometry import project
from rcdn.report.calibration import space
from rcdn.report.calibration.environment import script
from rcdn.types import Camera


def polygons(art, kind):
    """(points drawn (N, 2), points in space (N, 3)) of each shape of that class."""
    found = re.findall(rf'<(?:polygon|polyline) class="{kind}" points="([^"]*)" data-p="([^"]*)"', art)
    return [
        (np.array([p.split(",") for p in drawn.split()], float), np.array(data.split(), float).reshape(-1, 3))
        for drawn, data in found
    ]


def test_every_board_is_drawn_where_it_was():
    calibration = simulated(many=6)
    drawing = space.boards_in_space(calibration)
    art = drawing.art
    boards = polygons(art, "board")
    assert len(boards) == 6
    projection = space.Projection(*_projection(art))
    for (drawn, corners), view in zip(boards, calibration.views, strict=True):
        assert projection.to(corners) == pytest.approx(drawn, abs=0.1)
        assert corners == pytest.approx(space.board_rim(calibration, view), abs=1e-3)
        assert (drawn > 0).all()
        assert (drawn < [space.WIDTH, space.HEIGHT]).all()
    assert drawing.turns


def _projection(art):
    numbers = np.array(re.search(r'data-look="([^"]*)"', art)[1].split(), float)
    return numbers[:3], *numbers[3:]


def test_boards_left_out_are_told_apart_and_wild_ones_left_away():
    calibration = simulated(many=6)
    views = list(calibration.views)
    views[1] = replace(views[1], reason="bent & torn", used=np.zeros(len(views[1]), bool))
    T = np.array(views[2].pose.T_cam_board)
    T[:3, 3] *= 50
    views[2] = replace(views[2], reason="far", pose=replace(views[2].pose, T_cam_board=T))
    views[3] = replace(views[3], reason="no pose", pose=None)
    drawing = space.boards_in_space(replace(calibration, views=tuple(views)))
    art = drawing.art
    assert len(polygons(art, "board")) == 3
    assert len(polygons(art, "board out")) == 1
    assert "view 2: view001.png" in art
    assert "left out: bent &amp; torn" in art
    assert "1 board left out would stand far beyond, and is not drawn" in drawing.caption


def test_no_pose_no_drawing():
    calibration = simulated(many=3)
    blank = replace(calibration, views=tuple(replace(v, pose=None) for v in calibration.views))
    assert space.boards_in_space(blank) is None


@pytest.mark.parametrize("camera", [BROWN, FISHEYE, FOLDED, Camera(BROWN.K, [], BROWN.image_size, "pinhole")])
def test_the_frustum_goes_through_the_rim_of_the_frame(camera):
    rim = space.frustum(camera, 0.3)
    assert np.linalg.norm(rim, axis=1) == pytest.approx(0.3)
    if camera is not FOLDED:
        seen = project(camera, rim)
        width, height = camera.image_size
        assert (np.isclose(seen, -0.5) | np.isclose(seen, [width - 0.5, height - 0.5])).any(axis=1).all()


def test_the_script_projects_as_the_drawing_does():
    """The formulas are written twice; they have the same terms."""
    for term in (
        "ahead = Math.cos(a) * z - Math.sin(a) * x",
        "Math.cos(a) * x + Math.sin(a) * z",
        "Math.cos(b) * y - Math.sin(b) * ahead",
    ):
        assert term in script()
