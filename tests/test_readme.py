"""What README.md prints, done by somebody who copies it: its commands and its Python,
in a folder with rendered pictures."""

import re
from dataclasses import replace

import cv2
import numpy as np
import pytest
from tests.doc_blocks import ROOT, blocks, commands, run

import rcdn
from rcdn.io import read_calibration, read_camera, read_detections, read_rig, write_calibration, write_image
from rcdn.io.cameras import read_stereo
from rcdn.synthetic import camera_view, render

pytestmark = pytest.mark.xdist_group("readme")  # one folder
README = "README.md"
SQUARE = 0.025
BASELINE = 2  # squares
SEED = 1  # of `rcdn render`


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """After the commands of the first block."""
    folder = tmp_path_factory.mktemp("newcomer")
    first = commands(README)[:3]
    assert [words[1] for words in first] == ["render", "detect", "calibrate"]
    for words in first:
        run(folder, "-m", *words)
    return folder


def test_the_first_commands_do_what_they_say(folder):
    found, errors = read_detections(folder / "corners.json")
    assert errors == []
    assert len(found) == len(list((folder / "photos").glob("*.png"))) == len(list((folder / "seen").iterdir())) == 12
    assert all(picture.boards[0].size in ((9, 6), (6, 9)) for picture in found)
    truth = camera_view(SEED, 1).camera
    assert pytest.approx(truth.K, abs=0.5) == read_camera(folder / "camera.yaml").K
    assert "<html" in (folder / "report.html").read_text()


def test_the_python_runs_when_it_is_pasted(folder):
    code, _ = blocks(README, "python")
    (folder / "camera.yaml").unlink()
    lines = run(folder, "-c", code).splitlines()
    assert lines[0].startswith(("(9, 6) ", "(6, 9) "))
    level, rms, deviation = lines[1].split()
    assert level == "good"
    assert 0 < float(rms) < 0.1
    assert 0 < float(deviation) < 1
    assert pytest.approx(camera_view(SEED, 1).camera.K, abs=0.5) == read_camera(folder / "camera.yaml").K
    spec = camera_view(SEED, 1).boards[0]
    middle = cv2.Rodrigues(np.array(spec.rvec))[0] @ [4, 2.5, 0] + spec.tvec
    x, y, z = (float(v) for v in re.search(r"\[(.*?)\]", lines[2])[1].split())
    assert (
        np.linalg.norm(np.array([x, y, z]) - SQUARE * middle) < SQUARE * 5
    )  # a corner of the board lies 4.7 squares off its middle
    assert lines[2].endswith(" False")


def test_the_drop_in_has_opencvs_shapes(folder):
    (line,) = re.findall(
        r"`found, corners = rcdn\.(find_chessboard_corners)\(image, \(9, 6\)\)`", (ROOT / README).read_text()
    )
    code = f"import rcdn; print(*(v if v is True else v.shape for v in rcdn.{line}('photos/scene_000001.png', (9, 6))))"
    assert run(folder, "-c", code) == "True (54, 1, 2)\n"


@pytest.fixture(scope="module")
def workplace(folder):
    """The folder with what the other commands speak of: pictures of two cameras, and two calibrations of one."""
    for number in range(1, 7):
        scene = camera_view(SEED, number)
        (board,) = scene.boards
        x, y, z = board.tvec
        other = replace(scene, boards=(replace(board, tvec=(x - BASELINE, y, z)),))
        for side, view in (("left", scene), ("right", other)):
            write_image(folder / side / f"{number}.png", render(view))
    found, _ = read_detections(folder / "corners.json")
    boards = [picture.boards[0] for picture in found]
    for day, part in (("monday", boards[:7]), ("friday", boards[5:])):
        write_calibration(folder / f"{day}.json", rcdn.calibrate(part, spacing=SQUARE, model="brown", flat=True))
    return folder


def test_every_other_command_ends_well(workplace):
    for words in commands(README)[3:]:
        run(workplace, "-m", *words)
    assert (workplace / "board.pdf").read_bytes().startswith(b"%PDF")
    assert (workplace / "corners.vnl").read_text().startswith("#")
    pair = read_stereo(workplace / "rig.yaml")
    assert pair.T_right_left[:3, 3] == pytest.approx([-BASELINE * SQUARE, 0, 0], abs=1e-3)
    T, _ = read_rig(workplace / "rig.toml").relative("left", "right")
    assert T[:3, 3] == pytest.approx([-BASELINE * SQUARE, 0, 0], abs=1e-3)
    assert read_calibration(workplace / "monday.json").camera.model == "brown"
    assert "<html" in (workplace / "difference.html").read_text()


def test_the_python_of_a_rig_runs_when_it_is_pasted(workplace):
    _, code = blocks(README, "python")
    level, place, spread = re.fullmatch(r"(\w+) \[(.*)\] \[(.*)\]\n", run(workplace, "-c", code)).groups()
    assert level in ("good", "fair")
    assert np.array(place.split(), float) == pytest.approx([-BASELINE * SQUARE, 0, 0], abs=1e-3)
    assert (np.array(spread.split(), float) < 1e-3).all()


@pytest.mark.parametrize("page", ["README.md", "docs/training.md", "docs/features.md", "docs/results.md"])
def test_commands_of_pages_have_options_that_exist(page):
    """Whoever copies an option that isn't there any more would see it: by the help of each verb."""
    from typer.testing import CliRunner

    from rcdn.cli import app

    for words in commands(page):
        verb = words[1:3] if words[1] == "evaluate" else words[1:2]
        help_text = CliRunner().invoke(app, [*verb, "--help"], env={"COLUMNS": "200", "TERM": "dumb"}).stdout
        for option in (w for w in words if w.startswith("--")):
            assert option in help_text, f"{page}: {' '.join(words)}"


@pytest.mark.parametrize("config", sorted((ROOT / "configs").rglob("*.toml")), ids=lambda p: p.stem)
def test_configurations_of_training_need_no_folder_of_ours(config):
    tomllib = pytest.importorskip("tomllib")
    pool = tomllib.loads(config.read_text()).get("pool", {})
    assert pool.get("backgrounds", "") == ""
