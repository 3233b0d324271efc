"""Pictures of one name among several inputs: those with the same corners count once, the others get names of their
own."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rcdn.batch.spellings import composed, composed_path
from rcdn.errors import many
from rcdn.terminal.group import one_line

if TYPE_CHECKING:
    from rcdn.io import ImageResult
    from rcdn.types import Array

NEAR = 1.0
"""the bound of the distance between places of one corner in two detections of one picture, px"""
SHARED, FEWEST = 0.5, 6
"""the least share, and number, of corners that the smaller of two detections of one picture has in common with the
other: corners of different pictures lie so near each other by chance only"""
AROUND = np.stack(np.meshgrid([-1, 0, 1], [-1, 0, 1]), axis=-1).reshape(-1, 2)
"""steps to a cell and its neighbours"""
SHOWN = 3
"""the largest number of names listed in a sentence"""


@dataclass(frozen=True)
class Distinct:
    """`images`, each of another name; `folders`: for each image of a file of saved detections whose picture itself was
    not read, the folder of that file; `notes`: sentences on the images that were renamed, and on those left out."""

    images: tuple[ImageResult, ...]
    folders: Mapping[str, Path]
    notes: tuple[str, ...]


def distinct(images: Iterable[tuple[Path | None, ImageResult]]) -> Distinct:
    """The images of all inputs with a name each, in their order. Each comes with the file of saved detections that
    holds it, None if the picture itself was read.

    Of one name, images with the same corners are one picture, of which the first counts. Saved images with other
    corners are other pictures: each is renamed to FILE/NAME after its file. A picture that was read and what was saved
    under its name count once, the first of them. Accents may be spelled in two ways, except where two pictures that
    were read differ in that only.
    """
    listed = list(images)
    read_as = Counter(map(composed, {os.path.abspath(image.path) for file, image in listed if file is None}))
    groups: dict[str, list[_Entry]] = {}
    for place, (file, image) in enumerate(listed):
        path = os.path.abspath(image.path)
        key = path if read_as[composed(path)] > 1 else composed(path)
        groups.setdefault(key, []).append(_Entry(place, file, image, key))
    read = {name for name, group in groups.items() if any(entry.file is None for entry in group)}
    return _Names(set(groups), read).of(groups.values())


def same_corners(one: ImageResult, other: ImageResult) -> bool:
    """Whether two detections are of one picture: of one size, and of the one with fewer corners at least SHARED, and
    FEWEST, lie within NEAR of the other's. Corners of boards are compared, if both have boards."""
    from rcdn.geometry.near import nearest

    if (one.width, one.height) != (other.width, other.height):
        return False
    boards = bool(one.boards) and bool(other.boards)
    few, most = sorted((_corners(one, boards), _corners(other, boards)), key=len)
    if np.array_equal(few, most):
        return True
    near = int((nearest(most, few)[0] < NEAR).sum()) if len(few) else 0
    return near >= max(SHARED * len(few), FEWEST)


def _corners(image: ImageResult, boards: bool) -> Array:
    return np.concatenate([board.xy for board in image.boards]) if boards else image.corners.xy


@dataclass(frozen=True)
class _Entry:
    """The `image` at a `place` of the inputs, the `file` of saved detections that holds it, if any, and the `key` that
    all images of its name have."""

    place: int
    file: Path | None
    image: ImageResult
    key: str


@dataclass
class _Kept:
    """The `entries` of one name that count, with an index of them by the cells of NEAR px in which their corners lie,
    and by their corners, so that each new one is compared with few."""

    entries: list[_Entry] = field(default_factory=list)
    index: dict[object, list[int]] = field(default_factory=dict)

    def add(self, entry: _Entry) -> None:
        for key in {*map(tuple, _cells(entry).tolist()), entry.image.corners.xy.tobytes()}:
            self.index.setdefault(key, []).append(len(self.entries))
        self.entries.append(entry)

    def near(self, entry: _Entry) -> list[_Entry]:
        """The entries that may have the same corners."""
        around = (_cells(entry)[:, None] + AROUND).reshape(-1, 2)
        keys = {*map(tuple, around.tolist()), entry.image.corners.xy.tobytes()}
        return [self.entries[k] for k in sorted({k for key in keys for k in self.index.get(key, ())})]


def _cells(entry: _Entry) -> Array:
    """(N, 2) the cells in which the corners of an image and of its boards lie."""
    xy = np.concatenate([entry.image.corners.xy, *(board.xy for board in entry.image.boards)])
    return np.floor(xy[np.isfinite(xy).all(axis=1)] / NEAR).astype(np.int64)


@dataclass
class _Names:
    """The keys of names that are `taken`, and of these the pictures that were `read`; by file of saved detections the
    new names of the images `renamed`, and the names of those `left_out` though their corners differ; the `last` number
    that was tried of each file and name."""

    taken: set[str]
    read: set[str]
    last: dict[tuple[Path, str], int] = field(default_factory=dict)
    renamed: dict[Path, list[str]] = field(default_factory=dict)
    left_out: dict[Path, list[str]] = field(default_factory=dict)

    def of(self, groups: Iterable[Sequence[_Entry]]) -> Distinct:
        kept = [(entry, entry is not group[0]) for group in groups for entry in self._kept(group)]
        kept.sort(key=lambda each: each[0].place)
        images = tuple(self._with_own_name(entry) if another else entry.image for entry, another in kept)
        folders = {
            image.path: entry.file.parent
            for image, (entry, _) in zip(images, kept, strict=True)
            if entry.file is not None and entry.key not in self.read
        }
        notes = [_note_renamed(file, names) for file, names in self.renamed.items()]
        notes += [_note_left_out(file, names) for file, names in self.left_out.items()]
        return Distinct(images, folders, tuple(notes))

    def _kept(self, group: Sequence[_Entry]) -> list[_Entry]:
        """The entries of one name that count."""
        first, kept = group[0], _Kept()
        kept.add(first)
        for entry in group[1:]:
            file = entry.file or first.file
            if file is None or any(same_corners(k.image, entry.image) for k in kept.near(entry)):
                continue
            if first.key in self.read:
                self.left_out.setdefault(file, []).append(entry.image.path)
            else:
                kept.add(entry)
        return kept.entries

    def _with_own_name(self, entry: _Entry) -> ImageResult:
        """The image with the first name that isn't taken of FILE/NAME, FILE/2/NAME, …"""
        if entry.file is None:
            return entry.image
        name, path = entry.image.path.lstrip("/\\"), ""
        while not path or composed_path(path) in self.taken:
            number = self.last[entry.file, name] = self.last.get((entry.file, name), 0) + 1
            path = f"{entry.file}/{name}" if number == 1 else f"{entry.file}/{number}/{name}"
        self.taken.add(composed_path(path))
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
