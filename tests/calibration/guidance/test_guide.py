"""Guidance: what is wanted is worth it, frames that can't be taken are refused with their reason, and it ends."""

from dataclasses import replace

import numpy as np
import pytest

from rcdn.calibration.guidance import Guide
from rcdn.calibration.guidance.first_guess import first_guess
from rcdn.calibration.guidance.progress import planned
from rcdn.calibration.guidance.quality import Quality
from rcdn.calibration.next_view import distances_of
from rcdn.errors import ConfigError, RcdnError
from rcdn.geometry import project
from rcdn_lab.camera_scenes import CAMERAS, SIZE, SPACING, board, random_boards, see

BROWN = CAMERAS["brown"]
NOISE = 0.1


def held(camera, T, rng=None, noise=NOISE):
    """The board that the camera sees at `T`."""
    ij, xy = see(camera, T)
    xy = xy + (rng.normal(0, noise, xy.shape) if rng is not None else 0)
    return board(ij - ij.min(axis=0), xy, camera.image_size, np.full(len(xy), noise))


def followed(camera, views, **given):
    """A guide whose wanted poses were followed exactly for `views` pictures."""
    rng = np.random.default_rng(1)
    guide = Guide(camera.image_size, SPACING, **{"size": SIZE, "model": camera.model} | given)
    while len(guide.progress.views) < views:
        guide.add(held(camera, guide.progress.wanted.pose.T_cam_board, rng), str(len(guide.progress.views)))
    return guide


@pytest.fixture(scope="module")
def started():
    return followed(BROWN, 4)


def still(guide, seen, start=0.0, **given):
    """What is said of a board that is held still for half a second."""
    return [guide.look(seen, start + 0.05 * k, **given) for k in range(11)][-1]


@pytest.mark.parametrize("name", ["brown", "fisheye"])
def test_ten_pictures_reach_a_tenth_of_a_pixel_or_two(name):
    guide = followed(CAMERAS[name], 10)
    assert guide.progress.worst < 0.2
    truth = CAMERAS[name].parameters[:2]
    assert guide.progress.calibration.camera.parameters[:2] == pytest.approx(truth, rel=0.002)


def test_it_ends_when_the_target_is_reached():
    guide = followed(BROWN, 8, target=0.4)
    assert guide.progress.done
    assert guide.progress.sentence.startswith("Enough")
    before = followed(BROWN, 4, target=1.5)
    assert before.progress.worst < 1.5
    assert not before.progress.done  # too few to believe it


def test_the_same_frames_give_the_same_answers():
    a, b = (followed(BROWN, 4).progress for _ in range(2))
    assert np.array_equal(a.calibration.camera.parameters, b.calibration.camera.parameters)
    assert np.array_equal(a.wanted.pose.T_cam_board, b.wanted.pose.T_cam_board)


def test_before_any_camera_there_is_a_first_guess():
    """Two tilted views tell the focal length to some per cent, and how well."""
    none = first_guess(BROWN.image_size, [], [], SPACING, SIZE)
    assert none.camera.K[0, 0] == pytest.approx(0.8 * 640)
    assert np.sqrt(none.cov[0, 0]) > 0.25 * none.camera.K[0, 0]
    for name in ("brown", "fisheye"):
        camera = CAMERAS[name]
        boards, _ = random_boards(camera, 5, 2, noise=NOISE, whole=True)
        found = first_guess(camera.image_size, boards, ["a", "b"], SPACING, SIZE)
        deviation = np.sqrt(found.cov[0, 0])
        assert abs(found.camera.K[0, 0] - camera.K[0, 0]) < 3 * deviation
        assert deviation < 0.05 * camera.K[0, 0]


def test_the_size_is_learned_from_a_whole_board():
    guide = Guide(BROWN.image_size, SPACING)
    assert guide.progress.wanted is None
    boards, _ = random_boards(BROWN, 5, 1, whole=True)
    guide.look(boards[0], 0.0)
    assert sorted(guide.progress.wanted.size) == sorted(SIZE)


def test_a_board_held_as_wanted_is_taken_once_it_is_still(started):
    seen = held(BROWN, started.progress.wanted.pose.T_cam_board)
    first = started.look(seen, 100.0)
    assert not first.take
    assert first.refused == "Hold the board still."
    last = still(started, seen, 100.1)
    assert last.take
    assert not last.refused
    assert last.gain > 0.8


def test_a_moving_board_is_refused(started):
    seen = held(BROWN, started.progress.wanted.pose.T_cam_board)
    moving = [replace(seen, xy=seen.xy + np.array([1.5 * k, 0])) for k in range(20)]
    assessments = [started.look(b, 200 + 0.033 * k) for k, b in enumerate(moving)]
    assert all(k.refused == "Hold the board still." and not k.take for k in assessments)


def test_a_picture_that_is_there_already_is_refused(started):
    again = list(started._boards.values())[-1]
    assert "already" in still(started, again, 300.0).refused


def test_blur_and_bad_light_are_refused(started):
    seen = held(BROWN, started.progress.wanted.pose.T_cam_board)
    flat = np.full((480, 640), 128, np.uint8)
    assert "dark" in still(started, seen, 400.0, grey=flat).refused


def blurred_at(guide, distance, monkeypatch):
    """What is said of a still, blurred board that faces the camera at a `distance`, m."""
    blurs = Quality(blur=9.0, contrast=150.0, clipped=0.0)
    monkeypatch.setattr("rcdn.calibration.guidance.guide.quality", lambda grey, seen: blurs)
    T = np.eye(4)
    T[:3, 3] = [-4 * SPACING, -2.5 * SPACING, distance]
    return still(guide, held(BROWN, T), 100.0, grey=np.zeros((480, 640), np.uint8)).refused


@pytest.mark.parametrize("side", ["near", "far"])
def test_nothing_is_asked_for_outside_the_depth_of_field(side, monkeypatch):
    """A still board that is blurred nearer, or farther, than all sharp ones limits the distances from then on."""
    guide = followed(BROWN, 4)
    sharp = distances_of(guide.progress.calibration)
    here = 0.95 * sharp.min() if side == "near" else 1.05 * sharp.max()
    assert "blurred" in blurred_at(guide, here, monkeypatch)
    least, greatest = guide._sharp
    if side == "near":
        assert here < least <= sharp.min()
        assert greatest == np.inf
    else:
        assert here > greatest >= sharp.max()
        assert least == 0
    for k in range(4, 7):
        distance = guide.progress.wanted.distance
        assert least - 1e-9 <= distance <= greatest + 1e-9
        guide.add(held(BROWN, guide.progress.wanted.pose.T_cam_board, np.random.default_rng(k)), str(k))


def test_a_far_limit_keeps_far_poses_from_being_asked_for():
    """The pose that the guide would ask for beyond the limit is asked for within it."""
    guide = followed(BROWN, 1)
    free, wish, known = guide.progress.wanted, guide._wish, guide._plan.known
    near = planned(wish, known, (0.0, 0.8 * free.distance)).progress.wanted
    assert near.distance <= 0.8 * free.distance + 1e-9
    far = planned(wish, known, (1.3 * free.distance, np.inf)).progress.wanted
    assert far.distance >= 1.3 * free.distance - 1e-9


def test_blur_between_sharp_boards_limits_nothing(monkeypatch):
    guide = followed(BROWN, 4)
    sharp = distances_of(guide.progress.calibration)
    assert "blurred" in blurred_at(guide, float(sharp.mean()), monkeypatch)
    assert guide._sharp == (0.0, np.inf)


def test_small_and_partial_boards(started):
    far = held(BROWN, np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 3.0], [0, 0, 0, 1]]))
    assert "too far" in still(started, far, 500.0).refused
    assert "No board" in started.look(None, 600.0).refused
    assert "Too little" in started.look(board(far.ij[:5], far.xy[:5], far.image_size), 600.1).refused


def test_hints_lead_to_the_wanted_pose(started):
    """A board that is wrong in one thing is told that thing."""
    wanted = started.progress.wanted.pose.T_cam_board
    middle = np.array([4 * SPACING, 2.5 * SPACING, 0])
    at = wanted[:3, :3] @ middle + wanted[:3, 3]

    def assessed(scale=1.0, aside=(0.0, 0.0)):
        T = wanted.copy()
        T[:3, 3] += at * (scale - 1) + np.array([*aside, 0.0])
        return still(started, held(BROWN, T), assessed.time)

    assessed.time = 700.0
    away = assessed(scale=2.2)
    assert away.hint in ("Bring the board closer.", "Hold still.")
    assessed.time = 800.0
    x = project(BROWN, at[None])[0][0]
    side = assessed(scale=1.8, aside=(0.25 if x < 320 else -0.25, 0.0))
    assert ("left" if x < 320 else "right") in side.hint


def test_a_picture_can_be_given_up():
    guide = followed(BROWN, 4)
    before = guide.progress.worst
    guide.remove("3")
    assert guide.progress.views == ("0", "1", "2")
    assert guide.progress.worst > before
    with pytest.raises(ConfigError, match="name must be one of the accepted"):
        guide.remove("../3")


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"image_size": (0, 480)}, "image_size"),
        ({"spacing": -1.0}, "spacing"),
        ({"model": "thin"}, "model"),
        ({"target": 0.0}, "target"),
        ({"size": (1, 4)}, "size"),
    ],
)
def test_wrong_arguments_are_named(given, message):
    with pytest.raises(RcdnError, match=message):
        Guide(**{"image_size": (640, 480), "spacing": 0.03} | given)


def test_a_board_of_another_picture_size_is_refused(started):
    boards, _ = random_boards(BROWN, 1, 1, whole=True)
    with pytest.raises(ConfigError, match="640×480"):
        started.add(replace(boards[0], image_size=(800, 600)), "x")


@pytest.mark.parametrize(
    ("seen", "message"),
    [
        (lambda b: [b], "board must be one Board or None, not a list: give one of its boards"),
        (lambda b: [], "board must be one Board or None, not a list"),
        (lambda b: b.xy, "board must be a Board, as Detector.boards gives them, not ndarray"),
        (lambda b: replace(b, image_size=(800, 600)), "board must be of a picture of 640×480 px, not 800×600"),
    ],
)
def test_a_frame_is_judged_by_one_board_of_its_size(started, seen, message):
    board = held(BROWN, started.progress.wanted.pose.T_cam_board)
    with pytest.raises(ConfigError, match=message):
        started.look(seen(board), 500.0)


@pytest.mark.parametrize(
    "grey",
    [
        np.zeros((480, 640, 3), np.uint8), np.zeros((240, 320), np.uint8), np.zeros((640, 480), np.uint8),
        np.zeros((480, 640), np.uint16), [[0] * 640] * 480,
    ],
)  # fmt: skip
def test_a_frame_is_judged_by_its_whole_grey_picture(started, grey):
    seen = held(BROWN, started.progress.wanted.pose.T_cam_board)
    for each in (seen, None):
        with pytest.raises(ConfigError, match=r"grey must be the whole frame in grey, an array \(480, 640\) of uint8"):
            started.look(each, 500.0, grey)
