"""Photographs of saved detections that were moved: they are found in the places that the user names, or told."""

from functools import partial
from pathlib import Path

import numpy as np
import pytest

from rcdn.batch.moved_pictures import found_in
from rcdn.batch.pictures import Pictures
from rcdn.io import write_image
from rcdn_lab.camera_scenes import CAMERAS, SPACING, random_boards
from saved_boards import save

FAST = ("--model", "pinhole", "--spacing", SPACING)


def shown(page):
    return Path(page).read_text().count("data:image/jpeg")


@pytest.fixture
def moved(run, tmp_path):
    """A calibration whose six pictures, `day/cam/0.png`, …, lie in `archive/cam` and `archive/other` now."""
    width, height = CAMERAS["pinhole"].image_size
    for k, folder in enumerate(("archive/cam", "archive/other")):
        (tmp_path / folder).mkdir(parents=True)
        for n in range(6):
            write_image(tmp_path / folder / f"{n}.png", np.full((height, width), 60 * k + 10 * n, np.uint8))
    file = save("found.json", random_boards(CAMERAS["pinhole"], 3, 6)[0], "day/cam/{}.png")
    result = run(
        "calibrate", file, *FAST, "--json", "camera.json", "--report", "page.html", "--pictures", "archive/cam"
    )
    assert "photographs" not in result.stderr
    return file


def test_pictures_that_were_moved_are_found_in_the_places_that_the_user_names(run, tmp_path, moved):
    assert shown("page.html") == 6
    for places in (["archive/cam"], ["."], [str(tmp_path / "archive")], ["archive/other/5.png", "archive/cam"]):
        result = run("report", "camera.json", "-o", "again.html", *(w for p in places for w in ("--pictures", p)))
        assert result.stderr == "written: again.html\n"
        assert shown("again.html") == 6


def test_pictures_that_are_not_found_are_told_and_where_they_were_looked_for(run, tmp_path, moved):
    (tmp_path / "archive/cam/0.png").unlink()
    (tmp_path / "archive/cam/1.png").rename(tmp_path / "archive/1.png")
    (tmp_path / "archive/more").mkdir()
    (tmp_path / "archive/more/2.png").symlink_to("../../elsewhere.png")
    why = "photographs are left out: neither by path nor by name are they in"
    result = run("report", "camera.json", "-o", "again.html", "--pictures", "archive/cam")
    assert f"note: 2 of 6 {why} archive/cam." in result.stderr
    assert shown("again.html") == 4
    result = run("report", "camera.json", "-o", "again.html", "--pictures", "archive")
    assert f"1 of 6 {why} archive, or there more than once (1): name the folder" in result.stderr
    assert "nothere" in run("report", "camera.json", "-o", "again.html", "--pictures", "nothere").stderr
    assert shown("again.html") == 0


def test_of_moved_pictures_links_out_of_the_place_are_not_followed(run, tmp_path, moved):
    (tmp_path / "links").mkdir()
    for n in range(6):
        (tmp_path / f"links/{n}.png").symlink_to(f"../archive/cam/{n}.png")
    result = run("report", "camera.json", "-o", "again.html", "--pictures", "links")
    assert "6 of 6 photographs are left out" in result.stderr
    assert shown("again.html") == 0


def test_a_moved_picture_belongs_to_the_name_that_it_is_nearest_to(tmp_path):
    for name in ("new/left/7.png", "new/right/7.png", "new/left/8.png", "new/9.png"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    new = tmp_path / "new"
    found = partial(found_in, [new])
    left, right = "C:\\pictures\\left\\7.png", "old/right/7.png"
    assert found([left, right]) == ({left: str(new / "left/7.png"), right: str(new / "right/7.png")}, set())
    assert found(["7.png"]) == ({}, {"7.png"})
    assert found(["old/right/8.png"]) == ({"old/right/8.png": str(new / "left/8.png")}, set())
    assert found(["old/right/8.png"], ["old/left/8.png"]) == ({}, set())
    assert found(["a/9.png", "b/9.png"]) == ({}, set())
    (new / "e\u0301te\u0301.png").touch()  # as some systems spell it
    assert found(["old/\xe9t\xe9.png"]) == ({"old/\xe9t\xe9.png": str(new / "e\u0301te\u0301.png")}, set())


def test_frames_of_a_moved_video_are_shown(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("new").mkdir()
    Path("new/walk.mp4").touch()
    grey = np.full((4, 6), 7, np.uint8)
    monkeypatch.setattr(
        "rcdn.io.frames", lambda path: ((f"{path}#{n}", grey + n) for n in range(5 * Path(path).exists()))
    )
    names = ["old/walk.mp4#1", "old/walk.mp4#3"]
    pictures = Pictures(names, dict.fromkeys(names, Path("old")), [Path("new")])
    assert [pictures(name).max() for name in names] == [8, 10]
    assert pictures.left_out == ""
