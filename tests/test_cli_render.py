"""`rcdn render`: what is written, that it can be rendered again, and truth that fits the pictures."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from rcdn.cli import app
from rcdn.synthetic import render, scene_from_json, truth


def run(*arguments):
    return CliRunner().invoke(app, ["render", *map(str, arguments)], catch_exceptions=False)


def bytes_of(folder):
    return {p.name: p.read_bytes() for p in folder.iterdir()}


@pytest.fixture(scope="module")
def easy(tmp_path_factory):
    folder = tmp_path_factory.mktemp("render") / "easy"
    result = run(folder, "--count", 3, "--size", "320x240")
    assert result.exit_code == 0
    assert result.stderr == ""  # no progress bar in a pipe
    return folder, result.stdout


def test_what_is_written(easy):
    folder, stdout = easy
    stems = [f"scene_{k:06d}" for k in (1, 2, 3)]
    assert sorted(bytes_of(folder)) == sorted([f"{s}{e}" for s in stems for e in (".png", ".json")] + ["truth.json"])
    for stem in stems:
        image = cv2.imread(str(folder / f"{stem}.png"), cv2.IMREAD_UNCHANGED)
        assert image.shape == (240, 320)
        values = json.loads((folder / f"{stem}.json").read_text())
        scene = scene_from_json(json.dumps(values["scene"]))
        assert np.array_equal(render(scene), image)
        for board, expected in zip(values["boards"], truth(scene), strict=True):
            assert np.array_equal(board["xy"], expected.xy)
            assert np.array_equal(board["ij"], expected.ij)
            assert np.array_equal(board["visible"], expected.visible)
            assert np.array_equal(board["ignore"], expected.ignore)
    corners = sum(len(v["xy"]) for v in json.loads((folder / "truth.json").read_text())["easy"]["images"].values())
    assert stdout == f"wrote 3 pictures with {corners} corners to {folder}, and truth.json\n"
    assert corners > 30


def test_the_same_seed_gives_the_same_bytes_however_many(easy, tmp_path):
    folder, _ = easy
    run(tmp_path / "a", "--count", 2, "--size", "320x240")
    run(tmp_path / "b", "--count", 1, "--size", "320x240", "--seed", 2)
    one, two = bytes_of(folder), bytes_of(tmp_path / "a")
    assert all(two[name] == one[name] for name in two if name != "truth.json")
    assert bytes_of(tmp_path / "b")["scene_000001.png"] != one["scene_000001.png"]


def test_a_scene_can_be_rendered_again(easy, tmp_path):
    folder, _ = easy
    assert run(tmp_path / "again", "--scene", folder / "scene_000002.json", "--count", 5).exit_code == 0
    one, two = bytes_of(folder), bytes_of(tmp_path / "again")
    assert len(two) == 3
    assert two["scene_000001.png"] == one["scene_000002.png"]
    assert two["scene_000001.json"] == one["scene_000002.json"]
    bare = tmp_path / "bare.json"  # what Scene.to_json writes
    bare.write_text(json.dumps(json.loads(one["scene_000002.json"])["scene"]))
    run(tmp_path / "bare", "--scene", bare)
    assert bytes_of(tmp_path / "bare")["scene_000001.png"] == one["scene_000002.png"]


def test_truth_of_a_set(easy, tmp_path):
    folder, _ = easy
    (name, values), *rest = json.loads((folder / "truth.json").read_text()).items()
    assert (name, rest, values["exhaustive"]) == ("easy", [], True)
    scenes = {f"scene_{k:06d}.png": json.loads((folder / f"scene_{k:06d}.json").read_text()) for k in (1, 2, 3)}
    sizes = {(b["cols"], b["rows"]) for s in scenes.values() for b in s["scene"]["boards"]}
    assert len(sizes) > 1
    assert values["board"] is None  # boards of several sizes: labels can't be judged
    assert values["images"].keys() == scenes.keys()
    for file, image in values["images"].items():
        board = scenes[file]["boards"][0]
        assert image["xy"] == [xy for xy, seen in zip(board["xy"], board["visible"], strict=True) if seen]
        assert image["ordered"] is False
    run(tmp_path / "one", "--scene", folder / "scene_000001.json")
    alone = json.loads((tmp_path / "one" / "truth.json").read_text())["one"]
    spec = scenes["scene_000001.png"]["scene"]["boards"][0]
    assert alone["board"] == [spec["cols"], spec["rows"]]
    assert alone["images"]["scene_000001.png"]["ordered"] is True  # all corners, row by row


def test_hard_scenes(tmp_path):
    """Parts of boards, none, or several; spots that are neither demanded nor forbidden."""
    run(tmp_path, "--count", 12, "--ranges", "hard", "--size", "320x240", "--seed", 3)
    (values,) = json.loads((tmp_path / "truth.json").read_text()).values()
    images = list(values["images"].values())
    assert any(image["ignore"] for image in images)
    assert any(image["xy"] == [] and not image["ignore"] for image in images)
    assert all(image["xy"] is not None or image["ignore"] for image in images)
    assert not any(image["ordered"] for image in images)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--size", "640"], "width x height in pixels"),
        (["--size", "20x480"], "between 64 and 10000"),
        (["--size", "64x1000"], "take a larger"),
        (["--ranges", "soft"], "ordinary"),
        (["--count", "0"], "--count"),
        (["--scene", "none.json"], "--scene none.json: no such file"),
        (["--scene", "list.json"], "--scene list.json: scene must be an object"),
        (["--scene", "other.json"], "--scene other.json: scene: a Scene has no 'images'"),
    ],
)
def test_wrong_use(tmp_path, monkeypatch, arguments, message):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "list.json").write_text("[1]")
    (tmp_path / "other.json").write_text('{"version": 1, "images": []}')
    result = run("out", *arguments)
    assert result.exit_code == 2
    assert message in result.stderr
    assert not (tmp_path / "out").exists()


def test_a_folder_that_cannot_be_made(tmp_path):
    (tmp_path / "file").write_text("")
    result = run(tmp_path / "file", "--count", 1, "--size", "320x240")
    assert result.exit_code == 1
    assert "can't be written" in result.stderr


def test_one_camera_sees_one_whole_board_in_every_picture(tmp_path):
    assert run(tmp_path / "a", "--one-camera", "--count", 4, "--size", "320x240").exit_code == 0
    assert run(tmp_path / "b", "--one-camera", "--count", 1, "--size", "320x240", "--seed", 2).exit_code == 0
    scenes = [
        scene_from_json(json.dumps(json.loads(path.read_text())["scene"]))
        for path in sorted(tmp_path.glob("*/scene_*.json"))
    ]
    cameras = [(*s.camera.parameters, s.camera.model, *s.camera.image_size) for s in scenes]
    assert len(set(cameras[:4])) == 1
    assert cameras[4] != cameras[0]
    assert all(truth(scene)[0].visible.all() and len(scene.boards) == 1 for scene in scenes)
    assert len({scene.boards[0].tvec for scene in scenes}) == 5
