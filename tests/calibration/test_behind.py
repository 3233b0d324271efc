"""Cameras around a plate that is printed on both sides: who sees its back belongs to the rig, too."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rcdn.batch.behind import TwoSided
from rcdn.calibration import calibrate_rig, calibrate_stereo
from rcdn.calibration.behind import from_behind
from rcdn.detector import MIRRORED, Detection
from rcdn.errors import CalibrationError
from rcdn.geometry import rotation
from rcdn.types import Charuco, Corners
from rcdn.types.limits import READ_IN_A_MIRROR
from rcdn_lab.camera_scenes import CAMERAS, SIZE, SPACING, board, see
from rcdn_lab.rig_scenes import look_at

PRINT = Charuco(SIZE[0] + 1, SIZE[1] + 1, "DICT_4X4_100", 0.75)
EYES = {"front": (0.0, -0.7, 0.1), "beside": (0.4, -0.6, 0.0), "back": (0.1, 0.7, 0.0)}


def seen(noise=0.1):
    """The boards of three cameras, two before a plate and one behind it, and T_cam_world of each."""
    rng = np.random.default_rng(7)
    places = {name: look_at(np.array(eye), np.zeros(3)) for name, eye in EYES.items()}
    views = {name: [] for name in EYES}
    moments = {name: [] for name in EYES}
    upright = np.eye(4)
    upright[:3, :3] = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])  # its front towards −y of the world
    middle = np.eye(4)
    middle[:2, 3] = -(np.array(SIZE) - 1) * SPACING / 2
    for m in range(24):
        move = np.eye(4)
        move[:3, :3], move[:3, 3] = rotation(rng.normal(0, 0.35, 3)), rng.uniform(-0.08, 0.08, 3)
        for name, T in places.items():
            ij, xy = see(CAMERAS["brown"], T @ move @ upright @ middle)
            if len(ij) == SIZE[0] * SIZE[1]:
                found = board(ij, xy + rng.normal(0, noise, xy.shape), (640, 480), np.full(len(xy), noise))
                views[name].append(replace(found, target=PRINT, ids=PRINT.ids(ij)))
                moments[name].append(str(m))
    return views, moments, places


def test_a_camera_behind_the_plate_finds_its_place():
    views, moments, places = seen()
    found = calibrate_rig(views, SPACING, moments=moments, model="brown")
    assert found.components == (("front", "beside", "back"),)
    T, cov = found.rig.relative("front", "back")
    D = places["back"] @ np.linalg.inv(places["front"]) @ np.linalg.inv(T)
    off = np.concatenate([Rotation.from_matrix(D[:3, :3]).as_rotvec(), D[:3, 3]])
    assert off @ np.linalg.solve(cov, off) < 6 + 4 * np.sqrt(12)
    assert np.linalg.norm(off[3:]) < 0.02
    assert all(p.used == p.shared for p in found.pairs)


def test_two_cameras_on_both_sides_of_the_plate_are_a_pair():
    views, moments, places = seen()
    common = sorted(set(moments["front"]) & set(moments["back"]))
    pairs = [(moments["front"].index(m), moments["back"].index(m)) for m in common]
    found = calibrate_stereo(views["front"], views["back"], SPACING, pairs=pairs, model="brown")
    D = places["back"] @ np.linalg.inv(places["front"]) @ np.linalg.inv(found.T_right_left)
    assert np.linalg.norm(D[:3, 3]) < 0.02
    assert np.linalg.norm(Rotation.from_matrix(D[:3, :3]).as_rotvec()) < 0.02


def test_a_camera_whose_pictures_are_mirrored_stays_apart_and_is_told_to_flip_them():
    views, moments, _ = seen()
    views["beside"] = from_behind(views["beside"])
    found = calibrate_rig(views, SPACING, moments=moments, model="brown")
    assert found.components == (("front", "back"), ("beside",))
    assert "If the pictures of beside are mirrored (selfie mode), flip them." in found.verdict.against[0].action


def test_a_plain_board_that_runs_the_wrong_way_round_is_still_refused():
    views, moments, _ = seen()
    plain = {name: [replace(b, target=None, ids=None) for b in each] for name, each in views.items()}
    with pytest.raises(CalibrationError, match=r"camera back.*wrong way round"):
        calibrate_rig(plain, SPACING, moments=moments, model="brown")


def test_boards_of_the_mirror_image_go_back_to_the_picture():
    mine = seen()[0]["back"][0]
    mirror = replace(mine, xy=np.column_stack([639 - mine.xy[:, 0], mine.xy[:, 1]]))
    (back,) = from_behind([mirror, replace(mirror, target=None, ids=None)])
    assert back.xy == pytest.approx(mine.xy)
    assert back.target == PRINT


class Stub:
    """A detector that reads codes only in the mirror image, whose first pixel is dark."""

    def __init__(self, found, warning):
        self.found, self.warning = found, warning

    def detect(self, image):
        mirrored = image[0, 0] == 0
        boards = [self.found] if mirrored else [replace(self.found, target=None, ids=None)]
        return Detection(
            Corners(np.zeros((0, 2)), np.zeros(0), np.zeros((0, 2)), np.zeros(0, np.uint8)),
            boards,
            () if mirrored else (self.warning, "another warning"),
        )


def test_the_second_look_gives_numbers_to_what_is_seen_from_behind():
    mine = seen()[0]["front"][0]
    image = np.full((480, 640), 255, np.uint8)
    image[:, -1] = 0
    warning = MIRRORED.format(PRINT)
    assert warning.startswith(READ_IN_A_MIRROR)
    found = TwoSided(Stub(mine, warning)).detect(image)
    assert found.warnings == ("another warning",)
    assert found.boards[0].xy[:, 0] == pytest.approx(639 - mine.xy[:, 0])
    plain = TwoSided(Stub(mine, "no mirror")).detect(image)
    assert plain.boards[0].target is None
