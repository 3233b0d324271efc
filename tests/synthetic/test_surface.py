"""Sheets in space: forward and inverse maps agree."""

from dataclasses import replace

import numpy as np
import pytest
from plain_scene import BROWN, FISHEYE, board, corners_of, empty

from rcdn.geometry import unproject
from rcdn.synthetic import Bend
from rcdn.synthetic.surface import board_points, board_to_pixels, rays_to_board, viewing_cosine

BENDS = {
    "flat": None,
    "cylinder": Bend(curvature=0.06, angle=0.4),
    "hollow": Bend(curvature=-0.06, angle=2.0),
    "wave": Bend(amplitude=0.25, period=7.0, phase=1.0, angle=1.2),
}


@pytest.mark.parametrize("lens", [{}, BROWN, FISHEYE | {"focal": 250.0}], ids=["pinhole", "brown", "fisheye"])
@pytest.mark.parametrize("bend", BENDS.values(), ids=BENDS)
def test_inverse_of_forward(lens, bend):
    scene = empty(**lens)
    for rvec in ((0, 0, 0), (0.5, -0.3, 0.4), (0.1, 0.8, 3.0)):
        spec = board(scene, rvec, bend=bend, aspect=1.1)
        uv = corners_of(spec).astype(float)
        xy = board_to_pixels(spec, scene.camera, uv)
        assert (viewing_cosine(spec, uv) > 0.2).all()
        assert np.stack(rays_to_board(spec, unproject(scene.camera, xy)), axis=-1) == pytest.approx(uv, abs=1e-6)


def test_bend_keeps_to_its_formula():
    spec = board(empty(), cols=7, rows=5, bend=Bend(curvature=0.1, amplitude=0.2, period=4.0, phase=0.5, angle=0.0))
    x, _, z = board_points(spec, np.array([[0.0, 0], [3, 2], [5, 4]])).T
    s = x - 3
    assert z == pytest.approx(0.05 * s * s + 0.2 * np.sin(2 * np.pi * s / 4 + 0.5))
    turned = replace(spec, bend=replace(spec.bend, angle=np.pi / 2))
    assert board_points(turned, np.array([[0.0, 2], [6, 2]]))[:, 2] == pytest.approx(0.2 * np.sin(0.5))


@pytest.mark.parametrize("tilt", [0.0, 0.4, 1.2])
def test_viewing_cosine_of_a_tilted_board(tilt):
    scene = empty()
    spec = board(scene, (tilt, 0.0, 0.0), at=scene.centre)
    middle = np.array([[3.0, 2.0]])
    assert viewing_cosine(spec, middle) == pytest.approx(np.cos(tilt))
    assert viewing_cosine(board(scene, (np.pi - tilt, 0.0, 0.0), at=scene.centre), middle) == pytest.approx(
        -np.cos(tilt)
    )


def test_viewing_cosine_of_a_bend_is_that_of_its_tangent():
    """Against finite differences of the sheet."""
    scene = empty()
    spec = board(scene, (0.5, -0.3, 0.4), bend=BENDS["wave"])
    uv, h = corners_of(spec).astype(float), 1e-5
    points = board_points(spec, uv)
    du, dv = (board_points(spec, uv + step) - points for step in ([h, 0], [0, h]))
    normal = np.cross(du, dv)
    pose = spec.pose
    sight = points + pose.R.T @ pose.t
    cos = (normal * sight).sum(1) / np.linalg.norm(normal, axis=1) / np.linalg.norm(sight, axis=1)
    assert viewing_cosine(spec, uv) == pytest.approx(cos, abs=1e-4)


def test_rays_miss_a_board_behind_or_edge_on():
    scene = empty()
    spec = board(scene)
    rays = np.array([[0.0, 0, 1], [0, 0, -1], [1, 0, 0.01], [np.nan, 0, 1]])
    assert np.isfinite(rays_to_board(spec, rays)[0]).tolist() == [True, False, False, False]
    back = board(scene, (0.0, np.pi, 0.0))
    assert np.isnan(rays_to_board(back, rays[:1])[0]).all()
