"""What is refused leaves a guide as it was, and the next frame is judged and taken as ever."""

import copy
import datetime
from dataclasses import replace

import numpy as np
import pytest
from tests.calibration.coded_views import CHARUCO, all_places, coded_board, places, pose_before, seen_part
from tests.calibration.guidance.held_boards import PINHOLE, one, pairs, two, whole

from rcdn.calibration.guidance import Guide
from rcdn.errors import ConfigError
from rcdn.geometry import project
from rcdn.types import PuzzleBoard
from rcdn_lab.camera_scenes import SPACING, WIDE, detected, labels

REFUSED = {
    "a name that isn't text": (lambda b: b, 5, "name must be text, such as '5', not 5"),
    "no name": (lambda b: b, None, "name must be text, such as 'None', not None"),
    "a corner without a position": (lambda b: replace(b, xy=b.xy * np.nan), "x", "xy must be finite; leave out"),
    "another kind": (lambda b: charuco(), "x", "1 board is ChArUco .* have no codes .* from one kind"),
    "a number": (lambda b: 3, "x", "must be a Board"),
}
TIMES = ["0", None, float("nan"), float("inf"), 10**400, datetime.datetime(2026, 1, 1), True, np.array([1.0])]


def charuco(seed=1):
    rng = np.random.default_rng(seed)
    return seen_part(rng, PINHOLE, pose_before(rng, CHARUCO, SPACING), CHARUCO, SPACING, 1)


@pytest.fixture(scope="module")
def started():
    return one()


@pytest.fixture(scope="module")
def both():
    return two()


@pytest.mark.parametrize("why", REFUSED)
def test_a_refused_board_leaves_the_guide_as_it_was(started, why):
    """Alone, and with a good one; the next is taken."""
    guide, (change, name, message) = copy.deepcopy(started), REFUSED[why]
    before, fourth = guide.progress, whole(4)[3]
    for boards in ({name: change(fourth)}, {"good": fourth, name: change(fourth)}):
        with pytest.raises(ConfigError, match=message):
            guide.add_all(boards)
        assert guide.progress is before
    guide.look(fourth, 0.0)
    assert guide.add(fourth, "3").views == ("0", "1", "2", "3")
    assert guide.remove("3").views == ("0", "1", "2")


@pytest.mark.parametrize("why", ["a name that isn't text", "a corner without a position", "another kind"])
def test_refused_boards_leave_the_guide_of_two_cameras_as_it_was(both, why):
    guide, (change, name, message) = copy.deepcopy(both), REFUSED[why]
    before, (left, right) = guide.progress, pairs(4)[3]
    wrong = (charuco(1), charuco(2)) if why == "another kind" else (left, change(right))
    with pytest.raises(ConfigError, match=message.replace("1 board is", "2 boards are")):
        guide.add_all({"good": (left, right), name: wrong})
    assert guide.progress is before
    guide.look((left, right), 0.0)
    assert guide.add((left, right), "3").views == ("0", "1", "2", "3")


def test_boards_by_name_are_a_mapping(started, both):
    for guide, argument in ((started, "boards"), (both, "moments")):
        with pytest.raises(ConfigError, match=f"{argument} must be a dict by the pictures' names, not list"):
            guide.add_all([])


def test_a_picture_that_others_need_stays_with_its_reason():
    """Without one of the two boards with codes most would have none."""
    guide = Guide(WIDE, SPACING, model="pinhole")
    plain, coded = whole(2), [charuco(k) for k in (1, 2)]
    guide.add_all({"a": coded[0], "b": coded[1], "c": plain[0], "d": plain[1]})
    before = guide.progress
    with pytest.raises(ConfigError, match=r"1 board is ChArUco .* and 2 others"):
        guide.remove("a")
    assert guide.progress is before
    assert guide.remove("c").views == ("a", "b", "d")
    with pytest.raises(ConfigError, match=r"name must be one of the accepted pictures, not \[1\]"):
        guide.remove([1])


def test_a_board_of_another_kind_is_not_to_be_taken(started):
    guide = copy.deepcopy(started)
    assessments = [guide.look(charuco(), 0.05 * k) for k in range(11)]
    assert assessments[-1].refused == "This is another kind of board than in the accepted pictures."
    assert not any(a.take for a in assessments)


def test_later_parts_may_show_more_of_a_board_with_codes():
    """Nothing but its codes says how large a PuzzleBoard is."""
    rng, ij, guide = np.random.default_rng(1), all_places(PuzzleBoard()), Guide(WIDE, SPACING, model="pinhole")
    parts = [ij[ij[:, 0] < 238], ij[ij[:, 0] >= 236], ij]
    for k, part in enumerate(parts):
        T = pose_before(rng, PuzzleBoard(), SPACING, (0.5, 0.6), 0.1, 0.6)
        guide.add(
            coded_board(
                PuzzleBoard(), part, project(PINHOLE, places(PuzzleBoard(), part, SPACING) @ T[:3, :3].T + T[:3, 3])
            ),
            str(k),
        )
    assert guide.progress.views == ("0", "1", "2")
    assert guide.progress.wanted.size == (12, 9)


@pytest.mark.parametrize("time", TIMES, ids=str)
def test_a_time_is_a_number_of_seconds(started, both, time):
    seen = (whole(1)[0], pairs(1)[0])
    one_copy = copy.deepcopy(started)
    for guide, shown in zip((one_copy, copy.deepcopy(both)), seen, strict=True):
        for frame in (shown, None if guide is one_copy else (None, None)):
            with pytest.raises(ConfigError, match="time must be a finite number of seconds"):
                guide.look(frame, time)
        assert guide.look(shown, 1.0).refused == "Hold the board still."


def test_after_an_earlier_time_the_board_must_be_still_anew():
    guide, seen = Guide(WIDE, SPACING, model="pinhole"), whole(1)[0]
    times = [np.float32(5.0), 5.1, 5.2, 5.4, np.int64(1), 1.1, 1.2, 1.4, 1.4]
    still = [not guide.look(seen, time).refused for time in times]
    assert still == [False, False, False, True, False, False, False, True, False]


def test_a_clock_that_is_set_back_takes_no_time_off():
    """Of the time for which a board is held the wrong way up."""
    guide, seen = one(1), held_upright()
    guide._asked, guide._before = 5.0, 100.0
    assert guide._other_way(seen, replace(guide.progress.wanted, upright=False), 1.0)
    assert guide._asked == 5.0
    assert guide._other_way(seen, replace(guide.progress.wanted, upright=False), 1.25)
    assert guide._asked == 5.25


def held_upright():
    """A board whose labels grow to the right in the picture."""
    return detected(labels(), np.array([1, 0.1]) * (labels() * 30.0) + [100, 80], WIDE)
