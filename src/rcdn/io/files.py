"""Which endings are pictures' and videos', and writing that leaves either the whole file or what was there before."""

from __future__ import annotations

import errno
import os
import sys
from collections.abc import Iterable
from pathlib import Path

from rcdn.errors import OutputError
from rcdn.io import whole

PICTURE_ENDINGS = frozenset({".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp", ".pgm", ".ppm", ".pbm", ".jp2"})
VIDEO_ENDINGS = frozenset({".mp4", ".avi", ".mov", ".mkv", ".webm"})

STDOUT = Path("-")
"""standard output, where a file to write is asked for (a file of that name is ./-, as an absolute path)"""

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


def check_writable(path: str | Path) -> None:
    """Fail early: raise OutputError if a file at `path` surely can't be written; `STDOUT` can.

    Its folder must exist or be one that can be made, and take new files. Nothing is written or made. (A disk that
    fills up later is found by the write itself.)
    """
    if Path(path) == STDOUT:
        return
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
    """`write_bytes` of all `chunks`, one after the other: a file that need not fit into memory. To `STDOUT` they go as they come."""
    try:
        if Path(path) == STDOUT:
            sys.stdout.flush()
            sys.stdout.buffer.writelines(chunks)
            sys.stdout.flush()
            return
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


def is_stream(path: str | Path) -> bool:
    """Standard output, a device or a pipe: what is written there stays, and follows what was written before."""
    return Path(path) == STDOUT or is_special(path)


def output_error(path: str | Path, error: OSError) -> OutputError:
    """What to tell the user of `path` that can't be written."""
    fix = _FIXES.get(error.errno or 0, "choose another place")
    return OutputError(f"{path}: can't be written: {error.strerror or error}; {fix}")
