"""`rcdn evaluate coded`: its pictures, its parts and its goals, on boards that are rendered here."""

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from rcdn.cli import app
from rcdn.errors import FormatError
from rcdn.io import write_image
from rcdn.types import Charuco
from rcdn_lab import coded as suite
from rcdn_lab.coded import real, rendered, scenes, videos, without
from rcdn_lab.coded.goals import goals
from rcdn_lab.peers.coded import Labelled


@pytest.mark.parametrize("kind", scenes.KINDS)
def test_kinds_are_drawn_by_chance_and_again_the_same(kind):
    first, again, other = (scenes.made(kind, "half resolution", k) for k in (0, 0, 1))
    np.testing.assert_array_equal(first.image, again.image)
    assert (first.image != other.image).any()
    assert first.board.target == again.board.target
    assert first.image.shape == (240, 320)
    assert len(np.unique(first.board.ids)) == len(first.board.ids)
    assert first.board.demanded.sum() > 0.95 * len(first.board.ids)


def test_conditions_are_what_they_say():
    made = {name: scenes.made("charuco 5X5", name, 3) for name in scenes.CONDITIONS}
    plain = made["plain"]
    for name in ("noise 20", "noise 40", "blur 3", "dark", "cover"):
        np.testing.assert_array_equal(made[name].board.xy, plain.board.xy)
    assert (
        15 < (made["noise 20"].image.astype(float) - plain.image)[200:280, 280:360].std() < 22
    )  # black and white clip it
    assert 4 < plain.image.mean() / made["dark"].image.mean() < 6
    for name in ("cut", "cover"):
        assert 0.5 < made[name].board.demanded.mean() < scenes.LEFT + 0.1
    rvec = made["tilt 60"].scene.boards[0].rvec
    spec = made["tilt 60"].scene.boards[0]
    towards = np.array(spec.tvec) + cv2.Rodrigues(np.array(rvec))[0] @ [(spec.cols - 1) / 2, (spec.rows - 1) / 2, 0]
    cosine = cv2.Rodrigues(np.array(rvec))[0][:, 2] @ towards / np.linalg.norm(towards)
    assert np.rad2deg(np.arccos(cosine)) == pytest.approx(60, abs=0.01)


def test_opencv_reads_what_the_truth_says():
    """Told everything, on plain pictures of every family: its corners have the numbers of the truth."""
    rows = rendered.table(1, ["charuco"], ["plain"], ["opencv"])
    theirs = [r for r in rows if r["reader"] == "opencv"]
    assert len(theirs) == 10
    assert sum(r["wrong"] for r in theirs) == 0
    assert sum(r["right"] for r in theirs) > 0.9 * sum(r["corners"] for r in theirs)


def test_first_numbers_are_never_those_of_whole_pairs_of_rows():
    boards, parts = (
        [scenes.KINDS["charuco 4X4"](np.random.default_rng(k), part)[1] for k in range(40)] for part in (False, True)
    )
    assert [replace(board, first_id=0) for board in boards] == parts
    firsts = [board for board in boards if board.first_id]
    assert firsts
    assert all(board.first_id % board.columns for board in firsts)
    assert any(board.legacy for board in boards)
    assert any(board.inverted for board in boards)


def test_degraded_copies_are_the_same_each_time():
    image = scenes.made("charuco 4X4", "plain", 0).image
    for condition in real.CONDITIONS:
        copy, scale = real.degraded(image, condition, "a/b.png")
        np.testing.assert_array_equal(copy, real.degraded(image, condition, "a/b.png")[0])
        assert copy.shape == tuple(round(n * scale) for n in image.shape)
    assert (real.degraded(image, "noise 20", "a/b.png")[0] != real.degraded(image, "noise 20", "a/c.png")[0]).any()
    np.testing.assert_array_equal(real.degraded(image, real.AS_IT_IS, "a")[0], image)


def test_corners_of_a_halved_picture_are_where_its_pixels_are():
    image = np.zeros((40, 60), np.uint8)
    image[20:, 30:] = 255  # the corner between four pixels, at (29.5, 19.5)
    half, scale = real.degraded(image, "half", "a")
    assert half[10, 15] == 255
    assert half[9, 15] == half[10, 14] == 0
    board = replace(scenes.made("charuco 4X4", "plain", 0).board, xy=np.array([[29.5, 19.5]]))
    np.testing.assert_allclose(real.scaled(board, scale).xy, [[14.5, 9.5]])


def test_numbers_at_different_places_are_conflicts():
    xy = np.array([[10.0, 10], [50, 10], [90, 10]])
    a, b = Labelled(np.array([0, 1, 2]), xy), Labelled(np.array([1, 2, 7]), xy[1:].tolist() + np.zeros((1, 2)).tolist())
    b = Labelled(b.ids, np.array([[50.0, 12], [90, 14], [0, 0]]))
    assert videos.disagreement([a], [b]) == (2, 1)
    assert videos.disagreement([a], []) == (0, 0)
    assert videos.disagreement([a], [b, a]) == (3, 0)  # two boards of one kind


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A set of two labelled pictures, a video of eight frames, and a folder of a picture without codes."""
    root = tmp_path_factory.mktemp("coded")
    truth = {}
    for name, k in (("set/a.png", 0), ("set/b.png", 1)):
        made = scenes.made("charuco 4X4", "plain", k)
        t = made.board.target
        write_image(root / name, made.image) if (root / "set").mkdir(exist_ok=True) is None else None
        facts = {"squares": [t.columns, t.rows], "dictionary": t.dictionary, "legacy": t.legacy, "inverted": t.inverted}
        more = {"marker": t.marker, "first": t.first_id, "ids": made.board.ids.tolist(), "xy": made.board.xy.tolist()}
        truth[name] = [{"kind": "charuco", **facts, **more}]
    (root / "truth.json").write_text(json.dumps(truth | {"set/c.png": None}))
    _video(root / "rig", scenes.made("charuco 5X5", "plain", 0))
    (root / "none").mkdir()
    write_image(root / "none" / "d.png", without.scene_picture(0))
    return root


def _video(folder, made):
    t = made.board.target
    folder.mkdir()
    writer = cv2.VideoWriter(str(folder / "cam.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 10, (640, 480))
    for _ in range(3):
        writer.write(cv2.cvtColor(made.image, cv2.COLOR_GRAY2BGR))
    writer.release()
    flags = f"inverted = {str(t.inverted).lower()}\nlegacy_pattern = {str(t.legacy).lower()}"
    text = f'columns = {t.columns}\nrows = {t.rows}\ndictionary = "{t.dictionary}"\naruco_scale = {t.marker}\n{flags}\n'
    (folder / "charuco.toml").write_text(text)


def test_the_whole_command(folder, tmp_path):
    out = tmp_path / "coded.json"
    done = CliRunner().invoke(
        app,
        [
            "evaluate", "coded", str(folder), "--without", str(folder / "none"), "--scenes", "2", "--count", "1",
            "--kind", "charuco 6X6", "--condition", "plain", "--peers", "opencv", "-j", "1", "--json", str(out),
            "--pictures", str(tmp_path / "png"),
        ],
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    record = json.loads(out.read_text())
    assert record["suite"] == "coded"
    assert record["settings"]["parts"] == list(suite.PARTS)
    assert {"commit", "date", "platform"} <= set(record["provenance"])
    ours = [r for r in record["rows"] if r.get("reader") == "rcdn"]
    assert all(r.get("wrong", 0) == 0 for r in ours)
    (total,) = (r for r in ours if r["part"] == "real" and r["set"] == "ALL")
    assert (total["named"], total["recall"]) == (2, 1.0)
    (film,) = (r for r in ours if r["part"] == "videos" and r["set"] == "ALL")
    assert (film["frames"], film["labelled"], film["conflicts"]) == (3, 3, 0)
    (row,) = (r for r in record["rows"] if r.get("reader") == "rcdn told" and r["set"] == "ALL")
    assert (row["labelled"], row["conflicts"], row["other kind"]) == (3, 0, 0)
    assert [g for g in record["settings"]["goals"] if not g["passed"] and g["part"] != "degraded"] == []
    assert "pass  real: recall ≥ 0.98: 1" in done.output
    assert [p.name for p in (tmp_path / "png").iterdir()] == ["charuco_6X6,_plain,_0.png"]


def test_standard_output_has_one_record_of_all_parts():
    done = CliRunner().invoke(
        app,
        [
            "evaluate", "coded", "--part", "rendered", "--part", "no codes", "--kind", "charuco 6X6",
            "--condition", "plain", "--count", "1", "--scenes", "1", "--peers", "none", "-j", "1", "--json", "-",
        ],
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    assert json.loads(done.stdout)["settings"]["parts"] == ["rendered", "no codes"]


def test_goals_that_are_missed_are_said():
    row = {
        "part": "rendered",
        "set": "k",
        "condition": "plain",
        "reader": "rcdn",
        "goal": 0.98,
        "recall": 0.97,
        "wrong": 0,
        "other kind": 0,
    }
    assert [g.passed for g in goals([row])] == [False, True, True]
    assert [g.passed for g in goals([row | {"recall": 0.98, "wrong": 1}])] == [True, False, True]
    assert [g.passed for g in goals([row | {"recall": 1.0, "other kind": 1}])] == [True, True, False]
    # the worst kind counts, not the mean
    (first, *_) = goals([row | {"recall": 1.0}, row | {"set": "other"}])
    assert (first.passed, "other; 1 of 2" in first.got) == (False, True)
    assert not goals([{"part": "no codes", "set": "s", "of": ["a: b"]}])[0].passed
    assert goals([{"part": "no codes", "set": "s", "of": []}])[0].passed


def test_photographs_are_beside_opencv_all_together():
    row = {"part": "degraded", "set": "ALL", "wrong": 0, "other kind": 0}
    theirs = [row | {"reader": "opencv", "right": right, "ours": 90, "corners": 100} for right in (80, 20)]
    (ratio, *others) = goals([row | {"reader": "rcdn", "right": 90}, *theirs])
    assert (ratio.passed, ratio.got) == (True, "1.8 (all corners would be 2)")
    assert [g.passed for g in others] == [True, True]


def test_the_same_rows_whatever_the_workers():
    one, two = (rendered.table(1, ["aprilgrid tag16h5"], ["plain", "cut"], workers=n) for n in (1, 2))
    assert one == two


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--part", "real"], "needs DATA"),
        (["--part", "nothing"], "nothing is called nothing"),
        (["--part", "rendered", "--kind", "x"], "--kind"),
        (["--part", "rendered", "--condition", "x"], "--condition"),
        (["--peers", "x"], "no reader is called x"),
    ],
)
def test_wrong_arguments_are_told(arguments, message):
    done = CliRunner().invoke(app, ["evaluate", "coded", *arguments])
    assert done.exit_code == 2
    assert message in done.output


@pytest.mark.parametrize(
    "text", ["", "[]", '{"a/b.png": [{}]}', '{"a/b.png": [{"kind": "charuco", "ids": [0], "xy": [[1, 2]]}]}']
)
def test_truth_that_is_none_is_told(tmp_path, text):
    (tmp_path / "truth.json").write_text(text)
    with pytest.raises(FormatError, match=r"truth\.json"):
        real.truth_of(tmp_path)


def test_a_board_that_is_not_described_is_told(tmp_path):
    (tmp_path / "charuco.toml").write_text("columns = 4\n")
    with pytest.raises(FormatError, match=r"charuco\.toml"):
        videos.videos_of(tmp_path)


def test_sets_are_left_out(folder):
    assert [p.name for p in without.files_of([folder], skip=["set", "rig"])] == ["d.png"]
    assert [p.name for p in without.files_of([folder], skip=["a.png", "rig", "none"])] == ["b.png"]


def test_a_folder_of_labelled_boards_is_an_alarm(folder):
    rows = without.table([folder / "set"], (), 0)
    assert rows[-1]["alarms"] == 2
    assert all("ChArUco" in text for text in rows[0]["of"])


def test_legacy_and_columns_of_videos_are_judged():
    target = Charuco(4, 6, "DICT_4X4_50", 0.75, inverted=True)
    board = Labelled(np.arange(3), np.zeros((3, 2)), target)
    assert videos._is(target, board)
    assert not videos._is(target, replace(board, target=replace(target, legacy=True)))
    assert not videos._is(target, replace(board, target=replace(target, columns=5)))
