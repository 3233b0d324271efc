"""Disks of 300 kB that fill up: each output is whole or the old one, each failure is a line,
and the other outputs are written."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
from fault_commands import OLD, make_home

HERE = Path(__file__).parent


@pytest.fixture(scope="module")
def home(tmp_path_factory):
    probe = subprocess.run(["unshare", "-Urm", "mount", "-t", "tmpfs", "none", "/mnt"], capture_output=True, text=True)
    if probe.returncode:
        pytest.skip(f"no small disks here: {probe.stderr.strip()}")
    return make_home(tmp_path_factory.mktemp("home"))


def on_small_disks(home, disks, *words):
    """How the command ended, and all files; each of the `disks` (name → kB that are free) has 300 kB."""
    for name in disks:
        (home / name).mkdir(exist_ok=True)
        for file in ("found.json", "found.vnl", "camera.json"):
            (home / name / file).write_bytes(OLD)
    shape = {name: {"kB": 300, "free": free} for name, free in disks.items()}
    command = [sys.executable, str(HERE / "small_disk.py"), json.dumps(shape), sys.executable, "-m", "rcdn", *words]
    done = subprocess.run(["unshare", "-Urm", *command], cwd=home, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert "Traceback" not in found["err"]
    assert not [name for name in found["files"] if name.endswith((".tmp", ".part"))]
    return found


def errors(found):
    return [line for line in found["err"].splitlines() if line.startswith("error: ")]


@pytest.fixture(scope="module")
def whole(home):
    """What a run on a large disk writes."""
    words = ["detect", "in", "--json", "found.json", "--vnl", "found.vnl", "-j", "1"]
    subprocess.run([sys.executable, "-m", "rcdn", *words], cwd=home, check=True, capture_output=True)
    return {name: (home / name).read_text() for name in ("found.json", "found.vnl")}


def test_a_full_disk_for_the_json_does_not_lose_the_vnl(home, whole):
    found = on_small_disks(
        home,
        {"full": 8, "roomy": 250},
        "detect",
        "in",
        "--json",
        "full/found.json",
        "--vnl",
        "roomy/found.vnl",
        "-j",
        "1",
    )
    assert found["code"] == 1
    assert len(errors(found)) == 1
    assert "full/found.json: can't be written: No space left on device; make room" in found["err"]
    assert found["files"]["full/found.json"].encode() == OLD
    assert found["files"]["roomy/found.vnl"] == whole["found.vnl"]


def test_both_on_a_full_disk_end_the_run_with_whole_files_and_true_words(home, whole):
    found = on_small_disks(
        home, {"full": 12}, "detect", "in", "--json", "full/found.json", "--vnl", "full/found.vnl", "-j", "1"
    )
    assert found["code"] == 1
    for name in ("found.json", "found.vnl"):
        text = found["files"][f"full/{name}"]
        assert text.encode() == OLD or set(text.replace(",\n", "\n").splitlines()) <= set(
            whole[name].replace(",\n", "\n").splitlines()
        )
    held = " hold" in found["err"]
    assert held == (
        found["files"]["full/found.json"].encode() != OLD or found["files"]["full/found.vnl"].encode() != OLD
    )


def test_a_disk_that_holds_the_file_but_not_twice_is_enough(home, whole):
    """The lines that wait there make way for the file."""
    room = round(len(whole["found.json"]) * 1.5 / 1024 + 4)
    found = on_small_disks(home, {"full": room}, "detect", "in", "--json", "full/found.json", "-j", "1")
    assert (found["code"], found["err"]) == (0, "")
    assert found["files"]["full/found.json"] == whole["found.json"]


def test_overlays_on_a_full_disk_lose_nothing_else(home, whole):
    found = on_small_disks(home, {"full": 60}, "detect", "in", "--json", "j.json", "--overlay", "full/see", "-j", "1")
    assert found["code"] == 1
    assert 1 <= len(errors(found)) <= 2
    assert found["files"]["j.json"] == whole["found.json"]


def test_a_cache_on_a_full_disk_is_no_fault(home, whole):
    found = on_small_disks(home, {"full": 0}, "detect", "in", "--json", "j.json", "--cache", "full/kept", "-j", "1")
    assert (found["code"], found["err"]) == (0, "")
    assert found["files"]["j.json"] == whole["found.json"]


def test_a_calibration_whose_report_does_not_fit(home, whole):
    words = ["calibrate", "found.json", "--spacing", "25mm", "--model", "pinhole", "--flat", "--force"]
    found = on_small_disks(
        home, {"full": 40}, *words, "-o", "camera.yaml", "--report", "full/r.html", "--json", "c.json"
    )
    assert found["code"] == 1
    assert len(errors(found)) == 1
    assert "full/r.html: can't be written: No space left on device" in found["err"]
    assert {"camera.yaml", "c.json"} <= set(found["files"])
    assert "full/r.html" not in found["files"]
