"""Lines on their way to the outputs: disks that fill up, and room that comes free again."""

from __future__ import annotations

import errno
import io
import json
import os
from pathlib import Path

import pytest

from rcdn.batch import outputs as _outputs
from rcdn.batch.detection_files import FORMATS
from rcdn.batch.outputs import Outputs, Spool
from rcdn.errors import OutputError


class Disk:
    """A disk of so many bytes for each folder's name: what is written beyond them fails, after a part of it."""

    def __init__(self, monkeypatch, tmp_path, **rooms):
        self.rooms = rooms
        self.numbers = {tmp_path / name: 100 + k for k, name in enumerate(rooms)}
        for folder in self.numbers:
            folder.mkdir()
        monkeypatch.setattr(_outputs, "_nameless", self.nameless)
        monkeypatch.setattr(_outputs, "_disk", lambda folder: self.numbers[Path(folder)])
        monkeypatch.setattr(_outputs, "_temporary", lambda: tmp_path / "tmp")
        monkeypatch.setattr(_outputs.os, "fstat", lambda number: os.stat_result((0, 0, number, *[0] * 7)))

    def nameless(self, folder):
        return _File(self, folder.name, self.numbers[folder])


class _File(io.BytesIO):
    def __init__(self, disk, name, number):
        super().__init__()
        self.disk, self.name, self.number = disk, name, number

    def fileno(self):
        return self.number

    def write(self, data):
        room = self.disk.rooms[self.name] - self.tell()
        if room <= 0:
            raise OSError(errno.ENOSPC, "No space left on device")
        return super().write(bytes(data)[:room])


def test_a_torn_line_never_stays(monkeypatch, tmp_path):
    disk = Disk(monkeypatch, tmp_path, out=25, tmp=0)
    spool = Spool([tmp_path / "out"])
    spool.add(b"first line\n")
    spool.add(b"second line\n")
    with pytest.raises(OSError, match="No space"):
        spool.add(b"third line\n")
    assert list(spool) == [b"first line\n", b"second line\n"]
    disk.rooms["out"] = 999  # room comes free
    spool.add(b"fourth line\n")
    assert list(spool) == [b"first line\n", b"second line\n", b"fourth line\n"]


def test_lines_go_to_another_disk_that_an_output_goes_to(monkeypatch, tmp_path):
    Disk(monkeypatch, tmp_path, out=25, other=999, tmp=999)
    spool = Spool([tmp_path / "out", tmp_path / "other"])
    lines = [b"line %d of several\n" % k for k in range(9)]
    for line in lines:
        spool.add(line)
    assert list(spool) == lines
    assert spool.refused is None


def test_where_no_output_s_disk_takes_more_the_lines_are_kept_elsewhere_and_it_is_told(monkeypatch, tmp_path):
    Disk(monkeypatch, tmp_path, out=25, tmp=999)
    outputs = Outputs({tmp_path / "out" / "a.json": FORMATS["json"]})
    outputs.add("x" * 20)
    with pytest.raises(OutputError, match=r"a.json: can't be written: No space left on device; make room"):
        outputs.add("y" * 20)
    assert list(outputs._kept()) == ["x" * 20, "y" * 20]


LINE = json.dumps(
    {"path": "a.png", "width": 5, "height": 4, "corners": {"xy": [], "response": [], "status": []}, "boards": []}
)


def test_lines_that_took_the_room_of_the_file_make_way(monkeypatch, tmp_path):
    Disk(monkeypatch, tmp_path, out=999, tmp=999)
    outputs = Outputs({tmp_path / "out" / f"a.{name}": FORMATS[name] for name in ("json", "vnl")})
    outputs.add(LINE)
    tries = []

    def write_lines(path, lines, errors):
        tries.append(list(lines))
        if len(tries) == 1:
            raise OutputError("full") from OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("rcdn.io.write_lines", write_lines)
    assert outputs.write([]) == []
    assert tries == [[LINE], [LINE]]
    assert [p.name for p in outputs.written] == ["a.json", "a.vnl"]
    assert (tmp_path / "out" / "a.vnl").read_text().endswith("a.png - - -\n")


def test_a_disk_that_can_not_be_read_is_an_error_of_each_output(monkeypatch, tmp_path):
    Disk(monkeypatch, tmp_path, out=999, tmp=0)
    outputs = Outputs({tmp_path / "out" / f"a.{name}": FORMATS[name] for name in ("json", "vnl")})
    outputs.add(LINE)

    def broken(_):
        raise OSError(errno.EIO, "Input/output error")
        yield

    monkeypatch.setattr(Spool, "__iter__", broken)
    assert [str(e).split(":")[0] for e in outputs.write([])] == [
        str(tmp_path / "out" / f"a.{n}") for n in ("json", "vnl")
    ]
    assert list((tmp_path / "out").iterdir()) == []
