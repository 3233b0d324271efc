"""`--target`: auto, plain, a target in one word, or its file, on detect, calibrate and pose."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from tests.targets.raster import raster
from typer.testing import CliRunner

from rcdn.batch.no_board import target_hint
from rcdn.cli import app
from rcdn.io import write_camera
from rcdn.targets.drawing import draw
from rcdn.targets.files import write_target
from rcdn.terminal.target import DEFAULT, parse_target
from rcdn.types import AprilGrid, Camera, Charuco, Checkerboard, Deltille, Printed, PuzzleBoard, PuzzlePart

BOARD = Charuco(7, 5, "DICT_4X4_50", 0.75)
FOCAL, SIZE = 700.0, (640, 480)


def flat(printed, scale=60.0):
    """A flat picture of a target, `scale` px a side, on white."""
    drawing = draw(printed)
    many = scale / printed.spacing
    image = raster(drawing.shapes, drawing.width, drawing.height, many)
    return cv2.copyMakeBorder(image, *[40] * 4, cv2.BORDER_CONSTANT, value=255)


def photograph(printed, turn, tilt, distance=0.6, offset=(0.0, 0.0)):
    """The target in space before a pinhole camera of 640 × 480."""
    drawing = draw(printed)
    image = flat(printed)
    many = 60 / printed.spacing
    centre = np.array([drawing.width, drawing.height]) / 2
    rotation = cv2.Rodrigues(np.array([tilt, 0.7 * tilt, 0.0]))[0] @ cv2.Rodrigues(np.array([0, 0, turn]))[0]
    to_board = np.array([[1 / many, 0, -39.5 / many - centre[0]], [0, 1 / many, -39.5 / many - centre[1]], [0, 0, 1]])
    place = np.column_stack([rotation[:, :2], [*offset, distance]])
    K = np.array([[FOCAL, 0, 319.5], [0, FOCAL, 239.5], [0, 0, 1]])
    large = cv2.warpPerspective(
        image,
        np.diag([3, 3, 1.0]) @ [[1, 0, 1 / 3], [0, 1, 1 / 3], [0, 0, 1]] @ K @ place @ to_board,
        (1920, 1440),
        borderValue=150,
    )
    return cv2.GaussianBlur(cv2.resize(large, SIZE, interpolation=cv2.INTER_AREA), (0, 0), 0.6)


@pytest.fixture
def run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return lambda *words: CliRunner().invoke(app, [str(w) for w in words])


def found(path="found.json"):
    return [board for image in json.loads(Path(path).read_text())["images"] for board in image["boards"]]


@pytest.mark.parametrize(
    ("target", "given"),
    [
        (BOARD, "charuco:7x5:DICT_4X4_50:0.75"),
        (AprilGrid(4, 3, "tag36h11", 0.3), "aprilgrid:4x3:tag36h11:0.3"),
        (PuzzlePart(9, 7, 120, 333), "puzzleboard"),
        (PuzzlePart(9, 7, 120, 333), "puzzleboard:9x7:at=120,333"),
    ],
    ids=str,
)
def test_a_told_target_is_read_in_a_word_and_from_its_file(run, target, given):
    printed = Printed(target, 0.03)
    cv2.imwrite("a.png", cv2.GaussianBlur(cv2.rotate(flat(printed), cv2.ROTATE_180), (0, 0), 0.8))
    write_target("board.yaml", printed)
    for which in (["--target", given], ["--target", "board.yaml"], ["--target", "auto"], []):
        done = run("detect", "a.png", *which, "--json", "found.json", "--quiet")
        assert done.exit_code == 0, done.output
        (board,) = found()
        (image,) = json.loads(Path("found.json").read_text())["images"]
        assert len(np.unique(np.round(image["corners"]["xy"], 1), axis=0)) == len(image["corners"]["xy"])  # each once
        assert sorted(board["ids"]) == printed.ids.tolist()
        assert board["target"]["kind"] == target.kind
    assert run("detect", "a.png", "--target", "plain", "--json", "found.json").exit_code == 0
    assert all("target" not in board for board in found())


def test_the_paper_s_preset_reads_codes_only_if_it_is_told_to(run):
    cv2.imwrite("a.png", cv2.GaussianBlur(flat(Printed(BOARD, 0.03)), (0, 0), 0.8))
    assert run("detect", "a.png", "--preset", "paper", "--json", "found.json").exit_code == 0
    (board,) = found()
    assert "target" not in board
    assert run("detect", "a.png", "--preset", "paper", "--target", "auto", "--json", "found.json").exit_code == 0
    assert [board["target"]["dictionary"] for board in found()] == ["DICT_4X4_50"]


@pytest.mark.parametrize("target", [BOARD, AprilGrid(4, 3, "tag36h11", 0.3), PuzzlePart(9, 7, 120, 333)], ids=str)
def test_codes_are_read_without_scipy(target, tmp_path):
    """Its import takes as long as a dozen detections."""
    cv2.imwrite(str(tmp_path / "a.png"), cv2.GaussianBlur(flat(Printed(target, 0.03)), (0, 0), 0.8))
    code = f"""
import sys, rcdn
(board,) = rcdn.Detector().boards({str(tmp_path / "a.png")!r})
print(board.target.kind, sorted(board.ids.tolist()) == {Printed(target, 0.03).ids.tolist()}, 'scipy' in sys.modules)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stdout.split() == [target.kind, "True", "False"], done.stderr


def test_another_target_than_the_told_one_has_no_numbers(run):
    cv2.imwrite("a.png", cv2.GaussianBlur(flat(Printed(BOARD, 0.03)), (0, 0), 0.8))
    for which in ("charuco:7x5:DICT_5X5_50:0.75", "aprilgrid:6x6", "puzzleboard"):
        done = run("detect", "a.png", "--target", which, "--json", "found.json")
        assert done.exit_code == 0, done.output
        assert all("target" not in board for board in found())


def test_a_plain_target_says_the_board_s_size(run):
    cv2.imwrite("a.png", cv2.GaussianBlur(flat(Printed(Checkerboard(7, 4), 0.03), 40), (0, 0), 0.8))
    given = run("detect", "a.png", "--target", "checkerboard:7x4", "--json", "told.json")
    size = run("detect", "a.png", "--board", "7x4", "--json", "size.json")
    assert given.exit_code == size.exit_code == 0
    assert found("told.json") == found("size.json") != []
    assert found("told.json")[0]["complete"]
    done = run("detect", "a.png", "--target", "checkerboard:7x4", "--board", "7x5")
    assert done.exit_code == 2
    done = run("detect", "a.png", "--target", "deltille:7x4", "--json", "told.json")
    assert done.exit_code == 0, done.output
    assert found("told.json") == []


def test_calibrate_and_pose_take_the_spacing_from_the_file(run):
    printed = Printed(BOARD, 0.03)
    write_target("board.yaml", printed)
    for k in range(6):
        angle = 2 * np.pi * k / 6
        picture = photograph(printed, 0.4 * k, 0.35 + 0.03 * k, 0.34, (0.05 * np.cos(angle), 0.04 * np.sin(angle)))
        cv2.imwrite(f"{k}.png", picture)
    done = run(
        "calibrate",
        "0.png",
        *(f"{k}.png" for k in range(1, 6)),
        "--target",
        "board.yaml",
        "--model",
        "pinhole",
        "--flat",
        "--json",
        "c.json",
        "-j",
        "1",
        "--force",
    )
    assert done.exception is None or isinstance(done.exception, SystemExit), done.output
    record = json.loads(Path("c.json").read_text())
    assert record["spacing"] == 0.03
    write_camera(
        "camera.yaml", Camera(np.array([[FOCAL, 0, 319.5], [0, FOCAL, 239.5], [0, 0, 1]]), [], SIZE, "pinhole")
    )
    done = run("pose", "3.png", "--camera", "camera.yaml", "--target", "board.yaml", "--json", "p.json", "-j", "1")
    assert done.exit_code == 0, done.output
    record = json.loads(Path("p.json").read_text())
    assert record["spacing"] == 0.03
    assert record["poses"][0]["T_cam_board"][2][3] == pytest.approx(0.34, abs=0.06)
    done = run("pose", "3.png", "--camera", "camera.yaml", "--target", "board.yaml", "--spacing", "31mm", "-j", "1")
    assert done.exit_code == 0, done.output  # as it was measured
    done = run("pose", "3.png", "--camera", "camera.yaml", "--target", "board.yaml", "--spacing", "25mm", "-j", "1")
    assert done.exit_code == 2


def test_what_was_told():
    assert parse_target("auto").reads == "auto"
    assert parse_target("plain").reads == "plain"
    assert parse_target(DEFAULT).reads == "auto"
    assert parse_target("charuco:7x5:4X4_50:0.75").reads == BOARD
    assert parse_target("puzzleboard:9x7").reads == PuzzleBoard()
    assert parse_target("checkerboard:9x6").size == (9, 6)
    assert parse_target("deltille:9x6").deltille
    assert Deltille(9, 6).kind == "deltille"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--target", "charco:8x8"], "is no target: give a YAML file"),
        (["--target", "charuco:8x8"], "a dictionary is missing"),
        (["--target", "nothing.yaml"], "no such file"),
        (["--target", "aprilgrid:6x6", "--pattern", "deltille"], "contradict each other"),
    ],
)
def test_mistakes_are_wrong_use(run, words, message):
    Path("a.png").write_bytes(b"")
    done = run("detect", "a.png", *words)
    assert done.exit_code == 2
    assert message in " ".join((done.output + str(done.exception)).replace("│", " ").split())


def test_a_spacing_that_nobody_says_is_asked_for(run):
    Path("a.png").write_bytes(b"")
    for words in (["calibrate", "a.png"], ["calibrate", "a.png", "--target", "charuco:7x5:DICT_4X4_50:0.75"]):
        done = run(*words)
        assert done.exit_code == 2
        assert "--spacing is missing" in done.output + str(done.exception)


def test_a_target_that_no_board_is_of_is_told(run):
    """Otherwise the board would be taken for a plain one, numbered from another corner."""
    cv2.imwrite("board.png", photograph(Printed(BOARD, 0.03), 0.3, 0.2))
    told = "hint: of 1 board none carries the codes of ChArUco 7x5 DICT_5X5_100"
    other, camera = "charuco:7x5:DICT_5X5_100:0.75", Camera(np.diag([FOCAL, FOCAL, 1.0]), [], SIZE, "pinhole")
    assert f"{told}; `--target auto` tells" in run("detect", "board.png", "--target", other).output
    assert "hint" not in run("detect", "board.png", "--target", "charuco:7x5:DICT_4X4_50:0.75").output
    assert "hint" not in run("detect", "board.png").output
    write_camera("camera.json", camera)
    pose = run("pose", "board.png", "--camera", "camera.json", "--spacing", "30mm", "--target", other)
    assert told in pose.output
    run("detect", "board.png", "--json", "board.json")
    saved = run("calibrate", "board.json", "--spacing", "30mm", "--target", other)
    assert f"{told}; they are ChArUco 7x5 DICT_4X4_50" in saved.output


@pytest.mark.parametrize(
    ("read", "told"),
    [
        ("ChArUco 7x5 DICT_4X4_50", False),
        ("ChArUco 7x? DICT_4X4_50", False),
        ("ChArUco ?x? DICT_4X4_50 legacy", False),
        ("ChArUco 8x? DICT_4X4_50", True),
        ("ChArUco 7x? DICT_5X5_50", True),
        ("", True),
    ],
)
def test_parts_of_unknown_size_may_be_of_a_target(read, told):
    assert (target_hint(BOARD, [read, ""]) is not None) == told
    assert target_hint("auto", [read]) is None
    assert target_hint(BOARD, []) is None


def test_boards_of_the_other_layout_are_named():
    legacy = Charuco(6, 4, "DICT_4X4_50", 0.75, legacy=True)
    read = str(replace(legacy, legacy=False))
    assert target_hint(legacy, [str(legacy)] * 3) is None
    hint = target_hint(legacy, [str(legacy), read, read])
    assert hint is not None
    assert hint.startswith(f"2 of 3 boards are {read}, not {legacy}: correct the target's legacy")
    assert target_hint(replace(legacy, inverted=True), [str(replace(legacy, legacy=False, inverted=True))]) is not None
