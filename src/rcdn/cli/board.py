"""`rcdn board`: a checkerboard, a deltille, or a coded board, to print at true scale."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rcdn.errors import ConfigError
from rcdn.terminal.options import GridSize, parse_size
from rcdn.terminal.spacing import Length, check_length, length_of_file, parse_length

if TYPE_CHECKING:
    from rcdn.types import Print

MOST_CORNERS = 1_000_000


class Paper(StrEnum):
    """Sheet sizes; their dimensions are in rcdn.report.target."""

    a0 = "a0"
    a1 = "a1"
    a2 = "a2"
    a3 = "a3"
    a4 = "a4"
    a5 = "a5"
    letter = "letter"
    legal = "legal"
    tabloid = "tabloid"


class Printable(StrEnum):
    """The patterns that can be printed."""

    checker = "checker"
    deltille = "deltille"
    charuco = "charuco"
    aprilgrid = "aprilgrid"
    puzzleboard = "puzzleboard"


OPTIONS = {
    Printable.charuco: ("dictionary", "marker", "legacy", "inverted", "first"),
    Printable.aprilgrid: ("family", "gap", "border", "first"),
    Printable.puzzleboard: ("first",),
}
"""the options specific to each pattern"""


def _size(text: str) -> GridSize:
    return parse_size(text, least=1)  # 2 suffice for tags; the page checks each target's minimum


def board(
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="FILE", help="Where to write: a .pdf or .svg file.")
    ],
    size: Annotated[
        GridSize | None,
        typer.Option(
            parser=_size,
            metavar="COLSxROWS",
            help="Inner corners, where four squares (six triangles) meet: 9x6 gives 10x7 squares. Of a ChArUco board "
            "its squares, of an AprilGrid its tags.",
        ),
    ] = None,
    spacing: Annotated[
        Length | None,
        typer.Option(
            parser=parse_length,
            metavar="LENGTH",
            help="Side of one square, triangle or tag, with its unit: 25mm, 2.5cm, 1in. "
            "A number alone is in metres: 0.025.",
        ),
    ] = None,
    paper: Annotated[
        Paper, typer.Option(help="Paper size. It is turned if the board fits better that way.")
    ] = Paper.a4,
    pattern: Annotated[
        Printable,
        typer.Option(
            help="checker: squares. deltille: triangles, for `rcdn detect --pattern deltille`. The others carry codes "
            "that tell every corner from the others; --spacing is the side of a square or of a tag."
        ),
    ] = Printable.checker,
    dictionary: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help="charuco: OpenCV's dictionary of markers. Usually DICT_4X4_50 or a longer one."
        ),
    ] = None,
    marker: Annotated[
        float | None,
        typer.Option(metavar="SHARE", help="charuco: side of a marker over that of a square; usually 0.75."),
    ] = None,
    legacy: Annotated[
        bool, typer.Option("--legacy", help="charuco: as OpenCV before 4.6, even rows begin with a white square.")
    ] = False,
    inverted: Annotated[bool, typer.Option("--inverted", help="charuco: white markers in black squares.")] = False,
    family: Annotated[
        str | None, typer.Option(metavar="NAME", help="aprilgrid: the family of tags; usually tag36h11, Kalibr's.")
    ] = None,
    gap: Annotated[
        float | None, typer.Option(metavar="SHARE", help="aprilgrid: distance of tags over their side; usually 0.3.")
    ] = None,
    border: Annotated[
        int | None,
        typer.Option(metavar="BITS", help="aprilgrid: width of a tag's black border, 1 or 2; usually 2, Kalibr's."),
    ] = None,
    first: Annotated[
        str | None,
        typer.Option(
            metavar="N",
            help="The number of the first marker or tag, usually 0. puzzleboard: "
            "COLUMN,ROW of its first corner on the code.",
        ),
    ] = None,
    which: Annotated[
        str | None,
        typer.Option(
            "--target",
            metavar="WHICH",
            help="What to print in one word, such as charuco:8x6:DICT_4X4_50:0.75, or its YAML file, Kalibr's "
            "too, in place of --size, --pattern and a pattern's options.",
        ),
    ] = None,
    yaml: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Write what is printed as YAML, too: Kalibr's form where it has one for the target."
        ),
    ] = None,
) -> None:
    """Write a board to print, as PDF or SVG, at true scale.

    Print it at 100 % ("actual size"), measure the ruler at its foot, and glue it on something flat. Of a plain
    checkerboard take one odd and one even number (9x6, not 8x6): then the board looks different when it is turned by
    half, and it is always known which corner is the first.
    """
    ending = output.suffix.lower()
    if ending not in (".pdf", ".svg"):
        raise ConfigError(f"--output {output}: the name must end in .pdf or .svg")
    given: dict[str, Any] = {
        "dictionary": dictionary,
        "marker": marker,
        "legacy": legacy or None,
        "inverted": inverted or None,
    }
    given |= {"family": family, "gap": gap, "border": border, "first": first}
    given = {name: value for name, value in given.items() if value is not None}
    if which is None:
        target, length = _target(pattern, _present(size), given), spacing
    else:
        if size is not None or pattern is not Printable.checker or given:
            raise ConfigError("--target says what to print; leave out --size, --pattern and the options of patterns")
        target, length = _read(which, spacing)
    if length is None:
        raise ConfigError("--spacing is missing: the side of one square, triangle or tag, such as 25mm")
    _check(target, length)
    _write(target, length, paper, output, yaml)
    if note := _note(target):
        typer.echo(f"note: {note}")


def _present(size: GridSize | None) -> GridSize:
    if size is None:
        raise ConfigError("--size is missing, such as 9x6; or give --target WHICH")
    _check_size(size.cols, size.rows)
    return size


def _read(which: str, spacing: Length | None) -> tuple[Print, Length | None]:
    """The target of --target, and its spacing: --spacing, or that given in its file."""
    from rcdn.targets.specification import FORMS, read_specification
    from rcdn.types import Printed, PuzzleBoard

    parsed = read_specification(which)
    if isinstance(parsed, PuzzleBoard):
        raise ConfigError(f"--target {which}: which part of the code? Write {FORMS['puzzleboard']}")
    if isinstance(parsed, Printed):
        return parsed.target, spacing or length_of_file(which, parsed.spacing)
    return parsed, spacing


def _check(target: Print, spacing: Length) -> None:
    size = target.columns, target.rows or 0
    _check_size(*size)
    check_length(spacing, size)


def _check_size(columns: int, rows: int) -> None:
    if columns * rows > MOST_CORNERS:
        raise ConfigError(f"--size: a board of {columns}x{rows} can't be printed; {MOST_CORNERS} corners are the most")


def _note(target: Print) -> str | None:
    """A note on a target whose corners can't be identified uniquely, or None."""
    from rcdn.report.target import orientation_note
    from rcdn.targets.specification import specification
    from rcdn.types import AprilGrid, Charuco, Checkerboard

    if isinstance(target, Charuco) and target.first_id:
        return (
            f"numbers that begin with {target.first_id} are read where the paper above the first row is seen: leave "
            f"half a square of it white; else say which board it is, --target {specification(target)}"
        )
    if isinstance(target, AprilGrid) and target.first_id:
        return (
            f"numbers that begin with {target.first_id} can look like a part of a larger board that begins with 0: "
            f"say which board it is, --target {specification(target)}"
        )
    return orientation_note((target.columns, target.rows)) if isinstance(target, Checkerboard) else None


def _write(target: Print, spacing: Length, paper: Paper, output: Path, yaml: Path | None) -> None:
    from rcdn.io import check_writable, write_bytes, write_text
    from rcdn.report.target import make_page, to_pdf, to_svg
    from rcdn.targets.files import write_target
    from rcdn.types import Printed

    printed = Printed(target, float(spacing))
    page = make_page(printed, paper.value)
    if yaml is not None:
        if yaml.resolve() == output.resolve():
            raise ConfigError(f"--yaml {yaml} is --output, too; give another name")
        check_writable(yaml)
    if output.suffix.lower() == ".pdf":
        write_bytes(output, to_pdf(page))
    else:
        write_text(output, to_svg(page))
    lies = "landscape" if page.size[0] > page.size[1] else "portrait"
    what = page.labels[0].text.removesuffix(" · print at 100 %").replace(" · ", ", ")
    typer.echo(f"wrote {output}: {what}, {paper.value} {lies}")
    if yaml is not None:
        write_target(yaml, printed)
        typer.echo(f"wrote {yaml}: the target, for --target {yaml}")
    typer.echo("Print it at 100 % and measure the ruler: it must be 100 mm long.")


def _target(pattern: Printable, size: GridSize, given: Mapping[str, Any]) -> Print:
    """The target to print. Raises ConfigError for options of other patterns, and for invalid values."""
    from rcdn.targets.specification import whole
    from rcdn.types import AprilGrid, Charuco, Checkerboard, Deltille, PuzzlePart

    for name in given:
        if name not in OPTIONS.get(pattern, ()):
            of = " or ".join(p for p, names in OPTIONS.items() if name in names)
            raise ConfigError(f"--{name} is for --pattern {of}; leave it out with {pattern}")
    if pattern is Printable.puzzleboard:
        at = given.get("first", "0,0").split(",")
        if len(at) != 2:
            raise ConfigError(
                f"--first: a PuzzleBoard begins at COLUMN,ROW of its code, such as 0,100, not {given['first']!r}"
            )
        return PuzzlePart(*size, *(whole(text, "--first") for text in at))
    first = whole(given.get("first", "0"), "--first")
    if pattern is Printable.charuco:
        name = _dictionary(given.get("dictionary"), first + (size.cols * size.rows + 1) // 2)
        legacy, inverted = (given.get(key, False) for key in ("legacy", "inverted"))
        return Charuco(*size, name, given.get("marker", 0.75), first, legacy, inverted)
    if pattern is Printable.aprilgrid:
        from rcdn.targets.dictionaries import family_name

        family = family_name(given.get("family", "tag36h11"))
        return AprilGrid(*size, family, given.get("gap", 0.3), given.get("border", 2), first)
    return Checkerboard(*size) if pattern is Printable.checker else Deltille(*size)


def _dictionary(name: str | None, markers: int) -> str:
    """The requested dictionary, or the smallest one of 4 × 4 bits with at least that number of `markers`."""
    from rcdn.targets.dictionaries import dictionary_name

    if name is not None:
        return dictionary_name(name)
    return next((f"DICT_4X4_{n}" for n in (50, 100, 250) if markers <= n), "DICT_4X4_1000")
