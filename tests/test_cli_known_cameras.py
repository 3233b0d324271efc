"""`rcdn calibrate --rig --camera` and `--stereo --camera`: files of known lenses, by name, in one file, in a folder."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from rcdn.batch.known_cameras import camera_paths, known_cameras, known_pair
from rcdn.batch.rig_runs import _and_beside_them
from rcdn.cli import app
from rcdn.errors import ConfigError, FormatError
from rcdn.io import read_camera, read_stereo_calibration, write_camera, write_rig
from rcdn.types import Pose, Rig
from rcdn_lab.camera_scenes import SPACING
from rcdn_lab.rig_scenes import row
from saved_boards import save

SCENE = row([0.2], ("brown",))


@pytest.fixture
def made(tmp_path, monkeypatch):
    """Detections of two cameras by order, files of their lenses."""
    monkeypatch.chdir(tmp_path)
    boards, moments = SCENE.views(np.random.default_rng(2), [(0, 1)] * 6)
    both = [m for m in moments["c0"] if m in moments["c1"]]
    for name, side in (("c0", "left"), ("c1", "right")):
        save(f"{side}.json", [boards[name][moments[name].index(m)] for m in both])
    left, right = SCENE.cameras.values()
    Path("lenses").mkdir()
    write_camera("lenses/left_camera_info.yaml", left)
    write_camera("lenses/right.yaml", right)
    Path("lenses/notes.txt").write_text("taken on Monday")
    rig = Rig(("left", "right"), (left, right), (Pose(np.eye(4)), Pose(np.eye(4))))
    for name in ("rig.json", "rig.toml", "camera_array.toml"):
        write_rig(name, rig)
    return left, right


def run(*words):
    return CliRunner().invoke(
        app, ["calibrate", "left.json", "right.json", *map(str, words), "--spacing", str(SPACING), "--no-cache"]
    )


def test_one_command_holds_the_lenses_of_a_folder(made):
    result = run("--rig", "--camera", "lenses", "--json", "all.json")
    assert result.exit_code == 0, result.output
    assert result.stdout.count("brown as given") == 2
    written = json.loads(Path("all.json").read_text())
    assert written["given"] == ["left", "right"]
    assert [c["camera"]["K"] for c in written["cameras"]] == [c.K.tolist() for c in made]


@pytest.mark.parametrize(
    "files", [["rig.json"], ["rig.toml"], ["lenses"], ["lenses/left_camera_info.yaml", "right=lenses/right.yaml"]]
)
def test_cameras_are_known_by_their_names(made, files):
    found = known_cameras([Path(f) for f in files], ["left", "right"])
    assert [found[n].parameters.tolist() for n in ("left", "right")] == [c.parameters.tolist() for c in made]


def test_numbers_of_a_file_count_in_order(made, capsys):
    found = known_cameras([Path("camera_array.toml")], ["left", "right"])
    assert found["right"].parameters.tolist() == made[1].parameters.tolist()


def test_some_may_be_known_and_the_others_not(made):
    assert list(known_cameras([Path("lenses/right.yaml")], ["left", "right"])) == ["right"]


@pytest.mark.parametrize(
    ("files", "names", "text"),
    [
        (["lenses/right.yaml"], ["a", "b"], "right is no input; the inputs are a, b"),
        (["rig.json"], ["left", "b", "c"], "right is no input"),
        (["lenses/right.yaml", "rig.json"], ["left", "right"], "right is given twice"),
        (["top=rig.json"], ["left", "right"], "holds the cameras left, right, not top"),
        (["left=lenses"], ["left", "right"], "is a folder"),
    ],
)
def test_names_that_dont_match_are_refused(made, files, names, text):
    with pytest.raises(ConfigError, match=text):
        known_cameras([Path(f) for f in files], names)


def test_a_folder_without_cameras_and_use_without_a_rig_are_refused(made):
    Path("empty").mkdir()
    with pytest.raises(ConfigError, match="no file in it holds one camera"):
        known_cameras([Path("empty")], ["left", "right"])
    result = run("--camera", "rig.json")
    assert result.exit_code == 2
    assert "--camera names lenses that are known, for --rig and --stereo" in result.stderr


@pytest.mark.parametrize(
    ("files", "sides"),
    [
        (["lenses"], [0, 1]),
        (["rig.json"], [0, 1]),
        (["lenses/right.yaml"], [None, 1]),
        (["left=lenses/right.yaml"], [1, None]),
        (["a/camera.yaml", "b/camera.yaml"], [0, 1]),
        (["b/camera.yaml", "a/camera.yaml"], [1, 0]),
    ],
)
def test_cameras_of_a_pair_are_known_by_name_or_order(made, files, sides):
    for folder, camera in zip("ab", made, strict=True):
        Path(folder).mkdir()
        write_camera(f"{folder}/camera.yaml", camera)
    found = known_pair([Path(f) for f in files], ["cam1", "cam0"])
    expected = [None if k is None else made[k].parameters.tolist() for k in sides]
    assert [None if c is None else c.parameters.tolist() for c in found] == expected


def test_files_with_the_names_of_the_inputs_are_theirs(made):
    write_camera("cam0.yaml", made[0])
    write_camera("cam1.yaml", made[1])
    found = known_pair([Path("cam0.yaml"), Path("cam1.yaml")], ["cam1", "cam0"])
    assert [c.parameters.tolist() for c in found] == [made[1].parameters.tolist(), made[0].parameters.tolist()]
    left, right = known_pair([Path("cam0.yaml")], ["cam1", "cam0"])
    assert left is None
    assert right.parameters.tolist() == made[0].parameters.tolist()


def test_a_file_called_right_is_not_the_left_camera(made):
    write_camera("foo.yaml", made[0])
    with pytest.raises(ConfigError, match="right, foo are no inputs"):
        known_pair([Path("lenses/right.yaml"), Path("foo.yaml")], ["cam0", "cam1"])


def test_known_lenses_are_written_whatever_the_views_settle(made, monkeypatch):
    asked = []
    monkeypatch.setattr("rcdn.batch.calibration_outputs.Outputs.kept", lambda self, *c: asked.append(len(c)) or True)
    for files in (["lenses"], ["lenses/right.yaml"], []):
        words = [w for f in files for w in ("--camera", f)]
        assert run("--stereo", *words, "--model", "brown", "--json", "pair.json").exit_code == 0
    assert asked == [0, 1, 2]


@pytest.mark.parametrize("given", ["lenses", "left=lenses/right.yaml", "lenses/right.yaml"])
def test_a_known_camera_is_not_overwritten(made, given):
    before = Path("lenses/right.yaml").read_bytes()
    result = run("--stereo", "--camera", given, "-o", "lenses/right.yaml")
    assert result.exit_code == 2
    assert "would overwrite an input" in result.stderr
    assert Path("lenses/right.yaml").read_bytes() == before


@pytest.mark.parametrize("file", ["rig.json", "rig.toml", "camera_array.toml", "rig_config.json"])
def test_one_camera_of_a_rig_is_chosen_by_its_name(made, file):
    if file == "rig_config.json":
        write_rig(file, Rig(("left", "right"), made, (Pose(np.eye(4)), Pose(np.eye(4)))))
    name = {"camera_array.toml": "1"}.get(file, "right")
    convert = CliRunner().invoke(app, ["convert", file, "one.yaml", "--camera-name", name])
    assert convert.exit_code == 0, convert.output
    assert read_camera("one.yaml").K.tolist() == made[1].K.tolist()
    unknown = CliRunner().invoke(app, ["convert", file, "two.yaml", "--camera-name", "top"])
    assert unknown.exit_code == 1
    assert "not 'top'" in unknown.stderr
    assert CliRunner().invoke(app, ["compare", file, "one.yaml", "--camera-name", name]).exit_code == 0


@pytest.mark.parametrize(("several", "output"), [("--stereo", "camera_info.yaml"), ("--rig", "lens.yaml")])
def test_nor_by_the_file_of_one_of_the_cameras(made, several, output):
    """`-o FILE` may be a file a camera, FILE_left and FILE_right."""
    given = Path("lenses") / f"{Path(output).stem}_left.yaml"
    Path("lenses/left_camera_info.yaml").rename(given)
    before = given.read_bytes()
    result = run(several, "--camera", f"left={given}", "-o", f"lenses/{output}")
    assert result.exit_code == 2
    assert f"{given}: that would overwrite an input" in result.stderr.replace("\n", " ")
    assert given.read_bytes() == before
    assert not Path(f"lenses/{Path(output).stem}_right.yaml").exists()


def test_what_a_format_cant_hold_of_a_known_lens_is_told_before_the_work(made):
    result = run("--stereo", "--camera", "lenses", "-o", "camchain.yaml")
    assert result.exit_code == 1
    assert "camchain.yaml can't be written" in result.stderr
    result = run("--stereo", "--model", "rational", "--camera", "lenses", "-o", "opencv.yaml")
    assert result.exit_code == 0, result.output


def test_a_pair_with_known_lenses(made):
    result = run("--stereo", "--camera", "lenses", "--report", "page.html", "--json", "pair.json")
    assert result.exit_code == 0, result.output
    assert "left: lens as given, brown" in result.stdout
    found = read_stereo_calibration("pair.json")
    assert found.given == ("left", "right")
    assert [c.camera.K.tolist() for c in (found.left, found.right)] == [c.K.tolist() for c in made]
    page = Path("page.html").read_text()
    assert page.count('<span class="tag">given</span>') == 2
    again = CliRunner().invoke(app, ["report", "pair.json", "-o", "again.html"])
    assert again.exit_code == 0, again.output
    assert Path("again.html").read_text() == page


@pytest.mark.parametrize(("several", "rectified"), [("--stereo", True), ("--rig", False)])
def test_what_a_rig_in_another_format_lacks_of_a_calibration_is_told(made, several, rectified):
    assert run(several, "--camera", "lenses", "--json", "whole.json").exit_code == 0
    result = CliRunner().invoke(app, ["convert", "whole.json", "whole.toml"])
    assert result.exit_code == 0, result.output
    said = result.stderr.splitlines()
    assert "whole.toml: holds the cameras; views, deviations and the verdict are in whole.json only" in said
    assert ("whole.toml: holds no rectification" in result.stderr) == rectified
    assert ("whole.toml: holds no covariance" in result.stderr) != rectified


def test_a_name_that_is_neither_left_nor_right_is_refused(made):
    result = run("--stereo", "--camera", "front=lenses/right.yaml")
    assert result.exit_code == 2
    assert "front is no input; the inputs are left, right" in result.stderr


def test_time_is_corrected_only_in_a_rig(made):
    result = run("--rig", "--camera", "lenses", "--correct-time")
    assert result.exit_code == 0, result.output
    result = run("--stereo", "--correct-time")
    assert result.exit_code == 2
    assert "--correct-time is for cameras of a rig" in result.stderr


def test_frames_beside_the_chosen_ones_are_looked_at():
    assert _and_beside_them(((0, 5, 9),)) == ((0, 1, 4, 5, 6, 8, 9),)


def test_a_rig_has_a_page(made):
    result = run("--rig", "--camera", "lenses", "--report", "page.html", "--json", "all.json")
    assert result.exit_code == 0, result.output
    page = Path("page.html").read_text()
    again = CliRunner().invoke(app, ["report", "all.json", "-o", "again.html"])
    assert again.exit_code == 0, again.output
    assert Path("again.html").read_text() == page
    for word in ("Who looks where", "Pair by pair", "epipolar, px", "left – right", "Lenses given", "data-look"):
        assert word in page


def test_what_a_format_cant_hold_is_told_before_the_work(made):
    result = run("--rig", "--model", "brown", "-o", "camchain.yaml", "-o", "cameras.json")
    assert result.exit_code == 1
    assert result.stderr.index("camchain.yaml is not written: camera left: Kalibr's camchain: radtan holds") >= 0
    assert Path("cameras.json").exists()
    result = run("--rig", "--model", "brown", "-o", "camchain.yaml")
    assert result.exit_code == 1
    assert "rig of 2 cameras" not in result.stdout


def test_one_camera_of_a_file_of_several_is_given_to_an_input(made):
    write_rig("old#rig.json", Rig(("cam0", "cam1"), made, (Pose(np.eye(4)),) * 2))
    one, other = (c.parameters.tolist() for c in made)
    found = known_cameras([Path("left=old#rig.json#cam1"), Path("right=old#rig.json#cam0")], ["left", "right"])
    assert [found[n].parameters.tolist() for n in ("left", "right")] == [other, one]
    assert list(known_cameras([Path("old#rig.json#cam1")], ["cam1", "cam7"])) == ["cam1"]
    assert known_pair([Path("right=old#rig.json#cam0")], ["a", "b"])[1].parameters.tolist() == one
    assert camera_paths([Path("left=old#rig.json#cam1")]) == [Path("old#rig.json")]
    with pytest.raises(ConfigError, match=r"say which one it is: left=old#rig\.json#cam0"):
        known_cameras([Path("left=old#rig.json")], ["left", "right"])
    with pytest.raises(FormatError, match="holds the cameras cam0, cam1; name one of them, not 'cam2'"):
        known_cameras([Path("left=old#rig.json#cam2")], ["left", "right"])


def ros_file(path, camera, name):
    """A ROS file of a camera, called `name` in it."""
    write_camera(path, camera, "ros")
    Path(path).write_text(Path(path).read_text().replace("camera_name: camera", f"camera_name: {name}"))


@pytest.mark.parametrize("prefix", ["", "narrow_stereo/"])
def test_the_name_in_a_file_says_which_camera_it_is(made, prefix, capsys):
    left, right = made
    ros_file("a.yaml", right, f"{prefix}right")
    ros_file("b.yaml", left, f"{prefix}left")
    found = known_pair([Path("a.yaml"), Path("b.yaml")], ["left", "right"])
    assert [c.parameters.tolist() for c in found] == [c.parameters.tolist() for c in made]
    assert [c and c.parameters.tolist() for c in known_pair([Path("a.yaml")], ["cam0", "cam1"])] == [
        None,
        right.parameters.tolist(),
    ]
    assert list(known_cameras([Path("a.yaml")], ["left", "right"])) == ["right"]
    assert list(known_cameras([Path("left=a.yaml")], ["left", "right"])) == ["left"]
    assert capsys.readouterr().err == ""


def test_the_name_in_a_file_of_a_rig_as_opencvs_yaml_counts(made):
    rig = Rig(("left", "right"), made, (Pose(np.eye(4)), Pose(np.eye(4))))
    write_rig("cv.yaml", rig)
    assert list(known_cameras([Path("cv_right.yaml")], ["left", "right"])) == ["right"]


@pytest.mark.parametrize("name", ["camera", "head_camera"])
def test_a_name_in_a_file_that_is_no_input_leaves_the_files_name(made, name, capsys):
    ros_file("right.yaml", made[1], name)
    assert list(known_cameras([Path("right.yaml")], ["camera", "right"])) == ["right"]
    assert capsys.readouterr().err == ""


def test_a_name_in_a_file_that_contradicts_the_files_name_is_told(made, capsys):
    ros_file("left.yaml", made[1], "right")
    assert list(known_cameras([Path("left.yaml")], ["left", "right"])) == ["right"]
    assert "left.yaml holds the camera right by its `camera_name`, left by the file's name" in capsys.readouterr().err
    ros_file("cam0.yaml", made[1], "right")
    left, right = known_pair([Path("cam0.yaml")], ["cam0", "cam1"])
    assert (left is None, right is None) == (False, True)
    assert "it is taken for cam0" in capsys.readouterr().err
    known_pair([Path("cam0.yaml")], ["cam1", "cam0"])
    assert capsys.readouterr().err == ""


def test_two_files_of_one_camera_in_a_folder_are_refused(made):
    write_camera("lenses/left.yaml", made[0])
    with pytest.raises(ConfigError, match="the camera left is given twice in this folder"):
        known_cameras([Path("lenses")], ["left", "right"])
