"""Atomic writing: files appear whole or not at all, and no temporary files accumulate when a process is killed."""

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
"""bytes copied at once"""
TRIES = 100
"""attempts at naming a file while other processes write the same target"""


def replace(target: Path, chunks: Iterable[bytes], durable: bool = True) -> None:
    """Create or replace the file `target` with the bytes of all `chunks`: a reader sees the old file, if any, or the
    new one.

    The bytes are written to an unnamed file. At the end it is linked as `target`; if that exists, it is linked under
    the temporary name of that target and renamed. A file that a killed process left under the temporary name is
    replaced by the next run. If the file system doesn't support unnamed files, the bytes are written under the
    temporary name. The old file's mode is kept. `durable`: the data are flushed to the disk before the old file is
    replaced. Raises OSError, and leaves no temporary file.
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
    """The temporary name, unique to `target`, of the complete new file before it is renamed, or (`written`) while it is
    being written. A file that a killed process left there is replaced by the next one."""
    return f".{hashlib.sha256(os.fsencode(target.name)).hexdigest()[:16]}.{'part' if written else 'tmp'}"


def _fill(file: IO[bytes], chunks: Iterable[bytes], target: Path, durable: bool) -> None:
    file.writelines(chunks)
    file.flush()
    if durable:
        os.fsync(file.fileno())
    with contextlib.suppress(FileNotFoundError):
        os.chmod(file.fileno() if os.chmod in os.supports_fd else file.name, stat.S_IMODE(target.stat().st_mode))


# ---- unnamed files (Linux)


def _open_folder(folder: Path) -> int | None:
    """A descriptor of the folder, for linking files in it; None if the system can't link unnamed files."""
    if not hasattr(os, "O_TMPFILE") or not os.path.isdir("/proc/self/fd"):
        return None
    return os.open(folder, os.O_PATH | os.O_DIRECTORY)


def _nameless(folder: Path) -> IO[bytes] | None:
    """An unnamed file on the disk of `folder`; None if its file system doesn't support them."""
    try:
        return os.fdopen(os.open(folder, os.O_TMPFILE | os.O_RDWR | os.O_CLOEXEC, 0o666), "w+b")
    except OSError:  # for whatever reason: creating the named file reports errors of the folder
        return None


def _linked(file: IO[bytes], folder: int, target: Path) -> bool:
    """Link the unnamed `file` as `target`; False if that is impossible: the file system doesn't support it, or another
    process that writes the same target has removed the temporary name."""
    waiting = temporary_name(target)
    for _ in range(TRIES):
        with contextlib.suppress(FileExistsError):
            return _link(file, folder, target.name)
        try:
            if not _link(file, folder, waiting):
                return False
            os.replace(waiting, target.name, src_dir_fd=folder, dst_dir_fd=folder)
        except FileExistsError:  # left by a killed process, or in use by one that will notice the removal
            _unlink(waiting, folder)
        except FileNotFoundError:  # another process removed the temporary name
            pass
        except BaseException:
            _unlink(waiting, folder)
            raise
        if _is(file, folder, target.name):
            if _is(file, folder, waiting):  # another process has already renamed this file: the rename did nothing
                _unlink(waiting, folder)
            return True
    return False


def _unlink(name: str, folder: int) -> None:
    with contextlib.suppress(OSError):
        os.unlink(name, dir_fd=folder)


def _link(file: IO[bytes], folder: int, name: str) -> bool:
    """Link `file` under `name`; False if the file system can't. Raises FileExistsError."""
    try:
        os.link(f"/proc/self/fd/{file.fileno()}", name, dst_dir_fd=folder, follow_symlinks=True)
    except FileExistsError:
        raise
    except OSError:
        return False
    return True


def _is(file: IO[bytes], folder: int, name: str) -> bool:
    """True if `name` in `folder` is a link to `file`."""
    try:
        return os.path.samestat(os.fstat(file.fileno()), os.stat(name, dir_fd=folder, follow_symlinks=False))
    except OSError:
        return False


# ---- named files


def _by_name(target: Path, chunks: Iterable[bytes], durable: bool) -> None:
    temporary, file = _named(target)
    try:
        with file:
            _fill(file, chunks, target, durable)
            # renamed while locked, so that no other process takes it for a file left by a killed process
            if fcntl is not None:
                os.replace(temporary, target)
        if fcntl is None:  # Windows can't rename an open file
            os.replace(temporary, target)
    except BaseException:  # an interrupt, too, must not leave a temporary file
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)
        raise


def _named(target: Path) -> tuple[Path, IO[bytes]]:
    """(path, file) of a new temporary file: under the temporary name of `target`, or under a random name while another
    process uses that."""
    if fcntl is not None:
        path = target.with_name(temporary_name(target, written=True))
        file = os.fdopen(os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666), "r+b")
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if os.path.samestat(os.fstat(file.fileno()), os.stat(path)):
                file.truncate()
                return path, file
        except OSError:  # it is locked or removed, or the file system has no locks
            pass
        file.close()
    path = target.with_name(f".{secrets.token_hex(8)}.tmp")
    return path, open(path, "xb")
