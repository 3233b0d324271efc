"""Pictures of one name among several inputs: those with the same corners count once, the others get names of their
own."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rcdn.errors import many
from rcdn.terminal.group import one_line

if TYPE_CHECKING:
    from rcdn.io import ImageResult
    from rcdn.types import Array

NEAR = 1.0
"""the bound of the distance between places of one corner in two detections of one picture, px"""
SHARED = 0.5
"""the least share of corners that two detections of one picture have in common"""
SHOWN = 3
"""the largest number of names listed in a sentence"""


@dataclass(frozen=True)
class Distinct:
    """`images`, each of another name; `folders`: for each image that was renamed, the folder of its file of saved
    detections; `notes`: sentences on the images that were renamed, and on those left out."""

    images: tuple[ImageResult, ...]
    folders: Mapping[str, Path]
    notes: tuple[str, ...]


def distinct(images: Iterable[tuple[Path | None, ImageResult]]) -> Distinct:
    """The images of all inputs with a name each, in their order. Each comes with the file of saved detections that
    holds it, None if the picture itself was read.

    Of one name, images with the same corners are one picture, of which the first counts. Saved images with other
    corners are other pictures: each is renamed to FILE/NAME after its file. A picture that was read and what was saved
    under its name count once, the first of them.
    """
    groups: dict[str, list[_Entry]] = {}
    for place, (file, image) in enumerate(images):
        groups.setdefault(os.path.abspath(image.path), []).append(_Entry(place, file, image))
    return _Names(set(groups)).of(groups.values())


def same_corners(one: ImageResult, other: ImageResult) -> bool:
    """Whether two detections are of one picture: of one size, and at least SHARED of the corners of the one with more
    lie within NEAR of the other's. Corners of boards are compared, if both have boards."""
    if (one.width, one.height) != (other.width, other.height):
        return False
    boards = bool(one.boards) and bool(other.boards)
    few, most = sorted((_corners(one, boards), _corners(other, boards)), key=len)
    if np.array_equal(few, most):
        return True
    return len(few) >= SHARED * len(most) and _near(few, most) >= SHARED * len(most)


def _corners(image: ImageResult, boards: bool) -> Array:
    return np.concatenate([board.xy for board in image.boards]) if boards else image.corners.xy


def _near(few: Array, most: Array) -> int:
    """How many of `most` lie less than NEAR from one of `few`."""
    from rcdn.geometry.near import nearest

    return int((nearest(few, most)[0] < NEAR).sum())


@dataclass(frozen=True)
class _Entry:
    """The `image` at a `place` of the inputs, and the `file` of saved detections that holds it, if any."""

    place: int
    file: Path | None
    image: ImageResult


@dataclass
class _Names:
    """The names `taken`, as absolute paths; by file of saved detections the new names of the images `renamed`, and the
    names of those `left_out` though their corners differ."""

    taken: set[str]
    renamed: dict[Path, list[str]] = field(default_factory=dict)
    left_out: dict[Path, list[str]] = field(default_factory=dict)

    def of(self, groups: Iterable[Sequence[_Entry]]) -> Distinct:
        kept = [(entry, entry is not group[0]) for group in groups for entry in self._kept(group)]
        kept.sort(key=lambda each: each[0].place)
        images = tuple(self._with_own_name(entry) if another else entry.image for entry, another in kept)
        folders = {name: file.parent for file, names in self.renamed.items() for name in names}
        notes = [_note_renamed(file, names) for file, names in self.renamed.items()]
        notes += [_note_left_out(file, names) for file, names in self.left_out.items()]
        return Distinct(images, folders, tuple(notes))

    def _kept(self, group: Sequence[_Entry]) -> list[_Entry]:
        """The entries of one name that count."""
        first, kept = group[0], [group[0]]
        read = any(entry.file is None for entry in group)
        for entry in group[1:]:
            file = entry.file or first.file
            if file is None or any(same_corners(k.image, entry.image) for k in kept):
                continue
            if read:
                self.left_out.setdefault(file, []).append(entry.image.path)
            else:
                kept.append(entry)
        return kept

    def _with_own_name(self, entry: _Entry) -> ImageResult:
        """The image with the first name that isn't taken of FILE/NAME, FILE/2/NAME, …"""
        if entry.file is None:
            return entry.image
        number, name, folder = 1, entry.image.path.lstrip("/\\"), str(entry.file)
        while os.path.abspath(path := f"{folder}/{name}") in self.taken:
            number += 1
            folder = f"{entry.file}/{number}"
        self.taken.add(os.path.abspath(path))
        self.renamed.setdefault(entry.file, []).append(path)
        return replace(entry.image, path=path)


def _note_renamed(file: Path, names: Sequence[str]) -> str:
    if len(names) == 1:
        return f"{file}: 1 picture is named as another one whose corners differ; it is used as {_some(names)}"
    return f"{file}: {len(names)} pictures are named as others whose corners differ; they are used as {_some(names)}"


def _note_left_out(file: Path, names: Sequence[str]) -> str:
    have, count = ("has", "counts") if len(names) == 1 else ("have", "count")
    return (
        f"{file}: {many(len(names), 'picture')} that {have} other corners there than in the picture itself {count} "
        f"once, as given first: {_some(names)}; if they are different pictures, detect all boards from one folder "
        "above them, so that names differ"
    )


def _some(names: Sequence[str]) -> str:
    return ", ".join(one_line(name) for name in names[:SHOWN]) + (", …" if len(names) > SHOWN else "")
