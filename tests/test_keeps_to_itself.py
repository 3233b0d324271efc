"""What goes out of a run is what was asked for: no lines of libraries, no files in the user's home,
no pictures that others name."""

import os
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from rcdn.errors import ImageError
from rcdn.io import ImageResult, frames, read_image, write_detections, write_image
from rcdn.types import Corners
from rcdn_lab.camera_scenes import CAMERAS, SPACING, random_boards

FAST = ("--model", "pinhole", "--spacing", SPACING)
RUN = "from rcdn.cli import main; main()"


def rcdn(folder, *arguments, home=None):
    """The command itself, in `folder`, as a user runs it."""
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("XDG_", "ORT_", "RCDN_MAX"))}
    environment["HOME"] = str(home or folder)
    command = [sys.executable, "-c", RUN, *map(str, arguments)]
    return subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, timeout=240, check=False
    )


# ---- lines


def middle_gone(data):
    return data[: len(data) // 3] + data[len(data) // 2 :]


def zeroed(data):
    return data[: len(data) // 2] + bytes(400) + data[len(data) // 2 + 400 :]


def damaged(folder):
    """Damaged files of all formats; names by the damage. Each was met by some library's own lines."""
    rng = np.random.default_rng(2)
    rgb = cv2.GaussianBlur(rng.integers(0, 256, (120, 160, 3), np.uint8), (0, 0), 1)
    for ending in ("png", "jpg", "bmp", "tif", "webp", "ppm", "jp2"):
        data = cv2.imencode(f".{ending}", rgb)[1].tobytes()
        (folder / f"gone.{ending}").write_bytes(middle_gone(data))
        (folder / f"half.{ending}").write_bytes(data[: len(data) // 2])
        (folder / f"head.{ending}").write_bytes(data[:40])
    for ending, options in (("png", []), ("jpg", []), ("tif", [cv2.IMWRITE_TIFF_COMPRESSION, 8])):
        (folder / f"zeroed.{ending}").write_bytes(zeroed(cv2.imencode(f".{ending}", rgb, options)[1].tobytes()))
    odd = bytearray(cv2.imencode(".jpg", rgb)[1].tobytes())
    odd[odd.index(b"\xff\xc0") + 11] = 0x42  # a sampling for OpenCV's decoder, with too few blocks for it
    (folder / "sampling.jpg").write_bytes(bytes(odd[:-2]) + bytes(9) + bytes(odd[-2:]))
    (folder / "text.mp4").write_text("hello" * 99)
    (folder / "short.avi").write_bytes(b"RIFF\0\0\0\0AVI " + bytes(99))
    clip = cv2.VideoWriter(str(folder / "clip.mp4"), cv2.VideoWriter_fourcc(*"mp4v"), 10, (160, 120))
    for _ in range(4):
        clip.write(rng.integers(0, 256, rgb.shape, np.uint8))
    clip.release()
    (folder / "clip.mp4").write_bytes(middle_gone((folder / "clip.mp4").read_bytes()))
    return sorted(p.name for p in folder.iterdir())


def test_damaged_files_have_exactly_our_line_each(tmp_path):
    names = damaged(tmp_path)
    done = rcdn(tmp_path, "detect", *names, "--jobs", 1)
    lines = done.stderr.splitlines()
    wrong = [name for name in names if name != "sampling.jpg"]
    assert done.returncode == 1
    assert [line.split(":")[:2] for line in lines] == [["error", f" {name}"] for name in wrong], done.stderr


def test_workers_are_quiet_too(tmp_path):
    names = [name for name in damaged(tmp_path) if name.endswith(("png", "tif"))]
    done = rcdn(tmp_path, "detect", *names, "--jobs", 2)
    assert [line.split(":")[:2] for line in done.stderr.splitlines()] == [["error", f" {n}"] for n in names]


def test_a_warning_of_libpng_about_a_good_picture_is_not_shown(tmp_path):
    data = cv2.imencode(".png", np.full((40, 40), 7, np.uint8))[1].tobytes()
    import zlib

    content = b"iCCP" + b"x\0\0" + zlib.compress(b"no profile")
    chunk = (len(content) - 4).to_bytes(4, "big") + content + zlib.crc32(content).to_bytes(4, "big")
    (tmp_path / "a.png").write_bytes(data[:33] + chunk + data[33:])
    done = rcdn(tmp_path, "detect", "a.png")
    assert (done.returncode, done.stderr) == (0, "")


def test_opencv_s_log_level_is_given_back(tmp_path, capfd):
    write_image(tmp_path / "a.tif", np.zeros((9, 9), np.uint8))
    (tmp_path / "a.tif").write_bytes((tmp_path / "a.tif").read_bytes()[:60])
    (tmp_path / "clip.avi").write_bytes(b"RIFF")
    before = cv2.utils.logging.getLogLevel()
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_INFO)
    try:
        with pytest.raises(ImageError):
            read_image(tmp_path / "a.tif")
        with pytest.raises(ImageError):
            next(frames(tmp_path / "clip.avi"))
        assert cv2.utils.logging.getLogLevel() == cv2.utils.logging.LOG_LEVEL_INFO
    finally:
        cv2.utils.logging.setLogLevel(before)
    assert "global" not in capfd.readouterr().err


# ---- the user's home


@pytest.mark.parametrize("arguments", [("--preset", "paper"), ("--preset", "auto", "--device", "auto")])
def test_onnx_runtime_leaves_nothing_in_the_home(tmp_path, arguments):
    home = tmp_path / "home"
    home.mkdir()
    write_image(tmp_path / "a.png", np.zeros((60, 60), np.uint8))
    done = rcdn(tmp_path, "detect", "a.png", *arguments, home=home)
    assert done.returncode == 0, done.stderr
    assert list(home.rglob("*")) == []


def test_onnx_runtime_is_imported_only_where_it_runs(tmp_path):
    write_image(tmp_path / "a.png", np.zeros((60, 60), np.uint8))
    code = "import sys, rcdn; rcdn.Detector().detect(rcdn.read_image('a.png')); print('onnxruntime' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert done.stdout == "False\n"


# ---- pictures that files name


def saved(file, names):
    """Detections of a board a picture, under any names."""
    images = [
        ImageResult(name, *b.image_size, Corners(b.xy, b.response, b.status, sigma=b.sigma), (b,))
        for name, b in zip(names, random_boards(CAMERAS["pinhole"], 3, len(names))[0], strict=True)
    ]
    file.parent.mkdir(exist_ok=True)
    write_detections(file, images, ())
    return file


def shown(page):
    return Path(page).read_text().count("data:image/jpeg")


@pytest.fixture
def places(tmp_path):
    """Names of six pictures: three in the folder `mine` of the detections, a link out of it, and two elsewhere."""
    for folder in ("mine/deep", "elsewhere"):
        (tmp_path / folder).mkdir(parents=True)
    names = [
        "mine/0.png",
        "mine/deep/1.png",
        "mine/../mine/2.png",
        "mine/link.png",
        "elsewhere/4.png",
        "mine/../elsewhere/5.png",
    ]
    width, height = CAMERAS["pinhole"].image_size
    for name in names:
        if "link" not in name:
            write_image(tmp_path / name, np.full((height, width), 99, np.uint8))
    (tmp_path / "mine/link.png").symlink_to("../elsewhere/4.png")
    return names


LEFT_OUT = "3 of 6 photographs lie outside the folder of the file that names them and are left out"


def test_a_report_shows_only_pictures_in_the_file_s_own_folder(run, tmp_path, places):
    file = saved(tmp_path / "mine/found.json", places)
    result = run("calibrate", file, *FAST, "--report", "page.html", "--json", "mine/camera.json")
    assert f"note: --report: {LEFT_OUT}; --pictures FOLDER shows them." in result.stderr
    assert LEFT_OUT in Path("page.html").read_text()
    assert shown("page.html") == 3
    result = run("report", "mine/camera.json", "-o", "again.html")
    assert f"note: {LEFT_OUT}" in result.stderr
    assert shown("again.html") == 3


def test_pictures_that_the_user_names_are_shown(run, tmp_path, places):
    file = saved(tmp_path / "mine/found.json", places)
    run("calibrate", file, *FAST, "--report", "page.html", "--json", "camera.json", "--pictures", "elsewhere")
    assert shown("page.html") == 6
    result = run("report", "camera.json", "-o", "again.html", "--pictures", "elsewhere/5.png", "--pictures", "mine")
    assert "1 of 6" not in result.stderr
    assert shown("again.html") == 6
    assert (
        run("report", "camera.json", "-o", "again.html").stderr == "written: again.html\n"
    )  # all lie below its folder


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with names on this system")
def test_a_pipe_that_a_file_names_does_not_block(run, tmp_path, places):
    (tmp_path / "mine/0.png").unlink()
    os.mkfifo(tmp_path / "mine/0.png")
    file = saved(tmp_path / "mine/found.json", places)
    run("calibrate", file, *FAST, "--report", "page.html")
    assert shown("page.html") == 2
