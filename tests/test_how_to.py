"""docs/how-to: each page run from top to bottom, its commands and its Python, by somebody who copies them.

Blocks of `sh` are run by bash, those of `python` by this Python; a block of `text` after one says what it prints.
Blocks of `sh elsewhere` and `python elsewhere` need programs or devices that the tests haven't: of these the options of
rcdn are looked up, and Python is compiled.
"""

import os
import re
import shutil
import subprocess
import sys

import cv2
import numpy as np
import pytest
from tests.doc_blocks import ROOT, run
from tests.test_python_page import same

import rcdn
from rcdn.io import read_camera, read_detections, read_image
from rcdn.synthetic import camera_view, render

PAGES = sorted((ROOT / "docs/how-to").glob("*.md"))
BLOCK = re.compile(r"^```([^\n]+)\n(.*?)^```$", re.M | re.S)


def blocks_of(page):
    """[(language, text)], in order."""
    return BLOCK.findall(page.read_text("utf-8"))


def run_block(language, text, folder, cache):
    """What a block prints. Pictures with which many pages begin are rendered once, and copied."""
    text = re.sub(r"^rcdn render ([\w-]+) --one-camera --count 12$", rf"cp -r '{cache}/photos' \1", text, flags=re.M)
    variables = {**os.environ, "XDG_CACHE_HOME": str(cache), "OMP_NUM_THREADS": "1", "MPLBACKEND": "agg"}
    variables["PYTHONPATH"] = os.pathsep.join([str(ROOT / "src"), *os.environ.get("PYTHONPATH", "").split(os.pathsep)])
    script = f'set -eo pipefail\nrcdn() {{ "{sys.executable}" -m rcdn "$@"; }}\n{text}'
    words = ["bash", "-c", script] if language == "sh" else [sys.executable, "-c", text]
    done = subprocess.run(words, cwd=folder, env=variables, capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 0, f"{text}\n{done.stdout}\n{done.stderr}"
    return done.stdout


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    """The pictures with which several pages begin, and what is found in them, are kept there."""
    folder = tmp_path_factory.mktemp("kept")
    run(folder, "-m", "rcdn", "render", "photos", "--one-camera", "--count", "12")
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.stem)
def test_the_page_runs_and_prints_what_it_says(page, tmp_path, cache):
    if shutil.which("bash") is None:
        pytest.skip("the pages' commands need bash")
    if page.stem == "webcam":
        film(tmp_path / "webcam.mp4")
    printed, ran = "", 0
    for language, text in blocks_of(page):
        text = text.replace("VideoCapture(0)", 'VideoCapture("webcam.mp4")')  # no test has a camera
        if language in ("sh", "python"):
            printed, ran = run_block(language, text, tmp_path, cache), ran + 1
        elif language == "text":
            assert same(text, printed), printed
    assert ran
    CHECKS[page.stem.replace("-", "_")](tmp_path)


def film(path):
    """A video in which the board stands still twelve times, for four frames each."""
    out = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"mp4v"), 30, (640, 480))
    for number in range(1, 13):
        frame = cv2.cvtColor(render(camera_view(1, number)), cv2.COLOR_GRAY2BGR)
        for _ in range(4):
            out.write(frame)
    out.release()


def bend(folder, name):
    """How far corners of a picture's rows lie off straight lines, px."""
    (board,) = rcdn.Detector().boards(folder / name)
    rows = [row - row.mean(axis=0) for row in board.grid()]
    return np.sqrt(np.mean([np.linalg.svd(row)[1][1] ** 2 / len(row) for row in rows]))


def true_camera(folder, name, most=0.5):
    """Whether a file has the camera of `rcdn render --one-camera`, to `most` px."""
    camera = read_camera(folder / name)
    return pytest.approx(camera_view(1, 1).camera.K, abs=most) == camera.K


def check_undistort(folder):
    assert true_camera(folder, "camera.yaml")
    assert bend(folder, "straight.png") < 0.05 < 0.1 < bend(folder, "board-pictures/scene_000001.png")
    assert len(list((folder / "flat").glob("*.png"))) == len(list((folder / "wide").glob("*.png"))) == 12
    assert np.array_equal(read_image(folder / "straight.png"), read_image(folder / "flat/scene_000001.png"))


def check_opencv(folder):
    assert true_camera(folder, "camera.yaml")
    assert bend(folder, "straight.png") < 0.05
    assert (folder / "axes.png").stat().st_size > 1000


def check_ros2(folder):
    assert true_camera(folder, "camera_info.yaml")


def check_boards(folder):
    for name in ("board", "large", "charuco", "grid"):
        assert (folder / f"{name}.pdf").read_bytes().startswith(b"%PDF")
    assert (folder / "charuco.yaml").read_text().startswith("kind: charuco")


def check_report(folder):
    assert true_camera(folder, "camera.yaml")
    text = (folder / "report.html").read_text()
    for heading in (
        "The reasons",
        "The numbers",
        "Over the sensor",
        "Hold the board here next",
        "Where the boards were",
    ):
        assert heading in text
    for heading in ("Residuals", "Every picture", "Good"):
        assert f">{heading}</h2>" in text


def check_colmap(folder):
    assert true_camera(folder, "cameras.txt")
    assert true_camera(folder, "camera.yaml")
    assert "FULL_OPENCV 640 480" in (folder / "cameras.txt").read_text()
    assert bend(folder, "flat/scene_000001.png") < 0.05


def check_webcam(folder):
    assert true_camera(folder, "camera.yaml", most=2)
    assert len(list((folder / "taken").glob("*.png"))) == 12


def check_out_of_focus(folder):
    assert true_camera(folder, "camera.yaml")


def check_sigma(folder):
    found, _ = read_detections(folder / "corners.json")
    assert all(np.isfinite(picture.boards[0].sigma).all() for picture in found)


def check_convert(folder):
    assert true_camera(folder, "camera.yaml", most=1)
    (before, _), (after, _) = (read_detections(folder / name) for name in ("corners.json", "again.json"))
    assert len(before) == len(after) == 12
    assert all(np.allclose(a.boards[0].xy, b.boards[0].xy, atol=1e-3) for a, b in zip(before, after, strict=True))


def check_training(folder):
    pytest.importorskip("torch")
    from rcdn.training.config import read_config

    (text,) = (text for language, text in blocks_of(ROOT / "docs/how-to/training.md") if language == "toml")
    (folder / "mine.toml").write_text(text)
    assert read_config(folder / "mine.toml").pool.backgrounds == "pictures-without-boards"


CHECKS = {name.removeprefix("check_"): check for name, check in list(globals().items()) if name.startswith("check_")}


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.stem)
def test_blocks_are_of_known_kinds_and_options_exist(page):
    kinds = {"sh", "python", "text", "sh elsewhere", "python elsewhere", "text elsewhere", "yaml", "toml"}
    for language, text in blocks_of(page):
        assert language in kinds
        if language.startswith("python"):
            compile(text, str(page), "exec")
        for line in text.splitlines() if language == "sh elsewhere" else ():
            if line.startswith("rcdn "):
                verb = line.split()[1:3] if " evaluate " in line else line.split()[1:2]
                words = [sys.executable, "-m", "rcdn", *verb, "--help"]
                known = subprocess.run(words, capture_output=True, text=True, check=True).stdout
                assert all(option in known for option in re.findall(r" (--[a-z-]+)", line)), line


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.stem)
def test_the_page_has_a_picture_and_the_readme_leads_there(page):
    text = page.read_text("utf-8")
    pictures = re.findall(r"!\[[^\]]+\]\(([^)]+)\)", text)
    assert pictures
    assert all((page.parent / picture).is_file() for picture in pictures)
    index = (ROOT / "docs/how-to.md").read_text("utf-8")
    assert f"](how-to/{page.name})" in index
    assert "](docs/how-to.md)" in (ROOT / "README.md").read_text("utf-8")


def test_pictures_are_small_and_drawn_by_the_script():
    drawn = re.findall(r'^@picture\("(.*)"\)', (ROOT / "docs/images/draw.py").read_text("utf-8"), flags=re.M)
    kept = {path.name: path.stat().st_size for path in (ROOT / "docs/images/how-to").iterdir()}
    assert sorted(drawn) == sorted(kept)
    assert max(kept.values()) <= 60_000
