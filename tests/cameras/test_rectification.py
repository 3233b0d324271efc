"""Rectified pictures of a pair: what each camera sees of a plane, where its rectified camera sees it, row by row."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from rcdn import camera_work
from rcdn.cli import app
from rcdn.errors import ImageError, RcdnError
from rcdn.geometry import project, rotation, unproject
from rcdn.geometry.rectification import rectifying
from rcdn.geometry.resample import rectification
from rcdn.io import (
    Rectification,
    StereoCameras,
    read_pixels,
    read_stereo,
    write_image,
    write_rig,
    write_stereo,
    write_stereo_maps,
)
from rcdn.io.marks import mark_of
from rcdn.types import Calibration, Camera, Pose, Rig, StereoCalibration

LEFT = Camera([[300.0, 0, 155], [0, 302, 124], [0, 0, 1]], [-0.2, 0.05, 0.001, -0.002], (320, 240))
RIGHT = Camera([[150.0, 0, 82], [0, 150, 57], [0, 0, 1]], [0.02, -0.01, 0.003, 0], (160, 120), "fisheye")
PLANE = 2.0
"""m: distance of the plane z = PLANE from the left camera"""
CALIBRATION = Calibration(LEFT, 0.025, (), np.eye(14), 0.0, ())


def pair(shift=(-0.2, 0.01, 0.02)):
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = rotation(np.array([0.03, -0.1, 0.05])), shift
    return StereoCameras(LEFT, RIGHT, T)


def pattern(rays, T):
    """(...,) in 0..1: the plane's print where rays (..., 3) of a camera at `T` (4, 4), from the left one, meet it."""
    R, centre = T[:3, :3], -T[:3, :3].T @ T[:3, 3]
    rays = rays @ R
    on = centre + rays * ((PLANE - centre[2]) / rays[..., 2])[..., None]
    return 0.5 + 0.25 * np.sin(9 * on[..., 0]) + 0.2 * np.cos(7 * on[..., 1] + on[..., 0])


def pixels(size):
    return np.stack(np.meshgrid(*(np.arange(float(side)) for side in size)), axis=-1)


def pictures(of):
    """What both cameras see of the plane, float32."""
    sides = ((of.left, np.eye(4)), (of.right, of.T_right_left))
    return [pattern(unproject(c, pixels(c.image_size)), T).astype(np.float32) for c, T in sides]


@pytest.mark.parametrize("shift", [(-0.2, 0.01, 0.02), (0.01, -0.2, 0.02)], ids=["beside", "above"])
def test_rectified_pictures_are_what_the_rectified_cameras_see(shift):
    of = pair(shift)
    turns = of.turns
    for picture, R, P, T in zip(
        of.rectify(*pictures(of)),
        (turns.R_left, turns.R_right),
        (turns.P_left, turns.P_right),
        (np.eye(4), of.T_right_left),
        strict=True,
    ):
        assert picture.shape == (240, 320)
        rays = unproject(Camera(P[:, :3], None, (320, 240), "pinhole"), pixels((320, 240))) @ R
        shown = picture != 0
        assert shown.mean() > 0.6
        inside = cv2.erode(shown.astype(np.uint8), np.ones((5, 5))) > 0
        assert np.abs(picture - pattern(rays, T))[inside].max() < 0.01


@pytest.mark.parametrize("shift", [(-0.2, 0.01, 0.02), (0.01, -0.2, 0.02)], ids=["beside", "above"])
def test_points_lie_in_one_row_and_q_gives_them_back(shift):
    of = pair(shift)
    turns, points = of.turns, np.random.default_rng(1).uniform([-0.5, -0.4, 1.5], [0.5, 0.4, 4], (50, 3))
    moved = points @ of.T_right_left[:3, :3].T + of.T_right_left[:3, 3]
    seen = [
        project(Camera(P[:, :3], None, (320, 240), "pinhole"), at @ R.T)
        for R, P, at in ((turns.R_left, turns.P_left, points), (turns.R_right, turns.P_right, moved))
    ]
    across = int(abs(shift[1]) > abs(shift[0]))
    gap = seen[0] - seen[1]
    assert np.abs(gap[:, 1 - across]).max() < 1e-9
    back = np.column_stack([seen[0], gap[:, across], np.ones(50)]) @ turns.Q.T
    assert back[:, :3] / back[:, 3:] == pytest.approx(points @ turns.R_left.T, abs=1e-9)


def test_a_calibrated_pair_rectifies_by_its_own_rectification():
    of = pair()
    sides = (replace(CALIBRATION, camera=camera) for camera in (of.left, of.right))
    turned = Rectification(*rectifying(of.left, of.right, of.T_right_left))
    names = ("R_left", "R_right", "P_left", "P_right", "Q")
    held = {name: getattr(turned, name) for name in names} | {"P_left": turned.P_left * [[0.5], [0.5], [1]]}
    found = StereoCalibration(*sides, of.T_right_left, np.eye(6), 0.1, 0.1, **held)
    shown = found.rectify(*pictures(of))
    same = StereoCameras.of(found).rectify(*pictures(of))
    assert all(np.array_equal(a, b) for a, b in zip(shown, same, strict=True))
    assert not np.array_equal(shown[0], of.rectify(*pictures(of))[0])
    assert np.array_equal(shown[1], of.rectify(*pictures(of))[1])


def test_what_is_no_picture_of_its_camera_is_refused():
    of = pair()
    left, right = pictures(of)
    with pytest.raises(RcdnError, match="160×120 px, but the camera was calibrated at 320×240"):
        of.rectify(right, left)
    with pytest.raises(ImageError, match="image must be the pixels of a picture"):
        of.rectify("left.png", right)
    nowhere = replace(of, T_right_left=np.eye(4))
    with pytest.raises(RcdnError, match="at one place can't be rectified"):
        nowhere.rectify(left, right)


def test_files_that_need_a_rectification_get_that_of_the_cameras(tmp_path):
    of = replace(pair(), right=LEFT)
    back = read_stereo(*write_stereo(tmp_path / "camera_info.yaml", of, "ros"))
    np.testing.assert_allclose(back.T_right_left, of.T_right_left, atol=1e-14)
    np.testing.assert_allclose(back.turns.P_right, of.turns.P_right, atol=1e-12)
    first = write_stereo_maps(tmp_path / "maps.npz", of)[0]
    with np.load(first) as maps:
        assert np.array_equal(maps["P"], of.turns.P_left)
        picture = pictures(of)[0]
        remapped = cv2.remap(picture, maps["map_x"], maps["map_y"], cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    rectified = of.rectify(picture, picture)[0]
    assert np.array_equal(rectified[rectified != 0], remapped[rectified != 0])


@pytest.fixture
def run(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    for side, picture in zip(("left", "right"), pictures(pair()), strict=True):
        write_image(Path(side) / "1.png", (255 * picture).astype(np.uint8))
    return lambda *arguments: CliRunner().invoke(app, ["undistort", *arguments])


def test_the_command_rectifies_the_pictures_of_each_camera(run):
    write_stereo("rig.json", pair())
    for side in ("left", "right"):
        result = run("rig.json", side, "--rectify", "--camera-name", side, "--out", f"flat/{side}")
        assert (result.exit_code, result.stderr) == (0, "")
        assert result.stdout.startswith("1 picture of 320×240 px")
        assert mark_of(f"flat/{side}/1.png") == "rcdn undistorted"
    taken = [read_pixels(f"{side}/1.png") for side in ("left", "right")]
    for side, expected in zip(("left", "right"), pair().rectify(*taken), strict=True):
        assert np.array_equal(read_pixels(f"flat/{side}/1.png"), expected)


@pytest.mark.parametrize("kind", ["ros", "mrcal", "toml", "json"])
def test_the_command_takes_a_pair_in_two_files_and_a_rig_of_two(run, kind):
    of = replace(pair(), right=LEFT)
    poses = (Pose(np.eye(4)), Pose(of.T_right_left))
    if kind in ("ros", "mrcal"):
        name = {"ros": "camera_info.yaml", "mrcal": "pair.cameramodel"}[kind]
        write_stereo(name, of, kind)
    else:
        name = f"rig.{kind}"
        write_rig(name, Rig(("left", "right"), (of.left, of.right), poses))
    result = run(name, "left", "--rectify", "--camera-name", "left", "--out", "flat")
    assert (result.exit_code, result.stderr) == (0, "")
    picture = read_pixels("left/1.png")
    assert np.abs(read_pixels("flat/1.png") - of.rectify(picture, picture)[0].astype(float)).max() <= 1


def test_the_command_says_how_many_cameras_a_rig_has(run):
    poses = [Pose(np.eye(4) - 0.1 * k * np.eye(4, k=3)) for k in range(3)]
    write_rig("rig.toml", Rig(("a", "b", "c"), (LEFT,) * 3, tuple(poses)))
    result = run("rig.toml", "left", "--rectify", "--camera-name", "a", "--out", "flat")
    assert (result.exit_code, "is of two cameras, and it holds 3: a, b, c" in result.stderr) == (1, True)


def test_the_maps_of_a_pair_are_kept_together_however_large(monkeypatch):
    monkeypatch.setattr(camera_work, "KEPT", 0)
    made = []
    monkeypatch.setattr(camera_work, "rectification", lambda *given: made.append(given) or rectification(*given))
    of = pair()
    for _ in range(3):
        of.rectify(*pictures(of))
    assert len(made) == 2


def test_the_command_says_what_rectifying_needs(run):
    write_stereo("rig.json", pair())
    result = run("rig.json", "left", "--rectify", "--out", "flat")
    assert (result.exit_code, "--camera-name left | right" in result.stderr) == (2, True)
    result = run("rig.json", "left", "--rectify", "--camera-name", "left", "--scale", "2", "--out", "flat")
    assert (result.exit_code, "leave out --balance, --scale, --crop" in result.stderr) == (2, True)
    LEFT.save("camera.yaml")
    result = run("camera.yaml", "left", "--rectify", "--camera-name", "left", "--out", "flat")
    assert result.exit_code == 1
    assert "camera.yaml" in result.stderr
    assert not Path("flat").exists()
