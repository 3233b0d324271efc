"""Targets as one word, for options and labels: `charuco:8x8:DICT_4X4_50:0.75:legacy`, or the path of a target's
file."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from rcdn.errors import ConfigError, RcdnError, shown
from rcdn.targets.dictionaries import dictionary_name, family_name
from rcdn.targets.drawing import check
from rcdn.targets.files import read_target
from rcdn.types import AprilGrid, Charuco, Checkerboard, Deltille, Print, Printed, PuzzleBoard, PuzzlePart

FORMS = {
    "charuco": "charuco:COLUMNSxROWS:DICTIONARY:MARKER[:legacy][:inverted][:first=N] (squares; MARKER: side of a "
    "marker over that of a square), such as charuco:8x8:DICT_4X4_50:0.75",
    "aprilgrid": "aprilgrid:COLUMNSxROWS[:FAMILY[:GAP]][:border=N][:first=N] (tags; GAP: their distance over their "
    "side), such as aprilgrid:6x6:tag36h11:0.3",
    "puzzleboard": "puzzleboard, or a part of it, puzzleboard:COLUMNSxROWS[:at=COLUMN,ROW] (corners), "
    "such as puzzleboard:12x9:at=0,100",
    "checkerboard": "checkerboard:COLUMNSxROWS (inner corners), such as checkerboard:9x6",
    "deltille": "deltille:COLUMNSxROWS (inner corners), such as deltille:9x6",
}
"""the form of the specification of each kind of target"""
ENDINGS = (".yaml", ".yml")


def read_specification(text: str) -> Print | PuzzleBoard | Printed:
    """The target that `text` specifies; if it is the path of a YAML file (`files.read_target`), the target with its
    scale.

    Raises ConfigError, which names the mistake and shows the form, and FormatError for the contents of a file.
    """
    kind, *parts = [part.strip() for part in text.strip().split(":")]
    if kind.lower() in FORMS:
        return _parsed(kind.lower(), parts, text)
    if text.lower().endswith(ENDINGS) or _is_file(text):
        return read_target(text)
    raise ConfigError(
        f"{shown(text)} is no target: give a YAML file, or {', '.join(f'{k}:…' for k in FORMS)}; {FORMS['charuco']}"
    )


def specification(target: Print | PuzzleBoard) -> str:
    """The text that `read_specification` takes for the target."""
    words = [target.kind]
    if not isinstance(target, PuzzleBoard):
        words.append(f"{target.columns}x{target.rows}")
    if isinstance(target, Charuco):
        words += [target.dictionary, f"{target.marker:.6g}", *("legacy",) * target.legacy]
        words += ("inverted",) * target.inverted
    elif isinstance(target, AprilGrid):
        words += [target.family, f"{target.gap:.6g}", *(f"border={target.border}",) * (target.border != 2)]
    elif isinstance(target, PuzzlePart) and (target.column, target.row) != (0, 0):
        words.append(f"at={target.column},{target.row}")
    if isinstance(target, (Charuco, AprilGrid)) and target.first_id:
        words.append(f"first={target.first_id}")
    return ":".join(words)


def _is_file(text: str) -> bool:
    try:
        return Path(text).is_file()
    except (OSError, ValueError):  # not a valid file name
        return False


def _parsed(kind: str, parts: Sequence[str], text: str) -> Print | PuzzleBoard:
    if kind == "puzzleboard" and not parts:
        return PuzzleBoard()
    try:
        target = _MAKERS[kind](*_split(parts))
        check(target)
    except RcdnError as error:
        raise ConfigError(f"{shown(text)}: {error}. Write {FORMS[kind]}") from error
    return target


class _Words(dict[str, str]):
    """The named parts of a specification, which may come in any order: `legacy`, `first=3`."""

    def flag(self, name: str) -> bool:
        if self.get(name, ""):
            raise ConfigError(f"{name} has no value")
        return self.pop(name, None) is not None

    def number(self, name: str, default: int) -> int:
        return whole(self.pop(name), name) if name in self else default

    def done(self) -> None:
        for name in self:
            raise ConfigError(f"{name!r} has no meaning for this target")


def _split(parts: Sequence[str]) -> tuple[list[str], _Words]:
    """The positional parts of a specification, and the named ones."""
    named = [
        bool(re.fullmatch(r"[a-z]+(=.*)?", part)) and not re.fullmatch(r"(tag|t)\d+h\d+.*", part) for part in parts
    ]
    places = [part for part, name in zip(parts, named, strict=True) if not name]
    words = _Words()
    for part, name in zip(parts, named, strict=True):
        key, _, value = part.partition("=")
        if name and key in words:
            raise ConfigError(f"{key} is given twice")
        if name:
            words[key] = value
    return places, words


def _charuco(places: list[str], words: _Words) -> Print:
    (columns, rows), (dictionary, marker) = _size(places), _exactly(places, ("a dictionary", "a marker's share"))
    board = Charuco(
        columns, rows, dictionary_name(dictionary), _share(marker, "the marker's share of a square"),
        words.number("first", 0), words.flag("legacy"), words.flag("inverted"),
    )  # fmt: skip
    words.done()
    return board


def _aprilgrid(places: list[str], words: _Words) -> Print:
    columns, rows = _size(places)
    if len(places) > 3:
        raise ConfigError(f"{places[3]!r} is one part too many")
    family, gap = [*places[1:], *("tag36h11", "0.3")[len(places) - 1 :]]
    first = words.number("first", 0)
    grid = AprilGrid(columns, rows, family_name(family), _share(gap, "the gap"), words.number("border", 2), first)
    words.done()
    return grid


def _puzzle(places: list[str], words: _Words) -> Print:
    columns, rows = _size(places)
    _exactly(places, ())
    at = words.pop("at", "0,0").split(",")
    if len(at) != 2:
        raise ConfigError("at= takes a column and a row of the code, such as at=0,100")
    words.done()
    return PuzzlePart(columns, rows, whole(at[0], "at="), whole(at[1], "at="))


def _plain(kind: type[Checkerboard] | type[Deltille]) -> Callable[[list[str], _Words], Print]:
    def make(places: list[str], words: _Words) -> Print:
        columns, rows = _size(places)
        _exactly(places, ())
        words.done()
        return kind(columns, rows)

    return make


_MAKERS: dict[str, Callable[[list[str], _Words], Any]] = {
    "charuco": _charuco,
    "aprilgrid": _aprilgrid,
    "puzzleboard": _puzzle,
    "checkerboard": _plain(Checkerboard),
    "deltille": _plain(Deltille),
}


def _size(places: Sequence[str]) -> tuple[int, int]:
    match = re.fullmatch(r"(\d{1,4})\s*[xX×]\s*(\d{1,4})", places[0] if places else "")
    if match is None:
        raise ConfigError(f"{places[0]!r} is no size" if places else "a size is missing")
    return int(match[1]), int(match[2])


def _exactly(places: list[str], what: tuple[str, ...]) -> list[str]:
    """The parts after the size. Raises ConfigError unless there is one for each name in `what`."""
    if len(places) - 1 > len(what):
        raise ConfigError(f"{places[len(what) + 1]!r} is one part too many")
    if len(places) - 1 < len(what):
        raise ConfigError(f"{what[len(places) - 1]} is missing")
    return places[1:]


def _share(text: str, what: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise ConfigError(f"{what} must be a number between 0 and 1, not {text!r}") from None
    return value


def whole(text: str, what: str) -> int:
    """`text` as a whole number. Raises ConfigError, which begins with `what`, if it is none."""
    if not re.fullmatch(r"\s*\d{1,4}\s*", text):
        raise ConfigError(f"{what} must be followed by a whole number, not {text!r}")
    return int(text)
