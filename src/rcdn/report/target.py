"""A target to print at true scale: the layout of the page in millimetres, and its output as PDF or SVG.

Coordinates are millimetres on the page, origin at its top-left corner, x right, y down.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from xml.sax.saxutils import escape

from rcdn.errors import ConfigError
from rcdn.targets.drawing import draw, extent
from rcdn.targets.specification import specification
from rcdn.types import AprilGrid, Charuco, Checkerboard, Deltille, Print, Printed, PuzzlePart
from rcdn.types.shapes import Disc, Rect, Shape

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
"""Paper sizes, (width, height) mm, portrait."""

QUIET = 10.0
"""Minimum white margin around the squares, mm. It also covers the unprintable margin of printers."""
QUIET_SQUARES = 0.25
"""Minimum white margin around the squares, as a fraction of a square (or tag): large squares need a larger margin."""
FOOTER = 14.0
"""Height of the footer with a line of text and the ruler, mm."""
LINE = 4.5
"""Distance of lines of text, mm."""
EDGE = 6.0
"""Distance of the ruler's base line from the page's lower edge, mm."""
RULER = 100.0
"""Length of the ruler between the centres of its first and last tick, mm."""
HAIR = 0.2
"""Line width of the ruler, mm."""
FONT = 3.2
"""Font size, mm."""


@dataclass(frozen=True)
class Label:
    """A line of text whose baseline starts at (x, y), mm."""

    x: float
    y: float
    text: str


@dataclass(frozen=True)
class Page:
    """A page with one target. `size` (width, height) mm; `shapes` are those of the target, `ruler` and `labels` form
    the footer."""

    printed: Printed
    size: tuple[float, float]
    shapes: tuple[Shape, ...]
    ruler: tuple[Rect, ...]
    labels: tuple[Label, ...]


def make_page(printed: Printed, paper: str = "a4") -> Page:
    """Lay out a target on a sheet of `paper`, in landscape or portrait, whichever allows larger squares.

    Raises ConfigError if the target or the `paper` can't be used, or if the target doesn't fit; the message then gives
    a spacing that fits.
    """
    target, spacing = printed.target, printed.spacing
    if paper not in PAPERS:
        raise ConfigError(f"paper must be one of {', '.join(PAPERS)}, not {paper!r}")
    least = _LEAST.get(target.kind, 3)
    if min(target.columns, target.rows or 0) < least:
        raise ConfigError(
            f"size {target.columns}x{target.rows} is too small: a {target.kind} to print has at least "
            f"{least}x{least} {_counted(target)}"
        )
    upright = PAPERS[paper]
    size = max((upright, upright[::-1]), key=lambda p: _largest(target, p))
    most = _largest(target, size)
    if spacing * 1000 > most + 1e-6:
        raise ConfigError(_too_large(printed, paper, most))
    drawing = draw(printed)
    left, top = (size[0] - drawing.width * 1000) / 2, (size[1] - _footer(target) - drawing.height * 1000) / 2
    shapes = tuple(shape.placed(1000, left, top) for shape in drawing.shapes)
    x, y = QUIET, size[1] - EDGE
    lines = _text(printed)
    labels = [Label(x, y - LINE * (len(lines) - k), line) for k, line in enumerate(lines)]
    return Page(printed, size, shapes, _ruler(x, y), (*labels, Label(x + RULER + 2, y, "100 mm: measure it")))


def largest_spacing(target: Print, paper: str) -> float:
    """The largest spacing, m, at which a target fits on `paper`; 0 if none does."""
    width, height = PAPERS[paper]
    return max(_largest(target, (width, height)), _largest(target, (height, width)), 0.0) / 1000


def orientation_note(size: tuple[int, int]) -> str | None:
    """A note on boards of `size` that are symmetric under rotation, or None if this one isn't.

    A rotation by half a turn maps square (a, b) to (columns − a, rows − b): colours agree if columns + rows is even. A
    quarter turn of a board with columns = rows maps (a, b) to (b, columns − a): colours agree if columns is even.
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


def to_svg(page: Page) -> str:
    """`page` as SVG text; one user unit is a millimetre."""
    width, height = (_number(v) for v in page.size)
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}mm" height="{height}mm" '
        f'viewBox="0 0 {width} {height}">',
        f'<rect width="{width}" height="{height}" fill="white"/>',
        '<g id="squares" fill="black">',
        *map(_svg_shape, page.shapes),
        '</g>\n<g id="ruler" fill="black">',
        *map(_svg_shape, page.ruler),
        f'</g>\n<g id="labels" font-family="Helvetica, Arial, sans-serif" font-size="{_number(FONT)}">',
        *(f'<text x="{_number(t.x)}" y="{_number(t.y)}">{escape(t.text)}</text>' for t in page.labels),
        "</g>\n</svg>\n",
    ]
    return "\n".join(lines)


def to_pdf(page: Page) -> bytes:
    """`page` as a one-page PDF 1.4 that requests printing without scaling."""
    width, height = (v * 72 / 25.4 for v in page.size)
    content = _pdf_content(page)
    objects = [
        b"<< /Type /Catalog /Pages 2 0 R /ViewerPreferences << /PrintScaling /None >> >>",
        b"<< /Type /Pages /Kids [3 0 R] /Count 1 >>",
        f"<< /Type /Page /Parent 2 0 R /MediaBox [0 0 {width:.4f} {height:.4f}] /Contents 4 0 R "
        "/Resources << /Font << /F1 5 0 R >> >> >>".encode("ascii"),
        b"<< /Length %d >>\nstream\n%b\nendstream" % (len(content), content),
        b"<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica /Encoding /WinAnsiEncoding >>",
    ]
    return _pdf_file(objects)


_LEAST = {"aprilgrid": 2}
"""minimum number of columns and rows of a printed target; 3 for kinds not listed"""


def _counted(target: Print) -> str:
    return {"charuco": "squares", "aprilgrid": "tags"}.get(target.kind, "inner corners")


def _footer(target: Print) -> float:
    """Height of the footer, mm: coded targets need a second line of text."""
    return FOOTER + LINE * (not isinstance(target, (Checkerboard, Deltille)))


def _largest(target: Print, page: tuple[float, float]) -> float:
    """The largest spacing, mm, that fits on a page of this width and height (negative: none)."""
    fits = [
        min((room - 2 * QUIET) / count, room / (count + 2 * QUIET_SQUARES))
        for room, count in zip((page[0], page[1] - _footer(target)), extent(target), strict=True)
    ]
    return min(fits)


def _too_large(printed: Printed, paper: str, most: float) -> str:
    target, spacing = printed.target, printed.spacing
    wide, high = extent(target)
    unit = {"deltille": "triangles wide", "aprilgrid": f"by {high:g} sides of a tag"}.get(
        target.kind, f"by {high:g} squares"
    )
    article = "an" if target.kind == "aprilgrid" else "a"
    board = f"{article} {target.kind} of {target.columns}x{target.rows} {_counted(target)}"
    if not isinstance(target, Charuco):
        board += f" is {wide:g} {unit}"
    most = math.floor(most * 10) / 10  # rounded down, so that the suggested spacing fits
    if most < 1:
        return f"size: {board}, too many for {paper} paper; take a larger paper or a smaller size"
    advice = f"the largest spacing that fits is {most / 1000:g} m ({most:g}mm)"
    sheets = (p for p in PAPERS if (p[0] == "a") == (paper[0] == "a"))  # of the same standard
    if wider := [p for p in sheets if largest_spacing(target, p) >= spacing]:
        advice += f"; or take {min(wider, key=lambda p: PAPERS[p][0] * PAPERS[p][1])} paper"
    if spacing >= 1 and spacing <= most:
        advice = f"spacing is in metres: for {spacing:g} mm give {spacing / 1000:g}"
    return f"spacing {spacing:g}: {board}, which at {spacing * 1000:g} mm doesn't fit on {paper} paper; {advice}"


def _text(printed: Printed) -> tuple[str, ...]:
    """The description of the target on the page: all that is needed to use it."""
    target, side = printed.target, printed.spacing * 1000
    many = f"{target.columns}×{target.rows}"
    how = "print at 100 %"
    if isinstance(target, Charuco):
        one = f"ChArUco, {many} squares of {side:.6g} mm · markers {target.marker * side:.6g} mm · {how}"
    elif isinstance(target, AprilGrid):
        one = f"AprilGrid, {many} tags of {side:.6g} mm · {target.gap * side:.6g} mm apart · {how}"
    elif isinstance(target, PuzzlePart):
        one = f"PuzzleBoard, {many} inner corners · {side:.6g} mm squares · {how}"
    else:
        of, shape = ("deltille, ", "triangles") if isinstance(target, Deltille) else ("", "squares")
        return (f"{of}{many} inner corners · {side:.6g} mm {shape} · {how}",)
    return one, specification(target)


def _ruler(x: float, y: float) -> tuple[Rect, ...]:
    """The ruler: a base line and a tick every centimetre; positions are those of the ticks' centres."""
    base = Rect(x - HAIR / 2, y - HAIR, RULER + HAIR, HAIR)
    heights = {0: 3.0, 5: 2.5, 10: 3.0}
    ticks = [(x + 10 * k, heights.get(k, 1.5)) for k in range(11)]
    return (base, *(Rect(at - HAIR / 2, y - h, HAIR, h) for at, h in ticks))


def _number(value: float) -> str:
    """A number to a hundredth of a micrometre, never in exponent notation, which PDF doesn't allow."""
    return f"{value:.5f}".rstrip("0").rstrip(".")


def _svg_shape(shape: Shape) -> str:
    if isinstance(shape, Rect):
        x, y, w, h = map(_number, (shape.x, shape.y, shape.width, shape.height))
        return f'<rect x="{x}" y="{y}" width="{w}" height="{h}"/>'
    if isinstance(shape, Disc):
        x, y, r = map(_number, (shape.x, shape.y, shape.radius))
        fill = ' fill="white"' if shape.white else ""
        return f'<circle cx="{x}" cy="{y}" r="{r}"{fill}/>'
    loops = [" ".join(f"{_number(x)},{_number(y)}" for x, y in loop) for loop in shape.loops]
    if len(loops) == 1:
        return f'<polygon points="{loops[0]}"/>'
    return f'<path fill-rule="evenodd" d="{" ".join(f"M{loop}Z" for loop in loops)}"/>'


def _pdf_content(page: Page) -> bytes:
    """The page as PDF drawing operators. `cm` sets the unit to a millimetre; PDF's y axis points up, so y is
    flipped."""
    height = page.size[1]
    lines = [f"{72 / 25.4:.9f} 0 0 {72 / 25.4:.9f} 0 0 cm", "0 g"]
    lines += [_pdf_shape(shape, height) for shape in (*page.shapes, *page.ruler)]
    for label in page.labels:
        text = label.text.replace("\\", r"\\").replace("(", r"\(").replace(")", r"\)")
        lines.append(f"BT /F1 {_number(FONT)} Tf {_number(label.x)} {_number(height - label.y)} Td ({text}) Tj ET")
    return "\n".join(lines).encode("cp1252")


def _pdf_shape(shape: Shape, height: float) -> str:
    """The operators that fill a shape on a page of this height, mm."""
    if isinstance(shape, Rect):
        x, y, w, h = map(_number, (shape.x, height - shape.y - shape.height, shape.width, shape.height))
        return f"{x} {y} {w} {h} re f"
    if isinstance(shape, Disc):
        return f"{'1' if shape.white else '0'} g {_pdf_circle(shape, height)} f 0 g"
    paths = []
    for loop in shape.loops:
        points = [f"{_number(x)} {_number(height - y)}" for x, y in loop]
        paths.append(f"{points[0]} m {' l '.join(points[1:])} l h")
    return f"{' '.join(paths)} f*"


def _pdf_circle(disc: Disc, height: float) -> str:
    """A circle as four Bézier arcs, which deviate from it by less than 3/10,000 of its radius."""
    handle = 4 / 3 * (math.sqrt(2) - 1)
    x, y, r = disc.x, height - disc.y, disc.radius
    at = lambda u, v: f"{_number(x + r * u)} {_number(y + r * v)}"  # noqa: E731
    parts = [f"{at(1, 0)} m"]
    for u, v in ((1, 0), (0, 1), (-1, 0), (0, -1)):  # from (u, v) to (−v, u)
        parts.append(f"{at(u - handle * v, v + handle * u)} {at(-v + handle * u, u + handle * v)} {at(-v, u)} c")
    return " ".join(parts)


def _pdf_file(objects: list[bytes]) -> bytes:
    """A PDF file of the `objects`, numbered from 1, with the table of their byte offsets. The first is the
    catalogue."""
    out = bytearray(b"%PDF-1.4\n%\xe2\xe3\xcf\xd3\n")  # four bytes above 127 mark the file as binary
    offsets = []
    for number, body in enumerate(objects, start=1):
        offsets.append(len(out))
        out += b"%d 0 obj\n%b\nendobj\n" % (number, body)
    start = len(out)
    out += b"xref\n0 %d\n0000000000 65535 f \n" % (len(objects) + 1)
    out += b"".join(b"%010d 00000 n \n" % offset for offset in offsets)
    out += b"trailer\n<< /Size %d /Root 1 0 R >>\nstartxref\n%d\n%%%%EOF\n" % (len(objects) + 1, start)
    return bytes(out)
