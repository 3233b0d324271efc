"""`rcdn pose`: boards seen in part, boards of other targets than the told one, and several boards in a picture."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rcdn.io import ImageResult, write_camera, write_detections
from rcdn.types import Charuco, Corners
from rcdn_lab.camera_scenes import CAMERAS, SPACING, board, detected, labels, random_boards, see

PINHOLE = CAMERAS["pinhole"]
SEEN = "part of a board"
CHARUCO = Charuco(10, 7, "DICT_4X4_100", 0.75)
TARGET = "charuco:10x7:DICT_4X4_100:0.75"


def save(path, *pictures):
    """A file of detections of `pictures`, each a list of boards."""
    images = [
        ImageResult(f"{k}.png", *boards[0].image_size, Corners(*(np.zeros((0, 2)), np.zeros(0), np.zeros(0))), boards)
        for k, boards in enumerate(map(tuple, pictures))
    ]
    write_detections(path, images, ())
    return path


def coded(found, target):
    """The board as one of a `target` whose codes were read."""
    return replace(found, target=target, ids=target.ids(found.ij))


def poses(path="poses.json"):
    return json.loads(Path(path).read_text())["poses"]


@pytest.fixture
def scene(run):
    """Three whole boards and where they are; `run` without the words that all share."""
    write_camera("camera.yaml", PINHOLE)

    def pose(*words, spacing=SPACING):
        return run("pose", *words, "--camera", "camera.yaml", "--spacing", spacing, "--json", "poses.json")

    return *random_boards(PINHOLE, 5, 3, noise=0.02, whole=True), pose


def part_of(T, some):
    """The board at T as it is detected if only the corners that are `some` of its labels are seen."""
    ij, xy = see(PINHOLE, T)
    there = some(ij)
    return detected(ij[there], xy[there], (640, 480))


def ragged(ij):
    """All but three columns, and the half of a fourth."""
    return (ij[:, 0] > 3) | ((ij[:, 0] == 3) & (ij[:, 1] > 2))


# ---- parts


def test_a_part_is_said_to_be_one_and_its_pose_is_that_of_its_own_corner(scene):
    _, (T, *_), pose = scene
    part = part_of(T, ragged)
    result = pose(save("found.json", [part]))
    assert result.exit_code == 0, result.output
    (line,) = result.stdout.splitlines()
    assert line.endswith("px  part of a board, 6×6 (33 of 36 corners)")
    assert "hint: 1 of 1 board is seen in part" in result.stderr
    assert "--board COLSxROWS" in result.stderr
    (record,) = poses()
    assert (record["size"], record["complete"]) == ([6, 6], False)
    corners = np.column_stack([labels() * SPACING, np.zeros(54)]) @ T[:3, :3].T + T[:3, 3]
    off = np.linalg.norm(corners - np.array(record["T_cam_board"])[:3, 3], axis=1)
    assert off.min() < 0.001
    assert off[0] > 0.02  # it is another corner than the board's


def test_a_whole_board_is_no_part_whatever_its_size(scene):
    boards, (T, *_), pose = scene
    for found in (boards[0], part_of(T, lambda ij: ij[:, 0] > 0)):
        result = pose(save("found.json", [found]))
        assert result.exit_code == 0, result.output
        assert SEEN not in result.stdout
        assert "hint" not in result.stderr
        assert [record["complete"] for record in poses()] == [True]


def test_of_several_pictures_smaller_boards_than_most_are_parts(scene):
    boards, (T, *_), pose = scene
    smaller, part = part_of(T, lambda ij: ij[:, 0] > 0), part_of(T, ragged)
    hole = part_of(T, lambda ij: (ij != (4, 2)).any(axis=1))
    found = save("found.json", *([b] for b in (*boards, boards[0], smaller, part, hole)))
    result = pose(found)
    assert result.exit_code == 0, result.output
    ends = [line.partition(" px")[2].strip() for line in result.stdout.splitlines()]
    assert ends[:4] == [""] * 4
    assert ends[4] == "part of a board, 8×6 (48 of 54 corners)"
    assert ends[5] == "part of a board, 6×6 (33 of 54 corners)"
    assert ends[6] == ""  # a corner is missing, but its place on the board is known
    assert [record["complete"] for record in poses()] == [True] * 4 + [False] * 3
    assert "hint: 2 of 7 boards are seen in part" in result.stderr
    assert "--board 9x6 leaves such boards out" in result.stderr


def test_of_boards_of_two_sizes_the_smaller_are_no_parts(scene):
    boards, (T, *_), pose = scene
    smaller = part_of(T, lambda ij: ij[:, 0] > 0)
    result = pose(save("found.json", [boards[0]], [smaller], [boards[1]], [smaller]))
    assert SEEN not in result.output
    assert [record["complete"] for record in poses()] == [True] * 4


def test_parts_are_left_out_where_whole_boards_of_a_size_are_asked_for(scene):
    boards, (T, *_), pose = scene
    part = part_of(T, ragged)
    result = pose(save("found.json", [boards[0]], [part]), "--board", "9x6")
    assert result.exit_code == 0, result.output
    assert [record["path"] for record in poses()] == ["0.png"]
    assert "left out: 1.png: not a whole 9×6 board" in result.stderr
    result = pose(save("found.json", [part]), "--board", "9x6")
    assert result.exit_code == 1
    assert result.stdout == ""
    assert "no pose: no whole 9×6 board was found: 6×6 partial (33 of 54) in 0.png; " in result.stderr
    assert "no board was found" not in result.stderr


def test_codes_say_where_a_part_is(scene):
    _, (T, *_), pose = scene
    ij, xy = see(PINHOLE, T)
    there = ragged(ij)
    result = pose(save("found.json", [coded(board(ij[there], xy[there], (640, 480)), CHARUCO)]))
    assert result.exit_code == 0, result.output
    assert SEEN not in result.output
    (record,) = poses()
    assert np.array(record["T_cam_board"])[:3, 3] == pytest.approx(T[:3, 3], abs=0.001)


# ---- a told target


def test_boards_of_other_targets_than_the_told_one_have_no_pose(scene):
    boards, _, pose = scene
    other = coded(boards[2], replace(CHARUCO, dictionary="DICT_5X5_100"))
    result = pose(save("found.json", [coded(boards[0], CHARUCO)], [boards[1]], [other]), "--target", TARGET)
    assert result.exit_code == 0, result.output
    assert [record["path"] for record in poses()] == ["0.png"]
    assert f"left out: 1.png: its codes were not read, or it has none; {CHARUCO} was asked for" in result.stderr
    assert "left out: 2.png: it shows another target: ChArUco 10x7 DICT_5X5_100" in result.stderr
    result = pose(save("found.json", [boards[1]], [boards[2]]), "--target", TARGET)
    assert (result.exit_code, result.stdout, poses()) == (1, "", [])
    assert f"no pose: none of 2 boards in the pictures is known to be of the target {CHARUCO}" in result.stderr
    result = pose(save("found.json", [boards[1]]), "--target", "plain")
    assert (result.exit_code, len(poses())) == (0, 1)


@pytest.mark.parametrize("change", [{"first_id": 40}, {"inverted": True}], ids=str)
def test_boards_that_begin_elsewhere_or_are_inverted_are_of_another_target(scene, change):
    boards, _, pose = scene
    other = coded(boards[1], replace(CHARUCO, **change))
    result = pose(save("found.json", [coded(boards[0], CHARUCO)], [other]), "--target", TARGET)
    assert [record["path"] for record in poses()] == ["0.png"]
    assert f"left out: 1.png: it shows another target: {other.target}" in result.stderr


def test_a_length_for_the_told_kind_alone_places_no_other_boards(scene):
    boards, _, pose = scene
    found = save("found.json", [coded(boards[0], CHARUCO)], [boards[1]])
    result = pose(found, "--target", TARGET, spacing=f"charuco={SPACING}")
    assert result.exit_code == 0, result.output
    assert [record["path"] for record in poses()] == ["0.png"]
    assert "left out: 1.png: its codes were not read" in result.stderr


def test_what_holds_no_picture_or_boards_of_other_sizes_is_told(scene):
    boards, _, pose = scene
    write_detections("none.json", (), ())
    result = pose("none.json")
    assert result.exit_code == 1
    assert "no pose: there are no pictures in what was given" in result.stderr
    result = pose(save("found.json", [boards[0]]), "--board", "5x5")
    assert "5×5" in result.stderr
    assert "partial" not in result.stderr


def test_a_board_whose_own_length_is_named_has_a_pose_beside_a_told_target(scene):
    boards, truth, pose = scene
    found = save("found.json", [coded(boards[0], CHARUCO)], [boards[1]])
    result = pose(found, "--target", TARGET, spacing="charuco=30mm,checker=60mm")
    assert result.exit_code == 0, result.output
    for record, T, times in zip(poses(), truth, (1, 2), strict=False):
        assert np.array(record["T_cam_board"])[:3, 3] == pytest.approx(times * T[:3, 3], abs=0.002)


# ---- several boards


def test_of_several_boards_in_a_picture_each_line_says_which_it_is(scene):
    boards, (T, *_), pose = scene
    result = pose(save("found.json", [coded(boards[0], CHARUCO), boards[1], part_of(T, ragged)], [boards[2]]))
    assert result.exit_code == 0, result.output
    ends = [line.partition(" px")[2].strip() for line in result.stdout.splitlines()]
    assert ends[0] == "ChArUco 10x7 DICT_4X4_100 (54 corners)"
    assert ends[1] == "9×6"
    assert ends[2].startswith(SEEN)
    assert ends[3] == ""
