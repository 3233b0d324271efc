"""Labelled pictures of one's own as training data: where their labels are, what is demanded, what is refused."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import pytest

pytest.importorskip("rcdn.training", exc_type=ImportError, reason="needs rcdn[train]")

import cv2
import numpy as np
from lightning_fabric import Fabric
from typer.testing import CliRunner

from rcdn.cli import app
from rcdn.errors import ConfigError, FormatError, ImageError
from rcdn.io import ImageResult, read_image, write_detections, write_image
from rcdn.synthetic import BoardSpec, Scene, Sensor, crops, random_crop, render, truth
from rcdn.training import labelled, loop, validate
from rcdn.training.config import TrainConfig
from rcdn.training.labelled import crop, fingerprint, labelled_pool, read_labelled, scaled, window
from rcdn.training.samples import PoolConfig, targets
from rcdn.types import Board, Corners, Status

CLEAR = Sensor(blur=0.7, noise=0)


def scene(width=640, height=480, pitch=30.0, cols=9, rows=6, **changes):
    """A flat board of 9×6 corners, `pitch` px apart, turned a little, before a plain background."""
    turn = np.deg2rad(7)
    middle = np.array([(cols - 1) / 2, (rows - 1) / 2])
    rotation = np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
    t = -(rotation @ [*middle, 0]) + [0, 0, 10.0]
    board = BoardSpec(cols, rows, (0.0, 0.0, float(turn)), tuple(t.tolist()))
    centre = ((width - 1) / 2 + 0.3, (height - 1) / 2 - 0.4)
    return dataclasses.replace(Scene(width, height, 10 * pitch, centre, boards=(board,), sensor=CLEAR), **changes)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with three rendered pictures and their truth, as `rcdn render` writes it."""
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(app, ["render", "mine", "--count", "3", "--seed", "7", "--one-camera"])
    assert done.exit_code == 0
    return tmp_path / "mine"


def edited(path, change):
    data = json.loads(path.read_text())
    change(data)
    path.write_text(json.dumps(data))


def record(folder):
    return json.loads((folder / "truth.json").read_text())["mine"]["images"]


def test_the_labels_of_a_truth_are_its_corners(folder):
    for source in (folder, folder / "truth.json"):
        found = read_labelled(source)
        assert [p.path.name for p in found] == list(record(folder))
        for picture, known in zip(found, record(folder).values(), strict=True):
            sure = picture.labels[picture.labels[:, 2] > 0, :2]
            assert np.array_equal(sure, known["xy"])
            assert np.array_equal(picture.image, read_image(picture.path))


CLEAN = dataclasses.replace(
    crops.TRAINING, noise=0, noise_tail_p=0, contrast=(0.5, 0.9), pitch=(14, 40), deltille_p=0, unsure=99
)


def test_a_crop_has_the_target_of_the_renderer(tmp_path, monkeypatch):
    """`random_crop` draws a window of a scene, with labels; the same window of the whole scene's picture, saved with
    the labels that `rcdn render` writes, has the same target: where corners are demanded, open, and forbidden. (Within
    10 px of the border, where no network has an output, the renderer sees too little of a corner to call it
    legible.)"""
    monkeypatch.chdir(tmp_path)
    corners = doubtful = 0
    for seed in range(12):
        whole, (x, y, _, _) = crops.crop_scene(seed, 112, CLEAN, 0)
        write_image("a.png", render(whole, samples=1))
        boards = truth(whole)
        sure, open_ = (
            [xy for b in boards for xy in b.xy[kind(b)].tolist()] for kind in (lambda b: b.visible, lambda b: b.ignore)
        )
        Path("truth.json").write_text(json.dumps({"a": {"images": {"a.png": {"xy": sure, "ignore": open_}}}}))
        _, labels = random_crop(seed, 112, CLEAN)
        if sure:
            (picture,) = read_labelled(".")
            _, mine = window(*scaled(picture, 112)[0], (x, y), 112)
            goals = [
                [map_[0, 10:-10, 10:-10] for map_ in targets([rows], (112, 112), ring=True)] for rows in (mine, labels)
            ]
            assert all(np.array_equal(a, b) for a, b in zip(*goals, strict=True))
        corners, doubtful = corners + int((labels[:, 2] > 0).sum()), doubtful + int((labels[:, 2] == 0).sum())
    assert corners > 100
    assert doubtful > 5


@pytest.mark.parametrize(("pattern", "demanded"), [("checker", True), ("deltille", False)])
def test_corners_as_near_as_rendered_ones_that_are_ignored_are_not_demanded(pattern, demanded):
    """6.5 px apart: enough for four sectors, too little for six."""
    xy = 200 + 6.5 * np.stack(np.meshgrid(np.arange(5.0), np.arange(4.0)), axis=-1).reshape(-1, 2)
    grey = np.zeros((480, 640), np.uint8)
    picture = labelled.LabelledPicture(Path("a.png"), grey, np.column_stack([xy, np.ones(len(xy))]), pattern)
    (at_full_size,) = [labels for image, labels in scaled(picture, 112) if image.shape == grey.shape]
    assert (at_full_size[:, 2] > 0).all() if demanded else not at_full_size[:, 2].any()


@pytest.mark.parametrize(("size", "pitch"), [((640, 480), 30.0), ((2047, 1533), 170.0), ((200, 150), 10.0)])
def test_labels_are_right_at_every_scale(tmp_path, size, pitch):
    """OpenCV finds the corners of each scale at their labels. Pixel (0, 0) begins at −½: of a picture of half the size
    labels that were merely halved would lie ¼ px beside the corners, enlarged ones ½ px."""
    item = scene(*size, pitch)
    (board,) = truth(item)
    picture = labelled.LabelledPicture(tmp_path, render(item), np.column_stack([board.xy, np.ones(len(board.xy))]))
    views = scaled(picture, 112)
    assert views
    for image, labels in views:
        apart = np.linalg.norm(labels[1, :2] - labels[0, :2])
        assert labelled.PITCH[0] <= apart <= labelled.PITCH[1]
        inner = labels[labels[:, 2] > 0, :2]
        assert len(inner) > 40
        mean, largest = beside(image, inner)
        assert mean < 0.03
        assert largest < 0.25


def beside(image, labels):
    """Offset (x, y), px, of the corners in a picture from their labels (N, 2),
    by OpenCV's cornerSubPix: mean, and largest."""
    start = labels.astype(np.float32)[:, None]
    found = cv2.cornerSubPix(image, start.copy(), (3, 3), (-1, -1), (cv2.TERM_CRITERIA_EPS, 0, 1e-4))
    return np.abs((found - start).mean(axis=(0, 1))).max(), np.abs(found - start).max()


def test_crops_carry_their_labels_along(folder):
    pictures = read_labelled(folder)
    pool = labelled_pool(pictures, 30, 112, 1)
    seen = 0
    for k in range(30):
        rows = pool.labels[k][np.isfinite(pool.labels[k][:, 0])]
        inner = rows[(rows[:, 2] > 0) & (rows[:, :2] > 4).all(axis=1) & (rows[:, :2] < 107).all(axis=1), :2]
        if len(inner):
            assert beside(pool.images[k], inner)[1] < 0.25
            seen += 1
    assert seen > 20
    again = labelled_pool(pictures, 30, 112, 1)
    assert np.array_equal(pool.images, again.images)
    assert np.array_equal(pool.labels, again.labels, equal_nan=True)
    assert not np.array_equal(pool.images, labelled_pool(pictures, 30, 112, 2).images)


def test_corners_at_the_frame_or_too_near_are_open():
    labels = np.array(
        [[1.5, 50, 1], [50, 50, 1], [53, 50, 1], [150, 100, 1], [298, 198, 1], [297, 197, 1], [100, 100, 0]]
    )
    found = labelled._at_scale(labels, labelled.View((0, 0, 300, 200)), 4.0)
    assert np.array_equal(found[:, :2], labels[:, :2])
    assert found[:, 2].tolist() == [0, 0, 0, 1, 0, 0, 0]
    assert labelled._at_scale(labels, labelled.View((0, 0, 300, 200), 2.0), 4.0)[:, 2].tolist() == [1, 1, 1, 1, 0, 0, 0]


def detected(path, boards, single=()):
    """A file of detections: `boards` of `path`, and single corners besides."""
    xy = np.concatenate([b.xy for b in boards] + [np.reshape(single, (-1, 2))])
    corners = Corners(xy, np.ones(len(xy)), np.zeros(len(xy)))
    width, height = boards[0].image_size
    write_detections("found.json", [ImageResult(str(path), width, height, corners, tuple(boards))])


def board(xy, **changes):
    n = len(xy)
    parts = {"response": np.ones(n), "status": np.zeros(n), "orientation": "unique"} | changes
    return Board(xy, np.stack([np.arange(n), np.zeros(n)], axis=1), (300, 200), **parts)


def test_of_detections_boards_are_demanded_and_single_corners_open(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_image("a.png", np.zeros((200, 300), np.uint8))
    row = np.array([[20.0, 30], [50, 30], [80.25, 30], [110, 30]])
    status = [Status.REFINED, Status.SEED, Status.COMPLETED, Status.LOW_CONFIDENCE]
    detected("a.png", [board(row, status=status), board(row + np.array([0, 90]), pattern="deltille")], [[200.0, 100]])
    (picture,) = read_labelled("found.json")
    assert picture.labels.tolist() == [[20, 30, 1], [50, 30, 0], [80.25, 30, 1], [110, 30, 1], [200, 100, 0]]
    (other,) = read_labelled("found.json", "deltille")
    assert other.labels[:4].tolist() == [[20, 120, 1], [50, 120, 1], [80.25, 120, 1], [110, 120, 1]]
    Path("elsewhere").mkdir()
    monkeypatch.chdir("elsewhere")  # the picture is beside the file of detections
    assert len(read_labelled("../found.json")) == 1


def test_pictures_without_a_label_are_left_out(folder):
    edited(folder / "truth.json", lambda d: d["mine"]["images"]["scene_000001.png"].update(xy=None))
    edited(folder / "truth.json", lambda d: d["mine"]["images"]["scene_000002.png"].update(xy=[], ignore=[]))
    found = read_labelled(folder)
    assert [p.path.name for p in found] == ["scene_000002.png", "scene_000003.png"]
    assert found[0].labels.shape == (0, 3)  # labelled: no corner in it
    image, labels = crop(found[0].image, found[0].labels, 112, np.random.default_rng(1))
    assert image.shape == (112, 112)
    assert len(labels) == 0


@pytest.mark.parametrize(
    ("change", "error", "words"),
    [
        (lambda d: d["mine"].update(exhaustive=False), FormatError, "corners without a label would be learnt as none"),
        (
            lambda d: d["mine"]["images"]["scene_000001.png"].update(xy=[[1, 2, 3]]),
            FormatError, "'xy' must hold any × 2",
        ),
        (
            lambda d: d["mine"]["images"]["scene_000001.png"]["xy"].append([700, 3]),
            FormatError, "lies outside the picture of 640×480",
        ),
        (lambda d: d["mine"]["images"].update(nowhere={"xy": []}), FormatError, "no picture nowhere, seen from"),
        (
            lambda d: d["mine"]["images"].update({"a.mp4#000012": {"xy": []}}),
            FormatError, "save the frames as pictures",
        ),
        (
            lambda d: [d["mine"]["images"][k].update(xy=[]) for k in d["mine"]["images"]],
            ConfigError, "no corner of a checker board",
        ),
        (lambda d: d.update(other=3), FormatError, "'other' must be an object"),
    ],
)  # fmt: skip
def test_wrong_files(folder, change, error, words):
    edited(folder / "truth.json", change)
    with pytest.raises(error, match=words):
        read_labelled(folder)


def test_wrong_sources(folder, tmp_path):
    with pytest.raises(ConfigError, match=r"no truth\.json in"):
        read_labelled(tmp_path)
    with pytest.raises(FormatError, match="no such file"):
        read_labelled("nothing.json")
    Path("list.json").write_text("[1]")
    with pytest.raises(FormatError, match="neither detections of"):
        read_labelled("list.json")
    (folder / "scene_000002.png").write_bytes(b"\x89PNG\r\n\x1a\n")
    with pytest.raises(ImageError, match=r"scene_000002\.png"):
        read_labelled(folder)


def test_a_picture_of_another_size(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_image("a.png", np.zeros((100, 150), np.uint8))
    detected("a.png", [board(np.array([[20.0, 30], [50, 30], [80, 30]]))])
    with pytest.raises(FormatError, match=r"a\.png has 150×100 px, not 300×200"):
        read_labelled("found.json")
    with pytest.raises(ConfigError, match=r"50×40 px, too few for crops of pool\.size = 112 px"):
        scaled(labelled.LabelledPicture(Path("b.png"), np.zeros((40, 50), np.uint8), np.zeros((0, 3))), 112)


def test_a_training_with_labelled_pictures(folder, monkeypatch):
    """They are a quarter of the crops; the run says which they were, and doesn't go on with others."""
    crops_of = validate.validation_set.__wrapped__(2)
    monkeypatch.setattr(validate, "validation_set", lambda: crops_of)
    pools = []
    original = loop._learn
    monkeypatch.setattr(
        loop, "_learn", lambda config, runs, pool, *rest: pools.append(pool) or original(config, runs, pool, *rest)
    )
    pool = PoolConfig(count=6, size=64, ranges="ordinary", seed=4)
    config = TrainConfig("a", "A", side=54, batch=4, steps=2, validate_every=2, rate=0.02, pool=pool, labelled="mine")
    run = loop.train(config, Path("runs"), workers=0, fabric=Fabric(accelerator="cpu", devices=1))
    assert len(pools[0]) == 8
    facts = json.loads((run / "run.json").read_text())["labelled"]
    assert facts == fingerprint(read_labelled(folder)) == pools[0].labelled
    assert facts["pictures"] == 3
    assert facts["corners"] == sum(len(r["xy"]) for r in record(folder).values())
    from rcdn.training.export import provenance
    from rcdn.training.net import load_run

    net, report = load_run(run)
    assert provenance(report, net, b"")["labelled"] == facts
    edited(folder / "truth.json", lambda d: d["mine"]["images"]["scene_000001.png"]["xy"].pop())
    with pytest.raises(ConfigError, match="other labelled pictures"):
        loop.train(
            dataclasses.replace(config, steps=2), Path("runs"), workers=0, fabric=Fabric(accelerator="cpu", devices=1)
        )
    with pytest.raises(ConfigError, match=r"\(labelled\)"):
        loop.train(
            dataclasses.replace(config, labelled=""),
            Path("runs"),
            workers=0,
            fabric=Fabric(accelerator="cpu", devices=1),
        )


@pytest.mark.parametrize("share", [0, 1, -0.5, float("nan")])
def test_shares(share):
    with pytest.raises(ConfigError, match="labelled_share must be between 0 and 1"):
        TrainConfig("a", labelled_share=share)
