"""Endings of picture and video files, and atomic writing, which leaves either the whole new file or the old one."""

from __future__ import annotations

import errno
import os
import sys
from collections.abc import Iterable
from pathlib import Path

from rcdn.errors import OutputError
from rcdn.io import whole


def _endings(text: str) -> frozenset[str]:
    return frozenset(f".{name}" for name in text.split())


PICTURE_ENDINGS = _endings(
    "png jpg jpeg jpe jfif jfi jif mpo bmp dib tif tiff webp pgm ppm pbm pnm jp2 jpx jpf j2k j2c jpc heic heif hif avif"
)
_RAW = _endings(
    "3fr arw cr2 cr3 crw dcr dng erf fff gpr iiq kdc mef mos mrw nef nrw orf pef raf raw rw2 rwl sr2 srf srw x3f"
)
UNREAD_ENDINGS = _RAW | _endings("exr gif jxl pam pcx psd ras sr tga")
"""endings of pictures that folders may hold and that aren't looked for: raw formats of cameras, others that OpenCV
doesn't read, and GIF"""
VIDEO_ENDINGS = _endings("mp4 m4v avi mov mkv webm m2ts mpg mpeg wmv 3gp")

STDOUT = Path("-")
"""standard output in place of an output file (a file of that name can be given by its absolute path)"""

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
    """Raise OutputError early if a file at `path` certainly can't be written; `STDOUT` is always accepted.

    Its folder must exist or be possible to create, and be writable. Nothing is written or created. (A disk that fills
    up later is detected by the write itself.)
    """
    if Path(path) == STDOUT:
        return
    if os.path.isdir(path):
        raise output_error(path, IsADirectoryError(errno.EISDIR, "it is a folder"))
    if os.path.exists(path) and not os.access(path, os.W_OK):
        raise output_error(path, PermissionError(errno.EACCES, "the file may not be written"))
    if is_stream(path):
        return
    folder = Path(os.path.realpath(path)).parent
    while not os.path.exists(folder) and folder != folder.parent:
        folder = folder.parent
    if not folder.is_dir():
        raise output_error(path, NotADirectoryError(errno.ENOTDIR, f"{folder} is not a folder"))
    if not os.access(folder, os.W_OK | os.X_OK):
        raise output_error(path, PermissionError(errno.EACCES, f"the folder {folder} may not be written"))


def write_bytes(path: str | Path, data: bytes) -> None:
    """Write `data` to `path`, whole or not at all; missing folders are created.

    An unnamed (or temporary) file in the same folder is written, flushed to the disk and then renamed: a reader sees
    the old file or the new one, never a part. A link is followed, and the old file's mode is kept. Devices, pipes and
    what was opened before (/dev/stdout) are written directly. Raises OutputError with the reason and a fix; then no
    temporary file remains, and an old file is unchanged.
    """
    write_chunks(path, (data,))


def write_chunks(path: str | Path, chunks: Iterable[bytes]) -> None:
    """`write_bytes` of the concatenated `chunks`, which need not fit into memory. To `STDOUT` they are written
    immediately."""
    try:
        if Path(path) == STDOUT:
            sys.stdout.flush()
            sys.stdout.buffer.writelines(chunks)
            sys.stdout.flush()
            return
        if is_stream(path):
            with open(path, "ab") as file:
                file.writelines(chunks)
            return
        check_writable(path)
        target = Path(os.path.realpath(path))
        target.parent.mkdir(parents=True, exist_ok=True)
        whole.replace(target, chunks)
    except OSError as error:
        raise output_error(path, error) from error


def write_text(path: str | Path, text: str) -> None:
    """`write_bytes` of `text` in UTF-8, with unchanged line ends; undecodable bytes of file names are written as
    \\udc80 to \\udcff."""
    write_bytes(path, text.encode("utf-8", "backslashreplace"))


def is_special(path: str | Path) -> bool:
    """Whether `path` is a device or a pipe (/dev/stdout): renaming a file over it would destroy it."""
    return os.path.exists(path) and not os.path.isfile(path) and not os.path.isdir(path)


def is_stream(path: str | Path) -> bool:
    """Whether `path` is standard output, a device or a pipe, where output is appended and can't be replaced."""
    return Path(path) == STDOUT or is_special(path) or _is_descriptor(path)


def _is_descriptor(path: str | Path) -> bool:
    """Whether `path` names what this process was given open (/dev/stdout, /dev/fd/3): also where that is a file, others
    write to it, too."""
    name = os.path.abspath(path)
    return name in ("/dev/stdout", "/dev/stderr") or os.path.dirname(name) in ("/dev/fd", "/proc/self/fd")


def output_error(path: str | Path, error: OSError) -> OutputError:
    """The OutputError for a `path` that can't be written, with a fix."""
    fix = _FIXES.get(error.errno or 0, "choose another place")
    return OutputError(f"{path}: can't be written: {error.strerror or error}; {fix}")
