"""Finding pictures and videos: files, folders (recursively) and patterns, in natural sort order."""

from __future__ import annotations

import glob
import os
import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from itertools import groupby
from pathlib import Path

from rcdn.io.files import PICTURE_ENDINGS, UNREAD_ENDINGS, VIDEO_ENDINGS, Errors, is_special
from rcdn.io.marks import MARKED_ENDINGS, mark_of

LISTED = 3
"""smallest number of consecutive files that are taken for a shell's expansion of a pattern"""


@dataclass
class Found:
    """`files` in order; `errors`: (path, message) for each path that gives no file; `own`: skipped pictures that rcdn
    made; `unread`: files of folders that look like pictures of other formats."""

    files: list[Path] = field(default_factory=list)
    errors: Errors = field(default_factory=list)
    own: list[Path] = field(default_factory=list)
    unread: list[Path] = field(default_factory=list)

    def add(self, other: Found) -> None:
        """Append all of `other`."""
        self.files += other.files
        self.errors += other.errors
        self.own += other.own
        self.unread += other.unread


def natural(path: str | Path) -> tuple[tuple[tuple[str | int, ...], ...], tuple[str, ...]]:
    """A sort key for the natural order of paths: img2 before img10, folder by folder; ties are broken by characters."""
    parts = Path(path).parts
    return tuple(_counted(part) for part in parts), parts


def _counted(name: str) -> tuple[str | int, ...]:
    """A name split into text and numbers, alternating."""
    return tuple(int(piece) if k % 2 else piece for k, piece in enumerate(re.split("([0-9]+)", name)))


def expand(paths: Iterable[str | Path]) -> tuple[list[Path], Errors]:
    """The pictures and videos that `paths` denote, and (path, message) for each path that denotes none: the result of
    `find` without the skipped pictures."""
    found = find(paths)
    return found.files, found.errors


def find(paths: Iterable[str | Path]) -> Found:
    """The pictures and videos that `paths` denote.

    A file or pipe that is named itself is kept whatever its ending. A folder gives its pictures and videos by their
    endings, recursively and sorted by `natural`; hidden files and folders are skipped, and links to folders aren't
    followed. A path that doesn't exist and contains one of `*?[` is a pattern (`**` matches folders recursively).
    Folders and patterns give regular files only: a pipe or a device there, which could block or never end, is an error.
    They give no drawings of rcdn, recognized by their marks, and its undistorted pictures only if there are no others.
    Duplicates are removed. The order of `paths` is kept, except that a shell's expansion of a pattern (at least three
    files of one folder, sorted by characters) is sorted by `natural`, too. Never raises because of a path.
    """
    all_ = Found()
    for path in _unlisted([str(path) for path in paths]):
        all_.add(_find_one(path))
    once: dict[str, Path] = {}
    for file in all_.files:
        once.setdefault(os.path.abspath(file), file)
    all_.files = list(once.values())
    return all_


def _unlisted(paths: list[str]) -> list[str]:
    """`paths` with runs of files that a shell expanded from a pattern, sorted by characters, reordered by `natural`."""
    out: list[str] = []
    for _, run in groupby(paths, os.path.dirname):
        names = list(run)
        listed = names == sorted(names) or names == sorted(names, key=str.casefold)
        if len(names) >= LISTED and listed and all(map(os.path.isfile, names)):
            names.sort(key=natural)
        out += names
    return out


def _find_one(path: str) -> Found:
    if os.path.isdir(path):
        found = _pictures_in(path)
        if not found.files and not found.errors:
            why = "no pictures or videos in this folder (known by their endings); name other files"
            if found.own:
                why = "the pictures in this folder are all drawings of rcdn's; name other files"
            elif found.unread:
                formats = ", ".join(sorted({p.suffix.lower() for p in found.unread}))
                why = f"its pictures are of formats that aren't read ({formats}); convert them to TIFF or PNG"
                found.unread = []
            found.errors = [(path, f"{path}: {why}")]
        return found
    if os.path.exists(path):
        return Found([Path(path)])
    if any(c in path for c in "*?["):
        return _find_pattern(path)
    if not path:
        return Found(errors=[(path, "an empty path; name a picture, a folder or a pattern")])
    return Found(errors=[(path, f"{path}: no such file or folder (or one that may not be read); check the path")])


def _find_pattern(pattern: str) -> Found:
    found, files = Found(), []
    for match in sorted(glob.glob(pattern, recursive=True), key=natural):
        if os.path.isdir(match):
            inside = _pictures_in(match)
            files += inside.files
            found.add(Found(errors=inside.errors, own=inside.own, unread=inside.unread))
        else:
            files.append(Path(match))
    found.add(_others(_files_only(files)))
    if not found.files and not found.errors:
        why = "all that matches are drawings of rcdn's; name other files" if found.own else ""
        found.errors = [(pattern, f"{pattern}: {why or 'no picture matches this pattern; check it'}")]
    return found


def _pictures_in(folder: str) -> Found:
    """Pictures and videos below `folder`, sorted, and the folders that could not be listed."""
    files: list[Path] = []
    unread: list[Path] = []
    errors: Errors = []
    endings = PICTURE_ENDINGS | VIDEO_ENDINGS

    def unlisted(error: OSError) -> None:
        name = str(error.filename)
        errors.append((name, f"{name}: the folder can't be listed ({error.strerror}); check its permissions"))

    for root, folders, names in os.walk(folder, onerror=unlisted):
        folders[:] = [f for f in folders if not f.startswith(".")]
        for path in (Path(root, n) for n in names if not n.startswith(".")):
            if path.suffix.lower() in endings:
                files.append(path)
            elif path.suffix.lower() in UNREAD_ENDINGS:
                unread.append(path)
    found = _others(_files_only(sorted(files, key=natural)))
    found.errors = sorted(errors) + found.errors
    found.unread = sorted(unread, key=natural)
    return found


def _files_only(paths: list[Path]) -> Found:
    """`paths` without pipes and devices, which become errors. (A broken link is kept: its reader reports the
    reason.)"""
    found = Found()
    for path in paths:
        if is_special(path):
            why = "a pipe or a device, not a file; it is read only if it is named itself"
            found.errors.append((str(path), f"{path}: {why}"))
        else:
            found.files.append(path)
    return found


def _others(found: Found) -> Found:
    """`found` without rcdn's drawings, and without its undistorted pictures if there are other pictures."""
    marks = {p: mark_of(p) if p.suffix.lower() in MARKED_ENDINGS else None for p in found.files}
    mine = {p for p, mark in marks.items() if mark == "rcdn overlay"}
    if None in marks.values():
        mine |= {p for p, mark in marks.items() if mark == "rcdn undistorted"}
    return Found([p for p in found.files if p not in mine], found.errors, [p for p in found.files if p in mine])
