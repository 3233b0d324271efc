"""Sets with known faults, and good ones: what the verdict says of them."""

from __future__ import annotations

import numpy as np
import pytest

from rcdn.calibration import calibrate
from rcdn.geometry import project
from rcdn_lab import bad_cases, good_cases
from rcdn_lab.bad_cases import BROWN, circle_centres
from rcdn_lab.real_boards import curved_board
from rcdn_lab.verdicts import bad_outcome, good_outcome, row

BAD = {case.name: case for case in bad_cases.CASES}
GOOD = {case.name: case for case in good_cases.CASES}
FAST_BAD = (
    "four pictures, five copies each", "the centre only",
    "pictures of another size, one in five", "pictures of another size, every other", "spacing in millimetres",
    "board named by its squares", "half of the pictures smeared", "a fisheye taken for a pinhole",
)  # fmt: skip
FAST_GOOD = ("pinhole, 20 views, noise 0.1 px", "brown, 20 views, noise 0.1 px", "brown, 12 views, noise 0.1 px")


@pytest.mark.parametrize("name", FAST_BAD)
def test_a_fault_is_said_in_the_first_line(name):
    found = bad_outcome(BAD[name], model="brown")
    assert found.passed, found.first_line
    assert found.named, found.first_line


@pytest.mark.parametrize("name", FAST_GOOD)
def test_a_good_set_cries_no_wolf(name):
    found = good_outcome(GOOD[name], model=name.split(",")[0])
    assert found.passed, found.first_line
    assert row(found)["passed"] == "yes"


def test_there_are_enough_cases_and_each_is_called_something_else():
    assert len(BAD) == len(bad_cases.CASES) >= 20
    assert len(GOOD) == len(good_cases.CASES) >= 15


@pytest.mark.parametrize("name", BAD)
def test_every_bad_case_makes_boards_of_one_pattern(name):
    given = BAD[name].make(np.random.default_rng(1))
    assert len(given.boards) == len(given.names) >= 3
    assert all(np.isfinite(b.xy).all() for b in given.boards)


def test_centroids_of_circles_are_near_the_projected_centres_but_not_there():
    given = circle_centres(np.random.default_rng(0))
    camera = calibrate(given.boards, given.spacing, model="brown").camera
    assert camera.parameters[:4] == pytest.approx(BROWN.parameters[:4], abs=1.5)
    outline = np.array([[[0, 0], [2, 0], [2, 1], [0, 1]]], float)
    assert bad_cases.centroids(outline + 5.0) == pytest.approx(np.array([[6.0, 5.5]]))


def test_bent_boards_stand_out_in_the_middle():
    offsets = curved_board((0.01, 0.0)).reshape(6, 9, 3)
    assert offsets[2, [4, 0], 2] == pytest.approx([0.01, 0.0])
    assert (offsets[:, :, :2] == 0).all()


def test_a_larger_sensor_sees_the_same_directions():
    large = good_cases.larger(BROWN, 3.0)
    ray = np.array([[0.2, -0.1, 1.0]])
    small = project(BROWN, ray)
    assert (project(large, ray) + 0.5) / 3 - 0.5 == pytest.approx(small, abs=1e-9)
