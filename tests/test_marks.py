"""Marks in pictures that rcdn made of others."""

from io import BytesIO

import cv2
import numpy as np
import pytest
from PIL import Image, ImageSequence

from rcdn.batch.flat_files import DEPTHS
from rcdn.io import read_pixels, write_image
from rcdn.io.marks import MARKED_ENDINGS, mark_in, mark_of, marked


@pytest.mark.parametrize("name", ["a.png", "b.jpg"])
def test_a_mark_is_read_back_and_changes_no_pixel(tmp_path, name):
    pixels = np.random.default_rng(2).integers(0, 256, (40, 50, 3)).astype(np.uint8)
    plain, with_mark = tmp_path / f"plain-{name}", tmp_path / name
    write_image(plain, pixels)
    write_image(with_mark, pixels, mark="rcdn overlay")
    assert (mark_of(plain), mark_of(with_mark)) == (None, "rcdn overlay")
    assert np.array_equal(read_pixels(plain), read_pixels(with_mark))
    assert np.array_equal(cv2.imread(str(plain)), cv2.imread(str(with_mark)))


def test_other_comments_and_other_files_have_none(tmp_path):
    image = np.zeros((8, 8), np.uint8)
    for ending in (".png", ".jpg"):
        data = cv2.imencode(ending, image)[1].tobytes()
        ours = marked(data, "rcdn undistorted")
        assert mark_in(ours) == "rcdn undistorted"
        assert mark_in(ours.replace(b"rcdn und", b"rcdn Und")) is None
        for cut in range(60):
            assert mark_in(ours[:cut]) in (None, "rcdn undistorted")
    assert marked(b"BM...", "rcdn overlay") == b"BM..."
    assert mark_in(b"") is None
    assert mark_of(tmp_path) is None
    assert mark_of(tmp_path / "missing.png") is None


FORMATS = [(ending, dtype) for ending, dtypes in DEPTHS.items() for dtype in dtypes]


@pytest.mark.parametrize(("ending", "dtype"), FORMATS)
def test_every_format_of_undistorted_pictures_keeps_its_mark_and_its_pixels(tmp_path, ending, dtype):
    shape = (41, 53) if ending == ".pgm" else (41, 53, 3)
    pixels = (250 * np.random.default_rng(3).random(shape)).astype(dtype)
    plain, ours = tmp_path / f"plain{ending}", tmp_path / f"ours{ending}"
    write_image(plain, pixels)
    write_image(ours, pixels, mark="rcdn undistorted")
    assert (mark_of(plain), mark_of(ours)) == (None, "rcdn undistorted")
    assert np.array_equal(read_pixels(plain), read_pixels(ours))
    assert np.array_equal(cv2.imread(str(plain), cv2.IMREAD_UNCHANGED), cv2.imread(str(ours), cv2.IMREAD_UNCHANGED))
    if (dtype, pixels.ndim) != ("float32", 3):  # Pillow has no such pictures
        with Image.open(plain) as one, Image.open(ours) as other:
            assert np.array_equal(np.asarray(one), np.asarray(other))
    assert ending in MARKED_ENDINGS


@pytest.mark.parametrize("ending", sorted(MARKED_ENDINGS))
def test_what_is_left_of_a_file_with_a_mark_has_that_one_or_none(ending):
    image = np.zeros((41, 53) if ending == ".pgm" else (41, 53, 3), np.uint8)
    ours = marked(cv2.imencode(ending, image)[1].tobytes(), "rcdn overlay")
    for cut in range(len(ours)):
        assert mark_in(ours[:cut]) in (None, "rcdn overlay")
        damaged = bytearray(ours)
        damaged[cut] ^= 0xFF
        assert mark_in(bytes(damaged)) in (None, "rcdn overlay")


def test_a_picture_that_another_program_saves_again_is_no_longer_marked(tmp_path):
    pixels = np.random.default_rng(4).integers(0, 256, (41, 53, 3)).astype(np.uint8)
    for ending in (".webp", ".bmp", ".ppm", ".jp2"):
        write_image(tmp_path / f"a{ending}", pixels, mark="rcdn undistorted")
        with Image.open(tmp_path / f"a{ending}") as image:
            image.save(tmp_path / f"b{ending}")
        assert mark_of(tmp_path / f"b{ending}") is None


def test_a_tiff_of_several_pages_keeps_them_all(tmp_path):
    path = tmp_path / "pages.tif"
    pages = [Image.fromarray(np.full((5, 6), value, np.uint8)) for value in (10, 20)]
    pages[0].save(path, save_all=True, append_images=pages[1:], software="camera 1")
    ours = marked(path.read_bytes(), "rcdn undistorted")
    assert (mark_of(path), mark_in(ours)) == (None, "rcdn undistorted")
    with Image.open(BytesIO(ours)) as image:
        assert image.tag_v2[305] == "rcdn undistorted"
        assert [int(np.asarray(page)[0, 0]) for page in ImageSequence.Iterator(image)] == [10, 20]


def test_a_webp_with_an_alpha_channel_keeps_it():
    pixels = np.random.default_rng(5).integers(0, 256, (20, 30, 4)).astype(np.uint8)
    for quality in (80, 101):  # lossy; lossless
        data = cv2.imencode(".webp", pixels, [cv2.IMWRITE_WEBP_QUALITY, quality])[1].tobytes()
        ours = marked(data, "rcdn undistorted")
        assert mark_in(ours) == "rcdn undistorted"
        with Image.open(BytesIO(data)) as one, Image.open(BytesIO(ours)) as other:
            assert one.mode == other.mode == "RGBA"
            assert np.array_equal(np.asarray(one), np.asarray(other))
