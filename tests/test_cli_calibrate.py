"""`rcdn calibrate` and `rcdn pose` on detections that were saved: outputs, exit codes, and what is said."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from rcdn.batch import pool
from rcdn.batch.calibration_runs import BoardReader
from rcdn.calibration.verdict import headline
from rcdn.io import (
    ImageResult,
    read_calibration,
    read_camera,
    read_rig,
    read_stereo,
    read_stereo_calibration,
    write_camera,
    write_detections,
    write_image,
)
from rcdn.synthetic import BoardSpec, Scene, render
from rcdn.types import Corners
from rcdn_lab.camera_scenes import CAMERAS, SPACING, board, random_boards, random_pose, see

PINHOLE = CAMERAS["pinhole"]
FAST = ("--model", "pinhole", "--spacing", SPACING)


def save(path, boards, name="{:02d}.png", errors=()):
    """Detections of a board a picture."""
    images = [
        ImageResult(name.format(k), *b.image_size, Corners(b.xy, b.response, b.status, sigma=b.sigma), (b,))
        for k, b in enumerate(boards)
    ]
    write_detections(path, images, errors)
    return path


@pytest.fixture
def found(run):
    return save("found.json", random_boards(PINHOLE, 3, 6)[0])


def fine(result):
    assert result.exit_code == 0, result.output
    assert "Traceback" not in result.output
    return result


# ---- one camera


def test_the_camera_is_said_with_deviations_and_nothing_is_written_unasked(run, found):
    result = fine(run("calibrate", found, *FAST))
    assert result.stdout.startswith("Fair: usable with care. Only 6 views")
    assert "\npinhole camera, 640×480 px: 6 of 6 views" in result.stdout
    (fx,) = [line.split() for line in result.stdout.splitlines() if line.split()[:1] == ["fx"]]
    assert float(fx[1]) == pytest.approx(520, abs=5 * float(fx[3]))
    assert "RMS 0.2" in result.stdout
    assert result.stdout.count("Only 6 views") == 1
    assert "nothing is written" in result.stderr
    assert [p.name for p in Path().iterdir() if p.is_file()] == ["found.json"]


def test_pictures_without_a_board_are_named(run):
    boards = random_boards(PINHOLE, 3, 6)[0]
    images = [
        ImageResult(f"{k}.png", 640, 480, Corners(b.xy, b.response, b.status), (b,) * (k != 4))
        for k, b in enumerate(boards)
    ]
    write_detections(Path("some.json"), images)
    result = fine(run("calibrate", "some.json", *FAST))
    assert "no board was found in 1 of 6 pictures: 4.png" in result.stderr
    assert "5 of 5 views" in result.stdout


def test_the_verdict_is_one_and_may_be_a_failure(run, found):
    result = run("calibrate", found, *FAST, "--json", "a.json", "--report", "a.html", "--fail-on", "fair")
    assert result.exit_code == 1
    done = read_calibration("a.json")
    assert done.verdict.level == "fair"
    assert result.stdout.startswith(headline(done.verdict))
    assert done.verdict.against[0].sentence in Path("a.html").read_text("utf-8")
    assert fine(run("calibrate", found, *FAST, "--fail-on", "unsure")).exit_code == 0


FILES = ["camera.yaml", "camera_info.yaml", "camchain.yaml", "cameras.txt", "camera.cameramodel", "camera.json"]


def test_every_format_is_written_and_read_back(run, found):
    outputs = [part for name in FILES for part in ("-o", name)]
    result = fine(run("calibrate", found, *FAST, *outputs, "--json", "all.json", "--report", "report.html"))
    done = read_calibration("all.json")
    assert len(done.views) == 6
    assert done.camera.parameters == pytest.approx(PINHOLE.parameters, abs=10)
    for name in FILES:
        assert read_camera(name).parameters[:4] == pytest.approx(done.camera.parameters[:4], abs=1e-6), name
        assert name in result.stderr
    assert read_camera("all.json").parameters == pytest.approx(done.camera.parameters)
    assert "<html" in Path("report.html").read_text()
    assert "</html>" in Path("report.html").read_text()


def test_the_format_can_be_named(run, found):
    fine(run("calibrate", found, *FAST, "-o", "a.yaml", "--format", "ros"))
    assert "camera_matrix" in Path("a.yaml").read_text()
    assert "image_width" in Path("a.yaml").read_text()


def test_views_left_out_are_named(run):
    boards, _ = random_boards(PINHOLE, 3, 8)
    boards[2] = board(boards[2].ij, np.random.default_rng(0).permutation(boards[2].xy), (640, 480))
    result = fine(run("calibrate", save("d.json", boards), *FAST))
    assert "7 of 8 views" in result.stdout
    assert "left out: 02.png: " in result.stdout


def test_the_board_s_size_and_shape(run):
    boards, _ = random_boards(PINHOLE, 3, 7, whole=True)
    d = save("d.json", [*boards, random_boards(PINHOLE, 4, 1, size=(7, 7), whole=True)[0][0]])
    result = fine(run("calibrate", d, *FAST, "--board", "9x6"))
    assert "board 9×6" in result.stdout
    assert "can't be part of a 9×6 board" in result.stdout
    assert "off their places in its plane, bent by" in result.stdout
    flat = fine(run("calibrate", d, *FAST, "--board", "9x6", "--flat", "--json", "flat.json"))
    assert "bent by" not in flat.stdout
    assert read_calibration("flat.json").shape is None


def test_wrong_use_is_2(run, found):
    cases = {
        ("calibrate", found): "spacing",
        ("calibrate", found, "--spacing", "0"): "metres",
        ("calibrate", found, "--spacing", "-1"): "metres",
        ("calibrate", found, "--spacing", "nan"): "metres",
        ("calibrate", found, *FAST[2:], "--model", "pinhol"): "pinhol",
        ("calibrate", found, *FAST, "--json", found): "overwrite",
        ("calibrate", found, *FAST, "--json", "a.png"): "overwrite",
        ("calibrate", found, *FAST, "--report", "a.jpg"): "overwrite",
        ("calibrate", found, *FAST, "--board", "9"): "9",
        ("calibrate", found, *FAST, "--stereo"): "LEFT and RIGHT",
        ("calibrate", "empty", *FAST): "nothing to read",
        ("pose", found, "--camera", "a.yaml", "--spacing", "0"): "spacing",
        ("pose", found, "--spacing", "0.03"): "camera",
    }
    Path("empty").mkdir()
    before = Path(found).read_bytes()
    for arguments, text in cases.items():
        result = run(*arguments)
        assert result.exit_code == 2, (arguments, result.output)
        assert text in result.stderr, arguments
        assert "Traceback" not in result.output
    assert Path(found).read_bytes() == before


def test_an_unknown_ending_is_wrong_use(run, found):
    result = run("calibrate", found, *FAST, "-o", "camera.xyz")
    assert "camera.xyz: which format?" in result.stderr
    assert result.exit_code == 2


def test_too_little_is_1_and_says_what_to_do(run):
    few = save("few.json", random_boards(PINHOLE, 3, 2)[0])
    result = run("calibrate", few, *FAST, "-o", "camera.yaml")
    assert result.exit_code == 1
    assert "2 views" in result.stderr
    assert "10 to 30 pictures" in result.stderr
    assert not Path("camera.yaml").exists()
    none = save("none.json", [])
    result = run("calibrate", none, *FAST)
    assert result.exit_code in (1, 2)
    assert "no board" in result.stderr or "nothing" in result.stderr


def test_one_bad_file_is_1_but_the_camera_is_written(run, found):
    Path("bad.json").write_text("{}")
    result = run("calibrate", found, "bad.json", *FAST, "-o", "camera.yaml")
    assert result.exit_code == 1
    assert "error: bad.json" in result.stderr
    assert read_camera("camera.yaml").K[0, 0] == pytest.approx(520, rel=0.03)


def test_pictures_are_looked_at_once(run):
    """Rendered boards of 7 × 5 corners through the network; the second run knows them."""
    for k, (tilt, at) in enumerate(
        [((0.5, 0), (-3, -2)), ((0, 0.5), (-2, -1)), ((-0.4, 0.3), (-4, -3)), ((0.4, 0.4), (-3, -1))]
    ):
        scene = Scene(320, 240, 300.0, (159.5, 119.5), boards=(BoardSpec(7, 5, (*tilt, 0.1 * k), (*at, 13.0)),), seed=k)
        write_image(Path(f"{k}.png"), render(scene))
    arguments = ("calibrate", "*.png", *FAST, "--cache", "kept", "--json")
    fine(run(*arguments, "one.json"))
    known = []
    compute = pool.compute
    with pytest.MonkeyPatch.context() as patch:
        noted = lambda picture: known.append(picture.known is not None) or picture  # noqa: E731
        patch.setattr(pool, "compute", lambda pictures, *rest: compute(map(noted, pictures), *rest))
        fine(run(*arguments, "two.json"))
    assert known == [True] * 4
    assert Path("one.json").read_bytes() == Path("two.json").read_bytes()
    found = read_calibration("one.json")
    assert found.camera.K[0, 0] == pytest.approx(300, abs=5 * found.std[0] + 1)
    assert found.rms < 0.3


# ---- two cameras


def rig():
    T = np.eye(4)
    T[0, 3] = -0.1
    rng, left, right = np.random.default_rng(0), [], []
    while len(left) < 6:
        pose = random_pose(rng, 0.3, 0.7, (0.4, 0.8))
        seen = [see(PINHOLE, pose), see(PINHOLE, T @ pose)]
        if min(len(s[0]) for s in seen) == 54:
            for out, (ij, xy) in zip((left, right), seen, strict=True):
                out.append(board(ij, xy + rng.normal(0, 0.1, xy.shape), (640, 480)))
    return left, right


@pytest.mark.parametrize(
    ("one", "two"), [("a/{:02d}.png", "b/{:02d}.png"), ("left_{}.png", "right_{}.png"), ("x{}.png", "y.{}z.png")]
)
def test_stereo_by_names_or_order(run, one, two):
    left, right = rig()
    a, b = save("l.json", left, one), save("r.json", right, two)
    result = fine(
        run("calibrate", a, b, "--stereo", *FAST, "-o", "camchain.yaml", "-o", "stereo.yaml", "--json", "s.json")
    )
    done = read_stereo_calibration("s.json")
    assert done.baseline == pytest.approx(0.1, rel=0.02)
    assert "baseline 0.1" in result.stdout or "baseline 0.09" in result.stdout
    for name in ("camchain.yaml", "stereo.yaml"):
        assert read_stereo(name).T_right_left == pytest.approx(done.T_right_left, abs=1e-9)


def test_stereo_report_and_pictures_in_another_order(run):
    left, right = rig()
    a, b = save("l.json", left, "a/{}.png"), Path("r.json")
    images = [
        ImageResult(f"b/{k}.png", 640, 480, Corners(x.xy, x.response, x.status), (x,)) for k, x in enumerate(right)
    ]
    write_detections(b, images[::-1], ())
    fine(run("calibrate", a, b, "--stereo", *FAST, "--report", "r.html", "--json", "s.json"))
    assert read_stereo_calibration("s.json").rms < 0.2
    assert "</html>" in Path("r.html").read_text()


def test_both_cameras_of_a_pair_may_see_the_board_from_behind(run, monkeypatch):
    asked = []
    monkeypatch.setattr(BoardReader, "seen_from_behind", lambda _, name, inputs, got: asked.append(name) or got)
    left, right = rig()
    fine(run("calibrate", save("l.json", left), save("r.json", right), "--stereo", *FAST))
    assert asked == ["left", "right"]


def test_stereo_that_does_not_pair(run):
    left, right = rig()
    a, b = save("l.json", left, "dawn{0}.png"), save("r.json", right[:4], "{0}x{0}blue7.png")
    result = run("calibrate", a, b, "--stereo", *FAST)
    assert result.exit_code == 2
    assert "don't pair by name" in result.stderr
    result = run("calibrate", save("l.json", left), save("r.json", [*right[1:], right[0]]), "--stereo", *FAST)
    assert result.exit_code == 1
    assert "pairs agree" in result.stderr


def test_stereo_with_a_file_of_pairs(run):
    left, right = rig()
    order = [3, 1, 4, 0, 2, *range(5, len(right))]
    a, b = save("l.json", left, "dawn{0}.png"), save("r.json", [right[k] for k in order], "x{}.png")
    assert run("calibrate", a, b, "--stereo", *FAST).exit_code == 1
    lines = [f"dawn{k} x{order.index(k)}.png" for k in range(len(left))]
    Path("pairs.txt").write_text("\n".join(lines))
    result = fine(run("calibrate", a, b, "--stereo", *FAST, "--pairs", "pairs.txt", "--json", "s.json"))
    assert read_stereo_calibration("s.json").baseline == pytest.approx(0.1, rel=0.02)
    assert "paired by" not in result.stderr
    Path("pairs.txt").write_text("\n".join([*lines, "dusk x9"]))
    result = run("calibrate", a, b, "--stereo", *FAST, "--pairs", "pairs.txt")
    assert result.exit_code == 2
    assert f"line {len(lines) + 1}: no picture of the left camera is called dusk" in result.stderr
    result = run("calibrate", a, *FAST, "--pairs", "pairs.txt")
    assert result.exit_code == 2
    assert "give it with --stereo" in result.stderr


def test_a_rig_with_a_file_of_moments(run):
    left, right = rig()
    order = [3, 1, 4, 0, 2, *range(5, len(right))]
    a, b = save("l.json", left, "dawn{0}.png"), save("r.json", [right[k] for k in order], "{}x.png")
    result = run("calibrate", a, b, "--rig", *FAST)
    assert result.exit_code == 1
    assert "name those of one moment: --moments moments.txt" in result.stderr
    Path("moments.txt").write_text("\n".join(f"dawn{k} {order.index(k)}x.png" for k in range(len(left))))
    result = fine(run("calibrate", a, b, "--rig", *FAST, "--moments", "moments.txt", "-o", "rig.json"))
    assert "belong together by" not in result.stderr
    assert np.linalg.norm(read_rig("rig.json").relative("l", "r")[0][:3, 3]) == pytest.approx(0.1, rel=0.02)
    Path("moments.txt").write_text("dawn0 9x")
    result = run("calibrate", a, b, "--rig", *FAST, "--moments", "moments.txt")
    assert result.exit_code == 2
    assert "line 1: no picture of r is called 9x (it has 6, such as 0x.png)" in result.stderr


def test_stereo_says_how_it_paired_by_order(run):
    left, right = rig()
    result = fine(
        run("calibrate", save("l.json", left, "{}dawn.png"), save("r.json", right, "{}dusk.png"), "--stereo", *FAST)
    )
    assert "paired by number" in result.stderr
    assert "--pairs pairs.txt, a file with a line for each, such as `0dawn.png 0dusk.png`" in result.stderr


def test_a_format_that_cannot_hold_the_pair_does_not_stop_the_others(run):
    left, right = rig()
    a, b = save("l.json", left), save("r.json", right)
    files = ("-o", "cameras.txt", "-o", "stereo.yaml", "--json", "s.json", "--report", "r.html")
    result = run("calibrate", a, b, "--stereo", *FAST, *files)
    assert result.exit_code == 1
    assert "error: cameras.txt is not written: COLMAP" in result.stderr
    assert "written: stereo.yaml, s.json, r.html" in result.stderr
    assert all(Path(name).exists() for name in ("stereo.yaml", "s.json", "r.html"))


# ---- poses


def test_poses_as_text_and_json(run, found):
    fine(run("calibrate", found, *FAST, "-o", "camera.yaml"))
    boards, truth = random_boards(PINHOLE, 5, 3, whole=True)
    d = save("d.json", boards)
    result = fine(run("pose", d, "--camera", "camera.yaml", "--spacing", SPACING, "--json", "poses.json"))
    lines = result.stdout.splitlines()
    assert [line.split()[0] for line in lines] == ["00.png", "01.png", "02.png"]
    written = json.loads(Path("poses.json").read_text())
    assert written["spacing"] == SPACING
    for record, T, line in zip(written["poses"], truth, lines, strict=True):
        assert np.array(record["T_cam_board"])[:3, 3] == pytest.approx(T[:3, 3], abs=0.03)
        assert np.array(record["cov"]).shape == (6, 6)
        assert float(re.search(r"z (\S+)", line)[1]) == pytest.approx(record["T_cam_board"][2][3], abs=1e-5)
        assert not record["ambiguous"]


def test_poses_of_another_picture_size_or_no_board(run, found):
    fine(run("calibrate", found, *FAST, "-o", "camera.yaml"))
    small = [board(b.ij, b.xy / 2, (320, 240)) for b in random_boards(PINHOLE, 5, 1)[0]]
    result = run("pose", save("d.json", small), "--camera", "camera.yaml", "--spacing", SPACING)
    assert result.exit_code == 1
    assert "320×240" in result.stderr
    assert "no board was found" not in result.stderr
    Path("empty.png").write_bytes(b"")
    result = run("pose", "empty.png", "--camera", "camera.yaml", "--spacing", SPACING)
    assert result.exit_code == 1
    assert len(result.stderr.splitlines()) == 1
    result = run("pose", found, "--camera", "camera.yaml", "--spacing", SPACING, "--board", "5x4")
    assert result.exit_code == 1
    assert "no pose" in result.stderr
    result = run("pose", found, "--camera", "missing.yaml", "--spacing", SPACING)
    assert result.exit_code in (1, 2)
    assert "missing.yaml" in result.stderr


@pytest.mark.parametrize(
    ("verb", "words"),
    [("calibrate", ("--spacing", "--stereo", "--flat", "Exit code")), ("pose", ("--camera", "--spacing", "Exit code"))],
)
def test_help(run, verb, words):
    text = fine(run(verb, "--help")).stdout
    assert all(word in text for word in words)


def test_a_picture_is_left_out_by_hand(run, found):
    result = fine(
        run("calibrate", found, *FAST, "--leave-out", "02.png", "--json", "all.json", "--report", "page.html")
    )
    assert "5 of 6 views" in result.stdout
    assert "left out: 02.png: left out by hand" in result.stdout
    assert [v.name for v in read_calibration("all.json").left_out] == ["02.png"]
    assert "--leave-out 03.png" in Path("page.html").read_text()
    wrong = run("calibrate", found, *FAST, "--leave-out", "2.png")
    assert wrong.exit_code == 2
    assert "did you mean 02.png" in wrong.stderr
    pair = run("calibrate", "--stereo", found, found, *FAST, "--leave-out", "02.png")
    assert pair.exit_code == 2
    assert "--leave-out is for one camera" in pair.stderr


def test_the_pictures_that_tell_most_are_selected(run):
    found = save("many.json", random_boards(PINHOLE, 3, 14)[0])
    result = fine(run("calibrate", found, *FAST, "--select", "8", "--json", "some.json"))
    assert "8 of 14 pictures with a board are used" in result.stderr
    some = read_calibration(Path("some.json"))
    assert len(some.views) == 8
    assert some.camera.K[0, 0] == pytest.approx(520, abs=5)
    fine(run("calibrate", found, *FAST, "--select", "8", "--leave-out", some.views[0].name, "--json", "others.json"))
    assert some.views[0].name not in [v.name for v in read_calibration(Path("others.json")).views]
    pair = run("calibrate", "--stereo", found, found, *FAST, "--select", "8")
    assert pair.exit_code == 2
    assert "--select is for one camera" in pair.stderr


def test_where_to_hold_the_board_next_is_said_and_drawn(run):
    """Boards in the middle of the frame: the advice leads out of it."""
    found = save("few.json", random_boards(CAMERAS["brown"], 7, 6, whole=True, spread=0.1)[0])
    result = fine(run("calibrate", found, "--model", "brown", "--spacing", SPACING, "--report", "page.html"))
    (line,) = [line for line in result.stdout.splitlines() if line.startswith("- Next picture: Hold the board in the ")]
    assert "the worst projection uncertainty would fall from" in line
    assert line.removeprefix("- Next picture: ") in Path("page.html").read_text()


# ---- wrong inputs


@pytest.mark.parametrize("verb", [("calibrate", "--spacing", SPACING), ("undistort", "camera.json", "--out", "flat")])
def test_a_bag_of_ros_is_named_as_what_it_is(run, verb):
    write_camera("camera.json", PINHOLE)
    Path("run.mcap").write_bytes(b"\x89MCAP0\r\n" * 9)
    result = run(*verb[:2], "run.mcap", *verb[2:]) if verb[0] == "undistort" else run(verb[0], "run.mcap", *verb[1:])
    assert result.exit_code == 1
    assert "run.mcap: a bag of ROS, by its ending, is not read; write the pictures" in result.stderr
    assert "0 pictures" not in result.stderr


def test_a_folder_in_place_of_a_file_is_said(run):
    Path("photos").mkdir()
    result = run("convert", "photos", "a.yaml")
    assert result.exit_code == 1
    assert result.stderr == "error: photos: a folder, where a file is needed; name a file in it\n"


@pytest.mark.parametrize("option", [("--model", "brwn"), ("--fail-on", "worst")])
def test_a_wrong_choice_is_said_in_plain_words(run, found, option):
    result = run("calibrate", found, "--spacing", SPACING, *option)
    assert result.exit_code == 2
    assert option[1] in result.stderr
    assert "Value error" not in result.stderr


def test_kalibr_advises_the_model_that_it_holds(run):
    write_camera("camera.json", CAMERAS["brown"])
    result = run("convert", "camera.json", "camchain.yaml")
    assert result.exit_code == 1
    assert "`rcdn calibrate --model radtan`" in result.stderr


@pytest.mark.parametrize(
    ("name", "part"),
    [("ros.yaml", "camera_info"), ("left_kalibr.yml", "camchain"), ("across.yaml", ""), ("ros.json", "")],
)
def test_a_name_that_sounds_like_another_format_is_noted(run, name, part):
    write_camera("camera.json", PINHOLE)
    result = run("convert", "camera.json", name)
    assert result.exit_code == 0
    assert ("written as OpenCV's YAML" in result.stderr) == bool(part)
    assert part in result.stderr
