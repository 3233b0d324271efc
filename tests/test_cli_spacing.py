"""`--spacing` with units, `--board` in squares, and cameras that the pictures don't settle."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import typer
from tests.saved_boards import save

from rcdn.calibration.calibrate import FIXABLE, check_fix
from rcdn.errors import ConfigError
from rcdn.geometry import rotation
from rcdn.io import read_camera, write_camera
from rcdn.terminal.spacing import check_length, check_spacing, parse_length, sizes_of
from rcdn.types import AprilGrid
from rcdn_lab.camera_scenes import CAMERAS, SIZE, board, random_boards, see

PINHOLE = CAMERAS["pinhole"]


@pytest.fixture
def found(run):
    return save("found.json", random_boards(PINHOLE, 3, 6, whole=True)[0])


@pytest.fixture
def frontal(run):
    """Boards that nearly face the camera."""
    rng, out = np.random.default_rng(6), []
    while len(out) < 10:
        T, z = np.eye(4), rng.uniform(0.4, 0.7)
        T[:3, :3] = rotation(np.append(rng.normal(0, 0.04, 2), 0))
        T[:3, 3] = [*rng.uniform(-0.3, 0.2, 2) * z, z]
        ij, xy = see(PINHOLE, T, SIZE)
        if len(ij) == 54:
            out.append(board(ij, xy + rng.normal(0, 0.3, xy.shape), (640, 480), np.full(54, 0.3)))
    return save("frontal.json", out)


# ---- lengths


@pytest.mark.parametrize(
    ("text", "metres"),
    [
        ("25mm", 0.025),
        ("2.5cm", 0.025),
        ("0.025", 0.025),
        ("0.025m", 0.025),
        (" 1 in ", 0.0254),
        ('1"', 0.0254),
        ("25e-3", 0.025),
    ],
)
def test_lengths_with_units(text, metres):
    assert parse_length(text) == pytest.approx(metres, rel=1e-15)
    check_length(parse_length(text), (9, 6))


@pytest.mark.parametrize("text", ["", "mm", "25 furlongs", "1,5cm", "nan", "1 2mm"])
def test_no_lengths(text):
    with pytest.raises(typer.BadParameter, match="25mm"):
        parse_length(text)


@pytest.mark.parametrize(("text", "question"), [("25", "25mm"), ("2.5", "2.5cm"), ("1", "1cm")])
def test_a_board_of_metres_is_asked_back(text, question):
    for size in (None, (9, 6)):
        with pytest.raises(ConfigError, match=f"did you mean {question}"):
            check_length(parse_length(text), size)
    check_length(parse_length(f"{text}m"), (9, 6))


def test_the_size_of_the_board_decides():
    check_length(parse_length("0.3"), None)
    check_length(parse_length("0.3"), (4, 4))
    with pytest.raises(ConfigError, match="9×6 board 3 m across"):
        check_length(parse_length("0.3"), (9, 6))


def test_every_verb_takes_units(run, found):
    values = []
    for text in ("30mm", "0.03"):
        result = run(
            "calibrate", found, "--model", "pinhole", "--spacing", text, "--json", "all.json", "-o", "camera.yaml"
        )
        assert result.exit_code == 0, result.output
        values.append(json.loads(Path("all.json").read_text())["spacing"])
        result = run("pose", found, "--camera", "camera.yaml", "--spacing", text, "--json", "poses.json")
        assert result.exit_code == 0, result.output
        values.append(json.loads(Path("poses.json").read_text())["spacing"])
    assert values == [0.03] * 4
    assert "25 mm squares" in run("board", "--size", "9x6", "--spacing", "25mm", "-o", "board.svg").output
    for arguments in (
        ("calibrate", found, "--spacing", "0.3"),
        ("pose", found, "--camera", "camera.yaml", "--spacing", "0.3"),
        ("board", "--size", "9x6", "--spacing", "25", "-o", "large.svg"),
    ):
        result = run(*arguments)
        assert result.exit_code == 2
        assert "did you mean" in result.stderr
    assert run("calibrate", found, "--model", "pinhole", "--spacing", "0.3m").exit_code == 0


# ---- the board's size in squares


def test_squares_instead_of_corners_are_noticed(run, found):
    result = run("calibrate", found, "--spacing", "30mm", "--board", "10x7")
    assert result.exit_code == 2
    assert (
        "found 9×6 in 6 of 6 pictures: 10x7 squares have 9×6 inner corners; did you mean --board 9x6?" in result.stderr
    )
    result = run("calibrate", found, "--spacing", "30mm", "--board", "7x10")
    assert "did you mean --board 6x9?" in result.stderr
    result = run("calibrate", found, "--spacing", "30mm", "--board", "13x9", "--model", "pinhole")
    assert result.exit_code == 0
    assert "hint: found 9×6" in result.stderr


# ---- what the pictures don't settle


def test_an_unsettled_camera_is_said_first_and_written_only_by_force(run, frontal):
    arguments = (
        "calibrate",
        frontal,
        "--spacing",
        "30mm",
        "--model",
        "pinhole",
        "-o",
        "camera.yaml",
        "--json",
        "all.json",
    )
    result = run(*arguments)
    assert result.exit_code == 1
    assert result.stdout.startswith(
        "Bad: don't use this camera. The focal length can't be known from these pictures (±"
    )
    assert "not written: camera.yaml" in result.stderr
    assert "written: all.json" in result.stderr
    assert not Path("camera.yaml").exists()
    assert Path("all.json").exists()
    result = run(*arguments, "--force")
    assert result.exit_code == 0
    assert result.stdout.startswith("Bad: don't use this camera. The focal length can't be known")
    assert read_camera("camera.yaml").image_size == (640, 480)
    assert run(*arguments[:6]).exit_code == 0  # nothing was to be written


# ---- what is held fixed


def test_what_can_be_held_fixed(run, found):
    assert check_fix(["aspect"]) == check_fix("aspect") == {"aspect"}
    assert check_fix(FIXABLE) == {"aspect", "principal_point"}
    assert check_fix(()) == frozenset()
    with pytest.raises(ConfigError, match="aspect and principal_point, not 'focal'"):
        check_fix(["focal", "aspect"])
    result = run("calibrate", found, found, "--spacing", "30mm", "--stereo", "--fix-aspect")
    assert result.exit_code == 2
    assert "for one camera" in result.stderr


# ---- lengths of a target's file

KALIBR = "target_type: 'checkerboard'\ntargetCols: 9\ntargetRows: 6\nrowSpacingMeters: {0}\ncolSpacingMeters: {0}\n"
TAGS = "target_type: 'aprilgrid'\ntagCols: 6\ntagRows: 6\ntagSize: {0}\ntagSpacing: 0.3\n"
OURS = "kind: checkerboard\ncolumns: 9\nrows: 6\nspacing: {0}\n"


@pytest.mark.parametrize(
    ("text", "field"),
    [(KALIBR, "rowSpacingMeters"), (TAGS, "tagSize"), (OURS, "spacing")],
    ids=["plain", "tags", "ours"],
)
def test_a_file_that_makes_a_board_of_metres_is_asked_back(run, found, text, field):
    write_camera("camera.yaml", PINHOLE)
    Path("t.yaml").write_text(text.format(25))
    for words in (
        ("calibrate", found),
        ("pose", found, "--camera", "camera.yaml"),
        ("live", "folder"),
        ("board", "-o", "board.svg"),
    ):
        result = run(*words, "--target", "t.yaml")
        assert result.exit_code == 2, words
        assert f"t.yaml: {field} 25 means metres and makes a" in result.stderr
        assert "did you mean 0.025 (25mm)? If it is so large, add --spacing 25m" in result.stderr
    assert not Path("folder").exists()
    plain = text is not TAGS
    if plain:
        result = run("pose", found, "--camera", "camera.yaml", "--target", "t.yaml", "--spacing", "25m")
        assert result.exit_code == 0, result.output
        Path("t.yaml").write_text(text.format(0.03))
        assert run("pose", found, "--camera", "camera.yaml", "--target", "t.yaml").exit_code == 0


def test_the_size_of_an_aprilgrid_counts_in_tags():
    target = AprilGrid(6, 6, "tag36h11", 0.3)
    ij = np.stack(np.meshgrid(np.arange(12), np.arange(12)), axis=-1).reshape(-1, 2)
    grid = replace(board(ij, 20.0 * ij + 9, (640, 480)), pattern="aprilgrid", target=target, ids=target.ids(ij))
    check_spacing(parse_length("0.2"), sizes_of([grid]))  # 1.5 m
    with pytest.raises(ConfigError, match=r"6×6 board 2\.1 m across"):
        check_spacing(parse_length("0.3"), sizes_of([grid]))
