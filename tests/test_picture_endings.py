"""Endings of pictures in folders: those that are read, and those that are counted since they aren't."""

import io

import cv2
import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from rcdn.cli import app
from rcdn.errors import ImageError
from rcdn.io import find, frames, read_image
from rcdn.io.files import PICTURE_ENDINGS, UNREAD_ENDINGS, VIDEO_ENDINGS

GREY = np.add.outer(np.arange(48), 2 * np.arange(64)).astype(np.uint8)
"""a smooth picture, (48, 64) uint8"""
BY_OPENCV = {"dib": ".bmp", "pnm": ".pnm", "pgm": ".pgm", "jpe": ".jpe"}
"""by ending: the format that OpenCV writes by that name"""
BY_PIL = {
    "jfif": "JPEG", "jfi": "JPEG", "jif": "JPEG", "jpe": "JPEG", "mpo": "MPO",
    "jpx": "JPEG2000", "jpf": "JPEG2000", "j2k": "JPEG2000", "j2c": "JPEG2000", "jpc": "JPEG2000",
}  # fmt: skip
CODESTREAMS = ("j2k", "j2c", "jpc")
UNREAD = {"tga": "TGA", "pcx": "PCX"}


def by_pil(ending, format):
    out = io.BytesIO()
    options = {"no_jp2": ending in CODESTREAMS} if format == "JPEG2000" else {"quality": 98}
    Image.fromarray(GREY).save(out, format, **options)
    return out.getvalue()


def by_opencv(ending):
    colours = GREY if ending in ("pgm", "dib") else np.dstack([GREY] * 3)
    return cv2.imencode(BY_OPENCV[ending], colours)[1].tobytes()


WRITTEN = [*((e, by_opencv) for e in BY_OPENCV), *((e, lambda name: by_pil(name, BY_PIL[name])) for e in BY_PIL)]


@pytest.mark.parametrize(("ending", "written"), WRITTEN)
def test_a_picture_of_this_ending_is_found_in_a_folder_and_read(tmp_path, ending, written):
    path = tmp_path / f"a.{ending.upper()}"
    path.write_bytes(written(ending))
    assert find([tmp_path]).files == [path]
    grey = read_image(path)
    assert grey.shape == GREY.shape
    assert np.abs(grey.astype(float) - GREY).max() <= 4


def test_a_picture_of_canon_s_ending_is_read(tmp_path):
    heif = pytest.importorskip("pillow_heif")
    heif.register_heif_opener()
    Image.fromarray(np.dstack([GREY] * 3)).save(tmp_path / "a.heic", quality=98)
    (tmp_path / "a.heic").rename(tmp_path / "a.HIF")
    assert find([tmp_path]).files == [tmp_path / "a.HIF"]
    assert np.abs(read_image(tmp_path / "a.HIF").astype(float) - GREY).max() <= 4


@pytest.mark.parametrize("ending", UNREAD)
def test_a_picture_that_is_not_read_is_counted(tmp_path, ending):
    path = tmp_path / f"b.{ending}"
    path.write_bytes(by_pil(ending, UNREAD[ending]))
    with pytest.raises(ImageError, match="not a picture that can be read"):
        read_image(path)
    (tmp_path / "a.jfif").write_bytes(by_pil("jfif", "JPEG"))
    (tmp_path / "c.NRW").write_bytes(b"raw")
    result = CliRunner().invoke(app, ["detect", str(tmp_path)])
    assert "2 pictures of formats that aren't read are skipped" in result.stderr
    assert find([tmp_path]).files == [tmp_path / "a.jfif"]


@pytest.mark.parametrize("ending", sorted(VIDEO_ENDINGS - {".avi", ".webm"}))
def test_a_video_of_this_ending_is_found_in_a_folder_and_read(tmp_path, ending):
    path = tmp_path / f"a{ending}"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 25, (320, 240))
    if not writer.isOpened():
        pytest.skip("this OpenCV writes no such video")
    for level in range(0, 200, 20):
        writer.write(np.full((240, 320, 3), level, np.uint8))
    writer.release()
    assert find([tmp_path]).files == [path]
    greys = [float(grey.mean()) for _, grey in frames(path)]
    assert np.abs(np.subtract(greys, np.arange(0, 200, 20))).max() < 4


def test_an_ending_has_one_meaning():
    assert not PICTURE_ENDINGS & UNREAD_ENDINGS
    assert not VIDEO_ENDINGS & (PICTURE_ENDINGS | UNREAD_ENDINGS)
    assert all(e == e.lower() and e.startswith(".") for e in PICTURE_ENDINGS | UNREAD_ENDINGS)
