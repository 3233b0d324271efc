"""No file blocks, never ends or takes more memory than pictures need: pipes, devices,
and headers that claim too much."""

import io
import os
import struct
import threading
import zlib

import cv2
import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from detector_stand_in import StandIn, picture, video
from rcdn import limits
from rcdn.cli import app
from rcdn.cli import detect as verb
from rcdn.errors import ConfigError, FormatError, ImageError
from rcdn.io import expand, frames, read_image, read_vnl_boards
from rcdn.io.headers import picture_size
from rcdn.io.images import read_named_image

needs_pipes = pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with names on this system")
PNG = cv2.imencode(".png", np.arange(48, dtype=np.uint8).reshape(6, 8))[1].tobytes()


# ---- pipes and devices


@needs_pipes
def test_folders_and_patterns_give_files_only(tmp_path):
    (tmp_path / "a.png").write_bytes(PNG)
    os.mkfifo(tmp_path / "pipe.png")
    (tmp_path / "zero.png").symlink_to("/dev/zero")
    (tmp_path / "link.png").symlink_to("a.png")
    for argument in (tmp_path, tmp_path / "*.png"):
        found, errors = expand([argument])
        assert [p.name for p in found] == ["a.png", "link.png"]
        assert [message for _, message in errors] == [
            f"{tmp_path / name}: a pipe or a device, not a file; it is read only if it is named itself"
            for name in ("pipe.png", "zero.png")
        ]


@needs_pipes
@pytest.mark.parametrize("jobs", [1, 2])
def test_a_pipe_that_is_named_is_read_once_in_this_process(tmp_path, monkeypatch, jobs):
    """As a shell's `<(…)` is, whose descriptor other processes don't have; neither the cache nor a worker opens it."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(verb, "_make_detector", StandIn)
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    for k in range(3):
        picture(tmp_path / f"{k}.png", cols=5, rows=6, missing=k)
    data = picture(tmp_path / "other.png", cols=4, rows=3).read_bytes()
    writer = threading.Thread(target=pipe.write_bytes, args=(data,), daemon=True)
    writer.start()
    options = ["--jobs", str(jobs), "--cache", "kept", "--json", "found.json"]
    result = CliRunner().invoke(app, ["detect", "pipe", "0.png", "1.png", "2.png", *options], catch_exceptions=False)
    writer.join(timeout=10)
    assert not writer.is_alive()
    assert (result.exit_code, result.stderr) == (0, "")
    assert "4×3" in result.stdout


@needs_pipes
def test_names_in_files_are_files_only(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    os.mkfifo(tmp_path / "a.png")
    with pytest.raises(ImageError, match=r"a\.png: a pipe or a device, not a file"):
        read_named_image(tmp_path / "a.png")
    rows = "".join(f"a.png {10 * i} {10 * j} 0\n" for j in range(3) for i in range(4))
    (tmp_path / "corners.vnl").write_text(f"# filename x y level\n{rows}")
    with pytest.raises(FormatError, match="not a file"):
        read_vnl_boards(tmp_path / "corners.vnl", (4, 3))


@pytest.mark.skipif(not os.path.exists("/dev/zero"), reason="no /dev/zero on this system")
def test_a_device_that_never_ends():
    with pytest.raises(ImageError, match="/dev/zero: not a picture"):
        read_image("/dev/zero")


@needs_pipes
def test_a_pipe_that_never_ends(tmp_path, monkeypatch):
    monkeypatch.setenv(limits.VARIABLE, "1")
    os.mkfifo(tmp_path / "pipe")
    stop = threading.Event()

    def write():
        with open(tmp_path / "pipe", "wb", buffering=0) as file:  # nothing is left to be written on closing
            file.write(PNG)
            try:
                while not stop.is_set():
                    file.write(bytes(1 << 16))
            except BrokenPipeError:
                return

    writer = threading.Thread(target=write, daemon=True)
    writer.start()
    with pytest.raises(ImageError, match=r"pipe: more than 0\.016 GB, .*--max-megapixels or RCDN_MAX_MEGAPIXELS"):
        read_image(tmp_path / "pipe")
    stop.set()
    writer.join(timeout=10)
    assert not writer.is_alive()


@needs_pipes
def test_videos_are_files(tmp_path):
    os.mkfifo(tmp_path / "clip.mp4")
    with pytest.raises(ImageError, match=r"clip\.mp4: a pipe or device"):
        next(frames(tmp_path / "clip.mp4"))


# ---- pixels


def chunk(kind, content):
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))


def by_pillow(kind, **options):
    buffer = io.BytesIO()
    Image.new("RGB", (8, 6)).save(buffer, kind, **options)
    return buffer.getvalue()


def claim(kind, side):
    """A small file that says it has `side` × `side` pixels."""
    both = struct.pack(">II", side, side)
    if kind == "png":
        head = b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", both + bytes([8, 2, 0, 0, 0]))
        return head + chunk(b"IDAT", zlib.compress(b"\0")) + chunk(b"IEND", b"")
    if kind == "jpg":
        data = by_pillow("JPEG")
        at = data.index(b"\xff\xc0") + 5
        return data[:at] + struct.pack(">HH", side, side) + data[at + 4 :]
    if kind == "bmp":
        data = by_pillow("BMP")
        return data[:18] + struct.pack("<ii", side, -side) + data[26:]
    if kind in ("II*\0", "MM\0*"):
        order = "<" if kind[0] == "I" else ">"
        tags = [(256, side), (257, side), (258, 8), (259, 1), (262, 1), (273, 8), (277, 1), (278, side), (279, 4)]
        entries = b"".join(struct.pack(f"{order}HHII", tag, 4, 1, value) for tag, value in tags)
        return (
            kind.encode() + struct.pack(f"{order}II", 12, 0) + struct.pack(f"{order}H", len(tags)) + entries + bytes(4)
        )
    if kind == "webp":
        canvas = (side - 1).to_bytes(3, "little") * 2
        return b"RIFF" + struct.pack("<I", 22) + b"WEBPVP8X" + struct.pack("<II", 10, 0) + canvas
    if kind == "jp2":
        return cv2.imencode(".jp2", np.zeros((48, 64), np.uint8))[1].tobytes().replace(struct.pack(">II", 64, 48), both)
    if kind == "gif":
        return b"GIF89a" + struct.pack("<HH", side, side) + bytes(20)
    if kind == "hdr":
        return f"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {side} +X {side}\n".encode() + bytes(20)
    heads = {"pgm": "P5 # a comment\n# another\n{0} {0}\n255\n", "pbm": "P1\n{0}\t{0}\n", "pfm": "PF\n{0} {0}\n-1\n",
             "pam": "P7\nWIDTH {0}\nHEIGHT {0}\nDEPTH 3\nMAXVAL 255\nENDHDR\n"}  # fmt: skip
    return heads[kind].format(side).encode() + bytes(20)


CLAIMS = ["png", "jpg", "bmp", "II*\0", "MM\0*", "webp", "jp2", "gif", "hdr", "pgm", "pbm", "pfm", "pam"]


@pytest.mark.parametrize("kind", CLAIMS)
def test_what_a_header_claims_is_refused_before_decoding(tmp_path, monkeypatch, kind):
    path = tmp_path / "a"
    path.write_bytes(claim(kind, 16000))
    assert path.stat().st_size < 1000
    assert picture_size(path.read_bytes()) == (16000, 16000)
    monkeypatch.setattr(cv2, "imdecode", None)
    with pytest.raises(
        ImageError, match=r"a: 16000 × 16000 px are 256 megapixels, more than 250; .*--max-megapixels or RCDN_MAX"
    ):
        read_image(path)


@pytest.mark.parametrize("kind", ["png", "jpg", "bmp", "tif", "webp", "jp2", "pgm"])
def test_sizes_are_those_of_the_pixels(kind):
    grey = np.zeros((37, 53), np.uint8)
    data = cv2.imencode(f".{kind}", grey)[1].tobytes()
    assert picture_size(data) == (53, 37)


def test_webp_of_all_kinds():
    for options in ({"lossless": True}, {"quality": 50}, {"lossless": True, "exif": b"Exif\0\0"}):
        assert picture_size(by_pillow("WEBP", **options)) == (8, 6)


def test_the_limit_can_be_moved(tmp_path, monkeypatch):
    (tmp_path / "a.png").write_bytes(PNG)
    monkeypatch.setenv(limits.VARIABLE, "0.000047")
    with pytest.raises(ImageError, match="8 × 6 px"):
        read_image(tmp_path / "a.png")
    monkeypatch.setenv(limits.VARIABLE, "0.000048")
    assert read_image(tmp_path / "a.png").shape == (6, 8)
    for wrong in ("much", "-1", "0", "nan", "inf"):
        monkeypatch.setenv(limits.VARIABLE, wrong)
        with pytest.raises(ConfigError, match="RCDN_MAX_MEGAPIXELS must be a number"):
            read_image(tmp_path / "a.png")


@pytest.mark.parametrize("jobs", [1, 2])
def test_the_option_reaches_all_processes(tmp_path, monkeypatch, jobs):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv(limits.VARIABLE, "250")  # and is gone after the test
    monkeypatch.setattr(verb, "_make_detector", StandIn)
    for k in range(3):
        cv2.imwrite(f"{k}.png", np.full((40, 50), 9, np.uint8))
    command = ["detect", "0.png", "1.png", "2.png", "--jobs", str(jobs)]
    few = CliRunner().invoke(app, [*command, "--max-megapixels", "0.001"], catch_exceptions=False)
    assert few.exit_code == 1
    assert few.stderr.count("50 × 40 px are 0.002 megapixels, more than 0.001") == 3
    if jobs == 1:
        assert CliRunner().invoke(app, [*command, "--max-megapixels", "0.002"], catch_exceptions=False).exit_code == 0


def test_opencv_s_own_limit_follows(monkeypatch):
    monkeypatch.setenv(limits.VARIABLE, "")
    monkeypatch.delenv(limits.OPENCV, raising=False)
    limits.set_max_megapixels(1000)
    assert limits.OPENCV not in os.environ
    limits.set_max_megapixels(2000)
    assert (limits.max_megapixels(), os.environ[limits.OPENCV]) == (2000, "2000000000")
    monkeypatch.delenv(limits.OPENCV)


def test_frames_of_videos_are_limited(tmp_path, monkeypatch):
    video(tmp_path / "clip.avi", [None] * 2)
    (_, first), *_ = frames(tmp_path / "clip.avi")
    monkeypatch.setenv(limits.VARIABLE, str((first.size - 1) / 1e6))
    with pytest.raises(ImageError, match=rf"clip\.avi: {first.shape[1]} × {first.shape[0]} px are .*--max-megapixels"):
        next(frames(tmp_path / "clip.avi"))


def test_large_files_are_not_read(tmp_path, monkeypatch):
    monkeypatch.setenv(limits.VARIABLE, "0.001")
    with open(tmp_path / "a.png", "wb") as file:
        file.write(PNG)
        file.truncate(16001)
    with pytest.raises(ImageError, match=r"a\.png: more than 1\.6e-05 GB"):
        read_image(tmp_path / "a.png")


def test_arrays_are_not_limited(monkeypatch):
    from rcdn.io import as_grey

    monkeypatch.setenv(limits.VARIABLE, "0.0001")
    assert as_grey(np.zeros((50, 50), np.uint8)).shape == (50, 50)


def test_many_empty_segments_take_no_time():
    """A JPEG's segments are counted, and a file of markers only ends soon."""
    from rcdn.io.jpeg import segments

    assert len(list(segments(b"\xff\xd8" + b"\xff\x01" * 200_000))) == 1 << 16
