"""Pictures that are no longer where a file names them: they are searched in places that the user names."""

from __future__ import annotations

import os
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path


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
    single = {path: (fits[0], common) for path, (fits, common) in nearest.items() if len(fits) == 1}
    found = {path: single[path][0] for path in lost if path in single and _is_nearest(path, single)}
    return found, {path for path in lost if len(nearest[path][0]) > 1}


def _nearest(path: str, files: Collection[str]) -> tuple[list[str], int]:
    """The files that have most of the last parts of a path, and how many those are."""
    common = {file: _common(path, file) for file in files}
    most = max(common.values(), default=0)
    return [file for file, count in common.items() if count == most], most


def _is_nearest(path: str, single: Mapping[str, tuple[str, int]]) -> bool:
    """Whether no other path has as many parts in common with the file of this one."""
    file, common = single[path]
    return not any(other != path and at == file and count >= common for other, (at, count) in single.items())


def _common(path: str, file: str) -> int:
    """The number of last parts that two paths have in common."""
    count = 0
    for one, other in zip(reversed(_parts(path)), reversed(_parts(file)), strict=False):
        if one != other:
            break
        count += 1
    return count


def _parts(path: str) -> list[str]:
    """The parts of a path, which may come from a system that separates them by backslashes."""
    return re.split(r"[/\\]+", path.rstrip("/\\"))


def _files(places: Sequence[Path], names: Collection[str]) -> dict[str, list[str]]:
    """The files in `places` that have one of the `names`, by name."""
    found: dict[str, list[str]] = {}
    for place in places:
        root = Path(os.path.realpath(place))
        for file in _all_files(root):
            name, file = file.name, Path(os.path.realpath(file))
            if name in names and file.is_relative_to(root) and str(file) not in found.get(name, ()):
                found.setdefault(name, []).append(str(file))
    return found


def _all_files(root: Path) -> Iterator[Path]:
    if root.is_file():
        yield root
    for folder, _, names in os.walk(root):
        yield from (Path(folder, name) for name in names)
