"""Views left out by hand: found by name, kept with their reason, and of no influence on the camera."""

import numpy as np
import pytest

from rcdn.calibration import calibrate
from rcdn.calibration.by_hand import REASON, chosen, view_name
from rcdn.errors import ConfigError
from rcdn_lab.camera_scenes import CAMERAS, SPACING, board, random_boards

PINHOLE = CAMERAS["pinhole"]
NAMES = ["a/01.png", "a/02.png", "a/02.png", "b/01.png", "clip.mp4#12", "odd:3"]


def test_a_view_is_named_by_its_picture_and_its_board():
    assert chosen(["a/02.png"], NAMES) == {1, 2}
    assert chosen(["02.png:2"], NAMES) == {2}
    assert chosen(["clip.mp4#12", "b/01.png"], NAMES) == {3, 4}
    assert chosen(["odd:3"], NAMES) == {5}
    assert chosen([], NAMES) == set()


def test_what_to_write_for_a_view_names_it():
    given = [view_name(NAMES, k) for k in range(len(NAMES))]
    assert given == ["a/01.png", "02.png:1", "02.png:2", "b/01.png", "clip.mp4#12", "odd:3"]
    assert [chosen([t], NAMES) for t in given] == [{k} for k in range(len(NAMES))]


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ("a/03.png", "did you mean a/0"),
        ("nothing like it", "the pictures with boards are a/01.png, "),
        ("01.png", "several pictures; name one of a/01.png, b/01.png"),
        ("a/02.png:3", "boards 1 to 2, not number 3"),
        ("a/01.png:2", "one board, not number 2"),
        ("a/02.png:0", "not number 0"),
        ("", "no view is named ''"),
    ],
)
def test_a_name_that_is_none_is_an_error(entry, message):
    with pytest.raises(ConfigError, match="leave_out: ") as caught:
        chosen([entry], NAMES)
    assert message in str(caught.value)


def test_the_camera_is_that_of_the_others():
    """A wrong board and one of another picture size change nothing once they are left out,
    and the others keep their places."""
    boards, poses = random_boards(PINHOLE, 5, 8, whole=True)
    odd = board(boards[0].ij, boards[0].xy / 2, (320, 240), boards[0].sigma)
    every = [*boards[:2], odd, *boards[2:]]
    names = ["0", "1", "odd", "2", "2", *"34567"]
    found = calibrate(every, SPACING, names=names[: len(every)], model="pinhole", leave_out=["odd", "2:2"])
    rest = [b for k, b in enumerate(every) if k not in (2, 4)]
    plain = calibrate(rest, SPACING, names=[names[k] for k in range(len(every)) if k not in (2, 4)], model="pinhole")
    assert np.array_equal(found.camera.parameters, plain.camera.parameters)
    assert np.array_equal(found.cov, plain.cov)
    assert [v.name for v in found.views] == names[: len(every)]
    assert [v.board for v in found.views][3:5] == [0, 1]
    assert [v.reason for v in found.views if v.reason] == [REASON, REASON]
    assert found.views[2].pose is None
    hand = found.views[4]
    assert not hand.used.any()
    assert hand.rms == pytest.approx(0.2 * np.sqrt(2), rel=0.3)
    assert pytest.approx(poses[3], abs=0.02) == hand.pose.T_cam_board
