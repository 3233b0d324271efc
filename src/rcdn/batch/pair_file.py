"""The file of `--pairs`: pairs of pictures of two cameras, one pair per line."""

from __future__ import annotations

import csv
import os
import re
from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import Annotated

import typer

from rcdn.batch.spellings import composed, composed_path
from rcdn.errors import ConfigError

Pairs = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="With --stereo: which pictures belong together, a line for each pair: "
        "the left one's name and the right one's.",
    ),
]
SEPARATORS = (",", ";", "\t")
HEADERS = ({"left", "left_name", "left name"}, {"right", "right_name", "right name"})
LONGEST = 100_000
"""characters of a line, which has room for the paths of many cameras; longer fields aren't read by `csv`"""
MOST_DETAILED = 10
"""bad lines that an error message describes; for the others it lists the line numbers"""


@dataclass(frozen=True)
class PairLine:
    """A line of the file: its `number`, from 1, and the names of the left and the right picture."""

    number: int
    left: str
    right: str


@dataclass(frozen=True)
class PairFile:
    """A file of pairs: its `path` and its `lines`."""

    path: Path
    lines: tuple[PairLine, ...]

    @classmethod
    def read(cls, path: Path) -> PairFile:
        """Read one pair per line: `left right`, separated by spaces, a tab, a comma or a semicolon; names that contain
        separators are put in double quotes.

        Empty lines, comments (from a `#` at the start of a line or after a space), and a first line `left, right` are
        skipped. Raises ConfigError that lists every line without two names, or states that the file can't be read.
        """
        lines, bad = [], []
        for number, text, names in lines_with_fields(path, "--pairs"):
            if len(names) == 2 and all(names):
                lines.append(PairLine(number, *names))
            else:
                bad.append((number, f"must hold two names, left and right, not {text.strip()!r}"))
        refuse_lines(path, bad)
        if len(lines) > 1 and lines[0].left.lower() in HEADERS[0] and lines[0].right.lower() in HEADERS[1]:
            lines = lines[1:]
        if not lines:
            raise ConfigError(
                f"{path}: holds no pairs; write a line for each: the left picture's name, then the right one's"
            )
        return cls(path, tuple(lines))

    def match(
        self, left: Sequence[str], right: Sequence[str], unread: tuple[Sequence[str], Sequence[str]] = ((), ())
    ) -> list[tuple[int, int]]:
        """(index in `left`, index in `right`) of the pictures named by the lines, in the order of `left`.

        A name matches a picture if it is its path, or the last parts of it, with or without the file's ending; names
        may also be relative to the folder of this file. A line with a picture of the left or right camera that is
        `unread` (already reported) is skipped. Raises ConfigError that lists every line with an unknown name, with a
        name that matches several pictures, or with a picture of another line.
        """
        folder = self.path.parent
        sides = (Named(left, folder), Named(right, folder))
        lost = (Named(unread[0], folder), Named(unread[1], folder))
        taken: tuple[dict[int, int], dict[int, int]] = ({}, {})
        pairs, bad = [], []
        for line in self.lines:
            names = (line.left, line.right)
            if any(of_side.matching(name) for name, of_side in zip(names, lost, strict=True)):
                continue
            found = [_find(name, side, sides) for side, name in enumerate(names)]
            faults = [fault for _, fault in found if fault]
            for name, (at, _), before in zip(names, found, taken, strict=True):
                if at in before:
                    faults.append(f"{name} is in line {before[at]}, too")
                elif at >= 0:
                    before[at] = line.number
            if faults:
                bad.append((line.number, " and ".join(faults)))
            else:
                pairs.append((found[0][0], found[1][0]))
        refuse_lines(self.path, bad)
        return sorted(pairs)


def read_text(path: Path, option: str) -> str:
    """The text of the file that an `option` names. Raises ConfigError if it can't be read."""
    try:
        return path.read_text(encoding="utf-8-sig", errors="surrogateescape")  # as Python decodes file names
    except OSError as error:
        raise ConfigError(f"{option} {path}: can't be read ({error.strerror or error}); check the path") from error


def lines_with_fields(path: Path, option: str) -> list[tuple[int, str, list[str]]]:
    """Number, text and fields of each line that has fields in the file that an `option` names. Raises ConfigError if
    the file can't be read, or that lists every line longer than LONGEST."""
    lines = [*enumerate(read_text(path, option).splitlines(), 1)]
    too_long = f"has more than {LONGEST} characters; write one line for each pair or moment"
    refuse_lines(path, [(number, too_long) for number, text in lines if len(text) > LONGEST])
    split = ((number, text, fields_of(text)) for number, text in lines)
    return [(number, text, fields) for number, text, fields in split if fields]


def fields_of(line: str) -> list[str]:
    """The fields of a line without its comment, separated by one of SEPARATORS or by spaces."""
    text = re.sub(r"(^|\s)#.*", "", line).strip()
    if not text:
        return []
    separator = next((s for s in SEPARATORS if s in re.sub(r'"[^"]*"', "", text)), " ")
    fields = next(csv.reader([text], delimiter=separator, skipinitialspace=True))
    fields = [f.strip() for f in fields]
    return fields if separator != " " else [f for f in fields if f]


def _find(name: str, side: int, sides: tuple[Named, Named]) -> tuple[int, str]:
    """(index, "") of the picture called `name` of one camera (`side`: 0 left, 1 right), or (−1, description of the
    fault)."""
    found, pictures = sides[side].matching(name), sides[side].pictures
    if len(found) == 1:
        return found[0], ""
    here, there = ("left", "right") if side == 0 else ("right", "left")
    if found:
        some = " and ".join(pictures[k] for k in found[:2])
        return -1, f"{name} may be {some}: write more of the folder"
    if sides[1 - side].matching(name):
        return -1, f"{name} is a picture of the {there} camera: the left one comes first"
    example = f", such as {pictures[0]}" if pictures else ""
    return -1, f"no picture of the {here} camera is called {name} (it has {len(pictures)}{example})"


class Named:
    """The pictures of a camera by what a file in `folder` may call them: made once, and then asked for each name."""

    def __init__(self, pictures: Sequence[str], folder: Path) -> None:
        self.pictures = list(pictures)
        self._folder = folder
        self._same, self._exact = _Places(), _Places()
        self._ends, self._bare = _Places(), _Places()
        for k, picture in enumerate(self.pictures):
            self._same.add(picture, k)
            self._same.add(os.path.abspath(picture), k)
            path = PurePath(composed(picture))
            self._exact.add(composed_path(path), k)
            for places, parts in ((self._ends, path.parts), (self._bare, path.with_suffix("").parts)):
                for length in range(1, len(parts) + 1):
                    places.add(parts[-length:], k)

    def matching(self, name: str) -> list[int]:
        """Indices of the pictures that match `name` by the strictest rule that any picture satisfies; accents may be
        spelled in two ways."""
        absolute = {os.path.abspath(name), os.path.abspath(self._folder / name)}
        parts = PurePath(os.path.normpath(composed(name))).parts
        return (
            self._same.of(name, *absolute)
            or self._exact.of(*map(composed, absolute))
            or self._ends.of(parts)
            or self._bare.of(parts)
        )


class _Places:
    """The indices of the pictures with each key."""

    def __init__(self) -> None:
        self._at: dict[Hashable, list[int]] = {}

    def add(self, key: Hashable, index: int) -> None:
        self._at.setdefault(key, []).append(index)

    def of(self, *keys: Hashable) -> list[int]:
        return sorted({k for key in keys for k in self._at.get(key, ())})


def refuse_lines(path: Path, bad: Sequence[tuple[int, str]]) -> None:
    """Raise ConfigError with the number and the fault of each bad line, if there are any."""
    if not bad:
        return
    details = "; ".join(f"line {number}: {text}" for number, text in bad[:MOST_DETAILED])
    rest = [str(number) for number, _ in bad[MOST_DETAILED:]]
    raise ConfigError(
        f"{path}: {details}" + (f"; and the same kind of fault in lines {', '.join(rest)}" if rest else "")
    )
