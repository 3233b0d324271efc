"""Videos that were cut short give the frames that they have, and an error that says what is missing."""

import struct
from pathlib import Path

import cv2
import numpy as np
import pytest

from detector_stand_in import BrightSquare, video
from rcdn.batch.inputs import gather
from rcdn.config import DetectorConfig
from rcdn.errors import ImageError
from rcdn.io import frames
from rcdn.io.containers import cut_short

PLACES = [place for place in ((10, 10), (110, 10), (10, 80), (110, 80)) for _ in range(6)]


def cut(path, share):
    whole = path.read_bytes()
    path.write_bytes(whole[: int(share * len(whole))])


@pytest.mark.parametrize(("code", "ending"), [("MJPG", "avi"), ("mp4v", "mp4")])
def test_the_frames_come_first_and_then_the_error(tmp_path, code, ending):
    path = tmp_path / f"clip.{ending}"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*code), 10, (64, 48))
    if not writer.isOpened():
        pytest.skip("this OpenCV can't write videos")
    for _ in range(20):
        writer.write(np.random.default_rng(0).integers(0, 255, (48, 64, 3), np.uint8))
    writer.release()
    assert len(list(frames(path))) == 20
    cut(path, 0.6)
    found = frames(path)
    if ending == "mp4":  # whose index is at the end
        with pytest.raises(ImageError, match="can't be opened"):
            next(found)
        return
    assert [next(found)[0] for _ in range(5)] == [f"{path}#{k:06d}" for k in range(5)]
    with pytest.raises(ImageError, match=r"cut short after 1\d whole frames"):
        list(found)


def test_a_calibration_uses_the_frames_that_are_there_and_reports_the_file(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    video(Path("clip.avi"), PLACES)
    cut(Path("clip.avi"), 0.6)
    got = gather(["clip.avi"], DetectorConfig(), make=BrightSquare, jobs=1)
    assert [int(i.path[-6:]) // 6 for i in got.images] == [0, 1]  # the third is only half there
    assert [f.name for f in got.failures] == ["clip.avi"]
    assert "was cut short" in capsys.readouterr().err


def box(kind, content, length=None, wide=False):
    length = (16 if wide else 8) + len(content) if length is None else length
    return struct.pack(">I4sQ" if wide else ">I4s", *((1, kind, length) if wide else (length, kind))) + content


def chunk(kind, content, length=None):
    length = len(content) if length is None else length
    return kind + struct.pack("<I", length) + content + b"\0" * (len(content) % 2)


def avi(frames, length=None, behind=b"", kind=b"AVI "):
    movi = chunk(b"LIST", b"movi" + frames, length)
    return chunk(b"RIFF", kind + chunk(b"LIST", b"hdrlabc") + movi + behind)


@pytest.mark.parametrize(
    ("data", "is_cut"),
    [
        (box(b"ftyp", b"isom") + box(b"moov", b"1234") + box(b"mdat", b"12345"), False),
        (box(b"ftyp", b"isom") + box(b"moov", b"1234") + box(b"mdat", b"12345")[:-1], True),
        (box(b"ftyp", b"isom") + box(b"mdat", b"12345", wide=True), False),
        (box(b"ftyp", b"isom") + box(b"mdat", b"12345", wide=True)[:-1], True),
        (box(b"ftyp", b"isom") + box(b"mdat", b"12345", length=0), False),  # to the end, wherever that is
        (box(b"ftyp", b"isom") + box(b"mdat", b"12345") + box(b"free", b"123")[:-2], False),  # behind the frames
        (box(b"ftyp", b"isom") + box(b"mdat", b"12345") + b"TAGTitle of it", False),
        (b"YUV4MPEG2 W64 H48 and so on", False),
        (avi(b"12345"), False),
        (avi(b"12345")[:-1], False),  # without the byte that pads it
        (avi(b"12345")[:-2], True),
        (avi(b"123456", behind=chunk(b"idx1", b"1234"))[:-3], False),
        (avi(b"123456", behind=chunk(b"idx1", b"1234"))[:-13], True),
        (avi(b"123456") + avi(b"1234", kind=b"AVIX"), False),
        (avi(b"123456") + avi(b"1234", kind=b"AVIX")[:-2], True),
        (avi(b"123456", length=0), False),  # its writer was killed
        (chunk(b"RIFF", avi(b"123456")[8:], length=500), False),  # RIFF's own length is often wrong
        (b"\x1aE\xdf\xa3 and what else Matroska holds", False),
        (b"", False),
    ],
)
def test_lengths_of_parts_tell_that_a_file_was_cut(tmp_path, data, is_cut):
    (tmp_path / "clip").write_bytes(data)
    assert cut_short(tmp_path / "clip") == is_cut
