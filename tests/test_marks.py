"""Marks in pictures that rcdn made of others."""

import cv2
import numpy as np
import pytest

from rcdn.io import read_pixels, write_image
from rcdn.io.marks import mark_in, mark_of, marked


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
