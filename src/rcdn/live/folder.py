"""The folder of a session. Pictures are stored atomically, so that a session can resume after any interruption."""

from __future__ import annotations

import json
import os
import re
import secrets
from collections.abc import Sequence
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
SIDES = ("left", "right")
NAME = re.compile(r"frame-(\d{4})\.png")
MOST_PICTURES = 200
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
    `path`: of one camera in `pictures`, of two `cameras` in `left` and `right`, those of one moment with the same name.

    A moment is part of the session if its detections exist; they are written last and removed first.
    Raises ConfigError if the folder contains other files, belongs to a session with another number of cameras, or if
    another process uses it; OutputError if it can't be written.
    """

    def __init__(self, path: Path, cameras: int = 1) -> None:
        self.path, self.cameras = path, cameras
        self._places = [(PICTURES, DETECTIONS)] if cameras == 1 else [(s, f"{DETECTIONS}/{s}") for s in SIDES]
        new = not (path / SESSION).exists()
        if new and path.exists() and (not path.is_dir() or any(path.iterdir())):
            raise ConfigError(f"{path}: holds other files; name a new or an empty folder, or one of an earlier session")
        if new:
            self._write_settings(Settings())
        elif (before := _read(path / SESSION).get("cameras", 1)) != cameras:
            fix = "one camera; leave --stereo out" if before == 1 else "two cameras; give --stereo"
            raise ConfigError(f"{path}: belongs to a session of {fix}, or name another folder")
        self._last = 0  # number of the newest picture: that of a removed one isn't used again
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
                f"{self.path}: its pictures were taken with squares of {before.spacing} m and board size "
                f"{before.size or 'unknown'}, not {now.spacing} m and {now.size or 'unknown'}; name another folder"
            )
        self._write_settings(now)
        return now

    def _write_settings(self, settings: Settings) -> None:
        record = {"version": VERSION, "spacing": settings.spacing, "model": settings.model, "size": settings.size}
        record["cameras"] = self.cameras
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
        sides = range(self.cameras)
        there = {f"{p.stem}.png" for p in (self.path / self._places[0][1]).glob("frame-*.json")}
        whole = lambda n: all(  # noqa: E731
            self._detections(n, c).exists() and self.picture(n, c).exists() for c in sides
        )
        return sorted(n for n in there if NAME.fullmatch(n) and whole(n))

    def picture(self, name: str, camera: int = 0) -> Path:
        """The file of a picture. Raises RcdnError for a name that isn't a picture's."""
        if NAME.fullmatch(name) is None:
            raise RcdnError(f"{shown(name)} is no picture of this session")
        return self.path / self._places[camera][0] / name

    def add_moment(self, greys: Sequence[Array], boards: Sequence[Board | None]) -> str:
        """Store the pictures (H, W) uint8 of one moment and their boards, None where it isn't used; returns its name.
        All are on the disk when this returns."""
        every = [p for places in self._places for p in (self.path / places[0]).glob("*.png")]
        taken = [int(m[1]) for p in every if (m := NAME.fullmatch(p.name))]
        if len(self.names()) >= MOST_PICTURES or max([self._last, *taken]) >= 9999:
            raise RcdnError(f"there are {MOST_PICTURES} pictures already; remove some")
        self._last = max([self._last, *taken]) + 1
        name = f"frame-{self._last:04d}.png"
        for camera, grey in enumerate(greys):
            write_image(self.picture(name, camera), grey)
        for camera, (grey, board) in enumerate(zip(greys, boards, strict=True)):
            found = _result(f"{self._places[camera][0]}/{name}", (grey.shape[1], grey.shape[0]), board)
            write_detections(self._detections(name, camera), [found])
        return name

    def moment(self, name: str) -> tuple[Board | None, ...]:
        """The stored board of each camera's picture, None where it isn't used. Raises RcdnError if a file can't be read
        or if there is none."""
        found = tuple(next(iter(self._stored(name, c).boards), None) for c in range(self.cameras))
        if all(board is None for board in found):
            raise FormatError(f"{self._detections(name)}: holds no board; remove it")
        return found

    def sizes(self, name: str) -> tuple[tuple[int, int], ...]:
        """(width, height) px of each camera's picture."""
        found = [self._stored(name, c) for c in range(self.cameras)]
        return tuple((f.width, f.height) for f in found)

    def _stored(self, name: str, camera: int) -> ImageResult:
        images, _ = read_detections(self._detections(name, camera))
        if len(images) != 1:
            raise FormatError(f"{self._detections(name, camera)}: holds no board; remove it")
        return images[0]

    def grey(self, name: str, camera: int = 0) -> Array:
        """The picture (H, W) uint8."""
        return np.asarray(read_image(self.picture(name, camera)))

    def remove(self, name: str) -> None:
        """Remove the pictures of a moment and their detections."""
        cameras = range(self.cameras)
        for path in [*(self._detections(name, c) for c in cameras), *(self.picture(name, c) for c in cameras)]:
            path.unlink(missing_ok=True)

    def _detections(self, name: str, camera: int = 0) -> Path:
        return self.path / self._places[camera][1] / self.picture(name).with_suffix(".json").name


def _result(path: str, image_size: tuple[int, int], board: Board | None) -> ImageResult:
    """What is stored of a picture."""
    if board is None:
        nothing = np.zeros((0, 2))
        return ImageResult(path, *image_size, Corners(nothing, nothing[:, 0], nothing[:, 0]), ())
    corners = Corners(board.xy, board.response, board.status, sigma=board.sigma)
    return ImageResult(path, *image_size, corners, (board,))


def _read(path: Path) -> dict[str, Any]:
    try:
        record = json.loads(path.read_text("utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise FormatError(f"{path}: can't be read ({error}); name another folder") from error
    if not isinstance(record, dict):
        raise FormatError(f"{path}: is no record of a session; name another folder")
    return record
