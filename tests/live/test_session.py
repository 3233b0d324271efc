"""A session: frames in, accepted pictures on disk, gone on with after any end."""

from __future__ import annotations

import threading
import time
from dataclasses import replace

import numpy as np
import pytest
from tests.live import stand_in
from tests.live.desk import AnyDesk, close_all

from rcdn.errors import ConfigError, RcdnError
from rcdn.live.folder import Folder, Settings
from rcdn.live.session import Session

GREY = np.random.default_rng(0).integers(0, 256, (480, 640), np.uint8)


class Desk(AnyDesk):
    """A session of one camera."""

    def __init__(self, path, **other):
        super().__init__(path, stand_in.tools(lambda: None if self.at is None else stand_in.board(self.at), **other))

    def look(self, times=1):
        for _ in range(times):
            self.time += 0.05
            seen = self.session.see((GREY,), (self.time,))
        return seen


@pytest.fixture(autouse=True)
def _closed():
    """Sessions end with their test, whatever comes of it."""
    yield
    close_all()


@pytest.fixture
def desk(tmp_path):
    return Desk(tmp_path / "camera")


def test_still_boards_are_taken_and_on_disk_at_once(desk):
    state = desk.take(3)
    assert state["views"] == ["frame-0001.png", "frame-0002.png", "frame-0003.png"]
    assert np.array_equal(desk.folder.grey("frame-0002.png"), GREY)
    assert np.allclose(desk.folder.moment("frame-0002.png")[0].xy, stand_in.board((120.0, 60.0)).xy)
    assert state["history"] == [None, 0.5, pytest.approx(1 / 3)]
    assert state["size"] == (640, 480)


def test_the_camera_is_written_by_itself_once_it_is_enough(desk):
    desk.take(stand_in.ENOUGH)
    state = desk.until(lambda s: s["written"] is not None)
    assert state["written"] == {"level": "good", "lines": ("good: use it",), "files": ["camera.yaml", "report.html"]}
    desk.session.remove("frame-0002.png")
    state = desk.until(lambda s: s["written"] is None and not s["busy"])
    assert len(state["views"]) == stand_in.ENOUGH - 1
    desk.session.write()
    desk.until(lambda s: s["written"] is not None)


def test_removing_a_picture_removes_its_files(desk):
    desk.take(2)
    desk.session.remove("frame-0001.png")
    state = desk.until(lambda s: not s["busy"])
    assert "frame-0001.png" not in state["views"]
    assert desk.folder.names() == [n for n in state["views"]]
    with pytest.raises(RcdnError, match="no such picture"):
        desk.session.remove("frame-0001.png")


def test_the_name_of_a_removed_picture_is_not_used_again(desk):
    """The page keeps small copies by name."""
    desk.take(2)
    desk.session.remove("frame-0002.png")
    desk.until(lambda s: not s["busy"])
    assert desk.take(2)["views"] == ["frame-0001.png", "frame-0003.png"]


def test_the_side_of_a_square_does_not_change_while_a_picture_is_taken(desk):
    desk.take(1)
    desk.session._set_busy("Calculating")
    with pytest.raises(RcdnError, match="a picture is being taken"):
        desk.session.begin(0.031)
    desk.session._set_busy("")
    assert len(desk.take(2)["views"]) == 2


def test_nothing_is_taken_without_a_board(desk):
    desk.at = None
    desk.session.take()
    seen = desk.look(30)
    assert seen["refused"] == "No board is seen."
    assert desk.session.state()["views"] == []


def test_a_picture_by_hand_is_the_next_one_that_is_not_refused(desk):
    desk.take(1)
    desk.until(lambda s: not s["busy"])
    desk.look(20)
    assert len(desk.session.state()["views"]) == 1  # a picture of the same place isn't taken by itself
    desk.session.take()
    desk.until(lambda s: len(s["views"]) == 2)


@pytest.mark.parametrize("other", [None, (300.0, 300.0)])
def test_a_board_that_is_not_found_at_full_size_is_not_taken(tmp_path, other):
    found = [] if other is None else [stand_in.board(other)]
    desk = Desk(tmp_path / "camera", detect=lambda grey: found)
    state = desk.until(lambda s: s["trouble"])
    assert "wasn't sharp enough" in state["trouble"]
    assert state["views"] == desk.folder.names() == []
    desk.session.close()


def test_a_session_goes_on_where_it_ended(tmp_path):
    desk = Desk(tmp_path / "camera")
    views = desk.take(3)["views"]
    desk.session.close()
    again = Desk(tmp_path / "camera")
    state = again.until(lambda s: len(s["history"]) == 3 and not s["busy"])
    assert state["views"] == views
    assert again.take(4)["views"][-1] == "frame-0004.png"
    again.session.close()


def test_half_of_a_picture_does_not_count(desk):
    desk.take(2)
    (desk.folder.path / "detections" / "frame-0001.json").unlink()  # what a kill between the two files leaves
    (desk.folder.path / "pictures" / "frame-0009.png").write_bytes(b"")
    assert desk.folder.names() == ["frame-0002.png"]
    assert desk.folder.add_moment((GREY,), (stand_in.board((0, 0)),)) == "frame-0010.png"


def test_damaged_detections_are_told_and_left_out(tmp_path):
    desk = Desk(tmp_path / "camera")
    desk.take(2)
    desk.session.close()
    (tmp_path / "camera" / "detections" / "frame-0001.json").write_text("{")
    again = Desk(tmp_path / "camera")
    state = again.until(lambda s: not s["busy"] and s["trouble"])
    assert state["views"] == ["frame-0002.png"]
    assert "frame-0001.png" in state["trouble"]
    again.session.close()


def test_pictures_of_another_size_are_not_mixed(desk):
    desk.take(1)
    seen = desk.session.see((np.zeros((720, 1280), np.uint8),), (9.0,))
    assert seen["refused"] == "The camera gives 1280 × 720 px now, the pictures so far have 640 × 480"


def test_the_page_is_asked_for_the_side_of_a_square(tmp_path):
    folder = Folder(tmp_path / "camera")
    session = Session(folder, folder.agree(Settings()), stand_in.tools(lambda: None))
    assert session.see((GREY,), (0.0,))["refused"] == "Say how long the side of a square is"
    for wrong in (0.0, -1.0, 5.0):
        with pytest.raises(RcdnError, match="side of a square must be"):
            session.begin(wrong)
    session.begin(0.025)
    assert session.see((GREY,), (0.1,))["refused"] == "No board is seen."
    session.close()
    assert folder.settings().spacing == 0.025


def test_one_folder_is_for_one_process_and_one_board(tmp_path):
    desk = Desk(tmp_path / "camera")
    with pytest.raises(ConfigError, match="another `rcdn live` uses"):
        Folder(tmp_path / "camera")
    desk.take(1)
    with pytest.raises(ConfigError, match="name another folder"):
        desk.folder.agree(Settings(0.05))
    desk.session.close()
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "photo.png").write_bytes(b"")
    with pytest.raises(ConfigError, match="holds other files"):
        Folder(tmp_path / "mine")


def test_the_secret_of_the_address_is_for_this_user_and_stays(tmp_path):
    folder = Folder(tmp_path / "camera")
    token = folder.token()
    assert len(token) >= 43
    folder.keep_port(8642)
    assert (tmp_path / "camera" / ".address").stat().st_mode & 0o077 == 0
    folder.close()
    again = Folder(tmp_path / "camera")
    assert (again.token(), again.port()) == (token, 8642)
    again.close()


def test_frames_go_on_while_a_calibration_runs(tmp_path):
    free = threading.Event()

    class Slow(stand_in.Guide):
        def add(self, board, name):
            free.wait(10)
            return super().add(board, name)

    desk = Desk(tmp_path / "camera", make_guide=Slow)
    desk.until(lambda s: s["busy"] == "Calculating")
    assert desk.folder.names() == ["frame-0001.png"]  # on disk before it is calculated with
    begin = time.monotonic()
    desk.look(30)
    assert time.monotonic() - begin < 3
    assert desk.session.state()["busy"] == "Calculating"
    free.set()
    desk.until(lambda s: not s["busy"])
    desk.session.close()


def test_a_board_that_can_not_be_added_leaves_nothing(tmp_path):
    class Strict(stand_in.Guide):
        def add(self, board, name):
            raise RcdnError("that board is another one")

    desk = Desk(tmp_path / "camera", make_guide=Strict)
    state = desk.until(lambda s: s["trouble"])
    assert state["trouble"] == "that board is another one"
    assert state["views"] == desk.folder.names() == []
    desk.session.close()


def test_settings_are_what_the_session_is_about(tmp_path):
    folder = Folder(tmp_path / "camera")
    assert folder.agree(Settings(0.03, "brown", (9, 6))) == Settings(0.03, "brown", (9, 6))
    assert folder.settings() == Settings(0.03, "brown", (9, 6))
    assert folder.agree(replace(Settings(), model="brown")) == Settings(0.03, "brown", (9, 6))
    folder.close()
