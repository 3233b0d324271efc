"""Boards to print: the files are read back, and lengths are measured in millimetres."""

import math
import re
import shutil
import subprocess
import xml.etree.ElementTree as ET

import cv2
import numpy as np
import pytest
from tests.targets.raster import raster
from typer.testing import CliRunner

from rcdn.cli import app
from rcdn.config import DetectorConfig
from rcdn.detector import Detector
from rcdn.errors import ConfigError
from rcdn.report.target import PAPERS, QUIET, RULER, largest_spacing, make_page, orientation_note, to_pdf, to_svg
from rcdn.targets.files import write_target
from rcdn.targets.specification import specification
from rcdn.types import AprilGrid, Charuco, Checkerboard, Printed, PuzzlePart
from rcdn.types.shapes import Area, Disc, Rect

SVG = "{http://www.w3.org/2000/svg}"
NUMBER = r"-?\d+(?:\.\d+)?"


def checker(size, spacing, paper="a4"):
    return make_page(Printed(Checkerboard(*size), spacing), paper)


def svg_rects(text: str, group: str) -> np.ndarray:
    """(N, 4) x, y, width, height of a group's rectangles, mm."""
    root = ET.fromstring(text)
    found = root.find(f"{SVG}g[@id='{group}']")
    assert found is not None
    return np.array([[float(r.get(k)) for k in ("x", "y", "width", "height")] for r in found])


def pdf_parts(data: bytes) -> tuple[list[float], str]:
    """MediaBox in points, and the content stream."""
    box = re.search(rb"/MediaBox \[([^\]]*)\]", data)
    stream = re.search(rb"/Length (\d+) >>\nstream\n(.*)\nendstream", data, re.S)
    assert box is not None
    assert stream is not None
    assert int(stream[1]) == len(stream[2])
    return [float(v) for v in box[1].split()], stream[2].decode("cp1252")


def pdf_rects(data: bytes) -> np.ndarray:
    """(N, 4) x, y, width, height, mm, y up, after checking that the unit is a millimetre."""
    _, content = pdf_parts(data)
    scale = re.match(rf"({NUMBER}) 0 0 ({NUMBER}) 0 0 cm\n", content)
    assert scale is not None
    assert [float(scale[1]), float(scale[2])] == pytest.approx([72 / 25.4] * 2, rel=1e-8)
    return np.array([[float(v) for v in m.groups()] for m in re.finditer(rf"({NUMBER}) " * 4 + "re", content)])


def test_svg_squares_are_where_and_as_large_as_asked():
    text = to_svg(checker((9, 6), 0.025, "a4"))
    root = ET.fromstring(text)
    assert (root.get("width"), root.get("height"), root.get("viewBox")) == ("297mm", "210mm", "0 0 297 210")
    rects = svg_rects(text, "squares")
    assert len(rects) == 35  # half of 10 × 7
    np.testing.assert_allclose(rects[:, 2:], 25, atol=1e-4)
    cell = (rects[:, :2] - rects[0, :2]) / 25
    np.testing.assert_allclose(cell, cell.round(), atol=1e-5)
    assert {tuple(c) for c in cell.round().astype(int)} == {
        (a, b) for a in range(10) for b in range(7) if (a + b) % 2 == 0
    }
    np.testing.assert_allclose(rects[0, 0], (297 - 250) / 2, atol=1e-4)


def test_pdf_has_the_same_rectangles_and_the_paper_s_size():
    page = checker((9, 6), 0.025, "a4")
    data, svg = to_pdf(page), to_svg(page)
    box, content = pdf_parts(data)
    assert box == pytest.approx([0, 0, 297 * 72 / 25.4, 210 * 72 / 25.4], abs=1e-3)
    expected = np.concatenate([svg_rects(svg, "squares"), svg_rects(svg, "ruler")])
    expected[:, 1] = 210 - expected[:, 1] - expected[:, 3]
    np.testing.assert_allclose(pdf_rects(data), expected, atol=2e-5)
    assert "9×6 inner corners · 25 mm squares · print at 100 %" in content
    assert b"/PrintScaling /None" in data


@pytest.mark.parametrize("size", [(9, 6), (3, 14)])
def test_pdf_cross_references_point_to_their_objects(size):
    data = to_pdf(checker(size, 0.011))
    assert data.startswith(b"%PDF-1.4\n")
    assert data.endswith(b"%%EOF\n")
    start = int(re.search(rb"startxref\n(\d+)\n", data)[1])
    head, entries = re.match(rb"xref\n0 (\d+)\n((?:\d{10} \d{5} [nf] \n)+)trailer", data[start:]).groups()
    lines = entries.split(b"\n")[:-1]
    assert int(head) == len(lines)
    assert b"/Size %d " % len(lines) in data[start:]
    for number, entry in enumerate(lines[1:], start=1):
        assert data[int(entry[:10]) :].startswith(b"%d 0 obj\n" % number)


@pytest.mark.parametrize("paper", sorted(PAPERS))
@pytest.mark.parametrize("size", [(9, 6), (6, 9), (3, 3), (20, 3)])
def test_everything_stays_on_the_page_with_white_around(paper, size):
    spacing = math.floor(largest_spacing(Checkerboard(*size), paper) * 1e4) / 1e4
    page = checker(size, spacing, paper)
    squares = np.array([(r.x, r.y, r.x + r.width, r.y + r.height) for r in page.shapes])
    low, high = squares[:, :2].min(axis=0), squares[:, 2:].max(axis=0)
    white = max(QUIET, 0.25 * spacing * 1000) - 1e-6
    assert min(low) >= white
    assert page.size[0] - high[0] >= white
    foot = min(min(r.y for r in page.ruler), *(t.y - 3.2 for t in page.labels))
    assert foot - high[1] >= QUIET - 1e-6
    assert max(r.x + r.width for r in page.ruler) < page.size[0] - 25  # room for the ruler's label
    with pytest.raises(ConfigError, match="fit"):
        checker(size, largest_spacing(Checkerboard(*size), paper) * 1.001, paper)


def test_ruler_is_100_mm_between_the_outer_ticks():
    ticks = checker((9, 6), 0.02).ruler[1:]
    centres = np.array([r.x + r.width / 2 for r in ticks])
    np.testing.assert_allclose(np.diff(centres), 10)
    assert centres[-1] - centres[0] == pytest.approx(RULER)


def test_page_turns_if_the_board_fits_better():
    assert checker((9, 6), 0.02).size == (297.0, 210.0)
    assert checker((6, 9), 0.02).size == (210.0, 297.0)


@pytest.mark.parametrize(
    ("size", "spacing", "paper", "message"),
    [
        ((9, 6), 0.03, "a4", r"largest spacing that fits is 0\.0251 m \(25\.1mm\); or take a3 paper"),
        ((9, 6), 25, "a4", r"spacing is in metres: for 25 mm give 0\.025"),
        ((900, 600), 0.01, "a4", "larger paper"),
        ((9, 2), 0.01, "a4", "at least 3x3"),
        ((9, 6), 0, "a4", "above 0"),
        ((9, 6), float("nan"), "a4", "above 0"),
        ((9, 6), 0.01, "b9", "paper must be one of"),
    ],
)
def test_what_can_t_be_printed_says_why(size, spacing, paper, message):
    with pytest.raises(ConfigError, match=message):
        checker(size, spacing, paper)


@pytest.mark.parametrize("size", [(c, r) for c in range(2, 7) for r in range(2, 7)])
def test_orientation_note_agrees_with_the_colours(size):
    cols, rows = size
    black = np.add.outer(np.arange(rows + 1), np.arange(cols + 1)) % 2 == 0
    half = np.array_equal(black, np.rot90(black, 2))
    quarter = cols == rows and np.array_equal(black, np.rot90(black))
    note = orientation_note(size)
    assert (note is not None) == half
    if note:
        assert ("quarter" in note) == quarter
        better = re.search(r"such as (\d+)x(\d+)", note)
        assert orientation_note((int(better[1]), int(better[2]))) is None


@pytest.mark.skipif(shutil.which("pdftoppm") is None, reason="pdftoppm (poppler) is not installed")
def test_pdf_rendered_by_another_program_holds_the_board(tmp_path):
    (tmp_path / "board.pdf").write_bytes(to_pdf(checker((9, 6), 0.025)))
    command = ["pdftoppm", "-r", "72", "-gray", "-singlefile", "board.pdf", "board"]
    subprocess.run(command, cwd=tmp_path, check=True, timeout=60)
    page = cv2.imread(str(tmp_path / "board.pgm"), cv2.IMREAD_GRAYSCALE)
    found, corners = cv2.findChessboardCornersSB(page, (9, 6))
    assert found
    grid = corners.reshape(6, 9, 2)
    assert np.hypot(*(grid[0, -1] - grid[0, 0])) == pytest.approx(8 * 25 * 72 / 25.4, abs=0.3)


# ---- boards that carry codes

CODED = [
    Printed(Charuco(8, 6, "DICT_5X5_100", 0.75, legacy=True), 0.02),
    Printed(Charuco(5, 4, "DICT_4X4_50", 0.75, inverted=True), 0.03),
    Printed(AprilGrid(4, 3, "tag36h11", 0.3), 0.035),
    Printed(PuzzlePart(9, 7, 120, 333), 0.018),
]


def shapes_of_svg(text: str) -> list:
    """What an SVG of ours paints, in its order, without the page's ground."""
    points = lambda words: tuple(tuple(float(v) for v in pair.split(",")) for pair in words.split())  # noqa: E731
    shapes = []
    for group in ET.fromstring(text).findall(f"{SVG}g")[:2]:
        for one in group:
            name, got = one.tag.removeprefix(SVG), one.get
            if name == "rect":
                shapes.append(Rect(*(float(got(k)) for k in ("x", "y", "width", "height"))))
            elif name == "circle":
                shapes.append(Disc(*(float(got(k)) for k in ("cx", "cy", "r")), got("fill") == "white"))
            elif name == "polygon":
                shapes.append(Area((points(got("points")),)))
            else:
                assert (name, got("fill-rule")) == ("path", "evenodd")
                shapes.append(Area(tuple(points(loop) for loop in re.findall("M([^Z]*)Z", got("d")))))
    return shapes


def shapes_of_pdf(data: bytes, height: float) -> list:
    """What a PDF of ours paints, in its order."""
    shapes, white = [], False
    for line in pdf_parts(data)[1].splitlines()[2:]:
        if line.startswith("BT"):
            continue
        white = line.startswith("1 g")
        curve = re.findall(rf"({NUMBER}) ({NUMBER}) c", line)
        if curve:
            ends = np.array(curve, float)
            (x, y), r = ends.mean(axis=0), np.ptp(ends[:, 0]) / 2
            np.testing.assert_allclose(np.linalg.norm(ends - (x, y), axis=1), r, atol=2e-5)
            shapes.append(Disc(x, height - y, r, white))
        elif line.endswith("re f"):
            x, y, w, h = map(float, line.split()[:4])
            shapes.append(Rect(x, height - y - h, w, h))
        else:
            assert line.endswith("h f*")
            loops = [re.findall(rf"({NUMBER}) ({NUMBER}) [ml]", loop) for loop in line.split(" h")[:-1]]
            shapes.append(Area(tuple(tuple((float(x), height - float(y)) for x, y in loop) for loop in loops)))
    return shapes


@pytest.mark.parametrize("printed", CODED, ids=str)
def test_both_files_hold_the_same_board_at_true_scale(printed):
    page = make_page(printed)
    (width, height), scale = page.size, 3.0
    svg = raster(shapes_of_svg(to_svg(page)), width, height, scale)
    pdf = raster(shapes_of_pdf(to_pdf(page), height), width, height, scale)
    assert (svg != pdf).mean() < 1e-4
    board, *others = Detector(DetectorConfig(target="auto")).boards(cv2.GaussianBlur(svg, (0, 0), 0.8))
    assert not others
    assert sorted(board.ids) == printed.ids.tolist()
    millimetres = 1000 * printed.points(board.ids)
    apart = [np.linalg.norm(at[:, None] - at, axis=2) for at in (board.xy / scale, millimetres)]
    np.testing.assert_allclose(*apart, atol=0.3)  # circles pull corners by up to half a pixel


@pytest.mark.parametrize(
    ("printed", "lines"),
    [
        (
            CODED[0],
            [
                "ChArUco, 8×6 squares of 20 mm · markers 15 mm · print at 100 %",
                "charuco:8x6:DICT_5X5_100:0.75:legacy",
            ],
        ),
        (CODED[2], ["AprilGrid, 4×3 tags of 35 mm · 10.5 mm apart · print at 100 %", "aprilgrid:4x3:tag36h11:0.3"]),
        (CODED[3], ["PuzzleBoard, 9×7 inner corners · 18 mm squares · print at 100 %", "puzzleboard:9x7:at=120,333"]),
    ],
)
def test_the_page_says_all_that_has_to_be_known(printed, lines):
    page = make_page(printed)
    assert [label.text for label in page.labels[:2]] == lines
    assert all(line in to_svg(page) for line in lines)
    assert lines[1] in pdf_parts(to_pdf(page))[1]


@pytest.mark.parametrize("paper", ["a5", "a3", "letter"])
@pytest.mark.parametrize("printed", CODED, ids=str)
def test_coded_boards_take_all_of_the_paper(paper, printed):
    most = largest_spacing(printed.target, paper)
    page = make_page(Printed(printed.target, math.floor(most * 1e5) / 1e5), paper)
    dark = raster(page.shapes, *page.size, 2.0) < 255
    rows, columns = (np.flatnonzero(dark.any(axis=k)) / 2 for k in (1, 0))
    assert min(rows[0], columns[0], page.size[0] - columns[-1]) >= QUIET - 1
    top = min(label.y for label in page.labels) - 3.2
    assert top - rows[-1] >= QUIET - 1
    with pytest.raises(ConfigError, match=rf"largest spacing that fits is {math.floor(most * 1e4) / 1e4:g} "):
        make_page(Printed(printed.target, most * 1.01), paper)


@pytest.fixture
def run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return lambda *words: CliRunner().invoke(app, ["board", *words])


def test_board_prints_what_its_options_say(run, tmp_path):
    words = ["--pattern", "charuco", "--size", "6x8", "--spacing", "20mm", "--dictionary", "5x5_100", "--marker", "0.6"]
    done = run(*words, "--legacy", "--first", "3", "-o", "b.svg")
    assert done.exit_code == 0, done.output
    assert "ChArUco, 6×8 squares of 20 mm, markers 12 mm, a4 portrait" in done.stdout
    assert "--target charuco:6x8:DICT_5X5_100:0.6:legacy:first=3" in done.stdout
    board = Charuco(6, 8, "DICT_5X5_100", 0.6, 3, legacy=True)
    assert (tmp_path / "b.svg").read_text() == to_svg(make_page(Printed(board, 0.02)))
    done = run(
        "--pattern", "aprilgrid", "--size", "3x2", "--spacing", "40mm", "--border", "1", "--gap", "0.25", "-o", "a.pdf"
    )
    assert done.exit_code == 0, done.output
    assert "note" not in done.stdout
    grid = AprilGrid(3, 2, "tag36h11", 0.25, border=1)
    assert (tmp_path / "a.pdf").read_bytes() == to_pdf(make_page(Printed(grid, 0.04)))
    done = run("--pattern", "puzzleboard", "--size", "12x9", "--spacing", "15mm", "--first", "40,100", "-o", "p.svg")
    assert done.exit_code == 0, done.output
    part = PuzzlePart(12, 9, 40, 100)
    assert (tmp_path / "p.svg").read_text() == to_svg(make_page(Printed(part, 0.015)))


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--pattern", "charuco", "--gap", "0.3"], "--gap is for --pattern aprilgrid"),
        (["--legacy"], "--legacy is for --pattern charuco"),
        (["--pattern", "puzzleboard", "--first", "3"], "COLUMN,ROW"),
        (["--pattern", "charuco", "--first", "x"], "whole number"),
        (["--pattern", "charuco", "--dictionary", "4x4_51"], "DICT_4X4_50, "),
        (["--pattern", "charuco", "--dictionary", "4x4_50", "--first", "40"], "take DICT_4X4_100"),
        (["--pattern", "charuco", "--marker", "1.2"], "marker must lie between 0 and 1"),
        (["--pattern", "aprilgrid", "--family", "tag9"], "tag36h11"),
        (["--pattern", "aprilgrid", "--border", "3"], "border"),
        (["--yaml", "b.pdf"], "--output, too"),
    ],
)  # fmt: skip
def test_options_that_can_t_be_say_why(run, tmp_path, words, message):
    done = run("--size", "9x6", "--spacing", "10mm", "-o", "b.pdf", *words)
    assert done.exit_code == 2
    assert message in " ".join(str(done.exception or done.output).split()) + done.output
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("printed", CODED, ids=str)
def test_board_prints_what_a_word_or_a_file_says(run, tmp_path, printed):
    expected = to_svg(make_page(printed))
    write_target(tmp_path / "t.yaml", printed)
    millimetres = f"{printed.spacing * 1000:g}mm"
    for words in (["--target", "t.yaml"], ["--target", specification(printed.target), "--spacing", millimetres]):
        done = run(*words, "-o", "b.svg", "--yaml", "again.yaml")
        assert done.exit_code == 0, done.output
        assert (tmp_path / "b.svg").read_text() == expected
        assert (tmp_path / "again.yaml").read_text() == (tmp_path / "t.yaml").read_text()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--spacing", "10mm"], "--size is missing"),
        (["--size", "9x6"], "--spacing is missing"),
        (["--target", "checkerboard:9x6"], "--spacing is missing"),
        (["--target", "checkerboard:9x6", "--size", "9x6", "--spacing", "10mm"], "leave out --size"),
        (["--target", "charuco:5x7:DICT_4X4_50:0.75", "--legacy", "--spacing", "10mm"], "leave out --size"),
        (["--target", "puzzleboard", "--spacing", "10mm"], "which part"),
        (["--target", "charuco:5x7", "--spacing", "10mm"], "a dictionary is missing"),
    ],
)
def test_what_is_missing_is_asked_for(run, tmp_path, words, message):
    done = run("-o", "b.svg", *words)
    assert done.exit_code == 2
    assert message in done.output + str(done.exception)
    assert not list(tmp_path.iterdir())
