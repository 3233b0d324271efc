"""Copies of a guide, and those that come out of a pickle, go on by themselves."""

import copy
import pickle

import pytest
from tests.calibration.guidance.held_boards import one, pairs, two, whole

WAYS = {"copy": copy.copy, "deepcopy": copy.deepcopy, "pickle": lambda guide: pickle.loads(pickle.dumps(guide))}


@pytest.mark.parametrize("way", WAYS)
def test_copies_of_a_guide_go_on_by_themselves(way):
    guide, seen = one(), whole(4)[3]
    guide.look(seen, 0.0)
    twin = WAYS[way](guide)
    refusals = [[g.look(seen, time).refused for time in (0.2, 0.4)] for g in (twin, guide)]
    assert refusals == [["Hold the board still.", ""]] * 2
    assert twin.add(seen, "3").views == ("0", "1", "2", "3")
    assert guide.progress.views == ("0", "1", "2")
    assert guide.add(seen, "3").worst == twin.progress.worst


@pytest.mark.parametrize("way", WAYS)
def test_copies_of_a_guide_of_two_cameras_go_on_by_themselves(way):
    guide, seen = two(), pairs(4)[3]
    guide.look(seen, 0.0)
    twin = WAYS[way](guide)
    refusals = [[g.look(seen, time).refused for time in (0.2, 0.4)] for g in (twin, guide)]
    assert refusals == [["Hold the board still.", ""]] * 2
    assert twin.remove("2").views == ("0", "1")
    assert guide.progress.views == ("0", "1", "2")
