"""What contradicts itself on a command line, or would have no effect, is refused before any work, and what was read
another way than it was meant is said."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rcdn.io import ImageResult, StereoCameras, write_camera, write_detections, write_rig, write_stereo
from rcdn.types import Corners, Pose, Rig
from rcdn_lab.camera_scenes import CAMERAS, random_boards

PINHOLE = CAMERAS["pinhole"]
FAST = ("--model", "pinhole", "--spacing", "30mm")


@pytest.fixture
def found(run):
    save("found.json", random_boards(PINHOLE, 3, 6)[0])
    write_camera("camera.yaml", PINHOLE)
    return "found.json"


def save(path, boards):
    none = Corners(np.zeros((0, 2)), np.zeros(0), np.zeros(0))
    write_detections(path, [ImageResult(f"{k}.png", *b.image_size, none, (b,)) for k, b in enumerate(boards)])


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("-o", "maps.npz", "--format", "ros"), "maps.npz: the name ends as no ros file does; end it with .yaml"),
        (("-o", "c.json", "--format", "kalibr"), "c.json: the name ends as no kalibr file does"),
        (("--format", "ros"), "--format has no effect without --output"),
        (("--pictures", "."), "--pictures has no effect without --report"),
        (("--cache", "kept", "--no-cache"), "--cache and --no-cache contradict each other"),
        (("--stereo", "found.json", "-o", "-", "--format", "ros"), "a file for each camera"),
        (("--rig", "found.json", "-o", "-", "--format", "opencv"), "a file for each camera"),
        (("--rig", "found.json", "-o", "a.toml", "--format", "ros"), "a.toml: the name ends as no ros file does"),
    ],
)
def test_a_calibration_refuses_them(run, found, arguments, words):
    before = sorted(Path().iterdir())
    result = run("calibrate", found, *FAST, *arguments)
    assert result.exit_code == 2
    assert words in result.stderr
    assert sorted(Path().iterdir()) == before


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("found.json", "out.csv", "--to", "vnl"), "out.csv: the name ends as no vnl file does; end it with .vnl"),
        (("camera.yaml", "out.npz", "--to", "opencv"), "out.npz: the name ends as no opencv file does"),
    ],
)
def test_a_conversion_refuses_them(run, found, arguments, words):
    result = run("convert", *arguments)
    assert result.exit_code != 0
    assert words in result.stderr
    assert not Path(arguments[1]).exists()


@pytest.mark.parametrize("name", ["plain", "with.dots", "camera.yml"])
def test_names_that_tell_no_other_format_take_any(run, found, name):
    assert run("convert", "camera.yaml", name, "--to", "ros").exit_code == 0
    assert "distortion_model: plumb_bob" in Path(name).read_text()


def test_reports_on_standard_output_hold_nothing_else(run, found):
    result = run("calibrate", found, *FAST, "--report", "-")
    assert result.stdout.startswith("<!DOCTYPE html>")
    assert "Only 6 views" in result.stderr
    run("calibrate", found, *FAST, "--json", "a.json")
    result = run("compare", "a.json", "camera.yaml", "--report", "-")
    assert result.stdout.startswith("<!DOCTYPE html>")
    assert "px" in result.stderr


def test_poses_of_boards_of_another_size_hint_at_it(run, found):
    save("whole.json", [b for b in random_boards(PINHOLE, 3, 6)[0] if b.complete and b.size == (9, 6)])
    result = run("pose", "whole.json", "--camera", "camera.yaml", "--spacing", "30mm", "--board", "10x7")
    assert result.exit_code == 1
    assert "10x7 squares have 9×6 inner corners; did you mean --board 9x6?" in result.stderr


def test_a_rig_without_views_is_no_report(run):
    write_rig("rig.json", Rig(("a", "b"), (PINHOLE, PINHOLE), (Pose(np.eye(4)), Pose(np.eye(4)))))
    result = run("report", "rig.json", "-o", "r.html")
    assert result.exit_code == 1
    assert "holds a rig without its views; write it with `rcdn calibrate --rig --json`" in result.stderr


def test_a_pair_is_advised_formats_that_hold_pairs(run):
    lens = replace(PINHOLE, model="brown", distortion=[-0.1, 0.01, 0, 0, 0.02])  # k3, for which Kalibr has no place
    write_camera("one.yaml", lens)
    assert "or write opencv, ros, colmap, mrcal or json" in run("convert", "one.yaml", "camchain.yaml").stderr
    T = np.eye(4)
    T[0, 3] = -0.1
    write_stereo("pair.yaml", StereoCameras(lens, lens, T))
    assert "or write opencv, ros, mrcal or json" in run("convert", "pair.yaml", "camchain.yaml").stderr
