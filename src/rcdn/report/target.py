"""A checkerboard, or a deltille, to print at true scale: the geometry once, in millimetres, and two thin writers (PDF, SVG).

Coordinates are millimetres on the page, origin at its top-left corner, x right, y down.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from xml.sax.saxutils import escape

import numpy as np

from rcdn.errors import ConfigError
from rcdn.types import Pattern, plane_points
from rcdn.types.corners import ROW

PAPERS = {
    "a0": (841.0, 1189.0),
    "a1": (594.0, 841.0),
    "a2": (420.0, 594.0),
    "a3": (297.0, 420.0),
    "a4": (210.0, 297.0),
    "a5": (148.0, 210.0),
    "letter": (215.9, 279.4),
    "legal": (215.9, 355.6),
    "tabloid": (279.4, 431.8),
}
"""Sheet sizes, (width, height) mm, upright."""

QUIET = 10.0
"""Least white around the squares, mm. It also keeps them off the edge, where printers can't print."""
QUIET_SQUARES = 0.25
"""Least white around the squares, as a part of a square: large squares need more of it."""
FOOTER = 14.0
"""Height of the band at the foot of the page for the text and the ruler, mm."""
EDGE = 6.0
"""The ruler's ticks end this far above the page's lower edge, mm."""
RULER = 100.0
"""Length of the ruler between the centres of its first and last tick, mm."""
HAIR = 0.2
"""Line width of the ruler, mm."""
FONT = 3.2
"""Font size, mm."""


@dataclass(frozen=True)
class Rect:
    """A filled black rectangle; (x, y) is its top-left corner, mm."""

    x: float
    y: float
    width: float
    height: float


@dataclass(frozen=True)
class Triangle:
    """A filled black triangle; its corners (x, y), mm."""

    corners: tuple[tuple[float, float], tuple[float, float], tuple[float, float]]


@dataclass(frozen=True)
class Label:
    """A line of text whose baseline starts at (x, y), mm."""

    x: float
    y: float
    text: str


@dataclass(frozen=True)
class Target:
    """A page with one board. `size` (columns, rows) in inner corners; `spacing` in metres; `page` (width, height) mm.

    `squares` are the black squares, row by row from the top-left one, `triangles` the black triangles of a deltille; `ruler` and `labels` are
    the foot of the page.
    """

    size: tuple[int, int]
    spacing: float
    page: tuple[float, float]
    squares: tuple[Rect, ...]
    ruler: tuple[Rect, ...]
    labels: tuple[Label, ...]
    triangles: tuple[Triangle, ...] = ()


def make_target(size: tuple[int, int], spacing: float, paper: str = "a4", pattern: Pattern = "checker") -> Target:
    """Lay out a board of `size` (columns, rows) inner corners with squares of `spacing` metres on `paper`.

    `pattern` deltille: with triangles of that side; every other row of corners is set off by half a side, and the triangles are those at
    its inner corners. The sheet lies or stands, whichever takes the larger squares. Raises ConfigError if `size`, `spacing` or `paper`
    can't be used, or if the board doesn't fit; that message says which spacing does.
    """
    if paper not in PAPERS:
        raise ConfigError(f"paper must be one of {', '.join(PAPERS)}, not {paper!r}")
    if min(size) < 3:
        raise ConfigError(f"size {size[0]}x{size[1]} is too small: a board has at least 3x3 inner corners")
    if not (math.isfinite(spacing) and spacing > 0):
        raise ConfigError(f"spacing must be a length above 0, in metres, not {spacing:g}")
    upright = PAPERS[paper]
    page = max((upright, upright[::-1]), key=lambda p: _largest(size, p, pattern))
    side, most = spacing * 1000, _largest(size, page, pattern)
    if side > most + 1e-6:
        raise ConfigError(_too_large(size, spacing, paper, most, pattern))
    return _layout(size, spacing, page) if pattern == "checker" else _layout_deltille(size, spacing, page)


def largest_spacing(size: tuple[int, int], paper: str) -> float:
    """The largest spacing, metres, at which a board of `size` inner corners fits on `paper`; 0 if none does."""
    width, height = PAPERS[paper]
    return max(_largest(size, (width, height)), _largest(size, (height, width)), 0.0) / 1000


def orientation_note(size: tuple[int, int]) -> str | None:
    """What to know about boards of `size` that look the same when turned, or None if this one never does.

    Half a turn maps square (a, b) to (columns − a, rows − b): colours agree if columns + rows is even. A quarter turn
    of a board with columns = rows maps (a, b) to (b, columns − a): colours agree if columns is even.
    """
    cols, rows = size
    if (cols + rows) % 2:
        return None
    turn = "a quarter turn" if cols == rows and cols % 2 == 0 else "half a turn"
    better = f"{max(size) + 1}x{min(size)}"
    return (
        f"a board of {cols}x{rows} looks the same after {turn}: which corner is the first stays open. "
        f"One odd and one even number settle it, such as {better}."
    )


def to_svg(target: Target) -> str:
    """`target` as SVG text, one user unit a millimetre."""
    width, height = (_number(v) for v in target.page)
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}mm" height="{height}mm" '
        f'viewBox="0 0 {width} {height}">',
        f'<rect width="{width}" height="{height}" fill="white"/>',
        '<g id="squares" fill="black">',
        *map(_svg_rect, target.squares),
        *map(_svg_triangle, target.triangles),
        '</g>\n<g id="ruler" fill="black">',
        *map(_svg_rect, target.ruler),
        f'</g>\n<g id="labels" font-family="Helvetica, Arial, sans-serif" font-size="{_number(FONT)}">',
        *(f'<text x="{_number(t.x)}" y="{_number(t.y)}">{escape(t.text)}</text>' for t in target.labels),
        "</g>\n</svg>\n",
    ]
    return "\n".join(lines)


def to_pdf(target: Target) -> bytes:
    """`target` as a one-page PDF 1.4 that asks the viewer not to scale it when printing."""
    width, height = (v * 72 / 25.4 for v in target.page)
    content = _pdf_content(target)
    objects = [
        b"<< /Type /Catalog /Pages 2 0 R /ViewerPreferences << /PrintScaling /None >> >>",
        b"<< /Type /Pages /Kids [3 0 R] /Count 1 >>",
        f"<< /Type /Page /Parent 2 0 R /MediaBox [0 0 {width:.4f} {height:.4f}] /Contents 4 0 R "
        "/Resources << /Font << /F1 5 0 R >> >> >>".encode("ascii"),
        b"<< /Length %d >>\nstream\n%b\nendstream" % (len(content), content),
        b"<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica /Encoding /WinAnsiEncoding >>",
    ]
    return _pdf_file(objects)


def _extent(size: tuple[int, int], pattern: Pattern) -> tuple[float, float]:
    """Width and height of what is printed, in sides of a square or triangle."""
    cols, rows = size
    return (cols + 1.0, rows + 1.0) if pattern == "checker" else (cols + 1.5, (rows + 1) * ROW)


def _largest(size: tuple[int, int], page: tuple[float, float], pattern: Pattern = "checker") -> float:
    """Side of the largest squares, mm, that fit on a page of that width and height (below 0: none)."""
    fits = [
        min((room - 2 * QUIET) / count, room / (count + 2 * QUIET_SQUARES))
        for room, count in zip((page[0], page[1] - FOOTER), _extent(size, pattern), strict=True)
    ]
    return min(fits)


def _too_large(size: tuple[int, int], spacing: float, paper: str, most: float, pattern: Pattern) -> str:
    board = f"{size[0]}x{size[1]} inner corners are {size[0] + 1}x{size[1] + 1} squares"
    if pattern != "checker":
        board = f"a deltille of {size[0]}x{size[1]} inner corners is {size[0] + 1.5:g} triangles wide"
    most = math.floor(most * 10) / 10  # rounded down: the advice must fit
    if most < 1:
        return f"size: {board}, too many for {paper} paper; take a larger paper or a smaller size"
    advice = f"the largest spacing that fits is {most / 1000:g} (metres)"
    if spacing >= 1 and spacing <= most:
        advice = f"spacing is in metres: for {spacing:g} mm give {spacing / 1000:g}"
    return f"spacing {spacing:g}: {board}, which at {spacing * 1000:g} mm don't fit on {paper} paper; {advice}"


def _layout(size: tuple[int, int], spacing: float, page: tuple[float, float]) -> Target:
    side = spacing * 1000
    nx, ny = size[0] + 1, size[1] + 1
    left, top = (page[0] - nx * side) / 2, (page[1] - FOOTER - ny * side) / 2
    squares = [
        Rect(left + a * side, top + b * side, side, side) for b in range(ny) for a in range(nx) if (a + b) % 2 == 0
    ]
    x, y = QUIET, page[1] - EDGE
    text = f"{size[0]}×{size[1]} inner corners · {side:.6g} mm squares · print at 100 %"
    labels = (
        Label(x, y - 4.5, text),
        Label(x + RULER + 2, y, "100 mm: measure it"),
    )
    return Target(size, spacing, page, tuple(squares), _ruler(x, y), labels)


def _layout_deltille(size: tuple[int, int], spacing: float, page: tuple[float, float]) -> Target:
    side = spacing * 1000
    width, height = _extent(size, "deltille")
    left, top = (page[0] - width * side) / 2, (page[1] - FOOTER - height * side) / 2
    inner = {(k - j // 2, j) for j in range(size[1]) for k in range(size[0])}
    first = [(i + d, j + e) for i, j in inner for d, e in ((0, 0), (-1, 0), (0, -1))]
    triangles = []
    for i, j in sorted(set(first), key=lambda ij: (ij[1], ij[0])):
        xy = plane_points(np.array([(i, j), (i + 1, j), (i, j + 1)]), "deltille") * side
        xy += np.array([left + side, top + ROW * side])
        a, b, c = ((float(x), float(y)) for x, y in xy)
        triangles.append(Triangle((a, b, c)))
    x, y = QUIET, page[1] - EDGE
    text = f"deltille, {size[0]}×{size[1]} inner corners · {side:.6g} mm triangles · print at 100 %"
    labels = (Label(x, y - 4.5, text), Label(x + RULER + 2, y, "100 mm: measure it"))
    return Target(size, spacing, page, (), _ruler(x, y), labels, tuple(triangles))


def _ruler(x: float, y: float) -> tuple[Rect, ...]:
    """A base line and a tick every centimetre; positions are those of the ticks' centres."""
    base = Rect(x - HAIR / 2, y - HAIR, RULER + HAIR, HAIR)
    heights = {0: 3.0, 5: 2.5, 10: 3.0}
    ticks = [(x + 10 * k, heights.get(k, 1.5)) for k in range(11)]
    return (base, *(Rect(at - HAIR / 2, y - h, HAIR, h) for at, h in ticks))


def _number(value: float) -> str:
    """Up to a hundredth of a micrometre, never in exponent form (PDF doesn't know that)."""
    return f"{value:.5f}".rstrip("0").rstrip(".")


def _svg_rect(r: Rect) -> str:
    x, y, w, h = map(_number, (r.x, r.y, r.width, r.height))
    return f'<rect x="{x}" y="{y}" width="{w}" height="{h}"/>'


def _svg_triangle(t: Triangle) -> str:
    points = " ".join(f"{_number(x)},{_number(y)}" for x, y in t.corners)
    return f'<polygon points="{points}"/>'


def _pdf_content(target: Target) -> bytes:
    """Drawing operators. `cm` makes the unit a millimetre; PDF's y goes up, so it is turned round here."""
    height = target.page[1]
    lines = [f"{72 / 25.4:.9f} 0 0 {72 / 25.4:.9f} 0 0 cm", "0 g"]
    for r in (*target.squares, *target.ruler):
        x, y, w, h = map(_number, (r.x, height - r.y - r.height, r.width, r.height))
        lines.append(f"{x} {y} {w} {h} re")
    for t in target.triangles:
        (ax, ay), (bx, by), (cx, cy) = ((_number(x), _number(height - y)) for x, y in t.corners)
        lines.append(f"{ax} {ay} m {bx} {by} l {cx} {cy} l h")
    lines.append("f")
    for label in target.labels:
        text = label.text.replace("\\", r"\\").replace("(", r"\(").replace(")", r"\)")
        lines.append(f"BT /F1 {_number(FONT)} Tf {_number(label.x)} {_number(height - label.y)} Td ({text}) Tj ET")
    return "\n".join(lines).encode("cp1252")


def _pdf_file(objects: list[bytes]) -> bytes:
    """Number the objects from 1 and add the table of their byte offsets. The first object is the catalogue."""
    out = bytearray(b"%PDF-1.4\n%\xe2\xe3\xcf\xd3\n")  # four high bytes: tells transfer programs that it is binary
    offsets = []
    for number, body in enumerate(objects, start=1):
        offsets.append(len(out))
        out += b"%d 0 obj\n%b\nendobj\n" % (number, body)
    start = len(out)
    out += b"xref\n0 %d\n0000000000 65535 f \n" % (len(objects) + 1)
    out += b"".join(b"%010d 00000 n \n" % offset for offset in offsets)
    out += b"trailer\n<< /Size %d /Root 1 0 R >>\nstartxref\n%d\n%%%%EOF\n" % (len(objects) + 1, start)
    return bytes(out)
