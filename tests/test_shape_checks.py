"""The shapes in annotations (`rcdn.types.arrays`) are checked in every test: that this really happens."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("jaxtyping")
pytest.importorskip("beartype")
from jaxtyping import TypeCheckError
from tests.shape_checks import checked

from rcdn.geometry.near import within
from rcdn.precision.smooth import smooth
from rcdn.types import Camera
from rcdn.types.target import Charuco


def test_functions_with_shapes_are_replaced_wherever_they_are_imported():
    assert {"rcdn.geometry.near.within", "rcdn.precision.smooth.smooth", "rcdn.types.target.Charuco.ids"} <= checked


@pytest.mark.parametrize(
    "xy", [np.zeros((4, 3)), np.zeros(4), np.zeros((4, 2, 1))], ids=["three columns", "flat", "deep"]
)
def test_a_wrong_shape_is_refused(xy):
    with pytest.raises(TypeCheckError):
        within(np.zeros((4, 2)), xy, 1.0)


def test_one_letter_is_one_number():
    labels = np.argwhere(np.ones((3, 3)))
    xy, cov, trusted = labels * 10.0, np.tile(np.eye(2), (9, 1, 1)), np.ones(9, bool)
    places, _ = smooth(labels, xy, cov, trusted)
    assert places.shape == (9, 2)
    with pytest.raises(TypeCheckError):
        smooth(labels, xy[:8], cov, trusted)


def test_methods_are_checked():
    board = Charuco(5, 4, dictionary="DICT_4X4_50", marker=0.75)
    with pytest.raises(TypeCheckError):
        board.ids(np.zeros((2, 3), int))
    assert Camera(np.eye(3), np.zeros(0), (640, 480), "pinhole").parameters.shape == (4,)
