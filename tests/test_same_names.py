"""Pictures of one name in several inputs: files of saved detections, and pictures themselves."""

from __future__ import annotations

from pathlib import Path
from unicodedata import normalize

import numpy as np
import pytest

import detector_stand_in as stand_in
from rcdn.batch.inputs import gather
from rcdn.batch.same_names import distinct, same_corners
from rcdn.config import DetectorConfig
from rcdn.io import ImageResult, write_detections
from rcdn.terminal import console
from rcdn.types import Board, Corners

IJ = np.stack(np.meshgrid(np.arange(4), np.arange(3)), axis=-1).reshape(-1, 2)
"""labels of a 4×3 board"""


@pytest.fixture
def home(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    console.begin()
    return tmp_path


def seen(name, at, count=12):
    """An image of 100 × 80 px with one board of squares of 9 px, or its first `count` corners, whose corner (0, 0) lies
    `at` px."""
    xy = 9.0 * IJ[:count] + at
    board = Board(
        ij=IJ[:count],
        xy=xy,
        image_size=(100, 80),
        orientation="ambiguous_180",
        response=np.ones(count),
        status=np.zeros(count),
    )
    return ImageResult(name, 100, 80, Corners(xy, np.ones(count), np.zeros(count)), (board,))


def found(*inputs):
    return gather([str(i) for i in inputs], DetectorConfig(), make=stand_in.StandIn, jobs=1)


def places(got):
    """By picture the first corner of its board."""
    return [(i.path, *np.round(i.boards[0].xy[0]).astype(int).tolist()) for i in got.images]


def test_saved_pictures_of_one_name_and_other_corners_are_all_used(home):
    Path("b").mkdir()
    write_detections("a.json", [seen("1.png", (5, 6)), seen("2.png", (20, 9))])
    write_detections("b/b.json", [seen("2.png", (40, 8)), seen("1.png", (5, 6)), seen("/3.png", (7, 7))])
    write_detections("c.json", [seen("/3.png", (50, 9)), seen("2.png", (60, 30))])
    got = found("a.json", "b/b.json", "c.json")
    assert places(got) == [
        ("1.png", 5, 6), ("2.png", 20, 9), ("b/b.json/2.png", 40, 8), ("/3.png", 7, 7),
        ("c.json/3.png", 50, 9), ("c.json/2.png", 60, 30),
    ]  # fmt: skip
    assert got.notes == (
        "b/b.json: 1 picture is named as another one whose corners differ; it is used as b/b.json/2.png",
        "c.json: 2 pictures are named as others whose corners differ; they are used as c.json/3.png, c.json/2.png",
    )
    assert got.saved["b/b.json/2.png"] == Path("b")


def test_accents_spelled_in_two_ways_are_one_name(home):
    one, two = "café.png", normalize("NFD", "café.png")
    write_detections("a.json", [seen(one, (5, 6))])
    write_detections("b.json", [seen(two, (5, 6))])
    write_detections("c.json", [seen(two, (30, 9))])
    assert places(found("a.json", "b.json")) == [(one, 5, 6)]
    assert places(found("a.json", "c.json")) == [(one, 5, 6), (f"c.json/{two}", 30, 9)]


def test_pictures_that_differ_in_the_spelling_of_accents_only_are_two(home):
    one, two = "café.png", normalize("NFD", "café.png")
    got = distinct([(None, seen(one, (5, 6))), (None, seen(two, (5, 6))), (Path("a.json"), seen(two, (5, 6)))])
    assert [i.path for i in got.images] == [one, two]


def test_one_name_for_several_images_of_a_file_gives_each_its_own(home):
    write_detections("d.json", [seen("image", (5 * k, 5)) for k in (1, 2, 3, 2, 4)])
    got = found("d.json")
    assert places(got) == [
        ("image", 5, 5),
        ("d.json/image", 10, 5),
        ("d.json/2/image", 15, 5),
        ("d.json/3/image", 20, 5),
    ]
    assert got.notes == (
        "d.json: 3 pictures are named as others whose corners differ; "
        "they are used as d.json/image, d.json/2/image, d.json/3/image",
    )


def test_one_picture_saved_twice_counts_once_without_a_word(home):
    write_detections("a.json", [seen("1.png", (5, 6))])
    write_detections("b.json", [seen("./1.png", (5.4, 6.3), count=9)])
    got = found("a.json", "b.json")
    assert places(got) == [("1.png", 5, 6)]
    assert got.notes == ()


def test_a_picture_beside_other_corners_saved_under_its_name_is_told(home):
    stand_in.picture(Path("1.png"))
    write_detections("a.json", [seen("1.png", (5, 6)), seen("2.png", (5, 6))])
    got = found("1.png", "a.json")
    assert [i.path for i in got.images] == ["1.png", "2.png"]
    (note,) = got.notes
    assert note.startswith("a.json: 1 picture that has other corners there than in the picture itself counts once")
    assert found("a.json", "1.png").notes == got.notes


def scattered(count, seed=0, of=40):
    """An image of single corners: the first `count` of some `of` at random places."""
    xy = np.random.default_rng(seed).uniform(0, 640, (of, 2))[:count]
    return ImageResult("1.png", 640, 640, Corners(xy, np.ones(count), np.zeros(count)), ())


def test_few_of_the_same_corners_are_the_same_picture():
    assert same_corners(scattered(40), scattered(6))
    assert not same_corners(scattered(40), scattered(5))
    assert not same_corners(scattered(40), scattered(40, seed=1))


def test_of_many_images_each_that_differs_counts_once():
    files = [(Path("a.json"), scattered(30 + k % 3, seed=k % 20)) for k in range(60)]
    got = distinct(files)
    assert len(got.images) == 20
    assert len({image.path for image in got.images}) == 20


def test_the_first_file_of_a_name_says_where_its_picture_may_lie(home):
    Path("b").mkdir()
    write_detections("a.json", [seen("1.png", (5, 6)), seen("2.png", (20, 9))])
    write_detections("b/b.json", [seen("1.png", (40, 8)), seen("2.png", (20, 9))])
    there = {"1.png": Path("b"), "2.png": Path("b"), "a.json/1.png": Path()}
    assert found("b/b.json", "a.json").saved == there
    assert found("a.json", "b/b.json").saved == {"1.png": Path(), "2.png": Path(), "b/b.json/1.png": Path("b")}
    stand_in.picture(Path("2.png"))
    assert found("b/b.json", "a.json", "2.png").saved == {k: v for k, v in there.items() if k != "2.png"}


def test_corners_are_the_same_within_a_pixel_and_by_half():
    whole = seen("1.png", (5, 6))
    assert same_corners(whole, seen("1.png", (5.9, 6), count=6))
    assert not same_corners(whole, seen("1.png", (5.9, 6), count=5))
    assert not same_corners(whole, seen("1.png", (6.1, 6)))
    empty = ImageResult("1.png", 100, 80, Corners([], [], []), ())
    assert same_corners(empty, empty)
    assert not same_corners(empty, whole)
    assert not same_corners(whole, empty)
    assert not same_corners(empty, ImageResult("1.png", 80, 100, Corners([], [], []), ()))
