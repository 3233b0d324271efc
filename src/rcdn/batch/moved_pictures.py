"""Pictures that are no longer where a file names them: they are searched in places that the user names."""

from __future__ import annotations

import os
import re
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path

from rcdn.batch.spellings import composed


def found_in(
    places: Sequence[Path], lost: Collection[str], others: Collection[str] = ()
) -> tuple[dict[str, str], set[str]]:
    """Of the paths `lost` those whose file is found in `places` (folders or files), with that file; and those for
    which several files do equally well.

    A path's file is the one of its name that has most of the last parts of the path: of `day1/left/7.png`
    `photos/left/7.png` rather than `photos/right/7.png`. A file belongs to the path with which it has most parts in
    common; to none if that holds for several of `lost` and `others`, paths that lead nowhere, too. Links aren't
    followed out of `places`.
    """
    paths = {*lost, *others}
    files = _files(places, {_parts(path)[-1] for path in paths})
    nearest = {path: _nearest(path, files.get(_parts(path)[-1], ())) for path in paths}
    rivals: dict[str, list[tuple[int, str]]] = {}
    for path, (fits, common) in nearest.items():
        if len(fits) == 1:
            rivals.setdefault(fits[0], []).append((common, path))
    owners = {_nearest_of(each): file for file, each in rivals.items()}
    found = {path: owners[path] for path in lost if path in owners}
    return found, {path for path in lost if len(nearest[path][0]) > 1}


def _nearest(path: str, files: Collection[str]) -> tuple[list[str], int]:
    """The files that have most of the last parts of a path, and how many those are."""
    common = {file: _common(path, file) for file in files}
    most = max(common.values(), default=0)
    return [file for file, count in common.items() if count == most], most


def _nearest_of(rivals: Sequence[tuple[int, str]]) -> str:
    """The path with the most parts in common with a file, of `rivals` (parts, path); "" if several have as many."""
    most = max(rivals)[0]
    best = [path for common, path in rivals if common == most]
    return best[0] if len(best) == 1 else ""


def _common(path: str, file: str) -> int:
    """The number of last parts that two paths have in common."""
    count = 0
    for one, other in zip(reversed(_parts(path)), reversed(_parts(file)), strict=False):
        if one != other:
            break
        count += 1
    return count


def _parts(path: str) -> list[str]:
    """The parts of a path, which may come from a system that separates them by backslashes, or spells accents in
    another way."""
    return re.split(r"[/\\]+", composed(path).rstrip("/\\"))


def _files(places: Sequence[Path], names: Collection[str]) -> dict[str, list[str]]:
    """The files in `places` that have one of the `names`, by name."""
    found: dict[str, list[str]] = {}
    for place in places:
        root = Path(os.path.realpath(place))
        for file in _all_files(root):
            if (name := composed(file.name)) not in names:
                continue
            real = Path(os.path.realpath(file))
            if real.is_relative_to(root) and str(real) not in found.get(name, ()):
                found.setdefault(name, []).append(str(real))
    return found


def _all_files(root: Path) -> Iterator[Path]:
    if root.is_file():
        yield root
    for folder, _, names in os.walk(root):
        yield from (Path(folder, name) for name in names)
