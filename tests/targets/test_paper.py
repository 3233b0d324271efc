"""Boards that begin with any marker are told from parts of larger ones by the paper around them;
cut ones get no wrong number."""

from dataclasses import replace

import numpy as np
import pytest
from coded_scene import SQUARE, charuco, numbered, seen

from rcdn.config import DetectorConfig
from rcdn.detector import Detector
from rcdn.geometry import apply_homography
from rcdn.geometry.near import nearest
from rcdn.targets.paper import ended_sides
from rcdn.targets.rectify import wider

WHOLE = [
    (7, 6, "DICT_4X4_50", {"first": 3, "legacy": True}),
    (8, 6, "DICT_4X4_50", {"first": 4}),
    (8, 6, "DICT_5X5_100", {"first": 7}),
    (6, 4, "DICT_6X6_250", {"first": 6}),
    (5, 7, "DICT_5X5_250", {"first": 30}),
    (8, 6, "DICT_4X4_100", {"first": 24, "legacy": True}),
    (7, 6, "DICT_6X6_250", {"first": 21}),
    (9, 8, "DICT_5X5_100", {"first": 10, "ratio": 0.7}),
    (5, 4, "DICT_4X4_50", {"first": 10, "inverted": True}),
]
UP, LEFT, RIGHT, DOWN = (0, 1), (1, 0), (1, 2), (2, 1)
HIDDEN = {UP: np.s_[0], LEFT: np.s_[:, 0], RIGHT: np.s_[:, -1], DOWN: np.s_[-1]}


@pytest.fixture(scope="module")
def detector():
    return Detector(DetectorConfig(target="auto"))


@pytest.mark.parametrize(("columns", "rows", "dictionary", "more"), WHOLE)
@pytest.mark.parametrize("condition", [{"turn": 0.2}, {"turn": 2.5, "noise": 20}, {"turn": 1.4, "blur": 1.5}], ids=str)
def test_whole_boards_that_begin_with_any_marker(detector, columns, rows, dictionary, more, condition):
    drawing = charuco(columns, rows, dictionary, **more)
    image, xy = seen(drawing, **condition)
    right, wrong, shown = numbered(detector, image, drawing, xy)
    assert (right, wrong) == (shown, 0)
    target = detector.boards(image)[0].target
    assert (target.columns, target.rows, target.first_id) == (columns, rows, more["first"])
    assert target.legacy == more.get("legacy", False)
    assert target.inverted == more.get("inverted", False)


@pytest.mark.parametrize(("ratio", "turn"), [(0.8, 0.4), (0.8, 0.8), (0.8, 2.4), (0.84, 0.8), (0.84, 1.2), (0.84, 2.4)])
def test_paper_beside_large_markers_at_60_degrees_is_seen_once_corners_are_exact(detector, ratio, turn):
    """Before the last fit most of these corners are half a pixel off, more than the end of a side may be."""
    drawing = charuco(9, 6, "DICT_APRILTAG_36h11", ratio, first=11)
    image, xy = seen(drawing, tilt=1.05, turn=turn, size=0.85)
    right, wrong, shown = numbered(detector, image, drawing, xy)
    assert (right, wrong) == (shown, 0)
    (board,) = detector.boards(image)
    assert np.linalg.norm(board.xy - xy[np.argsort(drawing.ids)][board.ids], axis=1).max() < 0.15
    assert np.isfinite(board.sigma).all()
    found = detector.corners(image)
    assert nearest(found.xy, found.xy, 2)[0][:, 1].min() > 3
    assert np.isin(board.xy[:, 0], found.xy[:, 0]).all()


@pytest.mark.parametrize("side", range(4))
@pytest.mark.parametrize(
    ("columns", "rows", "dictionary", "more"),
    [(7, 7, "DICT_4X4_50", {}), (8, 8, "DICT_4X4_250", {"legacy": True}), WHOLE[7]],
)
def test_boards_under_a_sheet_of_paper_have_right_numbers_or_none(detector, columns, rows, dictionary, more, side):
    """A sheet as white as the board's lies over two of its rows or columns and a part of the third."""
    drawing = charuco(columns, rows, dictionary, **more)
    for k, part in enumerate((-0.3, -0.15, -0.07, 0.07, 0.15, 0.4, 0.75)):
        image = np.rot90(drawing.image, side).copy()
        image[: round(SQUARE * (2.5 + part))] = 255
        covered = replace(drawing, image=np.rot90(image, -side).copy())
        picture, xy = seen(covered, turn=0.3 + 0.9 * k, seed=k)
        right, wrong, _ = numbered(detector, picture, drawing, xy)
        assert wrong == 0
        assert right > 0 or "first" in more


@pytest.mark.parametrize("turn", [0.0, np.pi / 2, np.pi, 3 * np.pi / 2])
def test_only_boards_whose_first_row_is_seen_begin_with_another_marker(detector, turn):
    drawing = charuco(8, 8, "DICT_4X4_250", first=42)  # no row of a board from 0 begins with 42
    down = np.array([-290 * np.sin(turn), 200 * np.cos(turn)])  # the board's, in the picture
    image, xy = seen(drawing, turn=turn, tilt=0.1, shift=tuple(down.tolist()))
    right, wrong, shown = numbered(detector, image, drawing, xy)
    assert wrong == 0
    assert 0.9 * shown <= right < len(xy)
    image, xy = seen(drawing, turn=turn, tilt=0.1, shift=tuple((-down).tolist()))
    right, wrong, shown = numbered(detector, image, drawing, xy)
    assert (right, wrong) == (0, 0)
    assert 0 < shown < len(xy)


def flat(columns, rows, paper=230.0, samples=32):
    """A board of black squares and of white ones with grey blots, and what is around it,
    as `ended_sides` takes it; which have blots."""
    marked = np.add.outer(np.arange(rows), np.arange(columns)) % 2 == 1
    squares = np.full((rows + 2, columns + 2, samples, samples), paper)
    squares[1:-1, 1:-1][~marked] = 20.0
    squares[1:-1, 1:-1][marked] = 230.0
    squares[1:-1, 1:-1][marked, 8:24, 8:24] = 60.0
    return squares, marked


def test_paper_is_seen_on_all_four_sides():
    ended = ended_sides(*flat(6, 5))
    assert all(ended[side] for side in HIDDEN)
    assert ended.sum() == 4


@pytest.mark.parametrize("side", HIDDEN)
@pytest.mark.parametrize("grey", [np.nan, 120.0, 20.0, 350.0])
def test_a_side_that_shows_no_paper_is_not_known_to_end(side, grey):
    squares, marked = flat(6, 5)
    squares[HIDDEN[side]] = grey
    ended = ended_sides(squares, marked)
    assert not ended[side]
    assert ended.sum() == 3


def test_a_board_that_goes_on_or_ends_within_its_squares_is_not_seen_to_end():
    larger, marked = flat(6, 6)
    assert not ended_sides(larger[1:], marked[1:])[UP]
    cut, marked = flat(6, 5)
    cut[1, :, :5] = 230.0
    assert not ended_sides(cut, marked)[UP]
    more, marked = flat(6, 5)
    more[0, 1:-1][marked[0], -5:] = 20.0
    assert not ended_sides(more, marked)[UP]


def test_a_wider_grid_goes_on_as_the_plane_does():
    h = np.array([[40, 5, 100], [-4, 38, 90], [0.004, -0.003, 1]])
    j, i = np.mgrid[-1:7, -1:8]
    plane = apply_homography(h, np.stack([i, j], axis=-1).reshape(-1, 2).astype(float)).reshape(8, 9, 2)
    np.testing.assert_allclose(wider(plane[1:-1, 1:-1]), plane, atol=0.5)
