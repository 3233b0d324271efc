"""Pictures, videos, paths and writing: every bad input gives its own error, and no write leaves half a file."""

import errno
import io
import os
import stat
import struct
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from PIL import Image

from rcdn.errors import ImageError, OutputError, RcdnError
from rcdn.io import (
    as_grey,
    check_writable,
    expand,
    frames,
    is_video,
    read_image,
    write_bytes,
    write_image,
    write_text,
)
from rcdn.io.marks import mark_of, marked

H, W = 40, 60


@pytest.fixture(scope="module")
def rgb():
    noise = np.random.default_rng(0).integers(0, 256, (H, W, 3), np.uint8)
    return cv2.normalize(cv2.GaussianBlur(noise, (0, 0), 3), None, 0, 255, cv2.NORM_MINMAX)


def luma(rgb):
    return rgb.astype(float) @ [0.299, 0.587, 0.114]


def save(path, image, **options):
    image.save(path, **options)
    return path


def encoded(image, **options):
    buffer = io.BytesIO()
    image.save(buffer, **options)
    return buffer.getvalue()


# ---- read_image: what is right


@pytest.mark.parametrize("ending", ["png", "bmp", "tif", "ppm"])
def test_colour_becomes_rec601_luma(tmp_path, rgb, ending):
    grey = read_image(save(tmp_path / f"a.{ending}", Image.fromarray(rgb)))
    assert grey.dtype == np.uint8
    assert np.abs(grey - luma(rgb)).max() < 1


def test_file_and_array_go_the_same_way(tmp_path, rgb):
    path = save(tmp_path / "a.jpg", Image.fromarray(rgb), quality=90)
    np.testing.assert_array_equal(read_image(path), as_grey(cv2.imread(str(path))))
    np.testing.assert_array_equal(read_image(str(path)), read_image(path))


def test_alpha_is_dropped_not_composited(tmp_path, rgb):
    image = Image.fromarray(rgb)
    image.putalpha(0)
    assert np.abs(read_image(save(tmp_path / "a.png", image)) - luma(rgb)).max() < 1


def test_palette_and_one_bit(tmp_path, rgb):
    palette = Image.fromarray(rgb).quantize(64)
    expected = luma(np.array(palette.convert("RGB")))
    assert np.abs(read_image(save(tmp_path / "a.png", palette)) - expected).max() < 1
    bits = Image.fromarray(rgb).convert("1")
    np.testing.assert_array_equal(read_image(save(tmp_path / "b.png", bits)), np.array(bits) * np.uint8(255))


def test_cmyk_jpeg(tmp_path, rgb):
    grey = read_image(save(tmp_path / "a.jpg", Image.fromarray(rgb).convert("CMYK"), quality=95))
    assert np.abs(grey - luma(rgb)).max() < 6


@pytest.mark.parametrize("ending", ["jpg", "png", "tif"])
@pytest.mark.parametrize("orientation", [3, 6])
def test_orientation_is_ignored(tmp_path, rgb, ending, orientation):
    exif = Image.Exif()
    exif[0x0112] = orientation
    options = {"tiffinfo": {0x0112: orientation}} if ending == "tif" else {"exif": exif}
    turned = save(tmp_path / f"turned.{ending}", Image.fromarray(rgb), **options)
    plain = save(tmp_path / f"plain.{ending}", Image.fromarray(rgb))
    with Image.open(turned) as image:
        assert image.getexif()[0x0112] == orientation
    np.testing.assert_array_equal(read_image(turned), read_image(plain))


@pytest.mark.parametrize("ending", ["png", "tif", "pgm"])
def test_16_bits_are_stretched(tmp_path, ending):
    ramp = np.linspace(3000, 3400, H * W).reshape(H, W).astype(np.uint16)
    path = tmp_path / f"a.{ending}"
    write_image(path, ramp)
    grey = read_image(path)
    assert grey.dtype == np.float32
    assert (grey.min(), grey.max()) == (0, 255)
    inner = (ramp > 3001) & (ramp < 3399)
    slope = np.polyfit(ramp[inner].astype(float), grey[inner].astype(float), 1)[0]
    assert slope == pytest.approx(255 / (400 * 0.998), rel=0.01)


def test_16_bit_colour_and_alpha(tmp_path, rgb):
    deep = np.dstack([rgb[..., ::-1].astype(np.uint16) * 257, np.zeros((H, W), np.uint16)])
    path = tmp_path / "a.png"
    path.write_bytes(cv2.imencode(".png", deep)[1].tobytes())
    np.testing.assert_array_equal(read_image(path), as_grey(deep))


def test_constant_16_bit_file_becomes_zeros(tmp_path):
    write_image(tmp_path / "a.png", np.full((5, 7), 40000, np.uint16))
    np.testing.assert_array_equal(read_image(tmp_path / "a.png"), np.zeros((5, 7), np.float32))


def test_unicode_path_and_one_pixel(tmp_path):
    path = tmp_path / "größe 図 1.png"
    write_image(path, np.full((1, 1), 7, np.uint8))
    np.testing.assert_array_equal(read_image(path), [[7]])


def test_bytes_after_the_end_are_allowed(tmp_path, rgb):
    for kind in ("JPEG", "PNG"):
        path = tmp_path / f"a.{kind}"
        path.write_bytes(encoded(Image.fromarray(rgb), format=kind) + b"\0" * 100)
        assert read_image(path).shape == (H, W)


def test_progressive_jpeg(tmp_path, rgb):
    path = save(tmp_path / "a.jpg", Image.fromarray(rgb), progressive=True)
    assert read_image(path).shape == (H, W)


# ---- read_image: what is wrong


def fails(path, *words):
    with pytest.raises(ImageError) as caught:
        read_image(path)
    for word in (str(path), *words):
        assert word in str(caught.value)


def test_missing_folder_and_empty(tmp_path):
    fails(tmp_path / "none.png", "no such file")
    fails(tmp_path, "is a folder")
    (tmp_path / "empty.png").touch()
    fails(tmp_path / "empty.png", "empty")
    with pytest.raises(ImageError, match=r"can't be read|no such file"):
        read_image("a\0b.png")


def test_text_called_png(tmp_path):
    (tmp_path / "a.png").write_text("not a picture\n" * 20)
    fails(tmp_path / "a.png", "not a picture")


def test_permission(tmp_path, monkeypatch):
    path = tmp_path / "a.png"
    write_image(path, np.zeros((3, 3), np.uint8))

    def refuse(self, mode):
        raise PermissionError(errno.EACCES, "Permission denied", str(self))

    monkeypatch.setattr(Path, "open", refuse)
    fails(path, "may not be read", "permissions")


def test_read_error(tmp_path, monkeypatch):
    path = tmp_path / "a.png"
    write_image(path, np.zeros((3, 3), np.uint8))

    def broken(self, mode):
        raise OSError(errno.EIO, "Input/output error", str(self))

    monkeypatch.setattr(Path, "open", broken)
    fails(path, "Input/output error")


@pytest.mark.parametrize("kind", ["JPEG", "PNG"])
@pytest.mark.parametrize("fraction", [0.999, 0.9, 0.5])
def test_truncated(tmp_path, rgb, kind, fraction):
    data = encoded(Image.fromarray(cv2.resize(rgb, (300, 200))), format=kind)
    path = tmp_path / "cut"
    path.write_bytes(data[: min(int(len(data) * fraction), len(data) - 12)])
    fails(path, "truncated")


def test_truncated_jpeg_with_a_whole_thumbnail(tmp_path, rgb):
    image = encoded(Image.fromarray(rgb), format="JPEG")
    thumbnail = encoded(Image.fromarray(rgb).resize((8, 8)), format="JPEG")
    segment = b"\xff\xe1" + (len(thumbnail) + 2).to_bytes(2, "big") + thumbnail
    whole = image[:2] + segment + image[2:]
    path = tmp_path / "a.jpg"
    path.write_bytes(whole)
    assert read_image(path).shape == (H, W)
    path.write_bytes(whole[:-200])
    fails(path, "truncated")


@pytest.mark.parametrize("kind", ["BMP", "TIFF", "WEBP", "PPM"])
def test_other_formats_fail_when_cut(tmp_path, rgb, kind):
    data = encoded(Image.fromarray(rgb), format=kind)
    (tmp_path / "cut").write_bytes(data[: len(data) // 2])
    fails(tmp_path / "cut", "damaged")


def test_garbage_after_a_signature(tmp_path):
    for start in (b"\xff\xd8\xff", b"\x89PNG\r\n\x1a\n", b"II*\0", b"II*\0\xff\xff\xff\x7f", b"BM"):
        (tmp_path / "a").write_bytes(start)
        fails(tmp_path / "a")


def test_float_tiff_with_nan(tmp_path):
    image = np.ones((4, 4), np.float32)
    image[1, 2] = np.nan
    (tmp_path / "a.tif").write_bytes(cv2.imencode(".tif", image)[1].tobytes())
    fails(tmp_path / "a.tif", "1 values", "nan_to_num")


# ---- as_grey


def test_uint8_stays(rgb):
    grey = rgb[..., 0].copy()
    assert np.shares_memory(as_grey(grey), grey)
    np.testing.assert_array_equal(as_grey(grey), grey)
    np.testing.assert_array_equal(as_grey(grey[..., None]), grey)
    np.testing.assert_array_equal(as_grey(grey[::2, ::-1]), grey[::2, ::-1])
    frozen = grey.copy()
    frozen.setflags(write=False)
    np.testing.assert_array_equal(as_grey(frozen), grey)


def test_bgr_bgra_and_other_dtypes_agree(rgb):
    bgr = rgb[..., ::-1]
    expected = as_grey(bgr)
    assert np.abs(expected - luma(rgb)).max() < 1
    np.testing.assert_array_equal(as_grey(np.dstack([bgr, rgb[..., 0]])), expected)
    np.testing.assert_array_equal(as_grey(bgr.astype(np.int64)), expected)
    assert np.abs(as_grey(bgr / 255.0) - luma(rgb)).max() < 1e-3
    assert np.abs(as_grey(bgr.astype(np.float64)) - luma(rgb)).max() < 1e-3


def test_bool_and_ranges():
    np.testing.assert_array_equal(as_grey(np.array([[True, False]])), [[255, 0]])
    np.testing.assert_array_equal(as_grey(np.array([[0.0, 0.5, 1.0]])), [[0, 127.5, 255]])
    np.testing.assert_array_equal(as_grey(np.array([[0.0, 2.0, 250.0]], np.float16)), [[0, 2, 250]])
    np.testing.assert_array_equal(as_grey(np.array([[-1.0, 0.0, 1.0]]))[0, [0, 2]], [0, 255])
    np.testing.assert_array_equal(as_grey(np.array([[-5, 400]], np.int16)), [[0, 255]])
    np.testing.assert_array_equal(as_grey(np.array([[7]], np.uint16)), [[0]])


def test_byte_order_does_not_matter():
    image = np.arange(600, dtype=np.uint16).reshape(20, 30)
    np.testing.assert_array_equal(as_grey(image.astype(">u2")), as_grey(image))


def test_a_few_bright_pixels_survive_the_stretch():
    image = np.full((100, 100), 500, np.uint16)
    image[3, 4] = 600
    assert as_grey(image)[3, 4] == 255
    assert as_grey(image).sum() == 255


def test_stretch_of_a_large_image_uses_a_subset():
    image = np.tile(np.arange(2500, dtype=np.uint16), (2000, 1))
    grey = as_grey(image)
    exact = np.clip((image[0] - 2.5) / (2496.5 - 2.5) * 255, 0, 255)
    assert np.abs(grey[0] - exact).max() < 0.3


@pytest.mark.parametrize(
    ("image", "words"),
    [
        (None, "cv2.imread returns None"),
        ("a.png", "read_image"),
        ([[1, 2]], "numpy array, not list"),
        (np.zeros((0, 5)), "empty"),
        (np.zeros((5, 0, 3), np.uint8), "empty"),
        (np.zeros(5), "shape"),
        (np.zeros((5, 5, 2)), "shape"),
        (np.zeros((2, 5, 5, 3)), "shape"),
        (np.zeros((3, 3), complex), "complex128"),
        (np.full((3, 3), None), "object"),
        (np.array([["a"]]), "dtype"),
        (np.array([[0, np.nan, np.inf]]), "2 values that are NaN, infinite"),
        (np.array([[0, 1e300]]), "1 values"),
    ],
)
def test_bad_arrays(image, words):
    with pytest.raises(ImageError, match=r"^frame 3 ") as caught:
        as_grey(image, "frame 3")
    assert words in str(caught.value)


@settings(max_examples=60, deadline=None)
@given(
    hnp.arrays(
        st.sampled_from([np.uint8, np.uint16, np.int32, np.float32, np.float64, np.bool_]),
        st.one_of(
            st.tuples(st.integers(1, 6), st.integers(1, 6), st.sampled_from([1, 3, 4])),
            hnp.array_shapes(min_dims=2, max_dims=2),
        ),
    )
)
def test_grey_is_always_in_range(image):
    seen = image[..., :3] if image.ndim == 3 else image  # alpha is dropped unread
    largest = np.abs(seen.astype(float)).max()
    assume(not 0.99e30 < largest < 1.01e30)  # at the limit itself rounding decides
    if not largest < 1e30:
        with pytest.raises(ImageError, match="NaN"):
            as_grey(image)
        return
    grey = as_grey(image)
    assert grey.shape == image.shape[:2]
    assert grey.dtype in (np.uint8, np.float32)
    assert grey.min() >= 0
    assert grey.max() <= 255


# ---- paths and videos


def touch(folder, *names):
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).touch()


def names(found, folder):
    return [p.relative_to(folder).as_posix() for p in found]


def test_expand_folder(tmp_path):
    touch(tmp_path, "b.PNG", "a.jpg", "sub/c.tiff", "sub/.hidden/d.png", ".e.png", "notes.txt", "clip.mp4", "sub/f.jp2")
    found, errors = expand([tmp_path])
    assert names(found, tmp_path) == ["a.jpg", "b.PNG", "clip.mp4", "sub/c.tiff", "sub/f.jp2"]
    assert errors == []


def test_expand_keeps_order_drops_duplicates(tmp_path, monkeypatch):
    touch(tmp_path, "a.png", "b.png", "raw.dat")
    monkeypatch.chdir(tmp_path)
    found, errors = expand(["raw.dat", "b.png", "./b.png", str(tmp_path / "b.png"), ".", "?.png"])
    assert found == [Path("raw.dat"), Path("b.png"), Path("a.png")]
    assert errors == []


def test_expand_patterns(tmp_path):
    touch(tmp_path, "x/a1.png", "x/a2.png", "y/a3.png", "y/b.png", "odd[1].png")
    assert names(expand([tmp_path / "*" / "a?.png"])[0], tmp_path) == ["x/a1.png", "x/a2.png", "y/a3.png"]
    assert names(expand([f"{tmp_path}/**/b.png"])[0], tmp_path) == ["y/b.png"]
    assert names(expand([tmp_path / "[xy]"])[0], tmp_path) == ["x/a1.png", "x/a2.png", "y/a3.png", "y/b.png"]
    assert names(expand([tmp_path / "odd[1].png"])[0], tmp_path) == ["odd[1].png"]


def test_expand_errors(tmp_path):
    touch(tmp_path, "empty/notes.txt", "a.png")
    wrong = [tmp_path / "none.png", tmp_path / "empty", tmp_path / "*.bmp"]
    found, errors = expand([*wrong, "", tmp_path / "a.png"])
    assert names(found, tmp_path) == ["a.png"]
    assert [path for path, _ in errors] == [*map(str, wrong), ""]
    for (_, message), words in zip(errors, ("no such file", "no pictures", "matches", "empty path"), strict=True):
        assert words in message


def test_expand_reports_folders_that_cannot_be_listed(tmp_path, monkeypatch):
    touch(tmp_path, "a.png", "locked/b.png")
    scandir = os.scandir

    def refuse(path):
        if str(path).endswith("locked"):
            raise PermissionError(errno.EACCES, "Permission denied", str(path))
        return scandir(path)

    monkeypatch.setattr(os, "scandir", refuse)
    found, errors = expand([tmp_path])
    assert names(found, tmp_path) == ["a.png"]
    assert len(errors) == 1
    assert "can't be listed" in errors[0][1]


def test_is_video():
    assert is_video("a/b.MP4")
    assert is_video(Path("b.webm"))
    assert not is_video("b.png")


def test_frames_of_a_picture(tmp_path):
    path = tmp_path / "a.png"
    write_image(path, np.zeros((3, 4), np.uint8))
    [(name, grey)] = frames(path)
    assert name == str(path)
    assert grey.shape == (3, 4)


def test_frames_of_a_video(tmp_path):
    path = tmp_path / "clip.avi"
    video = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 10, (64, 48))
    if not video.isOpened():
        pytest.skip("this OpenCV can't write videos")
    for level in (0, 100, 200):
        video.write(np.full((48, 64, 3), level, np.uint8))
    video.release()
    found = list(frames(path))
    assert [name for name, _ in found] == [f"{path}#{k:06d}" for k in range(3)]
    assert [grey.shape for _, grey in found] == [(48, 64)] * 3
    assert np.allclose([grey.mean() for _, grey in found], [0, 100, 200], atol=3)


def test_bad_videos(tmp_path):
    (tmp_path / "a.mp4").write_text("not a video")
    for path, words in [(tmp_path / "a.mp4", "can't be opened"), (tmp_path / "b.mp4", "no such file")]:
        with pytest.raises(ImageError, match=words):
            list(frames(path))


# ---- writing


def test_write_replaces_and_keeps_the_mode(tmp_path):
    path = tmp_path / "new" / "folder" / "a.txt"
    write_text(path, "ä\n")
    assert path.read_bytes() == "ä\n".encode()
    path.chmod(0o640)
    write_bytes(path, b"2")
    assert path.read_bytes() == b"2"
    assert stat.S_IMODE(path.stat().st_mode) == 0o640
    assert list(path.parent.iterdir()) == [path]


def test_write_follows_links(tmp_path):
    (tmp_path / "real.txt").write_text("old")
    (tmp_path / "link.txt").symlink_to("real.txt")
    write_text(tmp_path / "link.txt", "new")
    assert (tmp_path / "link.txt").is_symlink()
    assert (tmp_path / "real.txt").read_text() == "new"


@pytest.mark.skipif(not os.path.exists(os.devnull) or os.name == "nt", reason="needs a device file")
def test_devices_are_written_not_replaced():
    check_writable(os.devnull)
    write_text(os.devnull, "gone")
    assert stat.S_ISCHR(os.stat(os.devnull).st_mode)


def full_disk(*_, **__):
    raise OSError(errno.ENOSPC, "No space left on device")


@pytest.mark.parametrize("steps", [("fsync",), ("link", "replace")])
@pytest.mark.parametrize("old", [None, b"old"])
def test_no_space_leaves_everything_as_it_was(tmp_path, monkeypatch, steps, old):
    path = tmp_path / "a.json"
    if old is not None:
        path.write_bytes(old)
    for step in steps:
        monkeypatch.setattr(os, step, full_disk)
    with pytest.raises(OutputError, match="No space left on device; make room") as caught:
        write_bytes(path, b"new")
    assert str(path) in str(caught.value)
    assert [p.read_bytes() for p in tmp_path.iterdir()] == ([] if old is None else [old])


def test_interrupt_leaves_no_temporary_file(tmp_path, monkeypatch):
    def interrupt(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "fsync", interrupt)
    with pytest.raises(KeyboardInterrupt):
        write_bytes(tmp_path / "a", b"new")
    assert list(tmp_path.iterdir()) == []


def test_bad_places(tmp_path):
    (tmp_path / "file").touch()
    places = [
        (tmp_path, "it is a folder"),
        (tmp_path / "file" / "a.json", "folder"),
        (tmp_path / "file/x/a.json", "folder"),
    ]
    for path, words in places:
        for attempt in (check_writable, lambda p: write_text(p, "")):
            with pytest.raises(OutputError, match=words):
                attempt(path)
    with pytest.raises(OutputError, match="shorter name"):
        write_text(tmp_path / ("x" * 300), "")


def test_folder_that_cannot_be_made(tmp_path, monkeypatch):
    def refuse(*_, **__):
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(Path, "mkdir", refuse)
    with pytest.raises(OutputError, match="may write to"):
        write_text(tmp_path / "new" / "a.json", "")


def test_permission_to_write(tmp_path, monkeypatch):
    (tmp_path / "old.json").write_text("old")
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    for name in ("old.json", "new.json", "sub/new.json"):
        for attempt in (check_writable, lambda p: write_text(p, "new")):
            with pytest.raises(OutputError, match="may not be written; choose a place"):
                attempt(tmp_path / name)
    assert (tmp_path / "old.json").read_text() == "old"


def test_check_writable_writes_nothing(tmp_path):
    check_writable(tmp_path / "a" / "b" / "c.json")
    check_writable("c.json")
    assert list(tmp_path.iterdir()) == []


def test_write_image_errors(tmp_path):
    picture = np.zeros((3, 3), np.uint8)
    for name, image in [("a.xyz", picture), ("a", picture), ("a.png", picture.astype(float)), ("a.png", picture[:0])]:
        with pytest.raises(OutputError, match="a"):
            write_image(tmp_path / name, image)
    assert list(tmp_path.iterdir()) == []


def test_errors_are_rcdn_errors():
    assert issubclass(ImageError, RcdnError)
    assert issubclass(OutputError, RcdnError)


def _tiff(big, order, orientation, pixels):
    """A TIFF or BigTIFF of one strip, with this tag of the orientation."""
    mark, (height, width) = {"II": "<", "MM": ">"}[order], pixels.shape
    entries = {256: (4, width), 257: (4, height), 258: (3, 8), 259: (3, 1), 262: (3, 1), 273: (4, 0),
               274: (3, orientation), 277: (3, 1), 278: (4, height), 279: (4, width * height)}  # fmt: skip
    head = struct.pack(f"{mark}HHHQ", 43, 8, 0, 16) if big else struct.pack(f"{mark}HI", 42, 8)
    whole, room = ("Q", 8) if big else ("I", 4)
    start = 2 + len(head) + (8 + 20 * len(entries) + 8 if big else 2 + 12 * len(entries) + 4)
    entries[273] = (4, start)
    out = order.encode() + head + struct.pack(mark + ("Q" if big else "H"), len(entries))
    for tag, (kind, value) in entries.items():
        shown = struct.pack(mark + ("H" if kind == 3 else "I"), value).ljust(room, b"\0")
        out += struct.pack(f"{mark}HH{whole}", tag, kind, 1) + shown
    return out + struct.pack(mark + whole, 0) + pixels.tobytes()


@pytest.mark.parametrize("big", [False, True])
@pytest.mark.parametrize("order", ["II", "MM"])
@pytest.mark.parametrize("orientation", [1, 3, 6])
def test_a_tiffs_orientation_is_left_as_stored(tmp_path, big, order, orientation):
    pixels = np.random.default_rng(0).integers(0, 256, (40, 60), np.uint8)
    (tmp_path / "a.tif").write_bytes(_tiff(big, order, orientation, pixels))
    assert np.array_equal(read_image(tmp_path / "a.tif"), pixels)


@pytest.mark.parametrize("big", [False, True])
@pytest.mark.parametrize("order", ["II", "MM"])
def test_a_tiff_of_either_byte_order_keeps_a_mark(tmp_path, big, order):
    pixels = np.random.default_rng(0).integers(0, 256, (40, 60), np.uint8)
    (tmp_path / "a.tif").write_bytes(marked(_tiff(big, order, 1, pixels), "rcdn undistorted"))
    assert mark_of(tmp_path / "a.tif") == "rcdn undistorted"
    assert np.array_equal(read_image(tmp_path / "a.tif"), pixels)
