"""Groups of pictures suggested by their names, and short names for such groups."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from pathlib import PurePath

from rcdn.io.finding import natural

FEWEST = 3
"""least number of pictures in a group"""
MOST_GROUPS = 4
"""most groups in a partition"""
LISTED = 3
"""names that are listed before an ellipsis"""

Partition = tuple[int, ...]
"""For each name the number of its group, −1 for names that belong to none."""


def name_partitions(names: Sequence[str]) -> list[Partition]:
    """Partitions of pictures into 2 to 4 groups that their names suggest, without repetition.

    By folder; by what remains of the name without its digits (`left01`, `right01`); and, if all names have the same
    structure, by each of their parts in turn (`cam0_001`, `cam1_001`). Names in groups of fewer than 3 pictures belong
    to no group.
    """
    paths = [PurePath(n) for n in names]
    columns: list[list[str]] = [[str(p.parent) for p in paths], [re.sub(r"\d+", "#", p.stem) for p in paths]]
    parts = [re.split(r"(\d+)", p.stem) for p in paths]
    if len({len(p) for p in parts}) == 1:
        columns += [list(column) for column in zip(*parts, strict=True)]
    found = (_partition(column) for column in columns)
    return list(dict.fromkeys(p for p in found if p is not None))


def _partition(keys: Sequence[str]) -> Partition | None:
    counts = Counter(keys)
    if len(counts) > len(keys) / 2:
        return None
    kept = [key for key in dict.fromkeys(keys) if counts[key] >= FEWEST]
    if not 2 <= len(kept) <= MOST_GROUPS:
        return None
    return tuple(kept.index(key) if key in kept else -1 for key in keys)


def natural_order(names: Sequence[str]) -> list[int]:
    """Indices of `names` in numerical order: `a2` before `a10`."""
    return sorted(range(len(names)), key=lambda k: natural(names[k]))


def describe(names: Sequence[str], others: Sequence[str]) -> str:
    """A short name for a group of pictures: `left*` if that matches all `names` and none of the `others`, otherwise its
    first names.

    A pattern is a common prefix of the file names, or their folder.
    """
    names, others = list(dict.fromkeys(names)), list(dict.fromkeys(others))
    files, rest = [PurePath(n).name for n in names], [PurePath(n).name for n in others]
    start = _beginning(files)
    if len(names) > 1 and start and not any(f.startswith(start) for f in rest):
        return f"{start}*"
    folders = {str(PurePath(n).parent) for n in names}
    if len(folders) == 1 and not folders & {str(PurePath(n).parent) for n in others} and folders != {"."}:
        return f"{PurePath(folders.pop()).name}/*"
    ordered = [files[k] for k in natural_order(files)]
    if len(ordered) <= LISTED:
        return ", ".join(ordered)
    if _contiguous(names, others):
        return f"{ordered[0]} to {ordered[-1]}"
    return f"{', '.join(ordered[:LISTED])}, …"


def _beginning(files: Sequence[str]) -> str:
    """The common prefix of all `files`, up to the first number in which they differ."""
    low, high = min(files), max(files)
    same = next((k for k, (a, b) in enumerate(zip(low, high, strict=False)) if a != b), min(len(low), len(high)))
    return re.sub(r"\d+$", "", low[:same])


def _contiguous(names: Sequence[str], others: Sequence[str]) -> bool:
    """True if no other name comes between the first and the last of `names`."""
    every = [*names, *others]
    places = [place for place, k in enumerate(natural_order(every)) if k < len(names)]
    return places[-1] - places[0] == len(names) - 1
