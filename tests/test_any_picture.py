"""A detector takes a path, an array or a PIL image, and finds the same in each."""

import io

import cv2
import numpy as np
import pytest
from PIL import Image

import rcdn
from rcdn.errors import ImageError
from rcdn.io import grey_of, read_image
from rcdn.synthetic import PRESETS, random_scene, render

GREY = render(random_scene(np.random.default_rng((1, 1)), PRESETS["ordinary"], (320, 240)))
TINTED = np.stack([GREY, np.roll(GREY, 40, 0), np.roll(GREY, 80, 1)], axis=2)  # RGB: each colour shows another board
DETECTOR = rcdn.Detector()


def place(kind, path):
    """The colour picture as it comes: its file, an array as OpenCV has it, or a PIL image."""
    if kind == "array":
        return np.ascontiguousarray(TINTED[:, :, ::-1])
    image = Image.fromarray(TINTED)
    if kind == "PIL":
        return image
    image.save(path)
    return Image.open(path) if kind == "file by PIL" else str(path) if kind == "text" else path


@pytest.mark.parametrize("kind", ["text", "path", "file by PIL", "PIL"])
def test_colours_are_those_of_the_array(tmp_path, kind):
    luma = cv2.cvtColor(TINTED, cv2.COLOR_RGB2GRAY)
    assert np.array_equal(grey_of(place("array", None)), luma)
    assert np.array_equal(grey_of(place(kind, tmp_path / "a.png")), luma)
    assert not np.array_equal(luma, cv2.cvtColor(TINTED, cv2.COLOR_BGR2GRAY))  # the order of colours shows


@pytest.mark.parametrize("kind", ["path", "PIL"])
def test_a_detector_finds_the_same(tmp_path, kind):
    given, array = place(kind, tmp_path / "a.png"), place("array", None)
    assert np.array_equal(DETECTOR.detect(given).corners.xy, DETECTOR.detect(array).corners.xy)
    assert len(DETECTOR.corners(given)) == len(DETECTOR.corners(array)) > 0
    assert len(DETECTOR.boards(given)) == len(DETECTOR.boards(array))
    assert np.array_equal(DETECTOR.response(given), DETECTOR.response(array))


@pytest.mark.parametrize("mode", ["1", "L", "P", "RGB", "RGBA", "LA", "I;16"])
def test_modes_of_pil_are_as_their_file_is(tmp_path, mode):
    image = Image.fromarray(TINTED).convert("L" if mode in ("I;16", "LA") else mode)
    if mode == "I;16":
        image = Image.fromarray(GREY.astype(np.uint16) * 257)
    elif mode == "LA":
        image.putalpha(Image.fromarray(255 - GREY))  # dropped, not composited
    assert image.mode == mode
    image.save(tmp_path / "a.png")
    assert np.array_equal(grey_of(image), read_image(tmp_path / "a.png"))


@pytest.mark.parametrize("mode", ["I", "F", "PA"])
def test_modes_that_no_png_has(mode):
    image = Image.fromarray(GREY).convert("P" if mode == "PA" else mode).convert(mode)
    assert image.mode == mode
    assert np.array_equal(grey_of(image), GREY)


def test_cmyk_becomes_rgb():
    image = Image.fromarray(TINTED).convert("CMYK")
    assert np.array_equal(grey_of(image), cv2.cvtColor(np.asarray(image.convert("RGB")), cv2.COLOR_RGB2GRAY))


def test_what_is_no_picture_is_said(tmp_path):
    with pytest.raises(ImageError, match=r"none\.png: no such file"):
        DETECTOR.detect("none.png")
    Image.fromarray(TINTED).save(path := tmp_path / "cut.png")
    path.write_bytes(path.read_bytes()[:-2000])
    with Image.open(path) as cut, pytest.raises(ImageError, match="PIL can't decode it"):
        DETECTOR.detect(cut)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ([GREY, GREY], r"not list; give one picture a call"),
        ((True, GREY), r"not tuple; .*VideoCapture\.read returns"),
        (b"\x89PNG", r"not bytes; decode it first: cv2\.imdecode"),
        (bytearray(b"\x89PNG"), r"not bytearray; decode it first: cv2\.imdecode"),
        (cv2.UMat(GREY), r"not UMat; .*umat\.get\(\)"),
        ({}, r"not dict; convert it, e\.g\. with np\.asarray"),
        (
            io.BytesIO(),
            r"not BytesIO; read it: cv2\.imdecode\(np\.frombuffer\(image\.read\(\), np\.uint8\), .*\), or PIL",
        ),
    ],
    ids=["list", "tuple", "bytes", "bytearray", "UMat", "dict", "BytesIO"],
)
def test_what_is_no_array_is_told_how_to_become_one(given, message):
    with pytest.raises(ImageError, match=f"^image must be a numpy array, {message}"):
        DETECTOR.detect(given)


def test_an_open_file_is_told_to_be_read(tmp_path):
    """What the message says is a picture then."""
    Image.fromarray(GREY).save(path := tmp_path / "a.png")
    wanted = DETECTOR.corners(path).xy
    with open(path, "rb") as image:
        with pytest.raises(ImageError, match="not BufferedReader; read it: ") as caught:
            DETECTOR.detect(image)
        decode, pil = str(caught.value).split("read it: ")[1].split(", or ")
        for way in (decode, pil.replace("PIL.", "")):
            image.seek(0)
            assert np.array_equal(DETECTOR.corners(eval(way)).xy, wanted)


def test_the_drop_in_takes_them_too(tmp_path):
    Image.fromarray(GREY).save(tmp_path / "a.png")
    size = DETECTOR.boards(GREY)[0].size
    found, corners = rcdn.find_chessboard_corners(tmp_path / "a.png", size)
    assert found
    assert np.array_equal(corners, rcdn.find_chessboard_corners(GREY, size)[1])
