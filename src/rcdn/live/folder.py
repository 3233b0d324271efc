"""The folder of a session. Pictures are stored atomically, so that a session can resume after any interruption."""

from __future__ import annotations

import json
import os
import re
import secrets
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np

from rcdn.errors import ConfigError, FormatError, RcdnError, shown
from rcdn.io import ImageResult, read_detections, read_image, write_detections, write_image, write_text
from rcdn.types import Array, Board, Corners

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

SESSION, ADDRESS = "session.json", ".address"
PICTURES, DETECTIONS = "pictures", "detections"
NAME = re.compile(r"frame-(\d{4})\.png")
MOST = 200
"""largest number of pictures in a session"""
VERSION = 1


@dataclass(frozen=True)
class Settings:
    """Settings of a session: side of a square, m (None: not known yet), lens model, and board size (columns, rows) in
    inner corners, if given."""

    spacing: float | None = None
    model: str = "auto"
    size: tuple[int, int] | None = None


class Folder:
    """Pictures (grey PNG, with the pixels from which the corners were computed) and detections of a session below
    `path`.

    A picture is part of the session if its detections exist; they are written last and removed first.
    Raises ConfigError if the folder contains other files, or if another process uses it; OutputError if it can't be
    written.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        new = not (path / SESSION).exists()
        if new and path.exists() and (not path.is_dir() or any(path.iterdir())):
            raise ConfigError(f"{path}: holds other files; name a new or an empty folder, or one of an earlier session")
        if new:
            self._write_settings(Settings())
        self._lock = self._locked()

    def _locked(self) -> IO[bytes] | None:
        """The session's lock file, open and locked until `close` or the end of this process."""
        if fcntl is None:
            return None
        lock = open(self.path / ".lock", "wb")  # noqa: SIM115
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            lock.close()
            raise ConfigError(
                f"{self.path}: another `rcdn live` uses this folder; end it, or name another one"
            ) from None
        return lock

    def close(self) -> None:
        """Unlock the folder for other processes."""
        if self._lock is not None:
            self._lock.close()

    # ---- settings

    def settings(self) -> Settings:
        """The settings stored in the folder. Raises FormatError for a damaged file."""
        record = _read(self.path / SESSION)
        spacing, size, model = record.get("spacing"), record.get("size"), record.get("model", "auto")
        if not (spacing is None or isinstance(spacing, int | float)) or not isinstance(model, str):
            raise FormatError(f"{self.path / SESSION}: spacing or model has no meaning; name another folder")
        return Settings(spacing, model, None if size is None else (int(size[0]), int(size[1])))

    def agree(self, wanted: Settings) -> Settings:
        """The settings for the resumed session: those of `wanted`, and the stored ones where `wanted` has None. Raises
        ConfigError if pictures were taken with other settings."""
        before = self.settings()
        now = Settings(wanted.spacing or before.spacing, wanted.model, wanted.size or before.size)
        if self.names() and (before.spacing, before.size) != (now.spacing, now.size):
            raise ConfigError(
                f"{self.path}: its pictures were taken with squares of {before.spacing} m and board size {before.size or 'unknown'}, "
                f"not {now.spacing} m and {now.size or 'unknown'}; name another folder"
            )
        self._write_settings(now)
        return now

    def _write_settings(self, settings: Settings) -> None:
        record = {"version": VERSION, "spacing": settings.spacing, "model": settings.model, "size": settings.size}
        write_text(self.path / SESSION, json.dumps(record) + "\n")

    # ---- address

    def token(self) -> str:
        """The random part of the page's address. It is the same after a restart, so that an open page can reconnect,
        and stored in a file that only this user can read."""
        return str(self._address()["token"])

    def port(self) -> int:
        """The last port used, or 0."""
        port = self._address().get("port")
        return port if isinstance(port, int) and 0 < port < 65536 else 0

    def keep_port(self, port: int) -> None:
        """Remember the `port` for the next start."""
        self._keep({"token": self.token(), "port": port})

    def _address(self) -> dict[str, Any]:
        with suppress(FormatError):
            record = _read(self.path / ADDRESS)
            if re.fullmatch(r"[\w-]{32,64}", str(record.get("token", ""))):
                return record
        record = {"token": secrets.token_urlsafe(32)}
        self._keep(record)
        return record

    def _keep(self, record: dict[str, Any]) -> None:
        place = self.path / ADDRESS
        if not place.exists():
            os.close(os.open(place, os.O_CREAT | os.O_WRONLY, 0o600))  # the file that replaces it keeps its mode
        write_text(place, json.dumps(record) + "\n")

    # ---- pictures

    def names(self) -> list[str]:
        """Names of the accepted pictures, in the order of capture."""
        there = (f"{p.stem}.png" for p in (self.path / DETECTIONS).glob("frame-*.json"))
        return sorted(n for n in there if NAME.fullmatch(n) and self.picture(n).exists())

    def picture(self, name: str) -> Path:
        """The file of a picture. Raises RcdnError for a name that isn't a picture's."""
        if NAME.fullmatch(name) is None:
            raise RcdnError(f"{shown(name)} is no picture of this session")
        return self.path / PICTURES / name

    def add(self, grey: Array, board: Board) -> str:
        """Store a picture (H, W) uint8 and its board; returns its name. Both are on the disk when this returns."""
        taken = [int(m[1]) for p in (self.path / PICTURES).glob("*.png") if (m := NAME.fullmatch(p.name))]
        if len(self.names()) >= MOST or max(taken, default=0) >= 9999:
            raise RcdnError(f"there are {MOST} pictures already; remove some")
        name = f"frame-{max(taken, default=0) + 1:04d}.png"
        write_image(self.picture(name), grey)
        corners = Corners(board.xy, board.response, board.status, sigma=board.sigma)
        found = ImageResult(f"{PICTURES}/{name}", *board.image_size, corners, (board,))
        write_detections(self._detections(name), [found])
        return name

    def board(self, name: str) -> Board:
        """The stored board of a picture. Raises RcdnError if the file can't be read or contains no board."""
        images, _ = read_detections(self._detections(name))
        if len(images) != 1 or not images[0].boards:
            raise FormatError(f"{self._detections(name)}: holds no board; remove it")
        return images[0].boards[0]

    def grey(self, name: str) -> Array:
        """The picture (H, W) uint8."""
        return np.asarray(read_image(self.picture(name)))

    def remove(self, name: str) -> None:
        """Remove a picture and its detections."""
        picture = self.picture(name)
        self._detections(name).unlink(missing_ok=True)
        picture.unlink(missing_ok=True)

    def _detections(self, name: str) -> Path:
        return self.path / DETECTIONS / self.picture(name).with_suffix(".json").name


def _read(path: Path) -> dict[str, Any]:
    try:
        record = json.loads(path.read_text("utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise FormatError(f"{path}: can't be read ({error}); name another folder") from error
    if not isinstance(record, dict):
        raise FormatError(f"{path}: is no record of a session; name another folder")
    return record
