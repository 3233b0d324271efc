"""HEIC pictures: as the sensor has them, whichever way the telephone was held; what is missing or damaged is said."""

import io
import sys

import cv2
import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

import rcdn
from rcdn.cli import app
from rcdn.errors import ImageError
from rcdn.io import find, read_image
from rcdn.io.images import read_pixels

pillow_heif = pytest.importorskip("pillow_heif")
pillow_heif.register_heif_opener()
TOP, FLIPPED = 1, 2
TURNED = (3, 6, 8)


def board():
    """A picture (240, 320, 3) BGR of a board of 7 × 5 corners."""
    squares = np.kron(np.add.outer(np.arange(6), np.arange(8)) % 2, np.ones((30, 30)))
    grey = np.full((240, 320), 200.0)
    grey[30:210, 40:280] = np.where(squares > 0, 40, 200)
    grey = cv2.GaussianBlur(grey, (0, 0), 0.8)
    return np.stack([grey, 0.9 * grey, 0.95 * grey], axis=2).astype(np.uint8)


def stored(path, pixels, orientation=TOP):
    """The picture as HEIC that decoders turn by an EXIF `orientation`."""
    exif = Image.Exif()
    exif[0x112] = orientation
    out = io.BytesIO()
    Image.fromarray(pixels[:, :, ::-1]).save(out, "HEIF", quality=95, exif=exif.tobytes())
    path.write_bytes(out.getvalue())


@pytest.mark.parametrize("orientation", [TOP, *TURNED])
def test_pixels_are_those_of_the_sensor(tmp_path, orientation):
    stored(tmp_path / "a.heic", board(), orientation)
    pixels = read_pixels(tmp_path / "a.heic")
    assert pixels.shape == board().shape
    assert np.abs(pixels.astype(int) - board()).mean() < 1.5


def test_mirrored_pictures_are_as_decoders_show_them(tmp_path):
    stored(tmp_path / "a.heic", board(), FLIPPED)
    with Image.open(tmp_path / "a.heic") as shown:
        assert (read_pixels(tmp_path / "a.heic")[:, :, ::-1] == np.asarray(shown.convert("RGB"))).all()


def test_ten_bits_are_kept(tmp_path):
    ramp = np.tile(np.linspace(0, 65535, 256).astype(np.uint16)[:, None, None], (1, 320, 3))
    pillow_heif.from_bytes("RGB;16", (320, 256), ramp.tobytes()).save(tmp_path / "a.heif", quality=95)
    pixels = read_pixels(tmp_path / "a.heif")
    assert pixels.dtype == np.uint16
    assert np.abs(pixels.astype(int) - ramp).mean() < 300


def test_boards_are_found_in_a_folder_of_them(tmp_path):
    stored(tmp_path / "IMG_1.HEIC", board())
    stored(tmp_path / "IMG_2.HEIC", board(), TURNED[1])
    assert [p.name for p in find([tmp_path]).files] == ["IMG_1.HEIC", "IMG_2.HEIC"]
    for path in find([tmp_path]).files:
        (found,) = rcdn.Detector().boards(path)
        assert (found.size, found.image_size) == ((7, 5), (320, 240))


def test_without_a_decoder_the_message_tells_how_to_get_one(tmp_path, monkeypatch):
    stored(tmp_path / "a.heic", board())
    for name in ("pi_heif", "pillow_heif"):
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(ImageError, match=r"a\.heic: HEIC pictures need a decoder: pip install 'rcdn\[heic\]'"):
        read_image(tmp_path / "a.heic")
    result = CliRunner().invoke(app, ["detect", str(tmp_path)])
    assert result.exit_code == 1
    assert "rcdn[heic]" in result.output


@pytest.mark.parametrize("share", [0.05, 0.5, 0.99])
def test_half_a_file_is_an_error(tmp_path, share):
    stored(tmp_path / "a.heic", board())
    data = (tmp_path / "a.heic").read_bytes()
    (tmp_path / "b.heic").write_bytes(data[: int(share * len(data))])
    with pytest.raises(ImageError, match=r"b\.heic"):
        read_image(tmp_path / "b.heic")


def test_pictures_of_other_formats_in_a_folder_are_told(tmp_path):
    for name in ("a.CR2", "b.dng"):
        (tmp_path / name).write_bytes(b"II*\0")
    alone = CliRunner().invoke(app, ["detect", str(tmp_path)])
    assert alone.exit_code == 2
    assert "formats that aren't read (.cr2, .dng); convert them" in alone.output
    cv2.imwrite(str(tmp_path / "c.png"), board())
    beside = CliRunner().invoke(app, ["detect", str(tmp_path)])
    assert beside.exit_code == 0
    assert "2 pictures of formats that aren't read are skipped: " in beside.output
    assert "a.CR2" in beside.output
