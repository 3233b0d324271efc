"""Files that appear whole or not at all, and leave nothing behind when their process is killed."""

from __future__ import annotations

import contextlib
import hashlib
import os
import secrets
import stat
from collections.abc import Iterable
from pathlib import Path
from typing import IO

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

PIECE = 1 << 20
"""bytes that are copied at once"""
TRIES = 100
"""how often a file is named anew while other processes write the same target"""


def replace(target: Path, chunks: Iterable[bytes], durable: bool = True) -> None:
    """Put a file with the bytes of all `chunks` where `target` is, or isn't yet: a reader sees the old file, if there was one, or the new one.

    It is written to a file without a name, which takes its name at the end, or its place over the temporary name of that target, where the next
    run finds and replaces what a killed one left. Where the file system knows no files without names, all is written under that temporary name.
    The old file's mode is kept. `durable`: on the disk before the old file goes. Raises OSError, and leaves no temporary file.
    """
    folder = _open_folder(target.parent)
    if folder is None:
        return _by_name(target, chunks, durable)
    try:
        file = _nameless(target.parent)
        if file is None:
            return _by_name(target, chunks, durable)
        with file:
            _fill(file, chunks, target, durable)
            if not _linked(file, folder, target):
                file.seek(0)
                _by_name(target, iter(lambda: file.read(PIECE), b""), durable)
    finally:
        os.close(folder)


def temporary_name(target: Path, written: bool = False) -> str:
    """The one name under which a new `target` waits in its folder for its place, or (`written`) is written: what a killed process left there,
    the next one replaces."""
    return f".{hashlib.sha256(os.fsencode(target.name)).hexdigest()[:16]}.{'part' if written else 'tmp'}"


def _fill(file: IO[bytes], chunks: Iterable[bytes], target: Path, durable: bool) -> None:
    file.writelines(chunks)
    file.flush()
    if durable:
        os.fsync(file.fileno())
    with contextlib.suppress(FileNotFoundError):
        os.chmod(file.fileno() if os.chmod in os.supports_fd else file.name, stat.S_IMODE(target.stat().st_mode))


# ---- files without a name (Linux)


def _open_folder(folder: Path) -> int | None:
    """The folder, to name files in; None where nameless files can't be named."""
    if not hasattr(os, "O_TMPFILE") or not os.path.isdir("/proc/self/fd"):
        return None
    return os.open(folder, os.O_PATH | os.O_DIRECTORY)


def _nameless(folder: Path) -> IO[bytes] | None:
    """A file without a name on the disk of `folder`; None if its file system has none."""
    try:
        return os.fdopen(os.open(folder, os.O_TMPFILE | os.O_RDWR | os.O_CLOEXEC, 0o666), "w+b")
    except OSError:  # for whatever reason: what is wrong with the place is told by the file with a name
        return None


def _linked(file: IO[bytes], folder: int, target: Path) -> bool:
    """Name the nameless `file` as `target`; False if that can't be done: not on this file system, or not any more, since another process that
    writes the same target took its temporary name away."""
    waiting = temporary_name(target)
    for _ in range(TRIES):
        with contextlib.suppress(FileExistsError):
            return _link(file, folder, target.name)
        try:
            if not _link(file, folder, waiting):
                return False
            os.replace(waiting, target.name, src_dir_fd=folder, dst_dir_fd=folder)
        except FileExistsError:  # of a process that was killed, or of one that will then see that its name is gone
            _unlink(waiting, folder)
        except FileNotFoundError:  # another process took the name away
            pass
        except BaseException:
            _unlink(waiting, folder)
            raise
        if _is(file, folder, target.name):
            if _is(file, folder, waiting):  # another process had put this file in its place: renaming did nothing
                _unlink(waiting, folder)
            return True
    return False


def _unlink(name: str, folder: int) -> None:
    with contextlib.suppress(OSError):
        os.unlink(name, dir_fd=folder)


def _link(file: IO[bytes], folder: int, name: str) -> bool:
    """Give `file` a name; False if the file system can't. Raises FileExistsError."""
    try:
        os.link(f"/proc/self/fd/{file.fileno()}", name, dst_dir_fd=folder, follow_symlinks=True)
    except FileExistsError:
        raise
    except OSError:
        return False
    return True


def _is(file: IO[bytes], folder: int, name: str) -> bool:
    """True if `name` is a name of `file`."""
    try:
        return os.path.samestat(os.fstat(file.fileno()), os.stat(name, dir_fd=folder, follow_symlinks=False))
    except OSError:
        return False


# ---- files with a name


def _by_name(target: Path, chunks: Iterable[bytes], durable: bool) -> None:
    temporary, file = _named(target)
    try:
        with file:
            _fill(file, chunks, target, durable)
            if fcntl is not None:  # while it is locked, nobody takes it for a dead process's
                os.replace(temporary, target)
        if fcntl is None:  # Windows moves no open file
            os.replace(temporary, target)
    except BaseException:  # an interrupt, too, must not leave a temporary file
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)
        raise


def _named(target: Path) -> tuple[Path, IO[bytes]]:
    """A new file to write, and its name: the temporary name of `target`, or one of its own while another process uses that."""
    if fcntl is not None:
        path = target.with_name(temporary_name(target, written=True))
        file = os.fdopen(os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666), "r+b")
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if os.path.samestat(os.fstat(file.fileno()), os.stat(path)):
                file.truncate()
                return path, file
        except OSError:  # it is locked, or gone, or the file system has no locks
            pass
        file.close()
    path = target.with_name(f".{secrets.token_hex(8)}.tmp")
    return path, open(path, "xb")
