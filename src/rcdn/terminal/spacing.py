"""`--spacing`: a length with its unit; an error asks for the unit if a length without one, or that of a target's file,
implies a board of metres."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated

import typer

from rcdn.errors import ConfigError, a_board

if TYPE_CHECKING:
    from rcdn.types import Board

UNITS = {"mm": 0.001, "cm": 0.01, "m": 1.0, "in": 0.0254, '"': 0.0254, "": 1.0}
"""m; a number without a unit is in metres"""
LARGEST = 2.0
"""m across: a larger board is accepted only if the length has a unit"""
SMALLEST_BOARD = 3
"""squares: smallest size of a board"""
LENGTH = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([a-z\"]*)\s*")


OPTION = "--spacing"


class Length(float):
    """A length in metres, with the `text` given by the user and whether it had a `unit`; `source`: the option, or the
    file and its field, that says it."""

    text: str
    unit: bool
    source: str = OPTION

    @property
    def of_file(self) -> bool:
        """Whether a target's file says it."""
        return self.source != OPTION


class Lengths(dict[str, Length]):
    """A length for each of several kinds of boards."""


def parse_length(text: str) -> Length:
    """`25mm`, `2.5cm`, `1in`, `0.025m`, or `0.025` (metres). Raises typer.BadParameter."""
    match = LENGTH.fullmatch(str(text))
    if match is None or match[2] not in UNITS:
        raise typer.BadParameter(f"{text!r} is not a length; give 25mm, 2.5cm, 1in, or metres: 0.025")
    # mm are divided by 1000, which is exact: 25 / 1000 == 0.025
    length = Length(float(match[1]) / 1000 if match[2] == "mm" else float(match[1]) * UNITS[match[2]])
    length.text, length.unit = str(text).strip(), bool(match[2])
    return length


def length_of_file(path: str, spacing: float) -> Length:
    """The length that `read_target` gives for the file in `path`: in metres, as the file says it."""
    from rcdn.targets.files import spacing_field

    length = Length(spacing)
    length.text, length.unit, length.source = f"{spacing:g}", False, f"{path}: {spacing_field(path)}"
    return length


def check_length(spacing: Length, size: tuple[int, int] | None = None) -> None:
    """Raise ConfigError unless `spacing` is positive and, if it has no unit, implies a board of `size` (inner corners)
    at most 2 m across."""
    from rcdn.types.ranges import SPACING, in_words, is_spacing

    if not is_spacing(spacing):
        raise ConfigError(
            f"{spacing.source} is the side of one square and must be above 0, {in_words(*SPACING)} m (25mm, or metres: "
            f"0.025), not {spacing.text}"
        )
    across = (SMALLEST_BOARD if size is None else max(size) + 1) * spacing
    if spacing.unit or across <= LARGEST:
        return
    board = "a board" if size is None else a_board((size[0], size[1]))
    least = "at least " if size is None else ""
    so_large = f"add {OPTION} {spacing.text}m" if spacing.of_file else f"write {spacing.text}m"
    raise ConfigError(
        f"{spacing.source} {spacing.text} means metres and makes {board} {least}{across:.3g} m across; did you mean "
        f"{_likely(spacing)}? If it is so large, {so_large}"
    )


def _likely(spacing: Length) -> str:
    """The same number with the unit that gives a square of usual size, and its value in metres, as a file has it."""
    unit = "mm" if spacing >= 5 else "cm"
    with_unit, in_metres = f"{spacing.text}{unit}", f"{spacing * UNITS[unit]:.6g}"
    return f"{in_metres} ({with_unit})" if spacing.of_file else f"{with_unit} ({in_metres})"


def parse_spacing(text: str) -> Length | Lengths:
    """One length, or `charuco=30mm,aprilgrid=88mm`. Raises typer.BadParameter."""
    if "=" not in str(text):
        return parse_length(text)
    found = Lengths()
    for part in str(text).split(","):
        kind, sign, length = part.partition("=")
        kind = kind.strip()
        if not sign or not kind or kind in found:
            raise typer.BadParameter(
                f"{text!r} is no list of lengths; give each kind of board one: charuco=30mm,aprilgrid=88mm"
            )
        found[kind] = parse_length(length)
    return found


def side(spacing: Length | Lengths, kind: str) -> float:
    """The length for boards of a `kind`, m. Raises ConfigError if none was given."""
    if isinstance(spacing, Lengths):
        if kind not in spacing:
            raise ConfigError(f"--spacing names no length for boards of the kind {kind}: add {kind}=30mm")
        return float(spacing[kind])
    return float(spacing)


def metres(spacing: Length | Lengths) -> float | dict[str, float]:
    """The length or lengths in the form that `calibrate` takes."""
    return {k: float(v) for k, v in spacing.items()} if isinstance(spacing, Lengths) else float(spacing)


def check_spacing(spacing: Length | Lengths, sizes: Mapping[str, tuple[int, int] | None] | None = None) -> None:
    """`check_length` for each length with the size (inner corners) of its kind of board, if `sizes` contains it."""
    sizes = sizes or {}
    if isinstance(spacing, Lengths):
        for kind, length in spacing.items():
            check_length(length, sizes.get(kind))
    else:
        check_length(spacing, max((s for s in sizes.values() if s is not None), key=max, default=None))


def sizes_of(boards: Sequence[Board], plain: tuple[int, int] | None = None) -> dict[str, tuple[int, int] | None]:
    """(columns, rows) by kind of board, for `check_spacing`; of AprilGrids in tags; for boards without codes the size
    `plain`, if given."""
    from rcdn.calibration.coded import kind_of
    from rcdn.geometry.cut import whole_size

    kinds = {kind_of(b) for b in boards}
    sizes = {kind: whole_size([b for b in boards if kind_of(b) == kind]) for kind in kinds}
    if tags := sizes.get("aprilgrid"):
        sizes["aprilgrid"] = (tags[0] // 2, tags[1] // 2)  # a tag has two corners a side
    return sizes if plain is None else {**sizes, "checker": plain}


SpacingOrFile = Annotated[
    Length | None,
    typer.Option(
        "--spacing",
        parser=parse_spacing,
        metavar="LENGTH",
        help="Side of one square (or triangle, or tag), with its unit: 25mm, 2.5cm, 1in. A number alone is in metres: "
        "0.025. For several kinds of boards charuco=30mm,aprilgrid=88mm (checker, deltille, puzzleboard). Needed "
        "unless --target names a file, which says it.",
    ),
]
