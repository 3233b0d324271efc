"""Halves of simulated sets: what is compared, that stated deviations hold there, and the table."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from rcdn.errors import RcdnError
from rcdn_lab import repeatability as suite
from rcdn_lab.camera_scenes import CAMERAS, board, random_boards
from rcdn_lab.repeatability import Half, Repeatability, halves, repeat, row, seen_area, summary

BROWN = CAMERAS["brown"]
NAMES = [f"{k:02d}.png" for k in range(24)]


@pytest.fixture(scope="module")
def boards():
    return random_boards(BROWN, 1, 24, 0.3)[0]


# ---- halves


def test_halves_share_nothing_and_are_the_same_for_everybody():
    first, second = halves([*NAMES, *NAMES[:5]], 3)
    assert not first & second
    assert first | second == set(NAMES)
    assert len(first) == len(second) == 12
    assert halves(list(reversed(NAMES)), 3) == (first, second)
    assert len({frozenset(halves(NAMES, k)[0]) for k in range(8)}) == 8


def test_an_odd_picture_goes_to_the_second_half():
    assert [len(h) for h in halves(NAMES[:11], 0)] == [5, 6]


def test_boards_of_one_picture_stay_together(boards):
    calls = []

    def solve(some, names, points):
        calls.append(set(names))
        return Half(BROWN)

    names = [f"{k // 2}.png" for k in range(24)]
    repeat("s", boards, names, "x", solve, 2)
    for a, b in zip(calls[::2], calls[1::2], strict=True):
        assert not a & b
        assert len(a | b) == 12


# ---- the area


def test_the_area_is_the_hull_of_the_corners():
    spots = np.array([[100.0, 100], [500, 100], [500, 400], [100, 400]])
    points = seen_area([board(np.array([[0, 0], [1, 0], [1, 1], [0, 1]]), spots, (640, 480))])
    assert ((points >= 100) & (points <= [500, 400])).all()
    assert len(points) == pytest.approx(24 * 18 * (400 * 300) / (640 * 480), rel=0.1)


# ---- figures of solvers that are made up


def drawn(seed, std, stated):
    """A solver whose cameras scatter with `std` px in fx, fy, cx, cy and state `stated`."""
    rng = np.random.default_rng(seed)

    def solve(boards, names, points):
        off = np.concatenate([rng.normal(0, std, 4), np.zeros(5)])
        return Half(BROWN.with_parameters(BROWN.parameters + off), np.full(4, stated))

    return solve


def test_a_right_deviation_has_the_ratio_one(boards):
    found = repeat("s", boards, NAMES, "x", drawn(0, 0.5, 0.5), 150)
    assert found.ratio == pytest.approx(1, abs=0.08)
    assert found.within == pytest.approx(0.683, abs=0.03)
    assert found.splits == 150
    assert found.focal == pytest.approx(0.5 * np.sqrt(2) / 520, rel=0.1)
    assert found.projections is None


def test_a_deviation_that_is_half_of_the_scatter_has_the_ratio_two(boards):
    found = repeat("s", boards, NAMES, "x", drawn(0, 0.5, 0.25), 100)
    assert found.ratio == pytest.approx(2, abs=0.2)
    assert found.within < 0.5


def test_failures_are_counted_and_cameras_without_deviations_have_no_ratio(boards):
    number = iter(range(100))

    def solve(some, names, points):
        return Half(None, failure="no") if next(number) == 2 else Half(BROWN)

    found = repeat("s", boards, NAMES, "x", solve, 3)
    assert (found.splits, found.failed, found.ratio, found.within) == (2, 1, None, None)
    assert found.px == pytest.approx(0, abs=1e-9)
    assert found.models == "bb bb"


def test_too_few_pictures(boards):
    with pytest.raises(RcdnError, match="set s: 9 pictures"):
        repeat("s", boards[:9], NAMES[:9], "x", drawn(0, 1, 1))


# ---- real solvers on simulated sets


def test_stated_deviations_hold_between_halves():
    """Six sets of 24 views: parameters and projections scatter as stated."""
    ours = partial(suite.ours, model="brown")
    found = [repeat(str(seed), random_boards(BROWN, seed, 24, 0.3)[0], NAMES, "auto", ours, 1) for seed in range(6)]
    assert 0.55 < np.sqrt(np.mean([f.ratio**2 for f in found])) < 1.3  # those of twelve views are on the safe side
    assert 0.55 < np.mean([f.within for f in found]) < 0.95
    assert 0.55 < np.sqrt(np.mean([f.projections**2 for f in found])) < 1.3
    assert all(f.failed == 0 and f.models == "bb" for f in found)


@pytest.mark.parametrize("model", CAMERAS)
def test_opencv_s_solver_finds_the_camera(model):
    camera = CAMERAS[model]
    some = random_boards(camera, 2, 14, 0.1, whole=True)[0]
    half = suite.opencv(some, NAMES[:14], seen_area(some), model)
    assert half.failure == ""
    assert half.camera.model == model
    if model != "rational":  # whose numbers make up for each other
        assert half.camera.parameters[:4] == pytest.approx(camera.parameters[:4], abs=4)
    assert (half.std is None) == (model == "fisheye")
    found = repeat(model, some, NAMES[:14], "opencv", partial(suite.opencv, model=model), 1)
    assert found.px < 3


def test_a_failure_of_opencv_is_told(boards):
    bad = [replace(b, xy=np.full_like(b.xy, 100.0)) for b in boards[:6]]
    half = suite.opencv(bad, NAMES[:6], np.zeros((0, 2)), "fisheye")
    assert half.camera is None
    assert half.failure


# ---- the table


def figures(name, solver, px, ratio=1.0):
    return Repeatability(name, solver, 10, 8, 0, px, px, 1e-3, ratio, 0.7, None, None, "")


def test_the_summary_is_over_the_sets_that_all_solvers_have():
    found = [
        figures("a", "auto", 1.0),
        figures("a", "opencv", 2.0, None),
        figures("b", "auto", 4.0),
        figures("b", "opencv", 8.0, None),
    ]
    found += [figures("c", "auto", 100.0), figures("c", "opencv", float("nan"), None)]
    auto, opencv = summary(found)
    assert auto["set"] == opencv["set"] == "ALL (2 sets)"
    assert auto["px"] == pytest.approx(2)
    assert opencv["px"] == pytest.approx(4)
    assert auto["difference / stated"] == 1
    assert opencv["difference / stated"] is None
    assert (auto["pictures"], auto["splits"]) == (20, 16)
    assert summary([]) == []
    assert set(row(found[0])) == set(auto)
