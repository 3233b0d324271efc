"""The command line with a stand-in detector: exit codes, what is written, and what is said."""

from __future__ import annotations

import errno
import json
import re
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

import rcdn
from detector_stand_in import BROKEN, STOP, StandIn, picture
from rcdn.batch import outputs as _outputs
from rcdn.batch import pool
from rcdn.batch import summary as _summary
from rcdn.batch.overlay_names import OverlayNames
from rcdn.batch.work import Failure, make_detector, read_ahead
from rcdn.cli import app
from rcdn.cli import detect as verb
from rcdn.errors import DependencyError, OutputError
from rcdn.io import ImageResult, read_detections, read_vnl
from rcdn.terminal.options import parse_size
from rcdn.types import Corners


@pytest.fixture
def run(monkeypatch, tmp_path):
    """Run `rcdn ARGUMENTS` in a temporary folder."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(verb, "_make_detector", StandIn)
    monkeypatch.setattr(pool, "usable_cores", lambda: 1)  # processes: test_cli_inputs.py

    def go(*arguments):
        return CliRunner().invoke(app, [str(a) for a in arguments], catch_exceptions=False)

    return go


def counts(stdout: str) -> dict[str, str]:
    """The table of the summary."""
    lines = stdout.splitlines()
    at = next(k for k, text in enumerate(lines) if text.split()[:2] == ["pictures", "complete"])
    return dict(zip(lines[at].split(), lines[at + 1].split(), strict=True))


# ---- the app


def test_help_lists_the_verbs(run):
    result = run("--help")
    assert result.exit_code == 0
    for name in ("detect", "board", "--version"):
        assert name in result.stdout


def test_version(run, monkeypatch):
    monkeypatch.setattr(rcdn, "__version__", "1.2.3", raising=False)
    assert run("--version").stdout == "rcdn 1.2.3\n"


@pytest.mark.parametrize("arguments", [["nosuch"], ["detect"], ["detect", "--nosuch", "a.png"], ["board"]])
def test_wrong_use_is_2(run, arguments):
    result = run(*arguments)
    assert result.exit_code == 2
    assert "Traceback" not in result.output


LIGHT = """
import sys, time
start = time.perf_counter()
from rcdn.cli import app
seconds = time.perf_counter() - start
from typer.testing import CliRunner
assert "detect" in CliRunner().invoke(app, ["--help"]).output
assert "--overlay" in CliRunner().invoke(app, ["detect", "--help"]).output
heavy = {"torch", "matplotlib", "onnxruntime", "scipy", "cv2"} & set(sys.modules)
print(seconds, *heavy)
"""


def test_import_and_help_are_light():
    command = [sys.executable, "-c", LIGHT]
    outputs = [subprocess.run(command, capture_output=True, text=True, check=True).stdout.split() for _ in range(3)]
    assert all(heavy == [] for _, *heavy in outputs)
    assert min(float(seconds) for seconds, *_ in outputs) < 1.0


def test_python_dash_m(tmp_path):
    command = [sys.executable, "-m", "rcdn", "detect", str(tmp_path)]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode == 2
    assert result.stderr.startswith("error: ")
    assert "Traceback" not in result.stderr


# ---- detect: reading and exit codes


def test_all_read_is_0_and_nothing_but_the_summary_is_said(run):
    for k in range(3):
        picture(Path(f"in/{k}.png"), missing=k)
    picture(Path("in/more/none.png"), cols=0, rows=0)
    result = run("detect", "in")
    assert result.exit_code == 0
    assert result.stderr == ""  # no progress bar in a pipe
    assert "\x1b" not in result.stdout
    table = counts(result.stdout)
    assert float(table.pop("seconds")) >= 0
    assert table == {
        "pictures": "4", "complete": "1", "partial": "2", "none": "1", "failed": "0", "boards": "3",
        "corners": str(3 * 54 - 3 + 4),
    }  # fmt: skip
    assert re.search(r"0\.png +9×6$", result.stdout, re.M)
    assert re.search(r"2\.png +9×6 partial \(52 of 54\)$", result.stdout, re.M)
    assert re.search(r"none\.png +no board \(1 corner\)$", result.stdout, re.M)


def test_one_bad_file_among_good_ones_is_reported_and_the_rest_go_on(run):
    picture(Path("a.png"))
    Path("b.png").write_text("this is no picture")
    picture(Path("c.png"), cols=BROKEN)
    picture(Path("d.png"))
    result = run("detect", "a.png", "b.png", "c.png", "d.png", "missing.png", "--json", "out.json")
    assert result.exit_code == 1
    assert counts(result.stdout)["failed"] == "3"
    lines = result.stderr.splitlines()
    assert len(lines) == 3
    assert all(text.startswith("error: ") for text in lines)
    assert "c.png: unexpected ValueError: a bug of two lines" in result.stderr
    images, errors = read_detections("out.json")
    assert [i.path for i in images] == ["a.png", "d.png"]
    assert [name for name, _ in errors] == ["missing.png", "b.png", "c.png"]


@pytest.mark.parametrize("argument", ["missing.png", "empty", "*.tif"])
def test_nothing_to_read_is_2(run, argument):
    Path("empty").mkdir()
    result = run("detect", argument, "--json", "out.json")
    assert result.exit_code == 2
    assert "nothing to read" in result.stderr
    assert not Path("out.json").exists()


def test_only_unreadable_files_is_1(run):
    Path("a.png").write_bytes(b"")
    result = run("detect", "a.png", "--json", "out.json")
    assert result.exit_code == 1
    assert json.loads(Path("out.json").read_text())["errors"][0]["path"] == "a.png"


@pytest.mark.parametrize(
    ("option", "value", "message"),
    [
        ("--board", "9-6", "not a size"),
        ("--board", "9x2", "at least 3x3"),
        ("--board", "9", "not a size"),
        ("--preset", "best", "auto"),
        ("--threads", "-1", "--threads"),
        ("--threads", "two", "--threads"),
        ("--json", "b.png", "overwrite a picture"),
        ("--vnl", "b.png", "overwrite a picture"),
        ("--overlay", ".", "are inputs"),
    ],
)
def test_wrong_option_values_are_2_and_nothing_is_touched(run, option, value, message):
    before = picture(Path("a.png")).read_bytes(), picture(Path("b.png")).read_bytes()
    result = run("detect", "a.png", option, value)
    assert result.exit_code == 2
    assert message in result.stderr
    assert (Path("a.png").read_bytes(), Path("b.png").read_bytes()) == before
    assert sorted(p.name for p in Path().iterdir()) == ["a.png", "b.png"]


def test_json_and_vnl_need_two_names_and_mrcal_plain_paths(run):
    picture(Path("a.png"))
    picture(Path("with space.png"))
    assert run("detect", "a.png", "--json", "o", "--vnl", "o").exit_code == 2
    result = run("detect", "a.png", "with space.png", "--vnl", "o.vnl")
    assert result.exit_code == 2
    assert "with space.png" in result.stderr


def test_files_by_their_names(run):
    """What `-o` writes is what the options write, and CSV as many corners as JSON holds in boards."""
    picture(Path("a.png"))
    result = run("detect", "a.png", "--json", "d.json", "-o", "e.json", "-o", "c.csv", "--output", "c.vnl")
    assert result.exit_code == 0
    assert Path("d.json").read_bytes() == Path("e.json").read_bytes()
    boards = read_detections("d.json")[0][0].boards
    assert len(Path("c.csv").read_text().splitlines()) == 1 + sum(map(len, boards)) > 1
    assert len(read_vnl("c.vnl")["a.png"]) == len(boards[0])
    for wrong in (["-o", "c.txt"], ["-o", "d.json", "--json", "./d.json"], ["-o", "a.png"]):
        result = run("detect", "a.png", *wrong)
        assert result.exit_code == 2, wrong
        assert wrong[1] in result.stderr


def test_options_reach_the_configuration(run, monkeypatch):
    seen = []
    monkeypatch.setattr(verb, "_make_detector", lambda config: seen.append(config) or StandIn(config))
    picture(Path("a.png"))
    run("detect", "a.png", "--preset", "paper", "--threads", "3", "--device", "auto")
    assert (seen[0].model, seen[0].threads, seen[0].device) == ("paper", 3, "auto")


def test_a_graphics_card_that_onnx_runtime_can_not_use_is_told(run, monkeypatch):
    monkeypatch.setattr(verb, "_make_detector", make_detector)
    monkeypatch.setattr("onnxruntime.get_available_providers", lambda: ["CPUExecutionProvider"])
    picture(Path("a.png"))
    result = run("detect", "a.png", "--device", "cuda")
    assert (result.exit_code, result.stdout) == (1, "")
    assert result.stderr.startswith("error: --device cuda: this ONNX Runtime has no CUDA, only CPUExecutionProvider; ")
    assert "pip install onnxruntime-gpu" in result.stderr


def test_errors_on_purpose_are_one_line_and_1(run, monkeypatch):
    def broken(config):
        raise DependencyError("onnxruntime is missing:\ninstall it")

    monkeypatch.setattr(verb, "_make_detector", broken)
    picture(Path("a.png"))
    result = run("detect", "a.png")
    assert (result.exit_code, result.stderr) == (1, "error: onnxruntime is missing: install it\n")


# ---- detect: outputs


def test_all_outputs(run):
    picture(Path("in/a.png"))
    picture(Path("in/b.png"), missing=5)
    result = run("detect", "in/*.png", "--json", "out/d.json", "--vnl", "out/c.vnl", "--overlay", "out/see")
    assert result.exit_code == 0
    images, errors = read_detections("out/d.json")
    assert [(len(i.boards[0]), i.width, i.height) for i in images] == [(54, 100, 80), (49, 100, 80)]
    assert errors == []
    vnl = read_vnl("out/c.vnl")
    assert {name: (len(v), int(np.isfinite(v[:, 0]).sum())) for name, v in vnl.items()} == {
        "in/a.png": (54, 54),
        "in/b.png": (54, 49),
    }
    assert sorted(p.name for p in Path("out/see").iterdir()) == ["a.png", "b.png"]
    assert cv2.imread("out/see/a.png").shape[2] == 3


def test_overlays_of_the_same_name_do_not_overwrite_each_other(run):
    inputs = [picture(Path(p)) for p in ("x/a.png", "y/a.png", "y/a.bmp", "y/A.png", "x__a.png", "x/z/a.png")]
    result = run("detect", *inputs, "--overlay", "see")
    assert result.exit_code == 0
    names = [p.name for p in Path("see").iterdir()]
    assert len({n.lower() for n in names}) == len(inputs)
    assert {"x__a.png", "y__a.png", "y__a.bmp.png", "x__z__a.png"} <= set(names)


def test_overlay_names_are_safe_short_and_deterministic():
    paths = [Path(f"/p/{'long folder/' * 30}{k}?ü.jpg") for k in range(3)] + [Path("/p/clip.mp4"), Path("/p/-x.png")]
    names = [str(p) for p in paths[:3]] + [f"/p/clip.mp4#{k:06d}" for k in range(2)] + ["/p/-x.png", "/p/x.png"]

    def taken():
        overlays = OverlayNames(paths)
        return [overlays.take(n) for n in names]

    files = taken()
    assert files == taken()
    assert len(set(files)) == len(files)
    assert all(len(f.encode()) < 200 and re.fullmatch(r"[\w.-]+", f) and f[0] not in "-." for f in files)
    assert files[3] == "clip.mp4-000000.png"


def test_a_second_run_does_not_take_overlays_for_inputs(run):
    picture(Path("in/a.png"))
    assert run("detect", "in", "--overlay", "in/see").exit_code == 0
    result = run("detect", "in", "--overlay", "in/see")
    assert result.exit_code == 0
    assert counts(result.stdout)["pictures"] == "1"
    assert "skipped" in result.stderr


@pytest.mark.parametrize("option", ["--json", "--vnl", "--overlay"])
def test_output_places_are_checked_before_the_work(run, option, monkeypatch):
    picture(Path("a.png"))
    Path("file").write_text("")
    monkeypatch.setattr(StandIn, "detect", lambda *_: pytest.fail("the work has begun"))
    result = run("detect", "a.png", option, "file/inside")
    assert result.exit_code == 1
    assert result.stderr.startswith("error: ")
    assert "file" in result.stderr


def full_disk(*_, **__):
    raise OutputError("out.json: can't be written: No space left on device; make room")


def test_no_space_for_one_output_leaves_the_others_and_the_summary(run, monkeypatch):
    picture(Path("a.png"))
    monkeypatch.setattr("rcdn.io.write_lines", full_disk)
    result = run("detect", "a.png", "--json", "out.json", "--vnl", "out.vnl")
    assert result.exit_code == 1
    assert result.stderr.count("error: ") == 1
    assert "No space left" in result.stderr
    assert counts(result.stdout)["complete"] == "1"
    assert Path("out.vnl").exists()
    assert not Path("out.json").exists()


def test_results_wait_on_the_disk_and_leave_nothing_there(run, monkeypatch):
    for k in range(3):
        picture(Path(f"in/{k}.png"))
    seen = []
    monkeypatch.setattr(verb.Outputs, "write", lambda self, _: seen.append(list(self._kept())) or [])
    assert run("detect", "in", "--json", "out/a.json").exit_code == 0
    assert [json.loads(line)["path"] for line in seen[0]] == [f"in/{k}.png" for k in range(3)]
    assert [p.name for p in Path().iterdir()] == ["in"]


def test_a_disk_that_takes_no_line_ends_the_run(run, monkeypatch):
    for k in range(3):
        picture(Path(f"{k}.png"))

    def full(_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(_outputs, "_nameless", full)
    result = run("detect", "*.png", "--json", "out.json")
    assert (result.exit_code, result.stderr) == (
        1,
        "error: out.json: can't be written: No space left on device; make room, or write to another disk\n",
    )


def test_no_space_for_overlays_keeps_all_else(run, monkeypatch):
    for k in range(3):
        picture(Path(f"{k}.png"))
    monkeypatch.setattr("rcdn.io.write_image", full_disk)
    result = run("detect", "*.png", "--json", "out.json", "--overlay", "see")
    assert result.exit_code == 1
    assert result.stderr.count("No space left") == 1
    assert result.stderr.endswith("error: 3 overlays could not be written\n")
    assert [i.path for i in read_detections("out.json")[0]] == ["0.png", "1.png", "2.png"]


def test_a_drawing_that_fails_keeps_its_result(run, monkeypatch):
    def broken(*_):
        raise RuntimeError("no ink")

    monkeypatch.setattr("rcdn.report.overlay.draw_overlay", broken)
    picture(Path("a.png"))
    result = run("detect", "a.png", "--json", "out.json", "--overlay", "see")
    assert result.exit_code == 1
    images, errors = read_detections("out.json")
    assert (len(images), len(errors)) == (1, 1)
    assert counts(result.stdout)["pictures"] == "1"


def test_ctrl_c_writes_what_is_done_and_is_130(run):
    for k, cols in enumerate((9, 9, STOP, 9)):
        picture(Path(f"{k}.png"), cols=cols)
    result = run("detect", "*.png", "--json", "out.json", "--vnl", "out.vnl")
    assert result.exit_code == 130
    assert "Ctrl-C" in result.stderr
    assert [i.path for i in read_detections("out.json")[0]] == ["0.png", "1.png"]
    assert len(read_vnl("out.vnl")) == 2


def test_video_frames_are_pictures(run, tmp_path):
    video = cv2.VideoWriter(str(tmp_path / "clip.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 5, (160, 128))
    if not video.isOpened():
        pytest.skip("this OpenCV writes no video")
    for _ in range(3):
        video.write(np.zeros((128, 160, 3), np.uint8))
    video.release()
    result = run("detect", "clip.avi", "--json", "out.json", "--overlay", "see")
    assert result.exit_code == 0
    assert [i.path for i in read_detections("out.json")[0]] == [f"clip.avi#{k:06d}" for k in range(3)]
    assert len(list(Path("see").iterdir())) == 3


# ---- detect: the summary


def test_the_list_of_pictures_ends_at_20(run):
    for k in range(21):
        picture(Path(f"{k:02d}.png"))
    assert "20.png" not in run("detect", "*.png").stdout
    assert "19.png" in run("detect", "0*.png", "1*.png").stdout


def test_board_accepts_either_orientation(run):
    picture(Path("a.png"), 9, 6)
    picture(Path("b.png"), 6, 9)
    picture(Path("c.png"), 7, 6)
    picture(Path("d.png"), 10, 7)
    result = run("detect", "*.png", "--board", "9x6")
    table = counts(result.stdout)
    assert (table["complete"], table["partial"]) == ("2", "2")
    assert "7×6 partial (42 of 54)" in result.stdout
    assert "10×7 partial (not 9×6)" in result.stdout
    assert "hint" not in result.stdout


def test_squares_counted_instead_of_corners_are_hinted_at(run):
    for k in range(3):
        picture(Path(f"{k}.png"), 8, 5)
    picture(Path("3.png"), 0, 0)
    result = run("detect", "*.png", "--board", "9x6")
    expected = "found 8×5 in 3 of 4 pictures: 9x6 squares have 8×5 inner corners; did you mean --board 8x5?"
    assert expected in result.stdout
    assert result.exit_code == 0
    assert "did you mean --board 5x8?" in run("detect", "*.png", "--board", "6x9").stdout
    assert "hint" not in run("detect", "*.png").stdout
    assert "and 4×4 in none; did you mean --board 8x5?" in run("detect", "*.png", "--board", "4x4").stdout
    picture(Path("4.png"), 7, 5)
    assert "hint" not in run("detect", "*.png", "--board", "9x6").stdout


def test_file_names_can_not_spoil_the_list():
    name = "a\nb\x1b[31m\udcff.png"
    image = ImageResult(name, 9, 9, Corners(np.zeros((0, 2)), [], []), ())
    lines = _summary.columns([_summary.line(o, None) for o in (_summary.brief(image), Failure(name, f"{name}: bad"))])
    assert len(lines) == 2
    assert all(text.isprintable() for text in lines)
    assert lines[1].endswith("failed: bad")


# ---- reading ahead


def test_read_ahead_keeps_the_order_and_stays_bounded(tmp_path, monkeypatch):
    read = []

    def frames(path):
        read.append(path)
        yield str(path), np.zeros((2, 2), np.uint8)

    monkeypatch.setattr("rcdn.io.frames", frames)
    paths = [Path(str(k)) for k in range(50)]
    pictures = read_ahead(paths, ahead=2)
    for k in range(10):
        assert next(pictures).name == str(k)
        assert len(read) <= k + 1 + 2 + 2  # given, in the queue, waiting to be put, being read
    pictures.close()
    assert len(read) < 20
    assert [p.name for p in read_ahead(paths)] == [str(p) for p in paths]


def test_read_ahead_survives_what_a_decoder_raises(monkeypatch):
    def frames(path):
        yield f"{path}#0", np.zeros((2, 2), np.uint8)
        raise MemoryError("too large")

    monkeypatch.setattr("rcdn.io.frames", frames)
    pictures = list(read_ahead([Path("a"), Path("b")]))
    assert [(p.index, p.name, bool(p.error)) for p in pictures] == [
        (0, "a#0", False), (0, "a", True), (1, "b#0", False), (1, "b", True),
    ]  # fmt: skip


# ---- board


@pytest.mark.parametrize("ending", ["pdf", "svg", "PDF"])
def test_board_writes_a_file(run, ending):
    result = run("board", "--size", "9x6", "--spacing", "0.025", "-o", f"out/board.{ending}")
    assert result.exit_code == 0
    assert Path(f"out/board.{ending}").stat().st_size > 1000
    assert "25 mm" in result.stdout
    assert "note" not in result.stdout


def test_board_warns_of_ambiguous_sizes(run):
    result = run("board", "--size", "8x6", "--spacing", "0.025", "-o", "b.svg")
    assert result.exit_code == 0
    assert "half a turn" in result.stdout


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"--spacing": "0.03"}, "largest spacing that fits is 0.0251 m (25.1mm); or take a3 paper"),
        ({"--spacing": "25"}, "0.025"),
        ({"--spacing": "-1"}, "above 0"),
        ({"--size": "9"}, "9x6"),
        ({"--paper": "b9"}, "a4"),
        ({"-o": "board.png"}, ".pdf or .svg"),
    ],
)
def test_board_wrong_use_is_2(run, changes, message):
    options = {"--size": "9x6", "--spacing": "0.025", "-o": "b.pdf"} | changes
    result = run("board", *(word for pair in options.items() for word in pair))
    assert result.exit_code == 2
    assert message in result.stderr
    assert list(Path().iterdir()) == []


def test_board_papers_are_the_report_s():
    from rcdn.cli.board import Paper
    from rcdn.report.target import PAPERS

    assert [p.value for p in Paper] == list(PAPERS)


@pytest.mark.parametrize("text", ["9x6", "9X6", "9×6", " 9 x 6 "])
def test_parse_size(text):
    assert parse_size(text) == (9, 6)
