"""What is printed, as data: numbers, labels and places in metres belong together,
and are those of each target's own tools."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rcdn.errors import RcdnError
from rcdn.types import AprilGrid, Charuco, Checkerboard, Deltille, Printed, PuzzleBoard, PuzzlePart

SIDE = st.integers(2, 12)
TARGETS = st.one_of(
    st.builds(Checkerboard, SIDE, SIDE),
    st.builds(Deltille, SIDE, SIDE),
    st.builds(Charuco, SIDE, SIDE, st.just("DICT_4X4_250"), st.floats(0.3, 0.9), st.integers(0, 90)),
    st.builds(AprilGrid, st.integers(1, 9), SIDE, st.just("tag36h11"), st.floats(0.05, 0.9)),
    st.builds(PuzzlePart, SIDE, SIDE, st.integers(0, 489), st.integers(0, 489)),
)


@given(TARGETS, st.floats(1e-3, 0.2))
@settings(max_examples=60, deadline=None)
def test_numbers_labels_and_places_belong_together(target, spacing):
    printed = Printed(target, spacing)
    ids = printed.ids
    assert (np.diff(ids) > 0).all()
    ij = printed.ij_of(ids)
    np.testing.assert_array_equal(target.ids(ij), ids)
    np.testing.assert_array_equal(ij, target.places())
    points = printed.points()
    np.testing.assert_allclose(points, target.plane(ij) * spacing)
    np.testing.assert_array_equal(printed.points(ids[::-2]), points[::-2])
    assert len(np.unique(points.round(9), axis=0)) == len(ids)
    scaled = replace(printed, spacing=2 * spacing)
    np.testing.assert_allclose(scaled.points(), 2 * points)


@pytest.mark.parametrize(("columns", "rows"), [(5, 7), (8, 8), (4, 5)])
@pytest.mark.parametrize("legacy", [False, True])
def test_corners_of_charuco_are_opencv_s(columns, rows, legacy):
    printed = Printed(Charuco(columns, rows, "DICT_4X4_50", 0.75, legacy=legacy), 0.03)
    known = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    board = cv2.aruco.CharucoBoard((columns, rows), 0.03, 0.0225, known)
    board.setLegacyPattern(legacy)
    np.testing.assert_allclose(printed.points() + 0.03, board.getChessboardCorners()[:, :2], atol=1e-7)
    assert printed.ids.tolist() == list(range(len(board.getChessboardCorners())))


def test_corners_of_aprilgrids_are_kalibr_s():
    """Kalibr: x to the right and y upwards from the bottom left, tag after tag (side + gap),
    corner after corner of a row."""
    columns, rows, side, gap = 4, 3, 0.1, 0.3
    points = Printed(AprilGrid(columns, rows, "tag36h11", gap), side).points()
    width = columns * side + (columns - 1) * side * gap
    for number, (x, y) in enumerate(points):
        row, column = divmod(number, 2 * columns)
        at = [n // 2 * side * (1 + gap) + n % 2 * side for n in (column, row)]
        np.testing.assert_allclose((width - x, y), at, atol=1e-12)


def test_rows_of_a_deltille_are_set_off_by_half_a_side():
    points = Printed(Deltille(4, 3), 2.0).points().reshape(3, 4, 2)
    np.testing.assert_allclose(np.diff(points[..., 0], axis=1), 2)
    np.testing.assert_allclose(points[:, 0], [(0, 0), (1, 3**0.5), (0, 2 * 3**0.5)], atol=1e-12)


def test_parts_of_a_puzzleboard_have_the_numbers_of_the_whole():
    part = PuzzlePart(4, 3, 490, 7)
    ids = Printed(part, 0.02).ids
    assert ids[[0, 4, -1]].tolist() == [501 * 7 + 490, 501 * 8 + 490, 501 * 9 + 493]
    np.testing.assert_array_equal(PuzzleBoard().ij_of(ids), part.places())
    np.testing.assert_allclose(Printed(part, 0.02).points()[0], [490 * 0.02, 7 * 0.02])
    with pytest.raises(RcdnError, match="no corner of the PuzzleBoard 4x3 from 490,7"):
        part.ij_of(np.array([501 * 7 + 489]))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Printed(Checkerboard(9, 6), 0.0), "spacing must be a length above 0"),
        (lambda: Printed(Checkerboard(9, 6), float("nan")), "spacing must be a length above 0"),
        (lambda: Printed(Charuco(5, 7, "DICT_4X4_50", 1.5), 0.02), "marker must lie between 0 and 1"),
        (lambda: Printed(AprilGrid(0, 7, "tag36h11", 0.3), 0.02), "columns must be a whole number"),
        (lambda: Checkerboard(1, 6), "at least 2"),
        (lambda: PuzzlePart(20, 20, 482, 0), "first column .* from 0 to 481"),
        (lambda: PuzzlePart(20, 20, 0, -1), "first row"),
        (lambda: PuzzlePart(600, 20), "at most 501 columns"),
        (lambda: Printed(Charuco(5, None, "DICT_4X4_50", 0.75), 0.02).ids, "rows"),
        (lambda: Printed(Charuco(5, 7, "DICT_4X4_50", 0.75), 0.02).points([24]), "ids holds 24, .* numbered 0 to 23"),
        (lambda: Printed(AprilGrid(6, 6, "tag36h11", 0.3), 0.02).points([-1]), "numbered 0 to 143"),
        (lambda: Printed(Checkerboard(9, 6), 0.02).points([0.5]), "whole numbers"),
    ],
)
def test_what_can_t_be_is_refused(make, message):
    with pytest.raises(RcdnError, match=message):
        make()
