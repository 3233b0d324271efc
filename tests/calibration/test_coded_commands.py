"""`rcdn calibrate` and `rcdn pose` on saved detections of boards with codes."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from coded_views import APRILGRID, CHARUCO, coded_boards
from tests.saved_boards import save

from rcdn.calibration.coded import same_boards
from rcdn.errors import FormatError
from rcdn.io import ImageResult, read_calibration, read_vnl, write_vnl
from rcdn.types import Board, Corners
from rcdn_lab.camera_scenes import CAMERAS, random_boards

CAMERA = CAMERAS["brown"]


@pytest.fixture
def mixed(run):
    one, _ = coded_boards(CAMERA, CHARUCO, 0.03, seed=5, views=7)
    other, _ = coded_boards(CAMERA, APRILGRID, 0.04, seed=6, views=5)
    save("mixed.json", [*one, *other])


def test_two_kinds_are_calibrated_and_everything_names_them(run, mixed):
    done = run("calibrate", "mixed.json", "--spacing", "charuco=30mm,aprilgrid=4cm", "--model", "brown",
               "--json", "camera.json", "--report", "report.html")  # fmt: skip
    assert done.exit_code == 0, done.output
    assert "board 8×6 (ChArUco 9x7 DICT_4X4_50)" in done.output
    back = read_calibration("camera.json")
    assert back.target == CHARUCO
    assert [v.target for v in back.views] == [CHARUCO] * 7 + [APRILGRID] * 5
    assert [v.spacing for v in back.views] == [0.03] * 7 + [0.04] * 5
    assert all((v.target.ids(v.ij) == v.ids).all() for v in back.views)
    assert np.abs(back.camera.parameters[:4] - CAMERA.parameters[:4]).max() < 2
    with open("report.html") as file:
        page = file.read()
    assert "ChArUco 9x7 DICT_4X4_50" in page
    assert "AprilGrid 5x4 tag36h11" in page


def test_poses_are_in_the_targets_coordinates(run, mixed):
    run(
        "calibrate",
        "mixed.json",
        "--spacing",
        "charuco=30mm,aprilgrid=4cm",
        "--model",
        "brown",
        "--json",
        "camera.json",
    )
    done = run(
        "pose",
        "mixed.json",
        "--camera",
        "camera.json",
        "--spacing",
        "charuco=30mm,aprilgrid=4cm",
        "--json",
        "poses.json",
    )
    assert done.exit_code == 0, done.output
    with open("poses.json") as file:
        written = json.load(file)
    assert written["spacing"] == {"charuco": 0.03, "aprilgrid": 0.04}
    assert [p["target"]["kind"] for p in written["poses"]] == ["charuco"] * 7 + ["aprilgrid"] * 5
    for record, line in zip(written["poses"], done.output.splitlines(), strict=True):
        told = re.search(r"x (\S+)  y (\S+)  z (\S+)  \(± \S+ \S+ \S+\)", line).groups()
        assert [float(v) for v in told] == pytest.approx(np.array(record["T_cam_target"])[:3, 3], abs=1e-5)


@pytest.mark.parametrize(
    ("spacing", "words"),
    [
        ("30mm", "2 kinds (charuco, aprilgrid)"),
        ("charuco=30mm,charuco=20mm", "no list of lengths"),
        ("charuco=30mm,", "no list of lengths"),
        ("charuco=30", "did you mean 30mm"),
        ("charucco=30mm", "kinds of boards are"),
        ("puzzleboard=30mm", "must name the kinds of the boards"),
    ],
)
def test_lengths_that_do_not_say_how_large_each_kind_is(run, mixed, spacing, words):
    done = run("calibrate", "mixed.json", "--spacing", spacing)
    assert done.exit_code == 2
    assert words.replace(" ", "") in "".join(c for c in done.output if c not in " \n│")


def test_parts_of_a_charuco_board_stand_at_their_place_in_mrcals_file(tmp_path):
    boards, _ = coded_boards(CAMERA, CHARUCO, 0.03, seed=5, views=3)
    images = [
        ImageResult(f"{k}.png", 640, 480, Corners(b.xy, b.response, b.status), (b,)) for k, b in enumerate(boards)
    ]
    assert write_vnl(tmp_path / "corners.vnl", images) == (8, 6)
    back = read_vnl(tmp_path / "corners.vnl")
    for k, b in enumerate(boards):
        np.testing.assert_allclose(back[f"{k}.png"][b.ids, :2], b.xy, atol=1e-3)
        assert np.isfinite(back[f"{k}.png"][:, 0]).sum() == len(b)
    (tags,), _ = coded_boards(CAMERA, APRILGRID, 0.04, seed=6, views=1, share=1)
    with pytest.raises(FormatError, match="AprilGrid aren't even"):
        write_vnl(tmp_path / "tags.vnl", [replace(images[0], boards=(tags,))], (10, 8))


def test_triangles_are_no_grid_of_mrcals_file(tmp_path):
    ij = np.array([(i, j) for j in range(4) for i in range(5)])
    xy = np.column_stack([ij[:, 0] + ij[:, 1] / 2, ij[:, 1] * np.sqrt(0.75)]) * 40 + 100
    many, status = np.ones(len(ij)), np.zeros(len(ij), np.uint8)
    board = Board(xy, ij, (640, 480), many, status, "ambiguous_120", pattern="deltille")
    write_vnl(tmp_path / "corners.vnl", [ImageResult("a.png", 640, 480, Corners(xy, many, status), (board,))], (5, 4))
    assert not np.isfinite(read_vnl(tmp_path / "corners.vnl")["a.png"]).any()


def test_boards_of_one_target_are_pairs_wherever_they_come_in_the_pictures():
    (a, b), _ = coded_boards(CAMERA, CHARUCO, 0.03, seed=5, views=2)
    (c,), _ = coded_boards(CAMERA, APRILGRID, 0.04, seed=5, views=1)
    (plain, other), _ = random_boards(CAMERA, 0, 2)
    assert same_boards([a, c], [c, b]) == [(0, 1), (1, 0)]
    assert same_boards([a, b], [b]) == []  # two of one kind: nobody knows which
    assert same_boards([plain, a], [other, b]) == [(1, 1), (0, 0)]
    assert same_boards([plain], [a]) == []
    assert same_boards([], [a]) == []
