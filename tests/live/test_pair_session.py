"""A session of two cameras: pairs on disk at once, gone on with after any end, frames of one moment only."""

from __future__ import annotations

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.live import stand_in, stand_in_pair
from tests.live.desk import AnyDesk, close_all
from tests.live.moving_board import SIZE, SPACING, Renderer, pose
from tests.live.stand_in_pair import GREYS
from tests.live.two_cameras import RIGHT, T_RIGHT_LEFT, Hands

from rcdn import Detector, DetectorConfig
from rcdn.batch.live_files import write_pair_files
from rcdn.errors import ConfigError, RcdnError
from rcdn.io import read_stereo, read_stereo_calibration
from rcdn.live.folder import Folder, Settings
from rcdn.live.sources import APART, Halves, TwoCameras, TwoFiles, open_pair


class Desk(AnyDesk):
    """A session of two cameras; the right one sees the board 10 px farther left."""

    patience = 30

    def __init__(self, path):
        super().__init__(path, stand_in_pair.tools(self.found), 2)

    def found(self, width):
        """Both have the same small picture: the board of the right one is at 1.25 times the place at full size."""
        if width == 640:
            return stand_in.board(self.at)
        small = stand_in.board(self.at)
        return replace(small, xy=(small.xy + 0.5) * 1.25 - 0.5, image_size=(800, 600))

    def look(self, apart=0.0):
        self.time += 0.05
        return self.session.see(GREYS, (self.time, self.time + apart))


@pytest.fixture(autouse=True)
def _closed():
    """Sessions end with their test, whatever comes of it."""
    yield
    close_all()


@pytest.fixture
def desk(tmp_path):
    return Desk(tmp_path / "rig")


def test_pairs_are_on_disk_at_once_in_a_folder_a_camera(desk):
    state = desk.take(2)
    assert state["views"] == ["frame-0001.png", "frame-0002.png"]
    assert state["size"] == ((640, 480), (800, 600))
    for camera, (side, grey) in enumerate(zip(("left", "right"), GREYS, strict=True)):
        assert np.array_equal(cv2.imread(str(desk.folder.path / side / "frame-0002.png"), 0), grey)
        assert np.array_equal(desk.folder.grey("frame-0002.png", camera), grey)
    left, right = desk.folder.moment("frame-0002.png")
    assert np.allclose(left.xy, stand_in.board((120.0, 60.0)).xy)
    assert right.image_size == (800, 600)
    assert desk.folder.sizes("frame-0002.png") == ((640, 480), (800, 600))


def test_what_the_page_is_told_is_json(desk):
    desk.take(2)
    state = json.loads(json.dumps(desk.session.state(), allow_nan=False))
    assert state["cameras"] == 2
    assert len(state["maps"]) == len(state["parts"]) == 3
    assert state["wanted"][0] is not None
    assert state["wanted"][1] is None
    look = json.loads(json.dumps(desk.look(), allow_nan=False))
    assert [bool(side["board"]) for side in look["sides"]] == [True, True]


def test_the_cameras_are_written_once_it_is_enough(desk):
    desk.take(stand_in.ENOUGH)
    state = desk.until(lambda s: s["written"] is not None)
    assert state["written"]["files"] == ["cameras.yaml", "report.html"]


def test_a_session_goes_on_where_it_ended(tmp_path):
    desk = Desk(tmp_path / "rig")
    views = desk.take(2)["views"]
    desk.session.close()
    again = Desk(tmp_path / "rig")
    state = again.until(lambda s: len(s["history"]) == 2 and not s["busy"])
    assert state["views"] == views
    assert again.take(3)["views"][-1] == "frame-0003.png"


@pytest.mark.parametrize(
    "lost",
    [
        "left/frame-0001.png",
        "right/frame-0001.png",
        "detections/left/frame-0001.json",
        "detections/right/frame-0001.json",
    ],
)
def test_half_of_a_pair_does_not_count(desk, lost):
    """What a kill in the middle of writing leaves."""
    desk.take(2)
    (desk.folder.path / lost).unlink()
    assert desk.folder.names() == ["frame-0002.png"]
    assert desk.folder.add_moment(GREYS, (stand_in.board((0, 0)), None)) == "frame-0003.png"
    assert desk.folder.moment("frame-0003.png")[1] is None


def test_removing_a_pair_removes_the_files_of_both(desk):
    desk.take(2)
    desk.session.remove("frame-0001.png")
    desk.until(lambda s: not s["busy"])
    left = [
        p
        for side in ("left", "right", "detections/left", "detections/right")
        for p in (desk.folder.path / side).glob("frame-0001*")
    ]
    assert left == []


def test_frames_that_are_too_far_apart_are_refused(desk):
    assert desk.look(APART)["refused"] != ""  # at first no board is followed
    for sign in (1, -1):
        late = desk.look(sign * (APART + 0.01))
        assert late["refused"] == "The cameras' pictures are 50 ms apart; at most 40 ms are allowed"
        assert [side["board"] for side in late["sides"]] == [None, None]
    desk.at = (200.0, 200.0)
    for _ in range(60):
        desk.look(0.2)
    assert desk.session.state()["views"] == []


def test_a_folder_is_for_one_camera_or_for_two(tmp_path):
    Folder(tmp_path / "one").close()
    Folder(tmp_path / "two", 2).close()
    with pytest.raises(ConfigError, match="one camera; leave --stereo out"):
        Folder(tmp_path / "one", 2)
    with pytest.raises(ConfigError, match="two cameras; give --stereo"):
        Folder(tmp_path / "two")
    Folder(tmp_path / "two", 2).close()


def test_a_moment_needs_a_board(tmp_path):
    folder = Folder(tmp_path / "rig", 2)
    name = folder.add_moment(GREYS, (None, None))
    with pytest.raises(RcdnError, match="holds no board"):
        folder.moment(name)
    folder.close()


POSES = [
    pose(0.03, 0, 0.42), pose(0.0, 0.02, 0.34, 25, -20), pose(0.06, 0.02, 0.36, -28, -18),
    pose(0.02, -0.03, 0.33, -20, 25), pose(0.05, 0.0, 0.3, 4, -35), pose(0.03, -0.01, 0.32, 35, 5, 10),
    pose(-0.02, -0.02, 0.45, 25, 25), pose(0.1, 0.04, 0.45, -30, 10),
]  # fmt: skip
"""T_left_board; all are whole in both pictures"""


def test_a_known_rig_comes_back_from_rendered_pairs(tmp_path):
    """From pictures to the files that are written at the end, of a session that was ended and gone on with."""
    hands, detector = Hands(noise=2), Detector(DetectorConfig(threads=1))
    folder = Folder(tmp_path / "rig", 2)
    for T in POSES:
        greys = hands.frames(T)
        boards = [max(detector.boards(g), key=len) for g in greys]
        assert [len(b) for b in boards] == [SIZE[0] * SIZE[1]] * 2
        folder.add_moment(greys, boards)
    names = folder.names()
    folder.close()
    again = Folder(tmp_path / "rig", 2)
    written = write_pair_files(again.path, names, [again.moment(n) for n in names], Settings(SPACING, "brown", SIZE))
    again.close()
    assert {f.name for f in written.files} >= {"cameras.yaml", "cameras.json", "calibration.json", "report.html"}
    found = read_stereo(again.path / "cameras.yaml")
    turn = Rotation.from_matrix(found.T_right_left[:3, :3] @ T_RIGHT_LEFT[:3, :3].T).magnitude()
    assert np.degrees(turn) < 0.1
    assert np.linalg.norm(found.T_right_left[:3, 3]) == pytest.approx(np.linalg.norm(T_RIGHT_LEFT[:3, 3]), rel=0.004)
    assert found.right.K[0, 0] == pytest.approx(RIGHT.K[0, 0], rel=0.005)
    done = read_stereo_calibration(again.path / "calibration.json")
    assert done.epipolar < 0.15
    assert {v.name.split("/")[-2] for v in done.right.views} == {"right"}


# ---- sources


def video(path, numbers):
    """A video whose frame k is of the brightness numbers[k]."""
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 200, (160, 128))
    for n in numbers:
        writer.write(np.full((128, 160, 3), n, np.uint8))
    writer.release()
    return str(path)


def test_two_files_are_read_by_the_number_of_the_frame(tmp_path):
    left, right = range(10, 200, 20), range(20, 180, 20)
    source = open_pair([video(tmp_path / "l.avi", left), video(tmp_path / "r.avi", right)])
    assert isinstance(source, TwoFiles)
    for a, b in zip(left, right, strict=False):
        (one, other), _ = source.read()
        assert (one.mean(), other.mean()) == (pytest.approx(a, abs=3), pytest.approx(b, abs=3))
    assert source.read() is None
    assert source.trouble == "Right camera: The video has ended"
    source.close()


class Stamped:
    """A source of frames at given times, s."""

    trouble = ""

    def __init__(self, *times):
        self.times = list(times)

    def read(self):
        return ((np.zeros((4, 4), np.uint8),), self.times.pop(0)) if self.times else None

    def close(self):
        pass


def test_two_cameras_frames_are_of_one_moment():
    """A frame that the other camera has none for is left out."""
    source, got = TwoCameras(Stamped(0.0, 0.1, 0.2, 0.3), Stamped(0.02, 0.19, 0.5)), []
    for _ in range(12):
        if (pair := source.read()) is not None:
            got.append(pair[1])
    assert got == [0.0, 0.2]


def test_halves_of_one_picture():
    picture = np.hstack([np.zeros((6, 5), np.uint8), np.ones((6, 5), np.uint8)])

    class One(Stamped):
        def read(self):
            return (picture,), 1.5

    (left, right), at = Halves(One()).read()
    assert (left.max(), right.min(), at) == (0, 1, 1.5)
    assert left.shape == right.shape == (6, 5)


@pytest.mark.parametrize(
    ("cameras", "message"),
    [
        (["browser", "0"], "two cameras of one kind"),
        (["0", "1", "2"], "two cameras of one kind"),
        (["0", "0"], "is given twice"),
    ],
)
def test_cameras_that_can_not_be_a_pair(cameras, message):
    with pytest.raises(ConfigError, match=message):
        open_pair(cameras)
    assert open_pair(["browser"]) is None


def test_the_rendered_rig_is_what_it_says():
    """A point of the board is where the right camera's pose says, to a tenth of a pixel of the detector."""
    hands, detector = Hands(noise=1), Detector(DetectorConfig(threads=1))
    from rcdn.geometry import project

    left, right = (max(detector.boards(g), key=len) for g in hands.frames(POSES[0]))
    T = T_RIGHT_LEFT @ POSES[0]
    for board, camera, at in ((left, Renderer().camera, POSES[0]), (right, RIGHT, T)):
        ij = np.stack(np.meshgrid(np.arange(9), np.arange(6)), axis=-1).reshape(-1, 2) * SPACING
        xy = project(camera, np.column_stack([ij, 0 * ij[:, 0]]) @ at[:3, :3].T + at[:3, 3])
        off = np.linalg.norm(board.xy[:, None] - xy[None], axis=2).min(axis=1)
        assert off.max() < 0.2
