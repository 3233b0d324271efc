"""The file that says which pictures of a rig's cameras are of one moment."""

from __future__ import annotations

import os
from pathlib import Path
from types import SimpleNamespace
from unicodedata import normalize

import pytest
from typer.testing import CliRunner

from rcdn.batch.moment_file import MomentFile
from rcdn.batch.pair_file import PairFile
from rcdn.batch.rig_runs import _moments
from rcdn.cli import app
from rcdn.errors import ConfigError

CAMERAS = {
    "a": ["/data/a/dawn.png", "/data/a/noon time.png", "/data/a/été.png"],
    "b": ["b/1.png", "b/2.png"],
    "c": ["c/x.png", "c/y.png", "c/s/x.jpg"],
}


def match(tmp_path, text, cameras=CAMERAS, unread=None):
    file = tmp_path / "moments.txt"
    file.write_text(text)
    return MomentFile.read(file).match(cameras, unread)


@pytest.mark.parametrize(
    "text",
    [
        'dawn 1 -\n"noon time" - y\n- 2 s/x\n',
        "# of Monday\ndawn.png,b/1.png,\nnoon time.png,,y.png  # by hand\n-;2.png;c/s/x.jpg\n",
        'b c a\n1 - dawn\n- y "noon time"\n2 s/x -\n',
    ],
)
def test_a_line_for_each_moment(tmp_path, text):
    a, b, c = match(tmp_path, text)
    assert a[0] == b[0]
    assert a[1] == c[1]
    assert b[1] == c[2]
    assert len({*a, *b, *c}) == 5  # two pictures are named by no line
    assert all(m.isdecimal() for m in (*a, *b, *c))


def test_moments_are_counted_by_lines(tmp_path):
    assert match(tmp_path, "\ndawn 1 x.png\n# none\n- 2 y\n") == [["2", "5", "6"], ["2", "4"], ["2", "4", "7"]]


def test_accents_and_pictures_that_were_not_read(tmp_path):
    got = match(tmp_path, normalize("NFD", "été 1 broken.png"), unread={"c": ["/data/c/broken.png"]})
    assert got[0][2] == got[1][0] == "1"


def test_a_picture_of_one_camera_that_was_not_read_leaves_the_others_in_their_moment(tmp_path):
    cameras = {"a": ["a/06.png"], "b": ["b/06.png", "b/07.png"], "c": ["c/06.png", "c/07.png"]}
    got = match(tmp_path, "06 06 06\n07 07 07\n", cameras, {"a": ["a/07.png"]})
    assert got == [["1"], ["1", "2"], ["1", "2"]]
    with pytest.raises(ConfigError, match="line 2: no picture of b is called 08"):
        match(tmp_path, "06 06 06\n08 08 07\n", cameras, {"a": ["a/08.png"]})


def test_pictures_of_a_moment_belong_together_where_one_is_not_read(tmp_path, monkeypatch):
    """The run of a rig says of which camera each failure is."""
    monkeypatch.chdir(tmp_path)
    Path("moments.txt").write_text("07 07\n08 08\n")
    picture, lost = SimpleNamespace, SimpleNamespace(name="a/07.png")
    found = {
        "a": SimpleNamespace(images=[picture(path="a/08.png")], failures=[lost]),
        "b": SimpleNamespace(images=[picture(path="b/07.png"), picture(path="b/08.png")], failures=[]),
    }
    assert _moments(found, MomentFile.read(Path("moments.txt"))) == [["2"], ["1", "2"]]


def test_every_bad_line_of_moments_is_named(tmp_path):
    with pytest.raises(ConfigError) as error:
        match(tmp_path, "dawn 1 y\ndusk 2 x\ndawn -  -\nnoon 2\n- 1 y\n- z -")
    message = str(error.value)
    assert "line 1:" not in message
    assert (
        "line 2: no picture of a is called dusk (it has 3, such as /data/a/dawn.png) and x may be c/x.png and "
        "c/s/x.jpg: write more of the folder" in message
    )
    assert "line 3: dawn is in line 1, too" in message
    assert "line 4: must hold 3 names, one for each camera, or -, not 2" in message
    assert "line 5: 1 is in line 1, too and y is in line 1, too" in message
    assert "line 6: no picture of b is called z" in message


def test_files_without_a_moment(tmp_path):
    for text in ("# none\n", "a b c\n"):
        with pytest.raises(ConfigError, match="holds no moments"):
            match(tmp_path, text)
    with pytest.raises(ConfigError, match=r"--moments .* can't be read"):
        MomentFile.read(tmp_path / "none.txt")


def calibrate(*words):
    return CliRunner().invoke(app, ["calibrate", *map(str, words), "--spacing", "30mm", "--no-cache"])


def test_moments_are_for_pictures_of_a_rig(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("m.txt").write_text("1 1\n")
    for folder in ("a", "b"):
        Path(folder).mkdir()
    result = calibrate("a", "b", "--stereo", "--moments", "m.txt")
    assert result.exit_code == 2
    assert "give it with --rig" in result.stderr
    result = calibrate("a.mp4", "b.mp4", "--rig", "--moments", "m.txt")
    assert result.exit_code == 2
    assert "frames of videos belong together by number" in result.stderr
    result = calibrate("a", "b", "--rig", "--moments", "m.txt", "--json", "m.txt")
    assert result.exit_code == 2
    assert "would overwrite an input" in result.stderr


def test_a_line_of_moments_that_is_too_long(tmp_path):
    file = tmp_path / "long.txt"
    file.write_text(f"dawn 1\n{'x' * 200_000} 2\n# {'x' * 90_000}\n{'y ' * 60_000}\n")
    with pytest.raises(ConfigError) as error:
        MomentFile.read(file)
    message = str(error.value)
    assert "line 2: has more than 100000 characters; write one line for each pair or moment; line 4: has" in message
    assert len(message) < 1000


def test_paths_are_taken_apart_once_a_camera(tmp_path, monkeypatch):
    """The work grows with the pictures and lines, not with their product."""
    calls = []
    monkeypatch.setattr("os.path.abspath", lambda path, plain=os.path.abspath: calls.append(path) or plain(path))
    cameras = {c: [f"{c}/{k:04d}.png" for k in range(500)] for c in "abcd"}
    got = match(tmp_path, "".join(f"{k:04d} " * 4 + "\n" for k in range(100)), cameras, {"a": ["a/bad.png"]})
    assert got[0][:100] == got[3][:100] == [str(k + 1) for k in range(100)]
    assert len(calls) < 10 * (4 * 500 + 4 * 100)


def test_pairs_take_paths_apart_once_a_camera(tmp_path, monkeypatch):
    calls = []
    monkeypatch.setattr("os.path.abspath", lambda path, plain=os.path.abspath: calls.append(path) or plain(path))
    one, two = ([f"{c}/{k:04d}.png" for k in range(500)] for c in "ab")
    (tmp_path / "pairs.txt").write_text("".join(f"{k:04d} {k:04d}\n" for k in range(100)))
    assert PairFile.read(tmp_path / "pairs.txt").match(one, two) == [(k, k) for k in range(100)]
    assert len(calls) < 10 * (2 * 500 + 2 * 100)
