"""Which of the boards of a picture is the one that is asked for, and how its corners are numbered."""

from dataclasses import replace

import numpy as np
import pytest
from tests.calibration.coded_views import APRILGRID, CHARUCO, coded_boards

from rcdn.adapters import views
from rcdn.errors import ConfigError
from rcdn.geometry import project
from rcdn.types import Board, Charuco, Checkerboard, Deltille, Printed
from rcdn_lab.camera_scenes import CAMERAS


def plain(columns, rows, drop=(), turn=False):
    """A board of squares of 10 px without the corners `drop`, labelled as it stands or, turned, as its quarter turn."""
    ij = np.array([(i, j) for j in range(rows) for i in range(columns) if (i, j) not in drop])
    xy = 50 + 10.0 * ij
    if turn:  # right-handed still
        ij = np.stack([ij[:, 1], columns - 1 - ij[:, 0]], axis=1)
        order = np.lexsort(ij.T)
        ij, xy = ij[order], xy[order]
    return Board(xy, ij, (640, 480), np.ones(len(xy)), np.zeros(len(xy)), "unique")


NINE_BY_SIX = Printed(Checkerboard(9, 6), 0.02)


def test_whole_plain_boards_are_numbered_row_by_row():
    holed = plain(9, 6, drop=[(4, 2)])
    whole, missing = views([[plain(9, 6)], [], [plain(4, 4), holed]], NINE_BY_SIX)
    assert whole.picture == 0
    assert np.array_equal(whole.ids, np.arange(54))
    assert np.array_equal(whole.xy, 50 + 500 * whole.points[:, :2])
    assert not whole.points[:, 2].any()
    assert missing.picture == 2
    assert np.array_equal(missing.ids, np.delete(np.arange(54), 2 * 9 + 4))
    assert np.array_equal(missing.points, NINE_BY_SIX.points(missing.ids) @ np.eye(2, 3))


def test_a_part_of_a_plain_board_is_no_view_of_it():
    assert views([[plain(8, 6)], [plain(9, 5)], [plain(10, 7)]], NINE_BY_SIX) == []


def test_a_turned_board_keeps_its_places():
    """Corners that are neighbours stay so, and the grid stays right-handed."""
    (view,) = views([[plain(9, 6, turn=True)]], NINE_BY_SIX)
    grid = view.xy.reshape(6, 9, 2)
    across, down = grid[0, 1] - grid[0, 0], grid[1, 0] - grid[0, 0]
    assert across @ across == down @ down == 100
    assert across[0] * down[1] - across[1] * down[0] == 100


def test_the_board_with_most_corners_is_taken():
    (view,) = views([[plain(9, 6, drop=[(1, 1)]), plain(9, 6), plain(9, 6, drop=[(2, 2)])]], NINE_BY_SIX)
    assert len(view.ids) == 54


def test_cameras_must_agree_on_the_first_corner():
    square = replace(plain(7, 7), orientation="ambiguous_90")
    printed = Printed(Checkerboard(7, 7), 0.02)
    assert len(views([[square]], printed)) == 1
    assert views([[square]], printed, several_cameras=True) == []
    assert len(views([[plain(9, 6)]], NINE_BY_SIX, several_cameras=True)) == 1


@pytest.mark.parametrize("target", [CHARUCO, APRILGRID], ids=str)
def test_parts_of_coded_boards_project_to_where_they_were_seen(target):
    """Numbers, places and positions belong together: true poses take the places to the pixels."""
    printed, camera = Printed(target, 0.03), CAMERAS["brown"]
    boards, poses = coded_boards(camera, target, printed.spacing, seed=3, views=5, share=0.5, noise=0.0)
    found = views([[plain(9, 6), board] for board in boards], printed)
    assert [view.picture for view in found] == list(range(5))
    for view, T in zip(found, poses, strict=True):
        assert (np.diff(view.ids) > 0).all()
        assert len(view.ids) < len(printed.ids)
        assert np.allclose(project(camera, view.points @ T[:3, :3].T + T[:3, 3]), view.xy, atol=1e-9)


def test_the_layout_of_a_charuco_board_need_not_be_as_given():
    """Corners of both layouts have the same places and numbers."""
    even = Charuco(8, 6, "DICT_4X4_50", 0.75)
    boards, _ = coded_boards(CAMERAS["brown"], even, 0.03, seed=3, views=2)
    as_given, other = (views([boards], Printed(replace(even, legacy=flag), 0.03)) for flag in (False, True))
    assert len(as_given) == len(other) == 1
    assert np.array_equal(as_given[0].ids, other[0].ids)
    assert np.array_equal(as_given[0].points, other[0].points)


def test_boards_of_other_targets_are_not_taken():
    other = replace(CHARUCO, dictionary="DICT_5X5_50")
    boards, _ = coded_boards(CAMERAS["brown"], CHARUCO, 0.03, seed=3, views=2)
    assert views([boards], Printed(other, 0.03)) == views([boards], NINE_BY_SIX) == []


def test_targets_without_such_numbers_are_refused():
    with pytest.raises(ConfigError, match="must be a Checkerboard, a Charuco or an AprilGrid"):
        views([], Printed(Deltille(9, 6), 0.02))
