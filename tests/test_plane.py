"""Where labels lie on printed planes."""

import numpy as np
import pytest

from rcdn.errors import RcdnError
from rcdn.types import AprilGrid, Plane, plane_points

IJ = np.stack(np.meshgrid(np.arange(6), np.arange(4)), axis=-1).reshape(-1, 2)


def test_tags_lie_one_side_and_one_gap_apart_in_turn() -> None:
    x = Plane("aprilgrid", 0.3).points(IJ[:6])[:, 0]
    assert np.diff(x) == pytest.approx([1, 0.3, 1, 0.3, 1])
    assert (AprilGrid(3, 2, "tag36h11", 0.3).plane(IJ) == Plane("aprilgrid", 0.3).points(IJ)).all()


def test_labels_between_corners_lie_between_them() -> None:
    halves = plane_points(np.array([[0.5, 0], [1.5, 0], [2.5, -0.5]]), "aprilgrid", 0.4)
    assert halves == pytest.approx(np.array([[0.5, 0], [1.2, 0], [1.9, -0.2]]))


def test_a_gap_of_one_is_a_plane_of_squares() -> None:
    assert (plane_points(IJ, "aprilgrid", 1.0) == plane_points(IJ)).all()


def test_tags_of_unknown_gap_have_no_places() -> None:
    with pytest.raises(RcdnError, match="depends on its gap"):
        Plane("aprilgrid").points(IJ)
    with pytest.raises(RcdnError, match=r"Plane\.gap must be a positive number"):
        Plane("aprilgrid", -0.1)
