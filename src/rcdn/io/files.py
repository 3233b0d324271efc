"""Which files to read, and writing that leaves either the whole file or what was there before."""

from __future__ import annotations

import errno
import glob
import os
from collections.abc import Iterable
from pathlib import Path

from rcdn.errors import OutputError
from rcdn.io import whole

PICTURE_ENDINGS = frozenset({".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp", ".pgm", ".ppm", ".pbm", ".jp2"})
VIDEO_ENDINGS = frozenset({".mp4", ".avi", ".mov", ".mkv", ".webm"})

Errors = list[tuple[str, str]]

_FIXES = {
    errno.ENOSPC: "make room, or write to another disk",
    errno.EDQUOT: "make room, or write to another disk",
    errno.EACCES: "choose a place that you may write to",
    errno.EPERM: "choose a place that you may write to",
    errno.EROFS: "choose a place that you may write to",
    errno.EISDIR: "give the name of a file in it",
    errno.ENOTDIR: "check the folders in the path: one of them is a file",
    errno.EEXIST: "check the folders in the path: one of them is a file",
    errno.ENOENT: "check the folders in the path",
    errno.ENAMETOOLONG: "choose a shorter name",
}


def is_video(path: str | Path) -> bool:
    """True if the ending of `path` is a video's (mp4 avi mov mkv webm, any case). Nothing is opened."""
    return Path(path).suffix.lower() in VIDEO_ENDINGS


def expand(paths: Iterable[str | Path]) -> tuple[list[Path], Errors]:
    """The pictures and videos that `paths` stand for, and (path, message) for each that stands for nothing.

    A file is kept whatever its ending, and so is a pipe: the user named it. A folder gives its pictures and videos by their
    endings, recursively and sorted; hidden files and folders are passed over and links to folders aren't followed. A path that
    doesn't exist and holds one of `*?[` is a pattern (`**` goes into folders). Folders and patterns give files only: a pipe or a device
    there, which could block or never end, is an error. Duplicates go; the order of `paths` stays. Never raises on account of a path.
    """
    found: dict[str, Path] = {}
    errors: Errors = []
    for path in paths:
        files, trouble = _expand_one(str(path))
        errors += trouble
        for file in files:
            found.setdefault(os.path.abspath(file), file)
    return list(found.values()), errors


def _expand_one(path: str) -> tuple[list[Path], Errors]:
    if os.path.isdir(path):
        files, errors = _pictures_in(path)
        if not files and not errors:
            errors = [
                (path, f"{path}: no pictures or videos in this folder (known by their endings); name other files")
            ]
        return files, errors
    if os.path.exists(path):
        return [Path(path)], []
    if any(c in path for c in "*?["):
        return _expand_pattern(path)
    if not path:
        return [], [(path, "an empty path; name a picture, a folder or a pattern")]
    return [], [(path, f"{path}: no such file or folder (or one that may not be read); check the path")]


def _expand_pattern(pattern: str) -> tuple[list[Path], Errors]:
    files: list[Path] = []
    errors: Errors = []
    for match in sorted(glob.glob(pattern, recursive=True)):
        if os.path.isdir(match):
            inside, trouble = _pictures_in(match)
            files, errors = files + inside, errors + trouble
        else:
            files.append(Path(match))
    files, special = _files_only(files)
    errors += special
    if not files and not errors:
        errors = [(pattern, f"{pattern}: no picture matches this pattern; check it")]
    return files, errors


def _pictures_in(folder: str) -> tuple[list[Path], Errors]:
    """Pictures and videos below `folder`, sorted, and the folders that could not be listed."""
    files: list[Path] = []
    errors: Errors = []

    def unlisted(error: OSError) -> None:
        name = str(error.filename)
        errors.append((name, f"{name}: the folder can't be listed ({error.strerror}); check its permissions"))

    for root, folders, names in os.walk(folder, onerror=unlisted):
        folders[:] = [f for f in folders if not f.startswith(".")]
        endings = PICTURE_ENDINGS | VIDEO_ENDINGS
        files += [Path(root, n) for n in names if not n.startswith(".") and Path(n).suffix.lower() in endings]
    files, special = _files_only(sorted(files))
    return files, sorted(errors) + special


def _files_only(paths: list[Path]) -> tuple[list[Path], Errors]:
    """Without pipes and devices, and these as errors. (What isn't there at all, a broken link, stays: its reader says why.)"""
    files: list[Path] = []
    errors: Errors = []
    for path in paths:
        if is_special(path):
            errors.append((str(path), f"{path}: a pipe or a device, not a file; it is read only if it is named itself"))
        else:
            files.append(path)
    return files, errors


def check_writable(path: str | Path) -> None:
    """Fail early: raise OutputError if a file at `path` surely can't be written.

    Its folder must exist or be one that can be made, and take new files. Nothing is written or made. (A disk that
    fills up later is found by the write itself.)
    """
    if os.path.isdir(path):
        raise output_error(path, IsADirectoryError(errno.EISDIR, "it is a folder"))
    if os.path.exists(path) and not os.access(path, os.W_OK):
        raise output_error(path, PermissionError(errno.EACCES, "the file may not be written"))
    if is_special(path):
        return
    folder = Path(os.path.realpath(path)).parent
    while not os.path.exists(folder) and folder != folder.parent:
        folder = folder.parent
    if not folder.is_dir():
        raise output_error(path, NotADirectoryError(errno.ENOTDIR, f"{folder} is not a folder"))
    if not os.access(folder, os.W_OK | os.X_OK):
        raise output_error(path, PermissionError(errno.EACCES, f"the folder {folder} may not be written"))


def write_bytes(path: str | Path, data: bytes) -> None:
    """Write `data` to `path`, whole or not at all; missing folders are made.

    A file without a name (or a temporary one) in the same folder is written, flushed to the disk and then named: a reader sees the old
    file or the new one, never a part. A link is followed, and the old file's mode is kept. Devices and pipes are written directly.
    Raises OutputError with the reason and a fix; then no temporary file stays and an old file is unchanged.
    """
    write_chunks(path, (data,))


def write_chunks(path: str | Path, chunks: Iterable[bytes]) -> None:
    """`write_bytes` of all `chunks`, one after the other: a file that need not fit into memory."""
    try:
        if is_special(path):
            with open(path, "wb") as file:
                file.writelines(chunks)
            return
        check_writable(path)
        target = Path(os.path.realpath(path))
        target.parent.mkdir(parents=True, exist_ok=True)
        whole.replace(target, chunks)
    except OSError as error:
        raise output_error(path, error) from error


def write_text(path: str | Path, text: str) -> None:
    """`write_bytes` of `text` in UTF-8, line ends as they are; of a file's name that isn't text the bytes as \\udc80 to \\udcff."""
    write_bytes(path, text.encode("utf-8", "backslashreplace"))


def is_special(path: str | Path) -> bool:
    """A device or a pipe (/dev/stdout): there's nothing to replace, and renaming over it would destroy it."""
    return os.path.exists(path) and not os.path.isfile(path) and not os.path.isdir(path)


def output_error(path: str | Path, error: OSError) -> OutputError:
    """What to tell the user of `path` that can't be written."""
    fix = _FIXES.get(error.errno or 0, "choose another place")
    return OutputError(f"{path}: can't be written: {error.strerror or error}; {fix}")
