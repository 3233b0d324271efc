"""`rcdn pose --rig`: saved detections of each camera, a rig's file, a line for each moment."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from unicodedata import normalize

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from rcdn.batch.saved_cameras import saved_in_folder
from rcdn.cli import app
from rcdn.io import read_rig, write_rig
from rcdn.types import Pose, Rig
from rcdn_lab.camera_scenes import SIZE, SPACING, board, random_pose, see
from rcdn_lab.rig_scenes import row
from saved_boards import save

SCENE = row([0.2], ("brown",))


@pytest.fixture
def made(tmp_path, monkeypatch):
    """A rig's file, the detections of its two cameras at four moments, and where the board then was."""
    monkeypatch.chdir(tmp_path)
    rng, names = np.random.default_rng(0), tuple(SCENE.places)
    first = np.linalg.inv(SCENE.places[names[0]])
    rig = Rig(names, tuple(SCENE.cameras.values()), tuple(Pose(T @ first) for T in SCENE.places.values()))
    write_rig("rig.json", rig)
    seen, truth = {n: [] for n in names}, []
    while len(truth) < 4:
        T = random_pose(rng, 0.1, 0.5, (0.6, 0.9))
        views = {n: see(c, p.T_cam_board @ T) for n, c, p in zip(names, rig.cameras, rig.poses, strict=True)}
        if all(len(ij) == SIZE[0] * SIZE[1] for ij, _ in views.values()):
            truth.append(T)
            for n, (ij, xy) in views.items():
                seen[n].append(board(ij, xy + rng.normal(0, 0.05, xy.shape), (640, 480), np.full(len(xy), 0.05)))
    for n, boards in seen.items():
        save(f"{n}.json", boards)
    return truth


def run(*words):
    return CliRunner().invoke(app, ["pose", *map(str, words), "--spacing", str(SPACING), "--no-cache"])


def test_a_line_for_each_moment_and_all_in_the_json(made):
    result = run("c0.json", "c1.json", "--rig", "rig.json", "--json", "poses.json")
    assert result.exit_code == 0, result.output
    assert result.stdout.count("by c0, c1") == 4
    written = json.loads(Path("poses.json").read_text())
    assert written["spacing"] == SPACING
    for record, T in zip(written["rig_poses"], made, strict=True):
        assert record["cameras"] == ["c0", "c1"]
        assert np.array(record["T_rig_board"])[:3, 3] == pytest.approx(T[:3, 3], abs=0.002)
        assert np.array(record["cov"]).shape == (6, 6)


def test_a_folder_with_saved_detections_of_each_camera_is_a_rigs_input(made):
    expected = run("c0.json", "c1.json", "--rig", "rig.json").stdout
    Path("saved").mkdir()
    for name in ("c0", "c1"):
        Path(f"{name}.json").rename(f"saved/{name}.json")
    Path("saved/rig.json").write_bytes(Path("rig.json").read_bytes())  # not detections
    result = run("saved", "--rig", "rig.json")
    assert result.exit_code == 0, result.output
    assert result.stdout == expected
    result = CliRunner().invoke(
        app, ["calibrate", "--rig", "saved", "--spacing", str(SPACING), "--json", "saved/c1.json", "--no-cache"]
    )
    assert (result.exit_code, "would overwrite an input" in result.stderr) == (2, True)


def test_only_files_of_detections_in_a_folder_without_folders_are_cameras(made):
    Path("saved").mkdir()
    for name in ("c10", "c2"):
        Path(f"saved/{name}.json").write_bytes(Path("c0.json").read_bytes())
    Path("saved/notes.json").write_text("{}")
    assert saved_in_folder(["saved"]) == ["saved/c2.json", "saved/c10.json"]
    assert saved_in_folder(["saved", "rig.json"]) == ["saved", "rig.json"]
    Path("saved/walk.mp4").touch()
    assert saved_in_folder(["saved"]) == ["saved"]
    Path("saved/walk.mp4").unlink()
    Path("saved/left").mkdir()
    assert saved_in_folder(["saved"]) == ["saved"]


def test_moments_are_in_the_order_that_people_count(made):
    for name in ("c0", "c1"):
        boards = json.loads(Path(f"{name}.json").read_text())
        for image, number in zip(boards["images"], (10, 9, 2, 1), strict=True):
            image["path"] = f"{name}/{number}.png"
        Path(f"{name}.json").write_text(json.dumps(boards))
    assert run("c0.json", "c1.json", "--rig", "rig.json", "--json", "poses.json").exit_code == 0
    assert [r["moment"] for r in json.loads(Path("poses.json").read_text())["rig_poses"]] == ["1", "2", "9", "10"]


def test_inputs_of_other_names_count_in_the_rigs_order(made):
    Path("c0.json").rename("left.json")
    Path("c1.json").rename("right.json")
    result = run("left.json", "right.json", "--rig", "rig.json")
    assert result.exit_code == 0, result.output
    assert "taken for c0, c1, in this order" in result.stderr


def test_a_rigs_name_may_spell_accents_in_another_way(made):
    write_rig("rig.json", replace(read_rig("rig.json"), names=("première", "c1")))
    Path("c0.json").rename(normalize("NFD", "première.json"))
    result = run("c1.json", normalize("NFD", "première.json"), "--rig", "rig.json")
    assert result.exit_code == 0, result.output
    assert result.stdout.count("by c1, première") + result.stdout.count("by première, c1") == 4
    assert "in this order" not in result.stderr


def test_wrong_use_is_said(made):
    save("other.json", [])
    cases = {
        ("c0.json", "c1.json", "--rig", "rig.json", "--camera", "rig.json"): "one of them",
        ("c0.json", "c1.json", "--rig", "rig.json", "--camera-name", "c0"): "--camera-name",
        ("c0.json", "c1.json", "other.json", "--rig", "rig.json"): "has cameras c0, c1",
        ("c0.json", "--rig", "rig.json"): "two inputs",
    }
    for words, text in cases.items():
        result = run(*words)
        assert result.exit_code == 2, (words, result.output)
        assert text in result.stderr, (words, result.stderr)


def film(path, camera, poses, blurred, size=(9, 6), side=40):
    """A video of a board in these poses through a pinhole, some of its frames blurred."""
    squares = np.kron(np.indices((size[1] + 1, size[0] + 1)).sum(0) % 2, np.ones((side, side)))
    sheet = np.float32(np.pad(40 + 170 * squares, side, constant_values=210))
    scale = SPACING / side
    to_board = np.array([[scale, 0, -2 * SPACING + scale / 2], [0, scale, -2 * SPACING + scale / 2], [0, 0, 1]])
    video = cv2.VideoWriter(path, cv2.VideoWriter_fourcc(*"MJPG"), 10, camera.image_size)
    for k, T in enumerate(poses):
        H = camera.K @ T[:3, [0, 1, 3]] @ to_board
        image = cv2.warpPerspective(sheet, H, camera.image_size, flags=cv2.INTER_LINEAR, borderValue=120)
        image = cv2.GaussianBlur(image, (0, 0), 2.5 if k in blurred else 0.7)
        video.write(cv2.cvtColor(np.uint8(np.clip(image, 0, 255)), cv2.COLOR_GRAY2BGR))
    video.release()


def test_of_videos_all_cameras_are_asked_at_each_moment(tmp_path, monkeypatch):
    """Each video's own sharp frames are others."""
    monkeypatch.chdir(tmp_path)
    scene, rng = row([0.2], ("pinhole",)), np.random.default_rng(3)
    names, first = tuple(scene.places), np.linalg.inv(scene.places["c0"])
    rig = Rig(names, tuple(scene.cameras.values()), tuple(Pose(T @ first) for T in scene.places.values()))
    write_rig("rig.json", rig)
    poses = []
    while len(poses) < 9:
        T = random_pose(rng, 0.1, 0.4, (0.6, 0.8))
        if all(len(see(c, M @ T)[0]) == 54 for c, M in zip(rig.cameras, rig.T_cam_rig, strict=True)):
            poses.append(T)
    for name, camera, M, blurred in zip(names, rig.cameras, rig.T_cam_rig, ((1, 4, 7), (2, 5, 8)), strict=True):
        film(f"{name}.avi", camera, [M @ T for T in poses], blurred)
    result = run("c0.avi", "c1.avi", "--rig", "rig.json", "--json", "poses.json")
    assert result.exit_code == 0, result.output
    lines = [line for line in result.stdout.splitlines() if line.startswith("#")]
    assert len(lines) >= 6
    assert all(line.endswith("by c0, c1") for line in lines), lines
    for record in json.loads(Path("poses.json").read_text())["rig_poses"]:
        T = poses[int(record["moment"].lstrip("#"))]
        assert np.array(record["T_rig_board"])[:3, 3] == pytest.approx(T[:3, 3], abs=0.004)


def test_a_moment_that_shows_a_part_says_so(made):
    for name in ("c0", "c1"):
        record = json.loads(Path(f"{name}.json").read_text())
        (found,) = record["images"][0]["boards"]
        kept = [k for k, (i, j) in enumerate(found["ij"]) if i < 6 or (i == 6 and j < 4)]
        for key in ("ij", "xy", "response", "status", "sigma"):
            found[key] = [found[key][k] for k in kept]
        found.update(size=[7, 6], complete=False)
        Path(f"{name}.json").write_text(json.dumps(record))
    result = run("c0.json", "c1.json", "--rig", "rig.json", "--json", "poses.json")
    assert result.exit_code == 0, result.output
    ends = [line.partition("by c0, c1")[2].strip() for line in result.stdout.splitlines()]
    assert ends == ["part of a board, 7×6 (40 of 54 corners)", "", "", ""]
    complete = [record["complete"] for record in json.loads(Path("poses.json").read_text())["rig_poses"]]
    assert complete == [False, True, True, True]
    result = run("c0.json", "c1.json", "--rig", "rig.json", "--target", "aprilgrid:6x6")
    assert (result.exit_code, result.stdout) == (1, "")
    assert "no pose: none of 8 boards" in result.stderr
