"""`rcdn convert`: every pair of formats, what is refused, and what is said."""

from pathlib import Path

import numpy as np
import pytest
from camera_files import FORMATS, LENSES, SIZE, UNHELD, K, camera, same_camera
from test_stereo_files import HOLD_STEREO, HOLD_TURNS, pair, same_pair
from typer.testing import CliRunner

from rcdn.cli import app
from rcdn.io import (
    ImageResult,
    camera_format,
    read_camera,
    read_detections,
    read_stereo,
    read_vnl,
    write_camera,
    write_detections,
    write_rig,
    write_stereo,
)
from rcdn.io.cameras import camera_names
from rcdn.types import Board, Camera, Corners, LensCorrection, Pose, Rig

NAMES = {
    "opencv": "a.yaml",
    "ros": "camera_info.yaml",
    "kalibr": "camchain.yaml",
    "colmap": "cameras.txt",
    "mrcal": "a.cameramodel",
    "json": "a.json",
}


@pytest.fixture
def run(monkeypatch, tmp_path):
    """Run `rcdn convert ARGUMENTS` in a temporary folder."""
    monkeypatch.chdir(tmp_path)

    def go(*arguments):
        return CliRunner().invoke(app, ["convert", *map(str, arguments)], catch_exceptions=False)

    return go


# ---- cameras


@pytest.mark.parametrize("lens", LENSES)
def test_every_format_becomes_every_other_or_is_refused(run, lens):
    for source in FORMATS:
        if (source, lens) in UNHELD:
            continue
        Path("in").mkdir(exist_ok=True)
        write_camera(f"in/{NAMES[source]}", camera(lens))
        for target in FORMATS:
            result = run(f"in/{NAMES[source]}", NAMES[target])
            if (target, lens) in UNHELD:
                assert result.exit_code == 1
                assert not Path(NAMES[target]).exists()
                assert " write " in result.stderr
                continue
            assert (result.exit_code, result.stdout) == (0, ""), result.stderr
            same_camera(read_camera(NAMES[target]), camera(lens))
            Path(NAMES[target]).unlink()


@pytest.mark.parametrize("target", HOLD_STEREO)
@pytest.mark.parametrize("source", ["opencv", "ros", "json"])
def test_pairs_are_converted(run, source, target):
    files = write_stereo("in" + Path(NAMES[source]).suffix, pair(), source)
    result = run(*files, "out.txt", "--to", target)
    assert result.exit_code == 0, result.stderr
    written = sorted(Path().glob("out*"))
    same_pair(read_stereo(*written), pair(rectified=target in HOLD_TURNS), turns=target in HOLD_TURNS)
    assert ("holds no rectification" in result.stderr) == (target not in HOLD_TURNS)


@pytest.mark.parametrize("out", ["pair.toml", "pair_rig_config.json", "camera_array.toml"])
@pytest.mark.parametrize("name", ["in.yaml", "in_camera_info.yaml", "in.json"])
def test_a_rig_that_holds_no_rectification_is_told_so(run, name, out):
    result = run(*write_stereo(name, pair()), out)
    assert result.exit_code == 0, result.stderr
    assert f"{out}: holds no rectification, which a rig has no place for" in result.stderr
    result = run(*write_stereo("plain.yaml", pair(rectified=False)), out)
    assert "rectification" not in result.stderr


def test_one_camera_of_a_pair_and_a_pair_where_there_is_no_place_for_it(run):
    write_stereo("pair.json", pair())
    assert run("pair.json", "left.yaml", "--camera-name", "left").exit_code == 0
    same_camera(read_camera("left.yaml"), pair().left)
    result = run("pair.json", "cameras.txt")
    assert (result.exit_code, Path("cameras.txt").exists()) == (1, False)
    assert "no place for the pose of a pair" in result.stderr
    result = run("pair.json", "pair.cameramodel")
    assert result.exit_code == 0
    assert "written: pair_left.cameramodel, pair_right.cameramodel\n" in result.stderr
    assert Path("pair_left.cameramodel").exists()
    assert Path("pair_right.cameramodel").exists()
    result = run("pair.json", "maps.npz")
    assert "written: maps_left.npz, maps_right.npz\n" in result.stderr
    result = run("pair.json", "-", "--to", "ros")
    assert result.exit_code == 2
    assert [p.name for p in Path().iterdir() if "-" in p.name] == []


def chain_of_three(path):
    """A camchain whose last camera has a lens that isn't read."""
    write_rig(path, Rig(("a", "b", "c"), (camera("brown4"),) * 3, (Pose(np.eye(4)),) * 3))
    head, mark, last = Path(path).read_text().partition("cam2:")
    Path(path).write_text(head + mark + last.replace("camera_model: pinhole", "camera_model: omni"))


def test_a_camera_is_chosen_beside_others_that_cannot_be_read(run):
    chain_of_three("camchain.yaml")
    assert camera_names("camchain.yaml") == ["cam0", "cam1", "cam2"]
    assert run("camchain.yaml", "one.json", "--camera-name", "cam1").exit_code == 0
    same_camera(read_camera("one.json"), camera("brown4"))
    same_camera(read_camera("camchain.yaml", name="cam0"), camera("brown4"))
    other = CliRunner().invoke(app, ["compare", "camchain.yaml", "one.json", "--camera-name", "cam0"])
    assert other.exit_code == 0, other.output
    for name, words in (("cam2", "'camera_model' must be pinhole, not 'omni'"), ("cam7", "not 'cam7'")):
        result = run("camchain.yaml", "two.json", "--camera-name", name)
        assert result.exit_code == 1
        assert words in result.stderr
    result = run("camchain.yaml", "all.json")
    assert "cam2: 'camera_model' must be pinhole" in result.stderr
    assert "or choose one of its cameras: --camera-name cam0 | cam1 | cam2" in result.stderr


def test_of_cameras_without_places_one_is_chosen(run):
    lines = [f"{k} SIMPLE_RADIAL 640 480 620 320 240 -0.2\n" for k in (1, 2, 7)]
    Path("cameras.txt").write_text("".join(lines))
    result = run("cameras.txt", "one.yaml")
    assert result.exit_code == 1
    assert "holds the cameras 1, 2, 7, but not where they stand" in result.stderr
    assert "choose one of its cameras: --camera-name 1 | 2 | 7" in result.stderr
    Path("cameras.txt").write_text("".join([*lines[:2], lines[2].replace("SIMPLE_RADIAL", "FOV")]))
    assert run("cameras.txt", "one.yaml", "--camera-name", "2").exit_code == 0


def test_a_lens_that_a_format_only_comes_near_is_written_on_demand(run):
    bumps = LensCorrection(0.01 * np.random.default_rng(3).normal(size=(6, 7, 2)), np.array([1.0, 0.8]))
    splined = Camera(K, np.array([-0.1, 0.02, 0, 0, 0]), SIZE, "brown", bumps)
    write_camera("s.json", splined)
    result = run("s.json", "camera_info.yaml")
    assert (result.exit_code, Path("camera_info.yaml").exists()) == (1, False)
    assert "can't hold the camera's lens: best fit of " in result.stderr
    assert "--lossy" in result.stderr
    result = run("s.json", "camera_info.yaml", "--lossy")
    assert result.exit_code == 0
    assert "px RMS" in result.stderr
    assert read_camera("camera_info.yaml").correction is None
    assert run("s.json", "t.json").exit_code == 0
    assert np.array_equal(read_camera("t.json").correction.control, bumps.control)


def test_maps_and_standard_output(run):
    write_camera("a.json", camera())
    assert run("a.json", "maps.npz").exit_code == 0
    assert np.load("maps.npz")["map_x"].shape == SIZE[::-1]
    result = run("a.json", "-", "--to", "ros", "-q")
    assert result.stderr == ""
    Path("b.yaml").write_text(result.stdout)
    same_camera(read_camera("b.yaml", "ros"), camera())


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (["a.json"], 2, "IN OUT"),
        (["a.json", "a.json"], 2, "is read and written"),
        (["a.json", "link.json"], 2, "is read and written"),
        (["a.json", "b.dat"], 1, "which format"),
        (["a.csv", "b.json"], 1, "a.csv: CSV is written, not read"),
        (["a.json", "-"], 1, "standard output; name its format with --to: opencv, ros"),
        (["a.json", "b.vnl"], 1, "holds no detections"),
        (["a.json", "b.csv"], 1, "holds no detections"),
        (["a.json", "b.yaml", "--to", "csv"], 1, "holds no detections"),
        (["missing.json", "b.yaml"], 1, "no such file"),
        (["missing.vnl", "b.json"], 1, "no such file"),
        (["a.json", "a.json", "a.json", "b.yaml"], 2, "one camera file"),
        (["a.json", "b.yaml", "--camera-name", "right"], 1, "name one of them"),
        (["a.json", "b.png"], 2, "overwrite a picture"),
        (["d.json", "b.yaml"], 1, "as json, vnl or csv; end the name with one"),
        (["d.json", "-"], 1, "as json, vnl or csv; name one with --to"),
        (["d.json", "d.json", "b.vnl"], 2, "file by file"),
        (["d.json", "d.vnl", "--image-size", "640x480"], 2, "--image-size has no effect: d.json tells the size"),
        (["d.json", "d.vnl", "--camera-name", "left"], 2, "--camera-name has no effect: d.json holds detections"),
        (["d.json", "d.vnl", "--lossy"], 2, "--lossy has no effect: d.json holds detections"),
        (["d.json", "d.csv", "--board", "5x4"], 2, "--board has no effect: neither file is a .vnl"),
        (["a.json", "b.yaml", "--board", "5x4"], 2, "--board has no effect: a.json holds no detections"),
        (["missing.vnl", "b.json", "--lossy"], 1, "no such file"),
        (["missing.yaml", "b.yaml", "--board", "5x4"], 1, "no such file"),
    ],
)
def test_wrong_use(run, arguments, code, words):
    write_camera("a.json", camera())
    write_detections("d.json", [image("a.png")])
    Path("link.json").symlink_to("a.json")
    before = sorted(p.name for p in Path().iterdir())
    result = run(*arguments)
    assert (result.exit_code, result.stdout) == (code, "")
    assert words in result.stderr
    assert sorted(p.name for p in Path().iterdir()) == before
    same_camera(read_camera("a.json"), camera())


def test_every_name_says_its_format():
    assert {kind: camera_format(name) for kind, name in NAMES.items()} == {kind: kind for kind in NAMES}


# ---- detections


def image(path, cols=5, rows=4, missing=0, boards=1, loose=0):
    """Boards of straight lines, each but for its last corners, and corners beside them."""
    j, i = np.divmod(np.arange(cols * rows), cols)
    ij = np.stack([i, j], axis=-1)[: cols * rows - missing]
    found = []
    for k in range(boards):
        xy = ij * [20.0, 21.0] + [30 + 150 * k, 40]
        found.append(Board(xy, ij, (640, 480), np.ones(len(ij)), np.zeros(len(ij), int), "ambiguous_180"))
    xy = np.concatenate([*[b.xy for b in found], np.arange(2.0 * loose).reshape(-1, 2) + 400])
    return ImageResult(path, 640, 480, Corners(xy, np.ones(len(xy)), np.zeros(len(xy), int)).sort(), tuple(found))


def test_detections_become_csv(run):
    write_detections("d.json", [image("a.png", loose=3), image("b.png", missing=2, boards=2), image("c.png", boards=0)])
    result = run("d.json", "d.csv")
    assert result.exit_code == 0
    assert len(Path("d.csv").read_text().splitlines()) == 1 + 20 + 18 + 18
    assert "left out: responses, 3 corners outside boards" in result.stderr
    assert run("d.json", "-", "--to", "csv").stdout == Path("d.csv").read_text()


def test_detections_become_a_table_and_come_back(run):
    write_detections("d.json", [image("a.png"), image("b.png", missing=2), image("c.png", boards=0)])
    assert run("d.json", "d.vnl").exit_code == 0
    assert [len(rows) for rows in read_vnl("d.vnl").values()] == [20, 20, 0]
    assert run("d.vnl", "e.json", "--image-size", "640x480").exit_code == 0
    images, _ = read_detections("e.json")
    for got, wanted in zip(images, read_detections("d.json")[0], strict=True):
        assert (got.path, got.width, got.height) == (wanted.path, 640, 480)
        assert len(got.boards) == len(wanted.boards)
        for one, other in zip(got.boards, wanted.boards, strict=True):
            assert np.array_equal(one.ij, other.ij)
            assert np.array_equal(one.xy, other.xy)
    assert run("e.json", "f.vnl").exit_code == 0
    assert Path("f.vnl").read_text() == Path("d.vnl").read_text()


def test_what_a_table_does_not_hold_is_said(run):
    write_detections("d.json", [image("a.png", boards=2, loose=3), image("b.png", cols=4)], [("c.png", "c.png: bad")])
    result = run("d.json", "d.vnl", "--board", "5x4")
    assert result.exit_code == 0
    assert result.stderr.splitlines() == [
        "d.vnl: holds one board of 5×4 corners a picture",
        "d.vnl: left out: deviations and responses, 2 boards, 3 corners outside boards, 1 file that could not be read",
        "written: d.vnl",
    ]


def test_boards_of_other_patterns_have_no_table(run):
    j, i = np.divmod(np.arange(12), 4)
    board = Board(
        np.stack([i, j], axis=-1) * 20.0, np.stack([i, j], axis=-1), (640, 480), np.ones(12), np.zeros(12, int),
        "ambiguous_120", pattern="deltille",
    )  # fmt: skip
    corners = Corners(board.xy, np.ones(12), np.zeros(12, int)).sort()
    write_detections("d.json", [ImageResult("a.png", 640, 480, corners, (board,))])
    result = run("d.json", "d.vnl")
    assert (result.exit_code, Path("d.vnl").exists()) == (1, False)
    assert "deltille" in result.stderr


def test_a_table_without_its_pictures_asks_for_their_size(run):
    write_detections("d.json", [image("a.png")])
    assert run("d.json", "d.vnl").exit_code == 0
    result = run("d.vnl", "e.json")
    assert result.exit_code == 1
    assert "the size of a picture is not in the file" in result.stderr
