"""`rcdn compare`: what it prints and writes, and how it fails."""

import json
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from rcdn.calibration import calibrate
from rcdn.calibration.comparison import compare
from rcdn.cli import app
from rcdn.errors import RcdnError
from rcdn.io import (
    StereoCameras,
    read_calibrations,
    write_calibration,
    write_camera,
    write_rig,
    write_rig_calibration,
    write_stereo,
)
from rcdn.types import Pose, Rig, RigCalibration
from rcdn_lab.camera_scenes import CAMERAS, SPACING, random_boards

PINHOLE, BROWN = CAMERAS["pinhole"], CAMERAS["brown"]


@pytest.fixture(scope="module")
def pair():
    """Two calibrations of one camera from other boards."""
    return tuple(calibrate(random_boards(PINHOLE, seed, 6)[0], SPACING, model="pinhole") for seed in (0, 1))


@pytest.fixture
def run(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    return lambda *arguments: CliRunner().invoke(app, ["compare", *map(str, arguments)], catch_exceptions=False)


@pytest.fixture
def files(run, pair):
    for name, found in zip("ab", pair, strict=True):
        write_calibration(f"{name}.json", found)
    return "a.json", "b.json"


class Text(HTMLParser):
    def __init__(self, text):
        super().__init__()
        self.text, self.sources = "", []
        self.feed(text)

    def handle_data(self, data):
        self.text += data

    def handle_starttag(self, tag, attrs):
        self.sources += [v for k, v in attrs if k in ("src", "href") and not v.startswith(("#", "data:"))]


def test_two_calibrations_of_one_camera_agree(run, files):
    result = run(*files, "--json", "c.json", "--report", "c.html")
    assert result.exit_code == 0
    assert "They agree within their uncertainty: difference ÷ stated" in result.stdout
    assert "that the corners of both calibrations cover" in result.stdout
    record = json.loads(Path("c.json").read_text())
    assert record["kind"] == "camera difference"
    assert record["where"] == "seen"
    assert record["agreement"]["agree"]
    assert record["agreement"]["pictures_shared"] == 0
    vectors, inside = np.array(record["vectors"]), np.array(record["inside"], bool)
    assert record["rms"] == pytest.approx(np.sqrt((vectors[inside] ** 2).sum(axis=1).mean()), abs=1e-4)
    assert len(record["points"]) == len(vectors) == len(record["agreement"]["ratio"])
    page = Text(Path("c.html").read_text())
    assert "They agree within their uncertainty" in page.text
    assert page.sources == []


def test_camera_files_are_compared_without_a_judgement(run):
    write_camera("a.yaml", PINHOLE)
    write_camera("b.cameramodel", replace(PINHOLE, K=PINHOLE.K + np.diag([5.2, 5.15, 0])))
    result = run("a.yaml", "b.cameramodel", "--report", "c.html")
    assert result.exit_code == 0
    assert "over the frame:" in result.stdout
    assert "agree" not in result.stdout
    assert "Give two calibrations" in Text(Path("c.html").read_text()).text


def test_the_largest_is_told_to_be_that_of_the_points_which_the_corners_are_not(run):
    write_camera("a.yaml", PINHOLE)
    write_camera("b.yaml", replace(PINHOLE, K=PINHOLE.K * [[1.01, 1, 1], [1, 1.01, 1], [1, 1, 1]]))
    result = run("a.yaml", "b.yaml", "--json", "c.json", "--report", "c.html")
    record = json.loads(Path("c.json").read_text())
    assert np.linalg.norm(record["corners"], axis=2).max() > record["largest"]
    assert "Where B sees what A sees, at 2,700 points over the frame:" in result.stdout
    assert len(record["points"]) == sum(record["inside"]) == 2700
    assert "\n  largest of these " in result.stdout
    page = Text(Path("c.html").read_text()).text
    assert "The difference at 2,700 points over the frame, and elsewhere in the frame" in page
    assert "largest of these" in page


def test_a_camera_of_a_pair_is_named(run):
    write_stereo("pair.json", StereoCameras(PINHOLE, BROWN, np.eye(4)))
    refused = run("pair.json", "pair.json")
    assert refused.exit_code == 2
    assert "--camera-name left | right" in refused.stderr
    result = run("pair.json", "pair.json", "--camera-name", "left", "--camera-name", "right")
    assert result.exit_code == 0
    assert "A: pair.json: pinhole" in result.stdout
    assert "B: pair.json: brown" in result.stdout


def test_calibrations_of_a_rig_are_compared_by_camera_name(run, pair):
    turned = np.eye(4)
    turned[0, 3] = -0.2
    poses = Pose(np.eye(4)), Pose(turned)
    rig = Rig(("near", "far"), tuple(c.camera for c in pair), poses, np.zeros((12, 12)))
    alone = {"near": pair[0], "far": pair[1], "alone": pair[1]}
    write_rig_calibration("full.json", RigCalibration(rig, alone, {}, 0.1, (), (("near", "far"), ("alone",))))
    members = read_calibrations("full.json")
    assert {name: len(c.views) for name, c in members.items()} == {"near": 6, "far": 6, "alone": 6}
    result = run("full.json", "full.json", "--camera-name", "near", "--camera-name", "far", "--where", "seen")
    assert result.exit_code == 0, result.output
    assert "that the corners of both calibrations cover" in result.stdout
    assert "They agree within their uncertainty" in result.stdout
    lone = run("full.json", "full.json", "--camera-name", "alone", "--camera-name", "far")
    assert "6 views have the same corners in both" in lone.stdout


def test_a_rig_without_its_views_is_compared_like_cameras(run, pair):
    write_rig("rig.json", Rig(("near", "far"), tuple(c.camera for c in pair), (Pose(np.eye(4)), Pose(np.eye(4)))))
    assert read_calibrations("rig.json") == {}
    result = run("rig.json", "rig.json", "--camera-name", "near", "--camera-name", "far")
    assert result.exit_code == 0, result.output
    assert "over the frame:" in result.stdout


def test_a_calibration_beside_itself_shares_its_views(run, files):
    result = run(files[0], files[0])
    assert "6 views have the same corners in both" in result.stdout


def test_what_cannot_be_compared_is_said(run, files):
    write_camera("small.yaml", replace(PINHOLE, image_size=(320, 240)))
    sizes = run(files[0], "small.yaml")
    assert sizes.exit_code == 1
    assert "640×480 and 320×240" in sizes.stderr
    write_camera("whole.yaml", PINHOLE)
    assert "choose 'frame'" in run("whole.yaml", "whole.yaml", "--where", "seen").stderr
    assert run("whole.yaml", "none.yaml").exit_code == 1
    assert run(*files, *["--camera-name", "left"] * 3).exit_code == 2


def test_the_seen_area_is_that_of_both(pair):
    found = compare(*pair)
    corners = [np.concatenate([v.xy[v.used] for v in c.used_views]) for c in pair]
    low, high = np.max([c.min(axis=0) for c in corners], axis=0), np.min([c.max(axis=0) for c in corners], axis=0)
    points = found.found.points[found.inside]
    assert (points >= low).all()
    assert (points <= high).all()
    assert 0.3 < found.inside.mean() < 1
    assert compare(*pair, "frame").inside.all()


def test_a_calibration_without_a_covariance_is_compared_like_a_camera(pair):
    unknown = replace(pair[0], cov=np.nan * pair[0].cov)
    found = compare(unknown, pair[1])
    assert found.agreement is None
    assert found.over_area.rms > 0


def test_calibrations_of_given_lenses_are_compared_without_a_judgement(pair):
    one, other = (replace(c, cov=np.zeros_like(c.cov)) for c in pair)
    assert compare(one, other).agreement is None
    assert compare(one, other).over_area.rms > 0
    assert compare(one, pair[1]).agreement is not None


def test_too_small_an_area_is_refused(pair):
    few = replace(pair[0].views[0], used=np.arange(len(pair[0].views[0])) < 3)
    with pytest.raises(RcdnError, match="points in common"):
        compare(replace(pair[0], views=(few,)), pair[1])


def test_calibrations_of_a_file_are_read_by_name(run, files):
    assert [len(c.views) for c in read_calibrations(files[0]).values()] == [6]
    write_camera("camera.json", PINHOLE)
    assert read_calibrations("camera.json") == {}
