"""Boards to print: the files are read back, and lengths are measured in millimetres."""

import math
import re
import shutil
import subprocess
import xml.etree.ElementTree as ET

import cv2
import numpy as np
import pytest

from rcdn.errors import ConfigError
from rcdn.report.target import PAPERS, QUIET, RULER, largest_spacing, make_target, orientation_note, to_pdf, to_svg

SVG = "{http://www.w3.org/2000/svg}"
NUMBER = r"-?\d+(?:\.\d+)?"


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
    text = to_svg(make_target((9, 6), 0.025, "a4"))
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
    target = make_target((9, 6), 0.025, "a4")
    data, svg = to_pdf(target), to_svg(target)
    box, content = pdf_parts(data)
    assert box == pytest.approx([0, 0, 297 * 72 / 25.4, 210 * 72 / 25.4], abs=1e-3)
    expected = np.concatenate([svg_rects(svg, "squares"), svg_rects(svg, "ruler")])
    expected[:, 1] = 210 - expected[:, 1] - expected[:, 3]
    np.testing.assert_allclose(pdf_rects(data), expected, atol=2e-5)
    assert "9×6 inner corners · 25 mm squares · print at 100 %" in content
    assert b"/PrintScaling /None" in data


@pytest.mark.parametrize("size", [(9, 6), (3, 14)])
def test_pdf_cross_references_point_to_their_objects(size):
    data = to_pdf(make_target(size, 0.011))
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
    spacing = math.floor(largest_spacing(size, paper) * 1e4) / 1e4
    target = make_target(size, spacing, paper)
    squares = np.array([(r.x, r.y, r.x + r.width, r.y + r.height) for r in target.squares])
    low, high = squares[:, :2].min(axis=0), squares[:, 2:].max(axis=0)
    white = max(QUIET, 0.25 * spacing * 1000) - 1e-6
    assert min(low) >= white
    assert target.page[0] - high[0] >= white
    foot = min(min(r.y for r in target.ruler), *(t.y - 3.2 for t in target.labels))
    assert foot - high[1] >= QUIET - 1e-6
    assert max(r.x + r.width for r in target.ruler) < target.page[0] - 25  # room for the ruler's label
    with pytest.raises(ConfigError, match="fit"):
        make_target(size, largest_spacing(size, paper) * 1.001, paper)


def test_ruler_is_100_mm_between_the_outer_ticks():
    ticks = make_target((9, 6), 0.02).ruler[1:]
    centres = np.array([r.x + r.width / 2 for r in ticks])
    np.testing.assert_allclose(np.diff(centres), 10)
    assert centres[-1] - centres[0] == pytest.approx(RULER)


def test_page_turns_if_the_board_fits_better():
    assert make_target((9, 6), 0.02).page == (297.0, 210.0)
    assert make_target((6, 9), 0.02).page == (210.0, 297.0)


@pytest.mark.parametrize(
    ("size", "spacing", "paper", "message"),
    [
        ((9, 6), 0.03, "a4", r"largest spacing that fits is 0\.0251 \(metres\)"),
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
        make_target(size, spacing, paper)


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
    (tmp_path / "board.pdf").write_bytes(to_pdf(make_target((9, 6), 0.025)))
    command = ["pdftoppm", "-r", "72", "-gray", "-singlefile", "board.pdf", "board"]
    subprocess.run(command, cwd=tmp_path, check=True, timeout=60)
    page = cv2.imread(str(tmp_path / "board.pgm"), cv2.IMREAD_GRAYSCALE)
    found, corners = cv2.findChessboardCornersSB(page, (9, 6))
    assert found
    grid = corners.reshape(6, 9, 2)
    assert np.hypot(*(grid[0, -1] - grid[0, 0])) == pytest.approx(8 * 25 * 72 / 25.4, abs=0.3)
