"""Which pictures of a rig's cameras are of one moment."""

from __future__ import annotations

from itertools import pairwise
from unicodedata import normalize

import pytest

from rcdn.batch.moments import cameras_in, moments_note, moments_of
from rcdn.errors import ConfigError


def numbered(pattern, *numbers):
    return [pattern.format(k) for k in numbers]


def row(pattern):
    """Four cameras in a row with 20 pictures each, of which each shares five with the next one; some show no board."""
    return [
        numbered(pattern.replace("?", str(c)), *range(16 * c, 16 * c + 10), *range(16 * c + 11, 16 * c + 21))
        for c in range(4)
    ]


OWN = [numbered("l/{:04d}.png", *range(20), *range(500, 512)), numbered("r/{:04d}.png", *range(100, 132))]
OWN[1][20:] = numbered("r/{:04d}.png", *range(500, 512))


@pytest.mark.parametrize(("pattern", "way"), [("c?/{:04d}.png", "name"), ("cam?_{:04d}.png", "number")])
def test_a_row_of_cameras_whose_neighbours_share_names(pattern, way):
    keys, found = moments_of(row(pattern))
    assert found == way
    assert [len(set(a) & set(b)) for a, b in pairwise(keys)] == [5, 5, 5]
    assert moments_note(keys, found) == (
        f"note: pictures belong together by {way}: 15 moments of several cameras, 50 of one camera only"
    )


def test_cameras_with_pictures_of_their_own_and_some_of_the_same_names():
    keys, way = moments_of(OWN)
    assert way == "name"
    assert set(keys[0]) & set(keys[1]) == {f"{k:04d}" for k in range(500, 512)}


def test_two_shared_names_of_many_are_chance():
    one, two = numbered("a/{:02d}.png", *range(20)), numbered("b/{:02d}.png", *range(18, 38))
    assert moments_of([one, two])[1] == "order"
    assert moments_of([one, numbered("b/{:02d}.png", 17, 18, 19, *range(21, 38))])[1] == "name"
    with pytest.raises(ConfigError, match="20, 19"):
        moments_of([one, two[:-1]])


@pytest.mark.parametrize("pattern", ["c?/DSC_{:04d}.png", "cam?_{:04d}.png"])
def test_counters_without_a_gap_share_a_few_numbers_by_chance(pattern):
    cameras = [numbered(pattern.replace("?", str(c)), *range(15 * c, 15 * c + 20)) for c in range(3)]
    assert moments_of(cameras) == ([[str(k) for k in range(20)]] * 3, "order")
    with pytest.raises(ConfigError, match="19, 20, 20"):
        moments_of([cameras[0][:-1], *cameras[1:]])


def test_numbers_that_count_nothing_tell_only_where_most_are_shared():
    one = ["dawn_7.png", "noon_8.png", "dusk_9.png", *numbered("a_{}.png", *range(10, 20))]
    two = ["red_7.png", "blue_8.png", "green_9.png", *numbered("b_{}.png", *range(20, 30))]
    assert moments_of([one, two])[1] == "order"


def test_moments_of_names_whose_accents_are_spelled_in_two_ways():
    names = [f"café {letter}.png" for letter in "abcd"]
    two = [normalize("NFD", f"r/{name}") for name in (*names[:1], *names[2:])]
    assert moments_of([names, two]) == (
        [["café a", "café b", "café c", "café d"], ["café a", "café c", "café d"]],
        "name",
    )


def test_nothing_is_said_where_most_names_are_shared():
    assert moments_note(*moments_of([["a/1.png", "a/2.png", "a/3.png"], ["b/1.png", "b/2.png"]])) == ""
    assert moments_note(*moments_of([["l1.png", "l2.png"], ["r1.png", "r2.png"]])).endswith(
        "by number: 2 moments of several cameras, 0 of one camera only"
    )
    assert "by order, since names and numbers don't say which do" in moments_note([["0"], ["0"]], "order")


def test_one_camera_is_no_rig(tmp_path):
    (tmp_path / "left").mkdir()
    for inputs in ([str(tmp_path)], ["left.json"], []):
        with pytest.raises(ConfigError, match="that holds a folder, a video or a file of saved detections of each"):
            cameras_in(inputs)
