"""Pictures that were turned by 180° or mirrored among others are named; pictures of one camera as they are are not."""

from dataclasses import replace

import numpy as np
import pytest

from rcdn.calibration import calibrate
from rcdn.calibration.one_camera import one_camera
from rcdn.calibration.turned import turned_pictures
from rcdn.types import Camera
from rcdn_lab.camera_scenes import CAMERAS, SPACING, detected, labels, random_boards

NOISE = 0.1
FISHEYE = Camera(
    np.array([[330.0, 0, 331], [0, 330, 228], [0, 0, 1]]), [0.02, -0.005, 0.001, -0.0002], (640, 480), "fisheye"
)


def off_centre(model, by=(14, -9)):
    """A camera of the scenes, its principal point off the middle of the picture."""
    camera = CAMERAS[model]
    middle = (np.array(camera.image_size) - 1) / 2
    there = middle + np.array(by)
    return camera.with_parameters(np.concatenate([camera.parameters[:2], there, camera.parameters[4:]]))


def flipped(board, way):
    """The board in a picture that is turned, or mirrored `left to right` or `top to bottom`: as a detector labels it
    there, with the same colour in its first square."""
    there = {"turned": (True, True), "left to right": (True, False), "top to bottom": (False, True)}[way]
    ij = board.ij if way == "turned" else board.ij * [1, -1] + [0, 5]
    return replace(board, xy=np.where(there, np.array(board.image_size) - 1.0 - board.xy, board.xy), ij=ij)


def taken(camera, seed, turned=(), count=14, way="turned"):
    """A calibration from whole boards, some of their pictures turned or mirrored, and the names of these."""
    boards = random_boards(camera, seed, count, noise=NOISE, whole=True)[0]
    boards = [flipped(b, way) if k in turned else b for k, b in enumerate(boards)]
    names = [f"{k:02}.png" for k in range(len(boards))]
    model = "fisheye" if camera.model == "fisheye" else "auto"
    return calibrate(boards, SPACING, names=names, model=model), {names[k] for k in turned}


@pytest.mark.parametrize(
    ("model", "turned"),
    [("pinhole", (2, 9)), ("pinhole", (1, 4, 7, 10, 13)), ("brown", (3,)), ("brown", (2, 9)), ("brown", (1, 4, 7, 10))],
)
def test_turned_pictures_are_named(model, turned):
    done, names = taken(off_centre(model), 1, turned)
    found = turned_pictures(done)
    assert set(found.names) == names
    assert found.rms < found.before
    (told, *_) = done.verdict.against
    assert "turned by 180°" in told.sentence
    assert all(name in told.sentence for name in names)


@pytest.mark.parametrize("way", ["left to right", "top to bottom"])
@pytest.mark.parametrize(("model", "some"), [("pinhole", (2, 9)), ("brown", (1, 3, 5, 7, 9, 11))])
def test_mirrored_pictures_are_named_as_such(model, some, way):
    done, names = taken(off_centre(model, (30, 20)), 1, some, way=way)
    (told, *_) = done.verdict.against
    assert f"mirrored {way} against" in told.sentence
    assert "turned" not in told.sentence
    assert told.action.startswith("Mirror them back")
    assert set(turned_pictures(done).names) == names


def test_a_change_that_leaves_the_changed_pictures_out_explains_nothing():
    """A quarter of the pictures: without them the others fit perfectly, whatever is done to the quarter."""
    done, names = taken(off_centre("pinhole", (40, -30)), 1, (1, 4, 7, 10), 16, "left to right")
    found = turned_pictures(done)
    assert set(found.names) == names
    assert [change.done for change in found.changes] == ["mirrored left to right"]
    assert found.views == 16


def test_turned_pictures_of_a_bent_board_that_looks_the_same_after_half_a_turn_are_not_said_to_be_mirrored():
    """Its labels follow how it lies, so that the shape of the others is the wrong way round in turned pictures."""
    size, some = (8, 6), (1, 4, 7, 10)
    u, v = (labels(size) / (np.array(size) - 1) - 0.5).T
    bent = np.stack([0 * u, 0 * u, 0.2 * SPACING * (8 * u**3 + 4 * v * u**2)], axis=1)
    boards = random_boards(off_centre("pinhole", (40, -30)), 1, 16, 0.05, whole=True, offsets=bent, size=size)[0]
    boards = [detected(b.ij, b.xy, b.image_size) for b in boards]
    boards = [flipped(b, "turned") if k in some else b for k, b in enumerate(boards)]
    found = turned_pictures(calibrate(boards, SPACING, names=list("abcdefghijklmnop"), model="pinhole", size=size))
    assert found.names == tuple("behk")
    assert [change.done for change in found.changes] == ["turned by 180°"]


def test_mirrored_pictures_may_be_turned_ones_where_the_principal_point_is_in_the_middle_of_a_column():
    done, names = taken(off_centre("pinhole", (14, 0)), 0, (1, 4, 7, 10), way="left to right")
    found = turned_pictures(done)
    assert set(found.names) == names
    assert {change.done for change in found.changes} == {"turned by 180°", "mirrored left to right"}
    assert all(change.done in found.finding for change in found.changes)
    assert found.remedy.startswith("Look which it is")


@pytest.mark.parametrize("by", [(14, -9), (30, 20)])
@pytest.mark.parametrize(("way", "done"), [("turned", "turned by 180°"), ("left to right", "mirrored left to right")])
def test_changed_pictures_with_other_file_names_are_named(way, done, by):
    """Their names and their principal point are those of another camera."""
    boards = random_boards(off_centre("brown", by), 1, 14, noise=NOISE, whole=True)[0]
    boards = [flipped(b, way) if k >= 7 else b for k, b in enumerate(boards)]
    names = [f"IMG_{k:04}.png" if k < 7 else f"selfie_{k}.png" for k in range(14)]
    calibration = calibrate(boards, SPACING, names=names, model="brown")
    assert one_camera(calibration).by == "names"
    (told, *_) = calibration.verdict.against
    assert f"{done} against" in told.sentence
    assert told.action.endswith(
        "or leave them out (--leave-out; in Python leave_out). If they are of another camera, whose names differ, "
        "calibrate each group by itself."
    )
    assert set(turned_pictures(calibration).names) == set(names[7:])


@pytest.mark.parametrize("by", [(-34, 26), (-36, 28)])
def test_two_cameras_are_not_taken_for_turned_pictures_of_one(by):
    """Their principal points lie on opposite sides of the middle, so that turning one's pictures makes them more alike:
    not the same, by their deviations."""
    cameras = [off_centre("pinhole", (40, -30)), off_centre("pinhole", by)]
    boards = [b for k in (0, 1) for b in random_boards(cameras[k], k, 8, noise=NOISE, whole=True)[0]]
    names = [f"cam{k // 8}_{k % 8}.png" for k in range(16)]
    calibration = calibrate(boards, SPACING, names=names, model="pinhole")
    assert set(turned_pictures(calibration).names) == set(names[8:])
    (told, *_) = calibration.verdict.against
    assert "not of one camera" in told.sentence
    assert "8 pictures (cam0_*)" in told.sentence


def test_turned_pictures_of_a_fisheye_are_named():
    done, names = taken(FISHEYE, 2, (0, 5, 6))
    assert set(turned_pictures(done).names) == names


@pytest.mark.parametrize("seed", range(3))
def test_pictures_as_they_are_are_not_named(seed):
    """Neither where the principal point is in the middle, so that turned ones hardly differ."""
    assert turned_pictures(taken(off_centre("brown"), seed)[0]) is None
    camera = CAMERAS["pinhole"]
    middle = (np.array(camera.image_size) - 1) / 2
    central = camera.with_parameters(np.concatenate([camera.parameters[:2], middle]))
    assert turned_pictures(taken(central, seed)[0]) is None


def test_a_turned_picture_that_is_left_out_spoils_nothing():
    done, names = taken(off_centre("pinhole"), 1, (3,))
    assert {v.name for v in done.left_out} == names
    assert turned_pictures(done) is None


def test_all_pictures_turned_are_one_camera():
    done, _ = taken(off_centre("brown"), 4, range(14))
    assert turned_pictures(done) is None
