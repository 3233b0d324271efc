"""Pictures whose data are damaged are refused; oddities that cameras write are not. What can't show is not claimed."""

import io
import struct
import zlib

import cv2
import numpy as np
import pytest
from PIL import Image

from rcdn.errors import ImageError
from rcdn.io import read_image
from rcdn.io.decode import decode
from rcdn.io.jpeg import segments

ANY = cv2.IMREAD_ANYCOLOR | cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION
KINDS = {
    "4:2:0": {},
    "4:2:2": {"subsampling": "4:2:2"},
    "4:4:4": {"subsampling": "4:4:4"},
    "RGB": {"keep_rgb": True},
    "progressive": {"progressive": True},
    "restarts": {"restart_marker_rows": 1},
    "grey": {"mode": "L"},
    "CMYK": {"mode": "CMYK"},
}


@pytest.fixture(scope="module")
def rgb():
    noise = np.random.default_rng(0).integers(0, 256, (403, 357, 3), np.uint8)
    return cv2.normalize(cv2.GaussianBlur(noise, (0, 0), 2), None, 0, 255, cv2.NORM_MINMAX)


def encoded(rgb, mode="RGB", kind="JPEG", **options):
    buffer = io.BytesIO()
    Image.fromarray(rgb).convert(mode).save(buffer, kind, **options)
    return buffer.getvalue()


def by_opencv(data):
    return cv2.imdecode(np.frombuffer(data, np.uint8), ANY)


def same(data, reference):
    expected = by_opencv(reference)
    np.testing.assert_array_equal(decode(data, "a.jpg").reshape(expected.shape), expected)


def places(data, code):
    """Where segments of one marker begin."""
    return [start for marker, start, _ in segments(data) if marker == code]


def scan(data):
    """(start, end) of the data of all scans of a JPEG."""
    return next(end for marker, _, end in segments(data) if marker == 0xDA), len(data) - 2


# ---- JPEG: what is whole


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("size", [(403, 357), (1, 1), (17, 9)])
def test_a_whole_jpeg_has_the_pixels_of_opencv(rgb, kind, size):
    data = encoded(rgb[: size[0], : size[1]], quality=90, **KINDS[kind])
    same(data, data)


def test_a_sampling_that_the_strict_decoder_does_not_take(rgb):
    data = bytearray(encoded(rgb[:64, :64], subsampling="4:4:4"))
    data[places(data, 0xC0)[0] + 14] = 0x21  # Cb sampled more finely than Y: pixels mean nothing, but it is no damage
    assert decode(bytes(data), "a.jpg").shape == (64, 64, 3)


@pytest.mark.parametrize("kind", ["4:2:0", "progressive", "restarts"])
def test_harmless_oddities_of_cameras_change_nothing(rgb, kind):
    data = encoded(rgb, quality=90, **KINDS[kind])
    last = places(data, 0xDA)[-1]
    thumbnail = b"\xff\xe1" + struct.pack(">H", 2 + len(data[:20000])) + data[:20000]  # as an EXIF that is cut short
    oddities = {
        "trailer": data + bytes(999),
        "multi-picture": data + data,
        "thumbnail": data[:2] + thumbnail + data[2:],
        "bytes before a marker": data[:last] + b"\0\0\0" + data[last:],
        "filled markers": data[:last] + b"\xff\xff\xff" + data[last:],
        "filled up with zeros": data[:-2] + bytes(40) + data[-2:],
        "filled up with ones": data[:-2] + b"\xff" * 40 + data[-2:],
        "JFIF of another version": data[:11] + b"\2" + data[12:],
        "several": data[:11] + b"\3" + data[12:last] + b"\0" + data[last:-2] + bytes(17) + data[-2:] + b"trailer",
    }
    for odd in oddities.values():
        same(odd, data)


def test_frames_of_motion_jpeg_lack_huffman_tables(rgb):
    data = encoded(rgb, optimize=False)
    bare = data
    for marker, start, end in reversed(list(segments(data))):
        if marker == 0xC4:
            bare = bare[:start] + bare[end:]
    same(bare, data)


def test_a_sequential_scan_with_other_parameters(rgb):
    data = bytearray(encoded(rgb))
    start = scan(data)[0]
    data[start - 3 : start] = b"\0\0\0"
    same(bytes(data), encoded(rgb))


# ---- JPEG: what is damaged


def removed(data, rng):
    """A span of the picture's data is missing, between 1 % and a half of it."""
    start, end = scan(data)
    size = int((end - start) * np.exp(rng.uniform(np.log(0.01), np.log(0.5))))
    at = rng.integers(start, end - size)
    return data[:at] + data[at + size :]


def zeroed(data, rng):
    start, end = scan(data)
    size = int((end - start) * np.exp(rng.uniform(np.log(0.01), np.log(0.5))))
    at = rng.integers(start, end - size)
    return data[:at] + bytes(size) + data[at + size :]


def refused(data):
    try:
        decode(data, "a.jpg")
    except ImageError:
        return True
    return False


@pytest.mark.parametrize("kind", KINDS)
def test_a_jpeg_without_its_middle_is_refused(tmp_path, rgb, kind):
    data = encoded(rgb, quality=90, **KINDS[kind])
    start, end = scan(data)
    path = tmp_path / "a.jpg"
    path.write_bytes(data[: start + (end - start) // 3] + data[start + (end - start) // 2 :])
    with pytest.raises(ImageError, match=r"a\.jpg: damaged: .*; copy it again"):
        read_image(path)


@pytest.mark.parametrize("damage", [removed, zeroed])
@pytest.mark.parametrize("kind", KINDS)
def test_nearly_all_damaged_jpegs_are_refused(rgb, kind, damage):
    data = encoded(rgb, quality=90, **KINDS[kind])
    rng = np.random.default_rng(5)
    count = sum(refused(damage(data, rng)) for _ in range(25))
    assert count >= 23  # rarely, as many blocks come out as there should be


# ---- other formats


def tiff(rgb, compression):
    return cv2.imencode(".tif", rgb, [cv2.IMWRITE_TIFF_COMPRESSION, compression])[1].tobytes()


def test_a_deflated_tiff_with_a_damaged_strip(rgb):
    data = tiff(rgb, 8)
    np.testing.assert_array_equal(decode(data, "a.tif"), rgb)
    for bad in (b"\xff" * 999, bytes(999)):
        with pytest.raises(ImageError, match=r"a\.tif: damaged: a strip can't be inflated"):
            decode(data[:9000] + bad + data[9999:], "a.tif")


def test_a_tiff_whose_strips_are_missing(rgb):
    """The directory first, as many programs write it: what is cut off is pixels."""
    data = encoded(rgb, kind="TIFF")
    assert int.from_bytes(data[4:8], "little") < 1000
    with pytest.raises(ImageError, match="damaged: strips lie beyond its end"):
        decode(data[: len(data) // 2] + data[len(data) * 2 // 3 :], "a.tif")


def test_a_png_says_which_checksum_is_wrong(rgb):
    data = encoded(rgb, kind="PNG")
    middle = len(data) // 2
    with pytest.raises(ImageError, match=r"a\.png: damaged: the checksum of its IDAT is wrong; copy it again"):
        decode(data[:middle] + bytes(50) + data[middle + 50 :], "a.png")


def test_a_png_without_some_of_its_pixels(rgb):
    raw = zlib.decompress(b"".join(_idat(encoded(rgb, kind="PNG"))))
    head = encoded(rgb, kind="PNG")[:33]
    short = head + _chunk(b"IDAT", zlib.compress(raw[: len(raw) // 2])) + _chunk(b"IEND", b"")
    with pytest.raises(ImageError, match=r"a\.png: damaged: its pixels can't be inflated"):
        decode(short, "a.png")


def _idat(data):
    pos = 8
    while pos < len(data):
        length, kind = struct.unpack_from(">I4s", data, pos)
        if kind == b"IDAT":
            yield data[pos + 8 : pos + 8 + length]
        pos += 12 + length


def _chunk(kind, content):
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))


@pytest.mark.parametrize("kind", ["WEBP", "BMP", "PPM", "JPEG2000"])
def test_other_formats_without_their_middle(rgb, kind):
    data = encoded(rgb, kind=kind)
    with pytest.raises(ImageError, match="damaged"):
        decode(data[: len(data) // 3] + data[len(data) // 2 :], "a")
