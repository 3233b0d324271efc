"""The pictures of Tables 2 and 3: what they show, that they stay the same, and photographs that aren't there."""

import json

import numpy as np
import pytest

from rcdn.errors import FormatError
from rcdn.io import write_image
from rcdn.synthetic import truth
from rcdn_lab.paper.sets import SETS, missing, scene, shots

RENDERED = [s for s in SETS.values() if s.recipe is not None]
PHOTOGRAPHS = [s for s in SETS.values() if s.recipe is None]
RULE = 7
"""px; the preset `paper` drops what is closer to the border"""


@pytest.mark.parametrize("wanted", RENDERED, ids=lambda s: s.name)
def test_rendered_boards_are_whole_and_far_enough_from_the_border(wanted):
    for shot in shots(wanted, most=12):
        assert shot.size == wanted.recipe.size
        assert len(shot.xy) == 54
        assert not len(shot.ignore)
        assert (shot.xy >= RULE).all()
        assert (shot.xy <= np.array(shot.size) - 1 - RULE).all()


@pytest.mark.parametrize("wanted", RENDERED, ids=lambda s: s.name)
def test_recipes_are_what_the_sets_stand_for(wanted):
    scenes = [scene(wanted, k) for k in range(12)]
    boards = [truth(s)[0] for s in scenes]
    pitch = np.array([np.median(b.pitch) for b in boards])
    noise = np.array([s.sensor.noise for s in scenes])
    assert len({s.to_json() for s in scenes}) == 12
    if wanted.column == "Mesa":
        assert (wanted.recipe.size, wanted.total) == ((176, 144), 206)
        assert min(b.pitch.min() for b in boards) >= 5
        assert pitch.max() < 10
        assert noise.min() >= 8
        assert noise.max() <= 20
        assert np.ptp(noise) > 6
    if wanted.column == "uEye":
        assert (wanted.recipe.size, wanted.total) == ((1280, 1024), 206)
        assert max(abs(s.distortion[0]) for s in scenes) <= 0.06
        assert max(s.sensor.gain for s in scenes) <= 0.5
    if wanted.column == "GoPro":
        assert (wanted.recipe.size, wanted.total) == ((2000, 1500), 100)
        assert {s.model for s in scenes} == {"fisheye"}
        assert min(s.width / s.focal for s in scenes) > np.deg2rad(110)


def test_a_set_is_the_same_every_time_and_a_part_is_the_beginning_of_the_whole():
    mesa = SETS["mesa-like"]
    few, many = shots(mesa, most=3), shots(mesa, most=5)
    for one, two in zip(few, many[:3], strict=True):
        assert one.identity == two.identity
        np.testing.assert_array_equal(one.image(), two.image())
        np.testing.assert_array_equal(one.xy, two.xy)
    assert len({shot.identity for shot in many}) == 5
    image = many[0].image()
    assert image.dtype == np.uint8
    assert image.shape == (144, 176)


def test_another_set_has_other_pictures_of_the_same_number():
    assert len({scene(s, 0).background.seed for s in RENDERED}) == len(RENDERED)


# ---- photographs


def folder(root, count, wanted):
    """A data folder with `count` pictures of 40×30 px; the second has no truth."""
    (root / wanted.folder).mkdir(parents=True)
    images = {}
    for k in range(count):
        write_image(root / wanted.folder / f"{k}.png", np.full((30, 40), k, np.uint8))
        images[f"{k}.png"] = {"xy": None if k == 1 else [[10 + k, 12], [20, 12]], "ordered": True}
    (root / "truth.json").write_text(json.dumps({wanted.folder: {"board": [9, 6], "images": images}}))
    return root


def test_photographs_come_with_their_truth_evenly_picked(tmp_path):
    wanted = SETS["gopro"]
    data = folder(tmp_path, 8, wanted)
    assert missing(wanted, data) is None
    every = shots(wanted, data)
    assert [s.name for s in every] == ["0.png", *(f"{k}.png" for k in range(2, 8))]
    np.testing.assert_array_equal(every[1].xy, [(12, 12), (20, 12)])
    assert every[1].size == (40, 30)
    assert (every[1].image() == 2).all()
    assert [s.name for s in shots(wanted, data, 3)] == ["0.png", "4.png", "7.png"]


def test_a_changed_file_is_another_picture(tmp_path):
    wanted = SETS["ueye"]
    data = folder(tmp_path, 3, wanted)
    before = shots(wanted, data)
    write_image(data / wanted.folder / "0.png", np.full((30, 40), 99, np.uint8))
    after = shots(wanted, data)
    assert before[0].identity != after[0].identity
    assert before[1].identity == after[1].identity


@pytest.mark.parametrize("wanted", PHOTOGRAPHS, ids=lambda s: s.name)
def test_photographs_that_are_not_there_say_what_to_do(wanted, tmp_path):
    for data in (None, tmp_path):
        assert "RCDN_DATA" in missing(wanted, data)
    assert all(missing(s, None) is None for s in RENDERED)


def test_a_file_of_truth_that_is_none_is_told(tmp_path):
    data = folder(tmp_path, 3, SETS["ueye"])
    for text in (
        "[]",
        "{",
        '{"rochade-ueye": {"images": {"0.png": {}}}}',
        '{"rochade-ueye": {"images": {"x.png": 3}}}',
    ):
        (data / "truth.json").write_text(text)
        with pytest.raises(FormatError, match=r"truth\.json.*rochade-ueye"):
            shots(SETS["ueye"], data)


def test_the_real_sets_are_whole_and_far_from_the_border(shared_data):
    for wanted in PHOTOGRAPHS:
        found = shots(wanted, shared_data)
        assert len(found) == wanted.total
        for shot in found:
            assert len(shot.xy) == 54
            assert (shot.xy >= RULE).all()
            assert (shot.xy <= np.array(shot.size) - 1 - RULE).all()
