"""Which views of a picture are looked at: a large one halved first, and then what that leaves open;
with the results of looking at all."""

import cv2
import numpy as np
import pytest

import rcdn
from rcdn import views
from rcdn.config import DetectorConfig
from rcdn.metrics import match
from rcdn.pyramid import View
from rcdn.synthetic import ORDINARY, random_scene, render, truth
from test_pyramid import front


def views_of(grey, monkeypatch, config=None):
    """The detection in a picture, and (scale, boards known before) of each view that was looked at."""
    seen, detect = [], views.Views._detect

    def noted(self, view, part, known=None, coarser=None):
        seen.append((view.scale, len(known or [])))
        return detect(self, view, part, known, coarser)

    with monkeypatch.context() as patch:
        patch.setattr(views.Views, "_detect", noted)
        return rcdn.Detector(config).detect(grey), seen


def whole_first(grey, monkeypatch):
    """The detection if the whole picture is looked at first."""
    with monkeypatch.context() as patch:
        patch.setattr(views, "halved_first", lambda _: None)
        return rcdn.Detector().detect(grey)


@pytest.mark.parametrize("pitch", [14.0, 25.0, 60.0])
def test_a_board_that_half_a_picture_shows_is_as_exact_as_from_the_whole(pitch, monkeypatch):
    scene = front(7, 5, pitch, (640, 480), noise=6.0)
    found, seen = views_of(render(scene), monkeypatch)
    assert seen[:2] == [(0.5, 0), (1.0, 1)]
    (board,), (whole,) = found.boards, whole_first(render(scene), monkeypatch).boards
    assert np.array_equal(board.ij, whole.ij)
    assert np.abs(board.xy - whole.xy).max() < 0.01
    gaps = [match(b.xy, truth(scene)[0].xy, 2)[1].mean() for b in (board, whole)]
    assert gaps[0] < 1.02 * gaps[1] + 1e-3


@pytest.mark.parametrize("seed", range(6))
def test_random_scenes_give_the_boards_that_they_give_when_all_is_looked_at(seed, monkeypatch):
    grey = render(random_scene(np.random.default_rng(seed), ORDINARY, (640, 480)))
    quick, slow = rcdn.Detector().detect(grey), whole_first(grey, monkeypatch)
    assert [(len(b), b.size) for b in quick.boards] == [(len(b), b.size) for b in slow.boards]
    for one, two in zip(quick.boards, slow.boards, strict=True):
        assert np.array_equal(one.ij, two.ij)
        assert np.abs(one.xy - two.xy).max() < 0.05


@pytest.mark.parametrize("tiny", [6.0, 7.0, 9.0])
def test_tiny_squares_beside_a_board_that_half_a_picture_shows_are_found(tiny):
    large, small = render(front(6, 4, 40.0, (400, 480))), render(front(7, 5, tiny, (240, 480)))
    found = rcdn.Detector().boards(np.concatenate([large, small], axis=1))
    assert sorted(len(b) for b in found) == [24, 35]


def test_corners_without_a_board_stay_where_the_picture_has_them(monkeypatch):
    grey = render(front(7, 5, 40.0, (640, 480)))
    grey[:60, :60] = 200
    grey[:30, :30] = grey[30:60, 30:60] = 40  # one more corner, at (29.5, 29.5), far from the board
    grey = cv2.GaussianBlur(grey, (0, 0), 0.8)
    found = rcdn.Detector().detect(grey)
    gap = np.linalg.norm(found.corners.xy - 29.5, axis=1).min()
    assert gap < 0.05
    assert [len(b) for b in found.boards] == [35]


def test_a_corner_that_the_picture_shows_elsewhere_asks_for_the_whole(monkeypatch):
    grey = render(front(7, 5, 40.0, (640, 480)))
    fit = views.saddle_position
    with monkeypatch.context() as patch:
        patch.setattr(views, "saddle_position", lambda *a: fit(*a) + np.array([1.5, 0]))
        found, seen = views_of(grey, monkeypatch)
    assert seen[:2] == [(0.5, 0), (1.0, 0)]
    assert [b.xy.tobytes() for b in found.boards] == [b.xy.tobytes() for b in whole_first(grey, monkeypatch).boards]


@pytest.mark.parametrize("changes", [{"recovery": "growth"}, {"refine": rcdn.DetectorConfig.paper().refine}])
def test_settings_whose_corners_need_the_response_look_at_the_whole_first(changes, monkeypatch):
    config = DetectorConfig.auto(**changes)
    assert views_of(render(front(7, 5, 40.0, (640, 480))), monkeypatch, config)[1][0] == (1.0, 0)


def test_half_a_picture_does_not_count_as_its_detail():
    grey = render(front(7, 5, 40.0, (640, 480)))
    at = views.Views(grey, rcdn.Detector()._model, DetectorConfig(), rcdn.types.Warnings())
    half = View((0, 0, 640, 480), 0.5)
    seen = at._detect(half, half.of(grey))
    assert not seen.detailed
    assert at._in_detail(seen, grey).detailed
