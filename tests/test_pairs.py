"""Which pictures of two cameras belong together."""

from __future__ import annotations

from types import SimpleNamespace
from unicodedata import normalize

import pytest

from rcdn.batch.calibration_runs import _paired
from rcdn.batch.pair_file import PairFile
from rcdn.batch.pairs import Pairing, pair_names, pairing_hint
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
    assert pair_names(left, right).pairs == same(2)


def test_names_come_before_order():
    assert pair_names(["a/2.png", "a/1.png"], ["b/1.png", "b/2.png"]).pairs == [(0, 1), (1, 0)]
    assert pair_names(["l_1.png", "l_2.png", "l_3.png"], ["r_3.png", "r_1.png", "r_2.png"]).pairs == [
        (0, 1),
        (1, 2),
        (2, 0),
    ]


def test_pictures_without_a_partner_are_passed_over():
    left, right = [f"a/{k}.png" for k in (1, 2, 3, 4, 5)], [f"b/{k}.png" for k in (2, 3, 4, 9)]
    assert pair_names(left, right).pairs == [(1, 0), (2, 1), (3, 2)]


@pytest.mark.parametrize(("one", "two"), [("a/{}.png", "b/{}.png"), ("l_{}.png", "r_{}.png"), ("x{}.png", "y{}.png")])
def test_a_few_pictures_of_both_among_many_of_one_camera(one, two):
    left = [one.format(k) for k in (*range(20), *range(500, 512))]
    right = [two.format(k) for k in (*range(100, 120), *range(500, 512))]
    assert pair_names(left, right).pairs == [(k, k) for k in range(20, 32)]
    assert "12 pairs" in pairing_hint(left, right, pair_names(left, right))
    assert pair_names(left[:22], right[:22]).way == "order"  # two names in common are chance


@pytest.mark.parametrize(("one", "two"), [("l/DSC_{:04d}", "r/DSC_{:04d}"), ("a_{:04d}", "b_{:04d}"), ("l_{}", "r_{}")])
def test_a_few_equal_numbers_of_counters_without_a_gap_are_chance(one, two):
    left, right = [one.format(k) for k in range(1, 21)], [two.format(k) for k in range(18, 38)]
    assert pair_names(left, right) == Pairing(same(20), "order")
    with pytest.raises(ConfigError, match="20 pictures of the left camera and 19 of the right one don't pair by name"):
        pair_names(left, right[:-1])
    without_one = [left[0], *left[2:]], [*right[:-2], right[-1]]
    assert len(pair_names(left, without_one[1]).pairs) == 3  # pictures were chosen, so that numbers are of both
    assert len(pair_names(*without_one).pairs) == 3
    frames = [[f"v.avi#{k:06d}" for k in each] for each in (range(1, 21), range(18, 38))]
    assert pair_names(*frames).pairs == [(17, 0), (18, 1), (19, 2)]


def test_numbers_that_count_nothing_do_not_pair_a_few():
    left = ["dawn_7", "noon_8", "dusk_9", *(f"a_{k}" for k in range(10, 20))]
    right = ["red_7", "blue_8", "green_9", *(f"b_{k}" for k in range(20, 30))]
    assert pair_names(left, right).way == "order"


def test_accents_that_are_spelled_in_two_ways_are_the_same():
    left = [f"l/café {letter}.png" for letter in "abc"]
    right = [normalize("NFD", f"r/café {letter}.png") for letter in "ca"]
    assert pair_names(left, right) == Pairing([(0, 1), (2, 0)], "name")


def test_numbers_with_other_zeros():
    assert pair_names(["p01.png", "p02.png", "p10.png"], ["q1.png", "q2.png", "q10.png"]).pairs == same(3)


def test_frames_of_videos_by_their_numbers():
    left, right = ["a.avi#000001", "a.avi#000005", "a.avi#000007"], ["b.avi#000005", "b.avi#000007"]
    assert pair_names(left, right).pairs == [(1, 0), (2, 1)]


def test_no_way_to_pair():
    with pytest.raises(ConfigError, match="2 pictures of the left camera and 1 of the right") as error:
        pair_names(["a/dawn.png", "a/noon.png"], ["b/blue sky.png"])
    assert '--pairs pairs.txt, a file with a line for each, such as `dawn.png "blue sky.png"`' in str(error.value)


def hint(left, right):
    return pairing_hint(left, right, pair_names(left, right))


def test_names_that_leave_no_doubt_need_no_hint():
    assert hint(["a/1.png", "a/2.png"], ["b/1.png", "b/2.png"]) == ""
    assert hint(["a/1.png", "a/2.png", "a/3.png"], ["b/1.png", "b/2.png"]) == ""  # more pictures of one camera


def test_the_hint_says_how_pictures_were_paired_and_the_way_out():
    text = hint(["x/dawn.png", "x/noon.png"], ["y/red.png", "y/blue.png"])
    assert text.startswith("paired by order, 2 pairs: dawn.png with red.png, and so on. If that is wrong")
    assert text.endswith("--pairs pairs.txt, a file with a line for each, such as `dawn.png red.png`")
    assert hint(["p01.png", "p02.png"], ["q1.png", "q2.png"]).startswith(
        "paired by number, 2 pairs: p01.png with q1.png"
    )
    text = hint([f"a/{k}.png" for k in (1, 2, 3, 4, 5, 6)], [f"b/{k}.png" for k in (2, 3, 4, 9)])
    assert text.startswith("paired by name, 3 pairs: 2.png with 2.png")
    assert "without a partner on the left: 1.png, 5.png, 6.png; without a partner on the right: 9.png." in text


# ---- a file of pairs

LEFT, RIGHT = (
    ["/data/l/dawn.png", "/data/l/noon time.png", "/data/l/v.avi#000003"],
    ["r/red.png", "r/blue.png", "r/s/red.jpg"],
)


def match(tmp_path, text, left=LEFT, right=RIGHT, unread=((), ())):
    file = tmp_path / "pairs.txt"
    file.write_text(text)
    return PairFile.read(file).match(left, right, unread)


@pytest.mark.parametrize(
    "text",
    [
        'dawn blue\n"noon time" s/red',
        "# of Monday\n\ndawn.png\tblue.png  # the first\nnoon time.png\tred.jpg\n",
        "left,right\r\nl/dawn.png, r/blue.png\r\nnoon time, s/red.jpg\r\n",
        "noon time.png;r/s/red.jpg\n/data/l/dawn.png;./r/blue.png",
        "\ufeffLeft_Name,Right_Name\ndawn,blue\nnoon time,s/red",
    ],
)
def test_a_file_of_pairs(tmp_path, text):
    assert match(tmp_path, text) == [(0, 1), (1, 2)]


def test_a_file_of_pairs_may_spell_accents_in_another_way(tmp_path):
    left, right = ["/data/été.png", "/data/hiver.png"], [normalize("NFD", "r/août.png"), "r/mai.png"]
    assert match(tmp_path, normalize("NFD", "été août"), left, right) == [(0, 0)]
    assert match(tmp_path, "/data/hiver mai\nété.png r/août.png", left, right) == [(0, 0), (1, 1)]
    both = ["/data/é.png", normalize("NFD", "/data/é.png")]
    assert match(tmp_path, normalize("NFD", "/data/é.png mai"), both, right) == [(1, 1)]  # as it is spelled there


def test_frames_and_names_beside_the_file(tmp_path):
    left = [str(tmp_path / "l" / "1.png"), "v.avi#000003"]
    assert match(tmp_path, "./l/1.png red.png\nv.avi#000003 blue", left) == [(0, 0), (1, 1)]


def test_every_bad_line_is_named(tmp_path):
    text = "dawn blue\ndusk blue\n'noon' green\nred.jpg dawn\nv.avi#000003 r/red\nl/dawn s/red\n"
    with pytest.raises(ConfigError) as error:
        match(tmp_path, text, right=[*RIGHT, "other/r/red.bmp"])
    message = str(error.value)
    assert (
        "line 2: no picture of the left camera is called dusk (it has 3, such as /data/l/dawn.png) "
        "and blue is in line 1, too" in message
    )
    assert "line 3: no picture of the left camera is called 'noon'" in message
    assert "line 4: red.jpg is a picture of the right camera: the left one comes first" in message
    assert "line 5: r/red may be r/red.png and other/r/red.bmp: write more of the folder" in message
    assert "line 6: l/dawn is in line 1, too" in message
    assert "line 1:" not in message


def test_lines_without_two_names(tmp_path):
    with pytest.raises(ConfigError, match="line 2: must hold two names, left and right, not 'noon'; line 4: must hold"):
        match(tmp_path, "dawn blue\nnoon\n\na b c\n")
    with pytest.raises(ConfigError, match="line 1: must hold two names"):
        match(tmp_path, "dawn,\n")
    many = "\n".join(f"x{k}" for k in range(14))
    with pytest.raises(ConfigError, match="in lines 11, 12, 13, 14"):
        match(tmp_path, many)
    with pytest.raises(ConfigError, match="holds no pairs"):
        match(tmp_path, "# nothing\n")
    with pytest.raises(ConfigError, match="can't be read"):
        PairFile.read(tmp_path)


def test_pictures_that_could_not_be_read_are_passed_over(tmp_path):
    assert match(tmp_path, "dawn blue\nbroken.png red.png", unread=(["/data/l/broken.png"], [])) == [(0, 1)]


def test_a_picture_that_could_not_be_read_is_of_its_own_camera(tmp_path):
    left, right = ["a/07.png", "a/09.png"], ["b/08.png", "b/09.png"]
    assert match(tmp_path, "07 08\n09 09\n", left, right, unread=([], ["b/07.png"])) == [(0, 0), (1, 1)]
    with pytest.raises(ConfigError, match="line 1: no picture of the left camera is called 05"):
        match(tmp_path, "05 08\n", left, right, unread=([], ["b/05.png"]))


def test_a_line_of_pairs_that_is_too_long(tmp_path):
    file = tmp_path / "long.txt"
    file.write_text(f"dawn 1\n{'x' * 200_000} 2\n# {'x' * 90_000}\n{'y ' * 60_000}\n")
    with pytest.raises(ConfigError) as error:
        PairFile.read(file)
    message = str(error.value)
    assert "line 2: has more than 100000 characters; write one line for each pair or moment; line 4: has" in message
    assert len(message) < 1000


def test_pairs_of_a_run_know_of_which_camera_a_picture_was_not_read(tmp_path):
    (tmp_path / "pairs.txt").write_text("07 08\n08 09\n")
    left, right = (
        SimpleNamespace(
            images=[SimpleNamespace(path=p) for p in paths], failures=[SimpleNamespace(name=n) for n in lost]
        )
        for paths, lost in ((["a/07.png", "a/08.png"], []), (["b/08.png", "b/09.png"], ["b/07.png"]))
    )
    assert _paired(left, right, PairFile.read(tmp_path / "pairs.txt")) == [(0, 0), (1, 1)]
