"""Files that are written whole or not at all: nameless ones, those that a killed process left,
several writers at once."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import pytest

from rcdn.io import whole, write_bytes, write_chunks
from rcdn.io.files import check_writable, is_stream


def full_disk(*_, **__):
    raise OSError(errno.ENOSPC, "No space left on device")


def without_nameless_files(monkeypatch):
    monkeypatch.delattr(os, "O_TMPFILE", raising=False)


@pytest.mark.parametrize("old", [None, b"old"])
def test_a_file_has_no_name_while_it_is_written(tmp_path, old):
    """What is killed meanwhile leaves nothing."""
    if not hasattr(os, "O_TMPFILE"):
        pytest.skip("this system knows no files without names")
    path = tmp_path / "a.json"
    if old is not None:
        path.write_bytes(old)
    seen = []

    def chunks():
        yield b"one"
        seen.append([p.name for p in tmp_path.iterdir()])
        yield b"two"

    write_chunks(path, chunks())
    assert seen == [[] if old is None else ["a.json"]]
    assert path.read_bytes() == b"onetwo"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(("nameless", "old"), [(True, b"old"), (False, None), (False, b"old")])
def test_what_a_killed_process_left_is_replaced(tmp_path, monkeypatch, nameless, old):
    path = tmp_path / "a.json"
    if old is not None:
        path.write_bytes(old)
    if not nameless:
        without_nameless_files(monkeypatch)
    left = path.with_name(whole.temporary_name(path, written=not nameless))
    left.write_bytes(b"half of a fi")
    write_bytes(path, b"new")
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == {"a.json": b"new"}


@pytest.mark.skipif(os.name == "nt", reason="no locks of POSIX")
def test_two_writers_of_one_file_do_not_mix(tmp_path, monkeypatch):
    without_nameless_files(monkeypatch)
    path = tmp_path / "a.json"

    def chunks():
        yield b"outer"
        write_bytes(path, b"inner" * 10)
        yield b" outer"

    write_chunks(path, chunks())
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == {"a.json": b"outer outer"}


@pytest.mark.parametrize("nameless", [True, False])
def test_many_writers_of_one_file_leave_one_of_them(tmp_path, monkeypatch, nameless):
    if not nameless:
        without_nameless_files(monkeypatch)
    path = tmp_path / "a.json"
    contents = [bytes([65 + k]) * 5000 for k in range(6)]

    def write(data):
        for _ in range(50):
            write_bytes(path, data)
            assert path.read_bytes() in contents

    monkeypatch.setattr(os, "fsync", lambda _: None)
    with ThreadPoolExecutor(len(contents)) as pool:
        list(pool.map(write, contents))
    assert list(tmp_path.iterdir()) == [path]


def test_a_file_system_that_links_no_nameless_file(tmp_path, monkeypatch):
    monkeypatch.setattr(os, "link", full_disk)
    write_chunks(tmp_path / "a", (b"one", b"two"))
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == {"a": b"onetwo"}


@pytest.mark.skipif(not os.path.exists("/dev/stdout"), reason="no /dev/stdout here")
def test_a_log_that_standard_output_goes_to_is_kept(tmp_path):
    code = "from rcdn.io import write_bytes; write_bytes('/dev/stdout', b'second\\n')"
    log = tmp_path / "log.txt"
    with log.open("ab") as file:
        file.write(b"first\n")
        file.flush()
        subprocess.run([sys.executable, "-c", code], stdout=file, check=True)
        file.write(b"third\n")
    assert log.read_bytes() == b"first\nsecond\nthird\n"


def test_what_is_open_already_is_a_stream():
    assert is_stream("-")
    assert is_stream("/dev/fd/1")
    assert not is_stream("stdout")
    check_writable("-")
