"""Which pictures of two cameras belong together."""

from __future__ import annotations

import pytest

from rcdn.cli._pairs import pair_names
from rcdn.errors import ConfigError


def same(n):
    return [(k, k) for k in range(n)]


@pytest.mark.parametrize(
    ("left", "right"),
    [
        (["a/01.png", "a/02.png"], ["b/01.jpg", "b/02.jpg"]),
        (["left_01.png", "left_02.png"], ["right_01.png", "right_02.png"]),
        (["01_Left.png", "02_Left.png"], ["01_right.png", "02_RIGHT.png"]),
        (["left01.jpg", "left02.jpg"], ["right01.jpg", "right02.jpg"]),
        (["x/cam0_5.png", "x/cam0_9.png"], ["x/cam1_5.png", "x/cam1_9.png"]),
        (["5_l.png", "6_l.png"], ["5_r.png", "6_r.png"]),
        (["IMG_0_17.png", "IMG_0_18.png"], ["IMG_1_17.png", "IMG_1_18.png"]),
        (["v1.avi#000003", "v1.avi#000009"], ["v2.avi#000003", "v2.avi#000009"]),
        (["dawn.png", "noon.png"], ["red.png", "blue.png"]),
    ],
)
def test_pairs_by_name_or_order(left, right):
    assert pair_names(left, right) == same(2)


def test_names_come_before_order():
    assert pair_names(["a/2.png", "a/1.png"], ["b/1.png", "b/2.png"]) == [(0, 1), (1, 0)]
    assert pair_names(["l_1.png", "l_2.png", "l_3.png"], ["r_3.png", "r_1.png", "r_2.png"]) == [(0, 1), (1, 2), (2, 0)]


def test_pictures_without_a_partner_are_passed_over():
    left, right = [f"a/{k}.png" for k in (1, 2, 3, 4, 5)], [f"b/{k}.png" for k in (2, 3, 4, 9)]
    assert pair_names(left, right) == [(1, 0), (2, 1), (3, 2)]


def test_numbers_with_other_zeros():
    assert pair_names(["p01.png", "p02.png", "p10.png"], ["q1.png", "q2.png", "q10.png"]) == same(3)


def test_frames_of_videos_by_their_numbers():
    left, right = ["a.avi#000001", "a.avi#000005", "a.avi#000007"], ["b.avi#000005", "b.avi#000007"]
    assert pair_names(left, right) == [(1, 0), (2, 1)]


def test_no_way_to_pair():
    with pytest.raises(ConfigError, match="2 pictures of the left camera and 1 of the right"):
        pair_names(["dawn.png", "noon.png"], ["blue.png"])
