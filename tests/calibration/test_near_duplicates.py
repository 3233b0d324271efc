"""Views that tell the same are one cluster: of one picture, copies, a board that hardly moved."""

from __future__ import annotations

import numpy as np

from rcdn.calibration.bundle import Corners3
from rcdn.calibration.near_duplicates import NEAR, alike
from rcdn_lab.camera_scenes import CAMERAS, SPACING, labels, random_pose, see

SIZE = (640, 480)
LIMIT = NEAR * np.hypot(*SIZE)


def whole_view(seed):
    rng = np.random.default_rng(seed)
    while True:
        ij, xy = see(CAMERAS["pinhole"], random_pose(rng, 0.3))
        if len(ij) == 54:
            return xy


def corners_of(views, keep=None):
    """Whole boards at the pixels `views`; `keep` of each: which corners are seen."""
    keep = [np.ones(54, bool)] * len(views) if keep is None else keep
    frame = np.repeat(np.arange(len(views)), [k.sum() for k in keep])
    board = np.concatenate([labels()[k] * SPACING for k in keep])
    xy = np.concatenate([v[k] for v, k in zip(views, keep, strict=True)])
    return Corners3(frame, 0 * frame, board, xy, np.zeros((len(frame), 0)))


def clusters(views, picture=None, keep=None):
    return alike(
        corners_of(views, keep), SIZE, np.arange(len(views)) if picture is None else np.array(picture)
    ).tolist()


A, B = whole_view(0), whole_view(1)


def test_different_views_are_apart_and_copies_together():
    assert clusters([A, B, A, B + 0.3]) == [0, 1, 0, 1]


def test_boards_of_one_picture_are_together_though_they_lie_apart():
    assert clusters([A, B, A + 200], picture=[7, 7, 3]) == [0, 0, 1]


def test_the_limit_is_a_share_of_the_frame():
    right = np.array([LIMIT, 0])
    assert clusters([A, A + 0.9 * right]) == [0, 0]
    assert clusters([A, A + 1.1 * right]) == [0, 1]


def test_a_board_that_moves_on_slowly_begins_a_new_cluster_at_last():
    """Each step is small, and all of them aren't."""
    steps = [A + 0.4 * k * np.array([LIMIT, 0]) for k in range(6)]
    assert clusters(steps) == [0, 0, 0, 1, 1, 1]


def test_views_with_few_corners_in_common_are_apart():
    left, right = labels()[:, 0] < 5, labels()[:, 0] >= 4
    assert clusters([A, A], keep=[left, right]) == [0, 1]
    most = labels()[:, 0] < 7
    assert clusters([A, A], keep=[most, np.ones(54, bool)]) == [0, 0]


def test_turned_labels_are_another_view():
    assert clusters([A, A[::-1]]) == [0, 1]
