"""Several outputs of one command: what can't be written is told in a line, and the others are written."""

from __future__ import annotations

import errno
from pathlib import Path

import pytest

from rcdn.batch import calibration_runs
from rcdn.errors import OutputError
from rcdn.io import ImageResult, read_calibration, read_camera, write_detections
from rcdn.report.calibration import comparison  # noqa: F401  # before write_text is replaced
from rcdn.types import Corners
from rcdn_lab.camera_scenes import CAMERAS, SPACING, random_boards

OTHERS = ("-o", "camera.yaml", "--json", "c.json", "--report", "r.html")


def save(path, lens):
    """Detections of six pictures of a board, by the camera with this lens."""
    boards = random_boards(CAMERAS[lens], 3, 6)[0]
    images = [
        ImageResult(f"{k}.png", *b.image_size, Corners(b.xy, b.response, b.status, sigma=b.sigma), (b,))
        for k, b in enumerate(boards)
    ]
    write_detections(path, images, ())
    return path


def all_are_there():
    return read_camera("camera.yaml") and read_calibration("c.json") and "</html>" in Path("r.html").read_text()


def calibrate(run, lens, *options):
    return run("calibrate", save("found.json", lens), "--spacing", SPACING, *options)


def test_a_format_that_can_not_hold_the_model_is_told_before_the_work(run, monkeypatch):
    events = []
    monkeypatch.setattr(
        "rcdn.batch.calibration_outputs.print_unwritten", lambda path, reason: events.append(f"{path}: {reason}")
    )
    reader = calibration_runs.BoardReader
    gather = reader.gather
    monkeypatch.setattr(reader, "gather", lambda *a, **k: events.append("work") or gather(*a, **k))
    result = calibrate(run, "brown", "--model", "brown", "-o", "camchain.yaml", *OTHERS)
    assert result.exit_code == 1
    assert "Kalibr" in events[0]
    assert events[1:] == ["work"]
    assert "written: camera.yaml, c.json, r.html" in result.stderr
    assert all_are_there()


def test_nothing_that_can_be_written_is_no_work(run, monkeypatch):
    monkeypatch.setattr(calibration_runs, "one_camera", lambda *_: pytest.fail("the work has begun"))
    result = calibrate(run, "brown", "--model", "brown", "-o", "camchain.yaml")
    assert result.exit_code == 1
    assert result.stderr.startswith("error: camchain.yaml can't be written: Kalibr")
    assert result.stderr.count("\n") == 1


def test_a_format_that_can_not_hold_what_was_chosen_loses_nothing_else(run):
    result = calibrate(run, "brown", "-o", "camchain.yaml", *OTHERS)
    assert result.exit_code == 1
    assert result.stderr.count("error: ") == 1
    assert "error: camchain.yaml is not written: Kalibr" in result.stderr
    assert all_are_there()
    assert not Path("camchain.yaml").exists()


@pytest.mark.parametrize(
    ("name", "error"),
    [
        ("rcdn.io.write_camera", OutputError("camera.yaml: can't be written: No space left on device; make room")),
        ("rcdn.io.write_calibration", OutputError("c.json: can't be written: No space left on device; make room")),
        ("rcdn.report.calibration.write_report", OSError(errno.EIO, "Input/output error")),
        ("rcdn.report.calibration.write_report", ValueError("a bug\nof two lines")),
    ],
)
def test_whatever_one_output_raises_the_others_are_written(run, monkeypatch, name, error):
    def broken(*_):
        raise error

    monkeypatch.setattr(name, broken)
    result = calibrate(run, "pinhole", "--model", "pinhole", *OTHERS)
    assert result.exit_code == 1
    lines = [line for line in result.stderr.splitlines() if line.startswith("error: ")]
    assert len(lines) == 1
    assert "No space" in lines[0] or "r.html is not written: unexpected" in lines[0]
    assert sum(Path(p).exists() for p in ("camera.yaml", "c.json", "r.html")) == 2


@pytest.mark.parametrize("second", ["-o", "--report"])
def test_two_outputs_of_one_name_are_wrong_use(run, second):
    result = calibrate(run, "pinhole", "--json", "c.json", second, "./c.json")
    assert result.exit_code == 2
    assert "named for 2 outputs" in result.stderr


def test_compare_writes_its_report_without_its_json(run, monkeypatch):
    calibrate(run, "pinhole", "--model", "pinhole", "--json", "c.json")

    def full(*_):
        raise OutputError("d.json: can't be written: No space left on device; make room")

    monkeypatch.setattr("rcdn.io.write_text", full)
    result = run("compare", "c.json", "c.json", "--json", "d.json", "--report", "d.html")
    assert result.exit_code == 1
    assert result.stderr.splitlines() == [
        "error: d.json: can't be written: No space left on device; make room",
        "written: d.html",
    ]


@pytest.mark.parametrize(
    "command",
    [
        ("render", "-"),
        ("undistort", "camera.yaml", "a.png", "--out", "-"),
        ("detect", "a.png", "--overlay", "-"),
        ("live", "-"),
        ("train", "a.toml", "--runs", "-"),
    ],
    ids=lambda command: command[0],
)
def test_standard_output_is_no_folder(run, command):
    result = run(*command)
    assert result.exit_code == 2
    assert "several files are written, which needs a folder" in result.stderr
    assert not Path("-").exists()


def test_a_folder_may_be_called_a_dash(run):
    assert run("render", "./-", "--count", "1").exit_code == 0
    assert (Path("-") / "truth.json").is_file()


def test_standard_output_is_told_to_have_no_ending_and_to_be_named_once(run):
    result = calibrate(run, "brown", "--model", "brown", "-o", "-")
    assert result.exit_code == 2
    assert result.stderr.startswith("error: --output -: standard output; name its format, --format opencv | ros")
    result = calibrate(run, "brown", "--model", "brown", "-o", "-", "--format", "ros", "--json", "-")
    assert result.exit_code == 2
    assert result.stderr.startswith("error: -: named for 2 outputs")
